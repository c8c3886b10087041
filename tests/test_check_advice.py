"""Advice of the checker mends what it is given for: faults are planted, named, the advice followed, the motion back."""

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

import motion_writers as writers
from hoi_retarget.motion.check import CheckedMotion, check, mended
from hoi_retarget.motion.formats import MotionFile, read
from hoi_retarget.numerics import se3
from planted_faults import FAULTS

SHARED = Path(__file__).resolve().parents[1].parent / "shared" / "data"
FOLDERS = [SHARED / "exports", SHARED / "foreign" / "motions"]
TRUE_FAULTS = {
    "Side_kick.pkl": {"jump"},  # The root's rotation, into frame 148.
    "squat.pkl": {"root layout"},  # Quaternions that were interpolated, and are 2 % short.
    "walk_stand.pkl": {"root layout"},
    "output_walk.csv": {"quaternion order"},  # MuJoCo's, in a table like Unitree's.
    # Of the root rotated once too often, and 2.14 times those of its poses: the others follow.
    "holosoma_wbt_with_object.npz": {"angular velocities of bodies"},
    "push_box-VID_20250423_220958-light-high-adjust_root_height": {"angular velocities of bodies"},
}
ONLY_NAMED = {
    # Nothing but other columns helps.
    "shuffled": "the columns are in no order that is known",
}
EXACT = 1e-6
LOOSE = {"raised": 0.06, "doubled frames": 0.05}
"""Of positions [m] and angles [rad]: where the soles were within the floor's tolerance, and frames between others."""


def causes(checked: CheckedMotion) -> set[str]:
    return {item.subject for item in checked.contradictions if not item.follows}


def told(checked: CheckedMotion) -> str:
    return "\n".join(f"{item.level} {item.subject}: {item.numbers}" for item in checked.findings)


def followed(file: MotionFile, checked: CheckedMotion, usual: set[str]) -> CheckedMotion:
    """Return what is found when advice is followed until none is left, or nothing but what was there before."""
    for _ in range(3):
        if not causes(checked) - usual:
            break
        file = mended(file, checked)
        checked = check(file, writers.model())
    return checked


def assert_same_motion(found: CheckedMotion, good: CheckedMotion, most: float) -> None:
    assert found.qpos is not None and good.qpos is not None
    apart = np.abs(np.delete(found.qpos - good.qpos, [3, 4, 5, 6], axis=1))
    assert apart.max() < most
    assert se3.angle_between(found.qpos[:, 3:7], good.qpos[:, 3:7]).max() < most
    for path, before in zip(found.objects, good.objects, strict=True):
        assert np.abs(path.pos - before.pos).max() < most


def assert_named_and_mended(file: MotionFile, name: str) -> None:
    """Plant a fault, look for its name, follow the advice, and compare with the good file."""
    good, fault = check(file, writers.model()), FAULTS[name]
    spoilt = fault.plant(file, writers.model())
    if spoilt is None:
        return
    checked = check(spoilt, writers.model())
    named = [item for item in checked.contradictions if item.subject in fault.subjects and fault.words in item.numbers]
    hidden = [
        item
        for item in checked.findings
        if item.level == "unknown" and any(word in item.numbers for word in fault.hidden)
    ]
    assert named or hidden, told(checked)
    if not named:
        return
    if not any(item.mend for item in named):
        assert ONLY_NAMED[name] in named[0].numbers
        return
    mended_file = followed(spoilt, checked, causes(good))
    assert causes(mended_file) <= causes(good), told(mended_file)
    assert_same_motion(mended_file, good, LOOSE.get(name, EXACT))


@cache
def good_file(name: str, scene: str = "carry_box") -> MotionFile:
    with TemporaryDirectory() as folder:
        content = writers.MAKERS[name](writers.motion(scene))
        return read(writers.save(name, content, Path(folder)))


# Written here


SLOWER = [pytest.param(name, marks=pytest.mark.slow) for name in ("sbto", "holosoma-wbt", "omniretarget", "mjlab")]


@pytest.mark.parametrize("name", ["gmr", "hdmi", *SLOWER])
@pytest.mark.parametrize("fault", FAULTS)
def test_advice_mends_what_is_planted(fault, name):
    assert_named_and_mended(good_file(name), fault)


# Other people's files


@pytest.mark.slow
@pytest.mark.skipif(not FOLDERS[1].is_dir(), reason="no files of other programs here")
def test_nothing_but_true_faults_is_said_of_other_peoples_files():
    files = [path for folder in FOLDERS for end in ("npz", "pkl", "csv", "motion") for path in folder.rglob(f"*.{end}")]
    assert len(files) > 15
    for path in files:
        name = path.parent.name if path.name == "motion.npz" else path.name
        checked = check(read(path), writers.model())
        assert causes(checked) == TRUE_FAULTS.get(name, set()), f"{name}: {told(checked)}"
