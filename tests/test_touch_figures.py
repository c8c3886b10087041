"""Figures of touch and penetration: what must not make them better."""

from dataclasses import replace

import numpy as np
import pytest

from hoi_retarget.clip.clip import Clip
from hoi_retarget.evaluation import evaluate
from hoi_retarget.motion.motion import Motion, Stage
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.pipeline import retarget
from hoi_retarget.robots import load_robot
from hoi_retarget.synthetic import make

G1 = load_robot("unitree_g1")
OF_SURFACES = ("touch_share", "touch_gap_p95_m", "touch_place_m", "penetration_mean_m", "penetration_p95_m")


@pytest.fixture(scope="module")
def carried() -> tuple[Clip, Motion]:
    clip = make("push_table")
    return clip, retarget(clip, G1, Config(contact="landmark"))


def moved(motion: Motion, way: np.ndarray) -> Motion:
    qpos = motion.qpos.copy()
    qpos[:, :3] += way
    return replace(motion, stages=(Stage("moved", qpos),))


def test_dropping_contacts_does_not_help(carried):
    clip, motion = carried
    none = replace(motion, contact_flags=np.zeros_like(motion.contact_flags))
    before, after = evaluate(motion, clip, G1), evaluate(none, clip, G1)
    assert all(before[name] == after[name] is not None for name in OF_SURFACES)


def test_neither_hovering_nor_lifting_pays(carried):
    clip, motion = carried
    before, lifted = evaluate(motion, clip, G1), evaluate(moved(motion, np.array([0.0, 0.0, 0.5])), clip, G1)
    assert lifted["stance_float_m"] == pytest.approx(0.5, abs=0.01)
    assert lifted["link_below_floor_m"] == 0.0
    assert lifted["touch_share"] == 0.0
    assert lifted["touch_gap_p95_m"] > before["touch_gap_p95_m"]
    sunk = evaluate(moved(motion, np.array([0.0, 0.0, -0.1])), clip, G1)
    assert sunk["link_below_floor_m"] == pytest.approx(before["link_below_floor_m"] + 0.1, abs=1e-9)


def test_walking_through_the_object_shows_in_every_figure_of_depth(carried):
    clip, motion = carried
    ahead = motion.object_pos[:, 0] - motion.qpos[:, :3]
    through = evaluate(moved(motion, ahead * [1.0, 1.0, 0.0]), clip, G1)
    assert through["penetration_max_m"] > 0.02
    assert through["penetration_mean_m"] > 0.01
