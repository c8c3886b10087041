"""Objects on objects: which one carries which, and that they stay together at all sizes."""

from dataclasses import replace
from itertools import pairwise
from typing import get_args

import numpy as np
import pytest

from hoi_retarget import evaluate
from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.supports import supports
from hoi_retarget.motion.motion import Motion
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from hoi_retarget.retargeting.config import Config, ContactKind, Scaling
from hoi_retarget.retargeting.solve import solve
from hoi_retarget.retargeting.targets import Targets, make_targets
from hoi_retarget.robots.model import RobotModel
from synthetic import make
from synthetic.walking import minimum_jerk
from trajectories import MODELS

FRAMES, FPS = 151, 30.0
TIMES = np.arange(FRAMES) / FPS
TABLE, SHELF, MUG = (0.5, 0.3, 0.36), (0.2, 0.2, 0.55), (0.04, 0.04, 0.05)  # Half sizes [m].
CLOSE = 1e-4  # [m]
every_robot = pytest.mark.parametrize("model", MODELS.values(), ids=list(MODELS))
every_contact = pytest.mark.parametrize("contact", get_args(ContactKind))
every_size = pytest.mark.parametrize("size", [1.0, 0.5, 1.5, "auto"])


def block(name: str, half: tuple[float, float, float], bottom: np.ndarray) -> ObjectTrack:
    """Return a box that does not turn, by the path of the middle of its bottom."""
    corners = np.array(half) * np.array(np.meshgrid([-1, 1], [-1, 1], [0, 2])).reshape(3, -1).T
    places = np.broadcast_to(bottom, (FRAMES, 3))
    return ObjectTrack(name, places, np.tile(se3.IDENTITY_QUAT, (FRAMES, 1)), ObjectGeometry(corners))


def stack(*objects: ObjectTrack) -> Clip:
    """Return a clip of somebody with these objects."""
    clip = make("carry_box", seconds=(FRAMES - 1) / FPS)
    assert clip.frames == FRAMES
    return replace(clip, objects=objects, contacts=())


def table() -> ObjectTrack:
    return block("table", TABLE, np.array([1.0, 0.5, 0.0]))


def shelf() -> ObjectTrack:
    return block("shelf", SHELF, np.array([-0.4, 1.5, 0.0]))


def carried_mug() -> ObjectTrack:
    """Return a mug that is taken from the table at 1 s, held 30 cm higher, and put on the shelf until 4 s."""
    start, end = np.array([0.7, 0.4, 2 * TABLE[2]]), np.array([-0.4, 1.4, 2 * SHELF[2]])
    raised = 0.3 * (minimum_jerk(TIMES, 1.0, 2.0) - minimum_jerk(TIMES, 3.0, 4.0))
    return block(
        "mug", MUG, start + minimum_jerk(TIMES, 1.4, 3.6)[:, None] * (end - start) + raised[:, None] * [0, 0, 1]
    )


def over(targets: Targets, rider: int, carrier: int) -> np.ndarray:
    """Return the place of a rider over a carrier on the robot's side."""
    return targets.object_pos[:, rider] - targets.object_pos[:, carrier]


def targets_of(clip: Clip, model: RobotModel, size: float | str, contact: ContactKind) -> Targets:
    return make_targets(clip, model, Scaling(object_scale=size), contact=contact)  # pyright: ignore[reportArgumentType]  # "auto"


@every_robot
@every_contact
@every_size
def test_a_mug_stays_on_its_table_and_the_table_where_it_is_alone(model, contact, size):
    mug = block("mug", MUG, np.array([0.7, 0.4, 2 * TABLE[2]]))
    targets = targets_of(stack(mug, table()), model, size, contact)
    expected = targets.object_scale[0] * np.array([-0.3, -0.1, 2 * TABLE[2]])
    assert np.abs(over(targets, 0, 1) - expected).max() < CLOSE
    alone = targets_of(stack(table()), model, size, contact)
    assert (alone.object_pos[:, 0] == targets.object_pos[:, 1]).all()


@every_robot
@every_contact
@every_size
def test_a_lid_stays_on_a_box_that_is_carried(model, contact, size):
    clip = make("carry_box", seconds=(FRAMES - 1) / FPS)
    box = clip.objects[0]
    top = box.geometry.points[:, 2].max()
    thin = np.ptp(box.geometry.points, axis=0) * [0.5, 0.5, 0.0] + [0.0, 0.0, 0.01]
    lid = replace(
        block("lid", tuple(thin), np.zeros(3)), positions=box.positions + np.array([0.0, 0.0, top]), quats=box.quats
    )
    targets = targets_of(replace(clip, objects=(box, lid), contacts=()), model, size, contact)
    assert np.abs(over(targets, 1, 0) - targets.object_scale[0] * np.array([0.0, 0.0, top])).max() < CLOSE


