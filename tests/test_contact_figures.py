"""Figures of touch, slip and penetration: known hands beside a box, and what must not make figures better."""

import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pytest
import scipy
import trimesh

from hoi_retarget.clip.augment import mirrored
from hoi_retarget.clip.clip import Clip, ContactTrack
from hoi_retarget.clip.edits import ContactEdits, Move, apply
from hoi_retarget.evaluation import (
    FIGURES,
    Comparison,
    evaluate,
    inter_robot_hand_errors,
    penetration,
    sunk_links,
    surface_residuals,
    thin_air_contacts,
)
from hoi_retarget.evaluation.contact_figures import SurfaceCurves, surface_curves
from hoi_retarget.evaluation.thresholds import Level, verdict_of
from hoi_retarget.motion.motion import Motion, Stage
from hoi_retarget.numerics import se3
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.retarget import retarget
from hoi_retarget.robots import load_robot
from hoi_retarget.robots.outer_skin import farthest_points
from hoi_retarget.robots.skin import LinkSkin, skins_from
from plain_motions import FPS, LINKS, plain_motion, standing_qpos
from synthetic import make

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


FRAMES, CONTACT = 60, slice(10, 50)
HALF = np.array([0.15, 0.6, 0.6])
"""Of the box [m]; its face at +x is touched."""
_MESH = trimesh.creation.box(2.0 * HALF)
BOX = ObjectGeometry(_MESH.vertices, faces=_MESH.faces)


TOUCH = ("touch_share", "palm_touch_share", "fingertip_touch_share")
SLIP = ("hand_slip_mps", "hand_slip_fast_share", "hand_wander_excess_m")
PERSON = ("person_slip_mps", "person_wander_m")
MEASURED = {*TOUCH, *SLIP, *PERSON, "touch_gap_p95_m", "touch_place_m", "recorded_place_m"}


@dataclass(frozen=True)
class World:
    """A person whose hand holds still on a box, and a robot whose hand is beside it."""

    clip: Clip
    motion: Motion

    @property
    def view(self) -> Comparison:
        return Comparison(self.motion, self.clip, 0, G1.forward(self.motion.qpos))

    @property
    def figures(self) -> Mapping[str, float | None]:
        view = self.view
        return {figure.name: figure.measure(view) for figure in FIGURES if figure.measure and figure.name in MEASURED}


def boards(side: str) -> list[tuple[np.ndarray, float, float]]:
    """Return the boards that a hand's palmar side can lie on, most skin first: outward normal, offset, skin's area."""
    (skin,) = skins_from(G1, f"{side}_palm")
    palm = G1.sites.frames[f"{side}_palm"].rotation[:, 1] * (-1.0 if side == "left" else 1.0)
    found = []
    for *normal, offset in scipy.spatial.ConvexHull(skin.points).equations:
        near = skin.points @ normal + offset > -0.002
        if np.dot(normal, palm) > 0.6:
            found.append((np.array(normal), offset, float(skin.areas[near].sum())))
    return sorted(found, key=lambda board: -board[2])


