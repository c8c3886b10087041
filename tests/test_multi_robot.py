"""Two people's robots in one world: the same object, frames in step, and hands where they should be from each other."""

from dataclasses import replace

import numpy as np
import pytest

from hoi_retarget.cli import main
from hoi_retarget.errors import ArgumentError
from hoi_retarget.evaluation import inter_robot_hand_errors
from hoi_retarget.motion.result_file import load
from hoi_retarget.retargeting.config import Config, Scaling
from hoi_retarget.retargeting.retarget import retarget_people
from hoi_retarget.retargeting.targets import make_targets, shared_scalings
from hoi_retarget.robots import team
from synthetic import make
from trajectories import MODELS

G1, H2 = MODELS["unitree_g1"], MODELS["unitree_h2"]
CLIP = make("carry_table")


@pytest.fixture(scope="module")
def mixed():
    return retarget_people(CLIP, [G1, H2], Config(contact="landmark"))


def test_robots_of_one_kind_are_scaled_as_each_alone():
    assert shared_scalings(CLIP, [G1, G1], Scaling()) == (Scaling(), Scaling())


@pytest.mark.parametrize("asked", [Scaling(), Scaling(root_scale=0.9), Scaling(object_scale=1.2, size_multiplier=0.5)])
def test_different_robots_share_root_scale_and_objects_but_not_their_size(asked):
    scalings = shared_scalings(CLIP, [G1, H2], asked)
    targets = [
        make_targets(CLIP, model, scaling, person=person)
        for person, (model, scaling) in enumerate(zip([G1, H2], scalings, strict=True))
    ]
    for name in ("root_scale", "object_scale", "object_pos", "object_quat"):
        np.testing.assert_array_equal(getattr(targets[0], name), getattr(targets[1], name))
    if asked.root_scale != "auto":
        assert targets[0].root_scale == asked.root_scale
    if asked.object_scale != "auto":
        np.testing.assert_allclose(targets[0].object_scale, asked.object_scale * asked.size_multiplier)
    heights = [float(np.ptp(target.site_positions[0, :, 2])) for target in targets]
    statures = [model.spec.stature for model in (G1, H2)]
    people = [person.height for person in CLIP.people]
    assert heights[1] / heights[0] == pytest.approx(statures[1] / statures[0] * people[1] / people[0], rel=0.15)


def test_a_body_of_another_size_goes_where_the_root_scale_puts_it():
    """Feet and pelvis are above the same places of the floor, however large the body."""
    pelvis = [row.human_joint for row in G1.spec.ik].index("pelvis")
    places = [
        make_targets(CLIP, G1, Scaling(root_scale=0.9, body_scale=body)).site_positions[:, pelvis, :2]
        for body in (0.8, 1.0)
    ]
    np.testing.assert_allclose(places[0], 0.9 * CLIP.people[0].position("pelvis")[:, :2], atol=1e-12)
    np.testing.assert_allclose(places[1], places[0], atol=1e-12)
    with pytest.raises(ArgumentError, match="body-scale is -1"):
        Scaling(body_scale=-1.0)


def test_two_kinds_of_robots_carry_one_table(mixed):
    assert [motion.robot for motion in mixed] == ["unitree_g1", "unitree_h2"]
    np.testing.assert_array_equal(mixed[0].object_pos, mixed[1].object_pos)
    assert mixed[0].frames == mixed[1].frames == CLIP.frames and mixed[0].fps == mixed[1].fps
    for motion in mixed:
        assert motion.report.figures["contact_gap_m"] < 0.005
        assert motion.report.inter_robot_hand_errors == mixed[0].report.inter_robot_hand_errors
    assert max(pair.max_m for pair in inter_robot_hand_errors(mixed, [G1, H2])) < 0.01


def test_hands_that_wander_are_seen_from_each_other(mixed):
    """One robot's table sways by 3 cm and its hands wander so; shifted for good, or both alike, nothing wanders."""
    before = inter_robot_hand_errors(mixed, [G1, H2])
    shift, sway = np.array([0.0, 0.03, 0.0]), (-1.0) ** np.arange(CLIP.frames)
    for moved, expected in ((shift, 0.0), (sway[:, None, None] * shift, 0.03)):
        one = replace(mixed[1], object_pos=mixed[1].object_pos + moved)
        for pair, was in zip(inter_robot_hand_errors([mixed[0], one], [G1, H2]), before, strict=True):
            assert abs(pair.mean_m - expected) <= was.max_m + 1e-3
    targets = [motion.contact_points + shift for motion in mixed]
    both = [replace(motion, contact_points=target) for motion, target in zip(mixed, targets, strict=True)]
    for pair, was in zip(inter_robot_hand_errors(both, [G1, H2]), before, strict=True):
        assert pair.mean_m == pytest.approx(was.mean_m, abs=1e-12)
    assert inter_robot_hand_errors(mixed[:1], [G1]) == ()


def test_numbers_of_robots_and_people_must_agree(tmp_path, capsys):
    assert [spec.name for spec in team("unitree_g1, unitree_h2")] == ["unitree_g1", "unitree_h2"]
    with pytest.raises(ArgumentError, match="3 robots are named for the 2 people"):
        retarget_people(CLIP, [G1, H2, G1], Config(contact="landmark"))
    words = ["--robot", "unitree_g1,unitree_h2", "--out", str(tmp_path)]
    assert main(["run", "builtin:carry_box", *words]) == 2
    assert "2 robots are named for the 1 person" in capsys.readouterr().err
    assert main(["run", "builtin:carry_table", "--contact", "landmark", *words]) == 0
    assert "hands of different people on table:" in capsys.readouterr().out
    assert [load(path).robot for path in sorted(tmp_path.glob("*.npz"))] == ["unitree_g1", "unitree_h2"]