@every_robot
@every_contact
@every_size
def test_a_mug_that_is_carried_to_another_table_stands_on_both_and_never_jumps(model, contact, size):
    clip = stack(table(), shelf(), carried_mug())
    targets = targets_of(clip, model, size, contact)
    scale = targets.object_scale[0]
    for carrier, rests in ((0, TIMES < 0.8), (1, TIMES > 4.2)):
        expected = scale * (clip.objects[2].positions - clip.objects[carrier].positions)
        assert np.abs(over(targets, 2, carrier) - expected)[rests].max() < CLOSE
    path = targets.object_pos[:, 2]
    # It is over the table or the shelf while the human's is, and as smooth as that but for its size.
    for carrier, there in ((0, TIMES < 1.4), (1, TIMES > 3.6)):
        height = over(targets, 2, carrier)[there, 2] - scale * 2 * (TABLE, SHELF)[carrier][2]
        assert height.min() > -1.1e-3
    largest = max(scale, targets.root_scale)
    for order, factor in ((2, 1.2), (3, 3.0)):
        own, human = (np.abs(np.diff(side, n=order, axis=0)).max() for side in (path, clip.objects[2].positions))
        assert own < factor * largest * human


@every_robot
def test_a_mug_that_is_lifted_from_its_table_and_put_back_never_sinks_into_it(model):
    lifted = 0.1 * (minimum_jerk(TIMES, 1.0, 2.0) - minimum_jerk(TIMES, 3.0, 4.0))
    mug = block("mug", MUG, np.array([0.7, 0.4, 2 * TABLE[2]]) + lifted[:, None] * [0, 0, 1])
    targets = targets_of(stack(table(), mug), model, 1.0, "landmark")
    height = over(targets, 1, 0)[:, 2] - 2 * TABLE[2]
    assert height.min() > -1.1e-3
    assert height.max() == pytest.approx(targets.root_scale * 0.1, abs=6e-3)  # The first 15 mm are the object's.


@every_robot
def test_the_order_of_objects_changes_nothing(model):
    objects = (table(), shelf(), carried_mug())
    given = targets_of(stack(*objects), model, 1.0, "surface").object_pos
    other = targets_of(stack(*objects[::-1]), model, 1.0, "surface").object_pos
    assert (given == other[:, ::-1]).all()


# Who carries whom


def carriers(*objects: ObjectTrack) -> list[list[str]]:
    """Return the names of an object's carriers, one after the other, for every object."""
    found = supports(objects, FPS).carriers
    names = [*(track.name for track in objects), "-"]
    return [[names[own[0]], *(names[b] for a, b in pairwise(own) if a != b)] for own in found.T]


def test_a_carried_mug_changes_its_carrier():
    assert carriers(carried_mug(), table(), shelf()) == [["table", "-", "shelf"], ["-"], ["-"]]


def test_what_stands_beside_on_the_floor_is_not_carried():
    assert carriers(table(), block("box", MUG, np.array([1.0 + TABLE[0] + MUG[0] + 0.002, 0.5, 0.0]))) == [["-"], ["-"]]


def test_what_hangs_from_a_stand_is_carried_by_it():
    bag = block("bag", MUG, np.array([0.7, 0.4, 0.5]))
    stand = block("stand", (0.1, 0.1, 0.01), np.array([0.7, 0.4, 0.605]))
    assert carriers(bag, replace(stand, positions=stand.positions + 1e-4)) == [["-"], ["bag"]]
    swung = replace(bag, positions=bag.positions + 0.05 * np.sin(TIMES)[:, None] * [1.0, 0.0, 0.0])
    assert carriers(swung, stand) == [["stand"], ["-"]]


def test_parts_that_move_as_one_belong_together_though_they_do_not_touch():
    away = np.outer(minimum_jerk(TIMES, 1.0, 4.0), [2.0, 0.0, 0.0])
    base = block("base", TABLE, away)
    lid = block("lid", MUG, away + np.array([0.0, 0.0, 2 * TABLE[2] + 0.05]))
    own = carriers(base, lid)
    assert own[0] == ["-"]
    assert own[1] == ["-", "base", "-"]


@pytest.fixture(scope="module")
def motion_on_table() -> tuple[Motion, Clip]:
    clip = stack(table(), block("mug", MUG, np.array([0.7, 0.4, 2 * TABLE[2]])))
    clip = replace(clip, people=tuple(replace(p, joint_positions=p.joint_positions - [0, 2, 0]) for p in clip.people))
    return solve(clip, MODELS["unitree_g1"], Config(contact="landmark")).motion, clip


@pytest.mark.parametrize("lifted", [0.0, 0.007, -0.05])
def test_the_figure_is_the_change_of_height_over_the_carrier(motion_on_table: tuple[Motion, Clip], lifted: float):
    motion, clip = motion_on_table
    places = motion.object_pos.copy()
    places[20, 1, 2] += lifted
    places[:, :, 2] += 0.1  # All together.
    figures = evaluate(replace(motion, object_pos=places), clip, MODELS["unitree_g1"], figures="fast")
    assert figures["support_height_error_m"] == pytest.approx(abs(lifted), abs=CLOSE)
    alone = {name: getattr(motion, name)[:, :1] for name in ("object_pos", "object_quat")}
    single = replace(motion, object_names=("table",), object_scale=motion.object_scale[:1], **alone)
    without = evaluate(single, replace(clip, objects=clip.objects[:1]), MODELS["unitree_g1"], figures="fast")
    assert without["support_height_error_m"] is None