def world(
    *,
    gap: float = 0.0,
    speed: float = 0.0,
    person: float = 0.0,
    tip: bool = False,
    side: str = "left",
    turn: float = 0.0,
    scale: float = 1.0,
) -> World:
    """Return a robot's hand that lies on a board, or touches it with one fingertip.

    Args:
        gap: From the board [m].
        speed: Of the robot's board along itself [m/s].
        person: The same of the person's.
        tip: Whether the hand is tilted so that a tip alone is next to it.
        side: Which hand.
        turn: Of the board about the palm, whole motion [rad].
        scale: Of the robot's box.
    """
    qpos = standing_qpos(G1, FRAMES)
    kinematics = G1.forward(qpos)
    (skin,) = skins_from(G1, f"{side}_palm")
    normal, offset, _ = boards(side)[0]
    if tip:
        extreme = skin.points[skin.points[:, 0].argmax()]
        palm = G1.sites.frames[f"{side}_palm"].rotation
        normal = palm @ [np.sqrt(0.5), (-1.0 if side == "left" else 1.0) * np.sqrt(0.5), 0.0]
        offset = -float((skin.points @ normal).max())
        assert np.linalg.norm(skin.points[(skin.points @ normal).argmax()] - extreme) < 0.05
    link = kinematics.orientation(skin.frame)[:, :, 0]
    outward = link @ normal
    touched = kinematics.point(skin.frame)[:, 0] + link @ (-offset * normal)
    palm_at = kinematics.site_position(f"{side}_palm")[0]
    along = np.cross(outward, [0.0, 0.0, 1.0])
    along /= np.linalg.norm(along)
    axes = np.stack([-outward, along, np.cross(-outward, along)], axis=1)
    centre = touched + axes @ [0.0, *(axes[:, 1:].T @ (palm_at - touched))] + outward * (scale * HALF[0] + gap)
    seconds = np.arange(FRAMES) / FPS
    places = centre + np.outer(seconds * speed, along)
    quats = se3.quat_multiply(se3.exp(np.outer(np.linspace(0.0, turn, FRAMES), outward)), se3.matrix_to_quat(axes))
    active = np.zeros(FRAMES, dtype=bool)
    active[CONTACT] = True
    whole = make("carry_box")
    acting = whole.people[0]
    still = replace(
        acting,
        joint_positions=np.repeat(acting.joint_positions[:1], FRAMES, axis=0),
        joint_quats=np.repeat(acting.joint_quats[:1], FRAMES, axis=0),
    )
    held = still.part_position(f"{side}_hand") - [HALF[0] + 0.03, 0.0, 0.0] + np.outer(seconds, [0.0, person, 0.0])
    upright = np.tile(se3.IDENTITY_QUAT, (FRAMES, 1))
    track = ContactTrack(0, 0, f"{side}_hand", active, np.tile([HALF[0] + 0.03, 0.0, 0.0], (FRAMES, 1)))
    box = ObjectTrack("box", held, upright, BOX)
    clip = replace(whole, people=(still,), objects=(box,), contacts=(track,), first_source_frame=1)
    column = LINKS.index(f"{side}_palm")
    flags = np.zeros((FRAMES, 2), dtype=bool)
    flags[:, column] = active
    points = np.full((FRAMES, 2, 3), np.nan)
    points[active, column] = scale * track.contact_points[active]
    motion = plain_motion(
        G1,
        qpos,
        object_pos=places[:, None],
        object_quat=quats[:, None],
        object_scale=np.array([scale]),
        contact_flags=flags,
        contact_object=np.where(flags, 0, -1),
        contact_points=points,
    )
    return World(clip, motion)


def of(figures: Mapping[str, float | None], names: tuple[str, ...]) -> list[float | None]:
    return [figures[name] for name in names]


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize(
    ("pose", "touch"),
    [
        ({}, (1.0, 1.0, 0.0)),
        ({"scale": 0.5}, (1.0, 1.0, 0.0)),
        ({"gap": 0.0019, "tip": True}, (1.0, 0.0, 1.0)),
        ({"tip": True}, (1.0, 0.0, 1.0)),
        ({"gap": 0.003}, (0.0, 0.0, 0.0)),
        ({"gap": -0.003}, (0.0, 1.0, 0.0)),
    ],
)
def test_a_hand_that_lies_on_a_board_touches_and_a_tip_is_told_apart(side, pose, touch):
    figures = world(side=side, **pose).figures
    assert of(figures, TOUCH) == list(touch)
    if pose.get("gap", 0.0) > 0.0:
        assert figures["touch_gap_p95_m"] == pytest.approx(pose["gap"], abs=1e-6)


