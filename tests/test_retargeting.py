"""People who sit, kneel and lie, and people without objects: the robot follows them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hoi_retarget.cli import main
from hoi_retarget.evaluation import evaluate
from hoi_retarget.human.person import stance
from hoi_retarget.numerics import se3
from hoi_retarget.readers import own_layout
from hoi_retarget.retargeting.config import WITHOUT_OBJECTS, Config, Scaling, Weights
from hoi_retarget.retargeting.ik import MIN_LIFT_M, raised_above_floor
from hoi_retarget.retargeting.orientation_flips import MAX_TRUNK_TURN_DEG, trunk_errors_deg, trunk_turns
from hoi_retarget.retargeting.retarget import judge, retarget
from hoi_retarget.retargeting.solve import solve
from hoi_retarget.retargeting.targets import make_targets
from hoi_retarget.retargeting.trajopt.trajectory_terms import trajectory_terms
from hoi_retarget.robots import load_robot
from hoi_retarget.robots.skin import link_heights, skin_of
from people_writer import alone
from posed_people import POSTURES, posed
from short_clips import cut
from synthetic import make
from trajectories import MODELS

LYING_FEET = ("legs stretched", "kneeling", "on the back", "on the front", "on the side")


@pytest.mark.slow
@pytest.mark.parametrize("robot", list(MODELS))
@pytest.mark.parametrize("posture", list(POSTURES))
def test_the_trunk_follows_in_every_posture(posture, robot):
    clip, model = posed(posture, heading=0.7), MODELS[robot]
    solution = solve(clip, model)
    motion, targets = judge(solution), solution.targets
    assert motion.converged
    assert trunk_errors_deg(model.forward(motion.qpos), targets).max() < 20.0
    assert motion.report.trunk_turns == ()
    assert motion.report.figures["link_below_floor_m"] < 0.01


@pytest.mark.parametrize("robot", list(MODELS))
def test_a_reference_in_the_floor_is_lifted_and_no_other(robot):
    model = MODELS[robot]
    targets = make_targets(posed("standing"), model, Scaling())
    standing = np.tile(model.home_qpos, (targets.frames, 1))
    assert raised_above_floor(model, targets, standing) is standing
    sunk = standing.copy()
    sunk[31:34, 2] -= 0.3
    above = raised_above_floor(model, targets, sunk)
    np.testing.assert_array_equal(np.delete(above, 2, axis=1), np.delete(sunk, 2, axis=1))
    ends = {model.site_bodies[model.sites.index[site]] for site in targets.contact_links}
    inner = [skin.link not in ends for skin in skin_of(model).links]
    assert link_heights(model.forward(above))[inner].min() > -MIN_LIFT_M - 1e-9
    lift = above[:, 2] - sunk[:, 2]
    assert lift.min() >= 0.0 and lift[:5].max() == 0.0 and np.abs(np.diff(lift)).max() < 0.2 * lift.max()


@given(st.sampled_from(list(POSTURES)), st.floats(-np.pi, np.pi))
@settings(max_examples=20, deadline=None)
def test_only_feet_with_the_sole_underneath_stand(posture, heading):
    flags = stance(posed(posture, heading=heading).people[0], 30.0)
    assert flags.any() == (posture not in LYING_FEET)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_trunk_turned_over_is_an_error_with_its_frames(axis):
    """A robot that follows the person, turned about its own base in some frames."""
    model, clip = MODELS["unitree_g1"], posed("standing")
    qpos = np.tile(model.home_qpos, (clip.frames, 1))
    targets = make_targets(clip, model, Scaling())
    before = trunk_errors_deg(model.forward(qpos), targets)
    heading = se3.exp(np.array([0.0, 0.0, np.pi / 2]))  # The posed person looks along -y.
    qpos[:, 3:7] = se3.quat_multiply(se3.quat_conjugate(heading), qpos[:, 3:7])
    assert before.max() > MAX_TRUNK_TURN_DEG and trunk_turns(model.forward(qpos), targets) == ()
    vector = np.zeros(3)
    vector[axis] = np.radians(80.0)
    qpos[10:15, 3:7] = se3.quat_multiply(qpos[10:15, 3:7], se3.exp(vector))
    (found,) = trunk_turns(model.forward(qpos), targets)
    assert (found.first_frame, found.last_frame) == (10, 14)
    assert found.value == pytest.approx(80.0, abs=10.0)


WALK = cut(alone("carry_box"), 120)
OF_OBJECTS = ("contact_gap_m", "relative_hand_rotation_deg", "object_path_error_m", "object_below_floor_m")


@pytest.fixture(scope="module")
def g1():
    return load_robot("unitree_g1")


@pytest.fixture(scope="module")
def motion(g1):
    return retarget(WALK, g1)


def weights_of(clip, model, weights):
    """Each term's name -> the weights of its rows."""
    targets = make_targets(clip, model, Config().scaling)
    standing = model.forward(np.tile(model.home_qpos, (clip.frames, 1)))
    terms = trajectory_terms(weights, targets, standing)
    return {term.name: getattr(term, "weight", None) for term in terms}


