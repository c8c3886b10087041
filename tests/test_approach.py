"""Laws of hands that come to objects and leave them in simulation."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hoi_retarget.dynamics.free_hands import palm_skin
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import runs
from hoi_retarget.objects.distance_field import distance_field
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.simulation.approach import (
    BROKEN_SECONDS,
    CLEAR,
    NEAR_SECONDS,
    arm_joints,
    wanted_room,
    with_approaches,
    with_steady_contacts,
)
from hoi_retarget.simulation.rollout import TICK
from plain_motions import plain_motion, standing_qpos
from test_rollout import CORNERS, G1, staged

GEOMETRY = ObjectGeometry(CORNERS)
PALM, SKIMMED = "left_palm", 0.004


def gaps(reference):
    """Distances of the left hand's skin from the box, by tick [m]."""
    field, (skin, _) = distance_field(GEOMETRY), palm_skin(G1, PALM)
    now = G1.forward(np.ascontiguousarray(reference.qpos[:, : 7 + G1.n]))
    points = np.einsum("tij,pj->tpi", now.site_rotation(PALM), skin) + now.site_position(PALM)[:, None]
    poses = reference.qpos[:, 7 + G1.n :]
    return np.array(
        [
            field.distances(se3.rotate_inverse(pose[3:], own - pose[:3])).min()
            for pose, own in zip(poses, points, strict=True)
        ]
    )


@pytest.fixture(scope="module")
def skimming():
    """A hand that stays 4 mm off a box beside it, and is labelled to touch it for a while."""
    qpos = standing_qpos(G1, 90)
    labels = np.zeros((90, 2), dtype=bool)
    labels[40:50, 0] = True
    beside = G1.forward(qpos[:1]).site_position(PALM)[0] + [0.0, 0.4, 0.0]

    def at(place):
        touching = {"contact_flags": labels, "contact_object": np.where(labels, 0, -1)}
        touching["contact_points"] = np.where(labels[..., None], np.zeros(3), np.nan)
        return staged(qpos, object_pos=np.tile(place, (90, 1, 1)), **touching)[1:]

    for _ in range(2):  # Distances from afar are not exact.
        beside = beside - [0.0, gaps(at(beside)[1])[0] - SKIMMED, 0.0]
    return at(beside)


@given(flags=st.lists(st.booleans(), min_size=1, max_size=120).filter(any))
def test_room_is_none_in_contact_and_far_from_it_and_never_jumps(flags):
    active = np.array(flags)
    room = wanted_room(active)
    ticks = np.flatnonzero(active)
    away = TICK * np.abs(np.arange(len(active))[:, None] - ticks).min(axis=1)
    assert (room[active] == 0.0).all() and (room[away >= NEAR_SECONDS] == 0.0).all()
    assert (room >= 0.0).all() and room.max() <= CLEAR
    assert np.abs(np.diff(room)).max(initial=0.0) < 0.2 * CLEAR
    np.testing.assert_allclose(wanted_room(active[::-1]), room[::-1], atol=1e-15)


def test_a_hand_keeps_off_until_it_touches_and_nothing_else_changes(skimming):
    scene, reference = skimming
    found = with_approaches(scene, reference, [GEOMETRY])
    touched = reference.touched[:, 0] >= 0
    room, gap = wanted_room(touched), gaps(found)
    assert gaps(reference).max() == pytest.approx(SKIMMED, abs=1e-3)
    assert (gap > np.maximum(0.8 * room, SKIMMED - 1e-3)).all() and gap.max() > 0.9 * CLEAR
    np.testing.assert_array_equal(found.qpos[touched], reference.qpos[touched])
    changed = np.flatnonzero((found.qpos != reference.qpos).any(axis=0))
    assert set(changed - 7) <= set(arm_joints(G1, PALM).tolist()) and len(changed)
    moved = np.gradient(found.qpos - reference.qpos, TICK, axis=0)[:, 7 : 7 + G1.n]
    np.testing.assert_allclose((found.qvel - reference.qvel)[:, 6 : 6 + G1.n], moved, atol=1e-12)
    assert (found.qpos[:, 7 : 7 + G1.n] <= G1.upper).all() and (found.qpos[:, 7 : 7 + G1.n] >= G1.lower).all()


def test_a_hand_that_touches_nothing_is_left_alone(skimming):
    scene, reference = skimming
    free = replace(reference, touched=np.full_like(reference.touched, -1))
    assert with_approaches(scene, free, [GEOMETRY]).qpos.tobytes() == free.qpos.tobytes()


def test_an_arm_moves_one_palm_and_not_the_other():
    left, right = (set(arm_joints(G1, f"{side}_palm").tolist()) for side in ("left", "right"))
    names = np.array(G1.joint_names)
    assert len(left) == len(right) == 7 and not left & right
    assert all(name.startswith("left") for name in names[sorted(left)])


@given(flags=st.lists(st.tuples(st.booleans(), st.integers(0, 1)), min_size=2, max_size=90))
def test_contacts_that_break_for_a_moment_go_on_and_no_others(flags):
    active, which = np.array([flag for flag, _ in flags]), np.array([item for _, item in flags])
    labels = np.stack([active, np.zeros_like(active)], axis=1)
    objects = np.where(labels, which[:, None], -1)
    points = np.where(labels[..., None], np.arange(len(flags))[:, None, None] * np.ones(3), np.nan)
    motion = plain_motion(
        G1,
        standing_qpos(G1, len(flags)),
        object_names=("box", "table"),
        contact_flags=labels,
        contact_object=objects,
        contact_points=points,
    )
    steady = with_steady_contacts(motion)
    now = steady.contact_flags[:, 0]
    assert (now >= active).all() and not steady.contact_flags[:, 1].any()
    for first, stop in runs(~now):
        inner = first > 0 and stop < len(now)
        same = inner and steady.contact_object[first - 1, 0] == steady.contact_object[stop, 0]
        assert not same or (stop - first) / motion.fps >= BROKEN_SECONDS
    for first, stop in runs(now & ~active):
        assert (stop - first) / motion.fps < BROKEN_SECONDS and objects[first - 1, 0] == objects[stop, 0]
        assert (steady.contact_points[first:stop, 0] == points[first - 1, 0]).all()
    kept = with_steady_contacts(steady)
    assert all(
        np.array_equal(getattr(kept, name), getattr(steady, name)) for name in ("contact_flags", "contact_object")
    )