def test_the_area_that_touches_is_that_of_the_skin_near_the_board():
    (curve,) = surface_curves(world().view).touches
    expected = boards("left")[0][2]
    assert curve.palmar_area[CONTACT] == pytest.approx(np.full(40, expected), rel=0.15)
    assert expected > 4e-4, "a flat hand is well above the 2 cm2 that are asked"


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_a_hand_covers_the_places_that_any_of_its_skin_touches(scale):
    made = world(scale=scale)
    (skin,), kinematics, (track,) = skins_from(G1, "left_palm"), made.view.kinematics, made.clip.contacts
    placed = kinematics.point(skin.frame)[:, 0] + skin.points @ kinematics.orientation(skin.frame)[:, :, 0].T
    inside = se3.rotate_inverse(made.motion.object_quat[0, 0], placed - made.motion.object_pos[0, 0])
    touching = inside[np.abs(inside[:, 0] - scale * HALF[0]) <= 2e-3]
    spread = np.linalg.norm(touching - touching.mean(axis=0), axis=1)
    for person in (
        touching[spread.argmin()],
        touching[spread.argmax()],
        touching.mean(axis=0) + np.array([0.0, 0.2, 0.1]),
    ):
        on_face = np.array([scale * HALF[0], *person[1:]])
        points = np.tile(on_face / scale, (FRAMES, 1))
        clip = replace(made.clip, contacts=(replace(track, contact_points=points),))
        (curve,) = surface_curves(replace(made, clip=clip).view).touches
        expected = np.linalg.norm(touching - on_face, axis=1).min()
        assert curve.uncovered[CONTACT] == pytest.approx(np.full(40, expected), abs=1e-6)
        assert (curve.uncovered[CONTACT] <= curve.place[CONTACT]).all()


@pytest.mark.parametrize(("uncovered", "gap", "residual"), [(0.05, 0.001, 0.001), (0.05, -0.004, 0.0), (0.2, 0.0, 0.2)])
def test_a_contact_is_elsewhere_only_if_no_touching_skin_is_near_the_place(uncovered, gap, residual, monkeypatch):
    view = world().view
    (curve,), full = surface_curves(view).touches, np.ones(FRAMES - view.first)
    far = replace(curve, place=0.3 * full, uncovered=uncovered * full, gap=gap * full)
    module = sys.modules[surface_residuals.__module__]  # Its package has a function of the module's name.
    monkeypatch.setattr(module, "surface_curves", lambda _: SurfaceCurves((), np.zeros((0, 0, 0)), (far,)))
    found = surface_residuals(view)[:, LINKS.index("left_palm")]
    assert found[CONTACT] == pytest.approx(np.full(40, residual)) and np.isnan(np.delete(found, CONTACT)).all()


@pytest.mark.parametrize("scale", [1.0, 0.5])
@pytest.mark.parametrize(("speed", "person"), [(0.0, 0.0), (0.02, 0.0), (0.02, 0.03), (0.11, 0.04)])
def test_a_hand_slips_as_fast_as_its_board_moves(speed, person, scale):
    moved = 23 / FPS  # [s] from the first to the last frame that counts.
    figures = world(speed=speed, person=person, scale=scale).figures
    assert of(figures, SLIP) == pytest.approx([speed, float(speed > 0.1), moved * (speed - person)], abs=1e-9)
    assert of(figures, PERSON) == pytest.approx([person, moved * person], abs=1e-9)


def test_what_turns_about_the_palm_does_not_slip_and_a_person_who_slides_asks_for_nothing():
    assert world(turn=1.0).figures["hand_slip_mps"] == pytest.approx(0.0, abs=1e-9)
    assert of(world(speed=0.2, person=0.06).figures, SLIP[:2]) == [None, None]