@pytest.mark.parametrize("name", Weights.__dataclass_fields__)
def test_weights_are_larger_without_objects_and_the_same_with_them(name):
    weights = Weights()
    assert getattr(weights.without_objects, name) == WITHOUT_OBJECTS.get(name, 1.0) * getattr(weights, name)


def test_tracking_counts_more_only_where_there_is_no_object(g1):
    clip = make("carry_box", seconds=1.0)
    person = cut(alone("carry_box"), clip.frames)
    for weights in (Weights(), Weights(base_position=2.0, joint_position=3.0)):
        with_box, close = weights_of(clip, g1, weights), weights_of(person, g1, weights)
        assert with_box["base_position"] == weights.base_position
        assert close["base_position"] == WITHOUT_OBJECTS["base_position"] * weights.base_position
        assert close["joint_position"] == WITHOUT_OBJECTS["joint_position"] * with_box["joint_position"]


@pytest.mark.slow
@pytest.mark.parametrize(("contact", "room"), [("landmark", 0.0), ("surface", 0.1)])
def test_a_person_alone_is_followed_closely(g1, contact, room):
    """Closer than with the weights of clips with objects, without skating, floating or more jerk."""
    inverse = {name: getattr(Weights(), name) / factor for name, factor in WITHOUT_OBJECTS.items()}
    closely, loosely = (
        retarget(WALK, g1, Config(weights=own, contact=contact)) for own in (Weights(), Weights(**inverse))
    )
    close, other = (evaluate(item, WALK, g1) for item in (closely, loosely))
    assert close["link_velocity_direction_deg"] < 0.8 * other["link_velocity_direction_deg"]
    # In surface contact anchored feet are flat with either: legs and trunk differ by less than a tenth of a degree.
    assert close["body_pose_deviation_deg"] <= other["body_pose_deviation_deg"] + room
    assert close["body_jerk_mps3"] < 1.1 * other["body_jerk_mps3"]
    assert close["stance_slide_mps"] < 0.03 and close["stance_sole_height_abs_m"] < 0.002
    steps = np.abs(np.diff(closely.qpos[:, 7:], axis=0)).max(axis=1)
    assert steps[0] <= steps[1:].max(), "no jump out of the first frame"


def test_figures_of_objects_are_not_there(motion, g1):
    figures = evaluate(motion, WALK, g1)
    assert all(figures[name] is None for name in OF_OBJECTS)
    assert figures["link_velocity_direction_deg"] is not None
    assert motion.object_names == () and not motion.contact_flags.any()


def test_every_verb_takes_a_person_alone(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    own_layout.write(cut(WALK, 30), tmp_path / "walk.npz")
    for line in (
        "inspect walk.npz",
        "run walk.npz --out out",
        "evaluate out/walk.npz --json figures.json",
        "contacts walk.npz",
        "convert walk.npz --out again.npz",
        "report out --out page",
        "share out/walk.npz --out gallery",
        "check-motion out/walk.npz",
        *(f"export out/walk.npz --to {name} --out exported" for name in ("beyondmimic", "holosoma", "gmr", "hdmi")),
    ):
        assert main(line.split()) == 0, line
    said = capsys.readouterr().out
    assert "Nothing is touched." in said
    assert '"contact_gap_m": null' in (tmp_path / "figures.json").read_text()
