"""Laws of two free hands on springs: firm holds keep an object, others lose it, and bodies do not count."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from hoi_retarget.cli import main
from hoi_retarget.dynamics.free_hands import KEPT_M, KeptObject, kept_objects
from hoi_retarget.dynamics.physics_settings import Physics
from hoi_retarget.motion import result_file
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.retarget import retarget
from synthetic import make
from trajectories import MODELS

CLIP = make("carry_box", seconds=5.0)
PHYSICS = Physics(object_mass=1.0)


@cache
def carried(robot="unitree_g1"):
    return retarget(CLIP, MODELS[robot], Config())


def kept(motion, physics=PHYSICS):
    (found,) = kept_objects(motion, CLIP, MODELS[motion.robot], physics)
    return found


@pytest.mark.parametrize("robot", ["unitree_g1", pytest.param("unitree_h2", marks=pytest.mark.slow)])
def test_two_hands_keep_a_box_between_them(robot):
    found = kept(carried(robot))
    assert found.kept_share == 1.0 and found.lost_after is None and found.off_m < 0.04
    assert str(found).startswith("two free hands keep the box: ")


def test_slippery_hands_lose_it_when_it_is_lifted():
    motion = carried()
    found = kept(motion, replace(PHYSICS, hand_friction=0.02))
    lifted = int((motion.object_pos[:, 0, 2] > motion.object_pos[0, 0, 2] + 0.01).argmax()) / motion.fps
    assert found.kept_share < 0.9 and found.off_m > KEPT_M and found.lost_after > lifted
    assert f"lose the box at {found.lost_after:.1f} s" in str(found)


def test_a_box_that_is_out_of_the_hands_stays_where_it_is():
    """Labels alone hold nothing: the robot walks a metre beside the box."""
    beside = carried().with_qpos(carried().qpos + np.eye(carried().qpos.shape[1])[1])
    found = kept(beside)
    path = beside.object_pos[:, 0]
    assert found.off_m == pytest.approx(
        np.linalg.norm(path - path[0], axis=1)[beside.contact_flags.any(1)].mean(), abs=0.02
    )


def test_the_body_does_not_count():
    """Legs that are elsewhere change nothing, beside the rounding of a simulation."""
    motion, model = carried(), MODELS["unitree_g1"]
    legs = [7 + index for index, name in enumerate(model.joint_names) if "knee" in name or "ankle" in name]
    qpos = motion.qpos.copy()
    qpos[:, legs] *= 0.9
    assert kept(motion.with_qpos(qpos)).off_m == pytest.approx(kept(motion).off_m, abs=0.005)


def test_what_somebody_else_holds_too_is_not_tested():
    clip, model = make("carry_table", seconds=2.0), MODELS["unitree_g1"]
    motion = retarget(clip, model, Config(contact="landmark"))
    assert motion.contact_flags.any() and kept_objects(motion, clip, model, PHYSICS) == ()
    alone = replace(clip, contacts=tuple(track for track in clip.contacts if track.person == motion.person))
    assert len(kept_objects(motion, alone, model, PHYSICS)) == 1


def test_an_object_that_is_near_most_of_the_time_is_kept():
    near = KeptObject("box", "a box", 0.02, 3.0, kept_share=0.96, lost_after=1.25)
    assert "keep the box: 2.0 cm and 3 degrees off on average, as a box" in str(near)
    assert "lose the box at 1.2 s" in str(replace(near, kept_share=0.94))


def test_the_command_tells_what_two_free_hands_keep(tmp_path, capsys):
    motion = retarget(make("carry_box"), MODELS["unitree_g1"], Config(contact="landmark"))
    result_file.save(motion, tmp_path / "box.npz")
    words = ["feasible", str(tmp_path / "box.npz"), "--clip", "builtin:carry_box", "--object-mass", "1"]
    assert main([*words, "--hands", "--json", str(tmp_path / "found.json")]) == 0
    (facts,) = json.loads((tmp_path / "found.json").read_text())
    (found,) = facts["two_free_hands"]
    assert str(KeptObject(**found)) in capsys.readouterr().out
    assert main(words) == 0 and "free hands" not in capsys.readouterr().out
