"""People alone: motions without any object, which follow the person closely, and every verb with them."""

import numpy as np
import pytest

from hoi_retarget.cli import main
from hoi_retarget.evaluation import evaluate
from hoi_retarget.readers import own_layout
from hoi_retarget.retargeting.config import WITHOUT_OBJECTS, Config, Weights
from hoi_retarget.retargeting.retarget import retarget
from hoi_retarget.retargeting.targets import make_targets
from hoi_retarget.retargeting.trajopt.trajectory_terms import trajectory_terms
from hoi_retarget.robots import load_robot
from hoi_retarget.synthetic import make
from people_writer import alone
from short_clips import cut

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
@pytest.mark.parametrize(("contact", "room"), [("landmark", 0.0), ("surface", 0.05)])
def test_a_person_alone_is_followed_closely(g1, contact, room):
    """Closer than with the weights of clips with objects, without skating, floating or more jerk."""
    inverse = {name: getattr(Weights(), name) / factor for name, factor in WITHOUT_OBJECTS.items()}
    closely, loosely = (
        retarget(WALK, g1, Config(weights=own, contact=contact)) for own in (Weights(), Weights(**inverse))
    )
    close, other = (evaluate(item, WALK, g1) for item in (closely, loosely))
    assert close["link_velocity_direction_deg"] < 0.8 * other["link_velocity_direction_deg"]
    # In surface contact anchored feet are flat with either: the legs then differ by hundredths of a degree.
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