def test_figures_do_not_depend_on_where_a_recording_begins():
    whole = world(speed=0.03, gap=0.001)
    cut, motion, clip = slice(5, None), whole.motion, whole.clip
    (still,), (box,), (track,) = clip.people, clip.objects, clip.contacts
    later = replace(
        clip,
        people=(replace(still, joint_positions=still.joint_positions[cut], joint_quats=still.joint_quats[cut]),),
        objects=(replace(box, positions=box.positions[cut], quats=box.quats[cut]),),
        contacts=(replace(track, active=track.active[cut], contact_points=track.contact_points[cut]),),
    )
    arrays = ("object_pos", "object_quat", "contact_flags", "contact_object", "contact_points", "stance_flags")
    changes = {name: getattr(motion, name)[cut] for name in arrays}
    moved = World(later, plain_motion(G1, motion.qpos[cut], **changes))
    names = (*TOUCH, *SLIP, "touch_place_m")
    assert of(moved.figures, names) == pytest.approx(of(whole.figures, names), abs=1e-12)


def test_an_edited_contact_is_judged_by_the_recorded_place_too():
    plain = world()
    own = plain.figures["touch_place_m"] or 0.0
    assert own > 0.0
    assert plain.figures["recorded_place_m"] is None
    edited = apply(plain.clip, ContactEdits.of(plain.clip).adding(Move("left_hand", 20, offset=(0.0, 0.1, 0.0))))
    found = World(edited, plain.motion).figures
    assert found["recorded_place_m"] == pytest.approx(own, abs=1e-12)
    assert abs((found["touch_place_m"] or 0.0) - own) > 0.01
    for seen, recorded in zip(mirrored(edited).recorded_contacts, mirrored(plain.clip).contacts, strict=True):
        assert seen.part == recorded.part == "right_hand"
        np.testing.assert_array_equal(seen.contact_points, recorded.contact_points)


@pytest.mark.parametrize(("away", "in_air"), [(0.019, False), (0.1, True)])
def test_a_contact_asked_in_thin_air_is_named_and_fails(away, in_air):
    clip, motion = world().clip, world().motion
    assert thin_air_contacts(clip) == ()
    edited = apply(clip, ContactEdits.of(clip).adding(Move("left_hand", 20, offset=(away, 0.0, 0.0))))
    events = thin_air_contacts(edited)
    assert len(events) == in_air
    judged = motion.with_report(clip="box", thin_air_contacts=events)
    reasons = [reason for reason in verdict_of(judged, G1).reasons if reason.threshold.name == "thin_air_share"]
    assert [reason.level for reason in reasons] == [Level.FAIL] * in_air
    for event in events:
        assert (event.first_frame, event.last_frame, event.subject) == (10, 49, "left_hand")
        assert event.value == pytest.approx(0.03 + away, abs=1e-6)
        assert "asked in thin air: left_hand is to touch 'box' up to 130 mm off" in str(judged.warnings[0])


def test_hands_of_two_robots_wander_as_they_part_not_by_their_thickness():
    def wander(drift: float, alike: float) -> list[float]:
        paths = [world(speed=speed).motion for speed in (alike, alike + drift)]
        return [value for pair in inter_robot_hand_errors(paths, [G1, G1]) for value in (pair.mean_m, pair.max_m)]

    assert wander(0.0, 0.0) == wander(0.0, 0.03) == pytest.approx([0.0, 0.0], abs=1e-12)
    steps = np.abs(np.arange(40) - 19.5) * 0.06 / FPS
    assert wander(0.06, 0.03) == pytest.approx([steps.mean(), steps.max()], abs=1e-9)


@pytest.mark.parametrize("radius", [0.01, 0.04])
def test_areas_of_skin_points_add_up_to_the_skin(radius):
    ways = np.random.default_rng(0).normal(size=(20_000, 3))
    normals = ways / np.linalg.norm(ways, axis=1, keepdims=True)
    normals = normals[farthest_points(radius * normals, 0.0035)]
    (hand,) = skins_from(G1, "left_palm")
    ball = LinkSkin("ball", hand.frame, radius * normals, normals, hand.solid)
    assert ball.areas.sum() == pytest.approx(4 * np.pi * radius**2, rel=0.02)
