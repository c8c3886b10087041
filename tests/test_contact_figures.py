"""Figures of touch and penetration: what must not make them better, and stretches of sunk links."""

from dataclasses import replace

import numpy as np
import pytest

from hoi_retarget.clip.clip import Clip
from hoi_retarget.evaluation import Comparison, evaluate, penetration, sunk_links
from hoi_retarget.evaluation.contact_figures import SurfaceCurves
from hoi_retarget.motion.motion import Motion, Stage
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.retarget import retarget
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


def test_a_sunk_link_has_its_first_and_last_frame(carried, monkeypatch):
    clip, motion = carried
    view = Comparison(motion, clip, 0, G1.forward(motion.qpos))
    links, (name,) = ("left_wrist_yaw_link", "pelvis"), motion.object_names
    depth = np.zeros((1, 2, clip.frames - view.first))
    depth[0, 0, 4:7] = 0.006, 0.021, 0.006
    depth[0, 0, 10:12] = 0.02  # Too short.
    depth[0, 1, :5] = 0.005  # Not deep enough.
    depth[0, 1, -3:] = 0.0051
    monkeypatch.setattr(penetration, "surface_curves", lambda _: SurfaceCurves(links, depth, ()))
    wrist, pelvis = sunk_links(view)
    assert view.first == 1
    assert (wrist.subject, wrist.object, wrist.first_frame, wrist.last_frame) == (links[0], name, 5, 7)
    assert (pelvis.subject, pelvis.first_frame, pelvis.last_frame) == (links[1], clip.frames - 3, clip.frames - 1)
    assert (wrist.value, pelvis.value) == (0.021, 0.0051)
    assert str(wrist).startswith(f"left_wrist_yaw_link is up to 21 mm inside {name!r}, frames 5 to 7: ")


def test_a_sunk_hand_is_as_deep_as_the_persons_own(carried, monkeypatch):
    clip, motion = carried
    view = Comparison(motion, clip, 0, G1.forward(motion.qpos))
    (track,) = [item for item in clip.contacts if item.part == "left_hand"]
    frame = int(np.flatnonzero(track.active)[5])
    points = track.contact_points.copy()
    surface = surface_of(clip.objects[0].geometry)
    inside = np.random.default_rng(0).uniform(*np.quantile(surface.vertices, (0, 1), axis=0), size=(3000, 3))
    points[frame] = inside[surface.signed_distances(inside).argmin()]
    moved_in = replace(clip, contacts=(replace(track, contact_points=points),))
    depth = np.zeros((1, 1, clip.frames - view.first))
    depth[0, 0, frame - view.first - 2 : frame - view.first + 1] = 0.02
    monkeypatch.setattr(penetration, "surface_curves", lambda _: SurfaceCurves(("left_wrist_yaw_link",), depth, ()))
    (by_person,), (by_robot,) = (sunk_links(Comparison(motion, made, 0, view.kinematics)) for made in (moved_in, clip))
    own = -float(surface.signed_distances(points[frame : frame + 1])[0]) * float(motion.object_scale[0])
    assert by_person.last_frame == frame and own > 0.005
    assert by_person.reason == f"the human's own part is up to {1e3 * own:.0f} mm inside it there"
    assert by_robot.reason == "no pose near by keeps the contacts and is free of it"
