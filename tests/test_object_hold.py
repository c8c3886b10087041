"""Holds on objects in simulated motions, and the shapes and friction that they depend on."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
import scipy
from hypothesis import given, settings
from hypothesis import strategies as st

from hoi_retarget.dynamics.contact_forces import forces_of
from hoi_retarget.dynamics.physics_scene import add_object, compiled, hand_contacts, scene_objects, scene_of
from hoi_retarget.dynamics.physics_settings import Physics
from hoi_retarget.dynamics.robot_parts import HAND_PARTS, parts_by_body
from hoi_retarget.motion.performance import STRICT_SHARE, Performance
from hoi_retarget.numerics import se3
from hoi_retarget.robots.skin import skin_of
from hoi_retarget.simulation.object_hold import NEAR_M, object_holds, up_to
from hoi_retarget.simulation.rollout import TICK, Reference, Rollout, object_poses, reference_of
from plain_motions import plain_motion, standing_qpos
from synthetic import make
from trajectories import MODELS

TICKS = 100


def rollouts(off, turned_deg=0.0, touched=(20, 80)):
    """A robot without joints and an object that is away from its path along x by `off` [m]; touched in some ticks."""
    qpos = np.tile([0.0, 0.0, 0.8, 1.0, 0.0, 0.0, 0.0, 0.3, 0.0, 0.9, 1.0, 0.0, 0.0, 0.0], (TICKS, 1))
    labels = np.full((TICKS, 2), -1)
    labels[slice(*touched), 1] = 0
    reference = Reference(qpos, np.zeros((TICKS, 12)), np.zeros((TICKS, 0)), ("left_palm", "right_palm"), labels)
    found = qpos.copy()
    found[:, 7] += off
    found[:, 10:] = se3.exp(np.array([0.0, 0.0, 1.0]) * np.radians(np.broadcast_to(turned_deg, TICKS))[:, None])
    return reference, Rollout(found, np.zeros((TICKS, 12)), np.zeros((TICKS, 0)), None)


@settings(max_examples=30, deadline=None)
@given(off=st.floats(0.0, 0.3), turned=st.floats(0.0, 60.0))
def test_an_object_that_is_evenly_off_is_held_within_the_bounds(off, turned):
    (hold,) = object_holds(*rollouts(off, turned), 0)
    assert hold.mean_m == pytest.approx(off, abs=1e-9) and hold.mean_deg == pytest.approx(turned, abs=1e-6)
    near = off <= NEAR_M and turned <= 20.0
    assert (hold.lost_after is None) == near and hold.kept_share == float(near)


@pytest.mark.parametrize("when", [30, 60])
def test_a_dropped_object_is_lost_when_it_goes(when):
    reference, rollout = rollouts(np.where(np.arange(TICKS) >= when, 0.5, 0.01))
    (hold,) = object_holds(reference, rollout, 0)
    assert hold.lost_after == pytest.approx(TICK * when)
    assert hold.kept_share == pytest.approx((when - 20) / 60)
    assert len(up_to(rollout, hold.lost_after).qpos) == when + 1


def test_a_short_way_off_is_held_but_not_strictly():
    off = np.where((np.arange(TICKS) >= 40) & (np.arange(TICKS) < 48), 0.15, 0.02)
    (hold,) = object_holds(*rollouts(off), 0)
    assert hold.lost_after is None and hold.kept_share < STRICT_SHARE
    assert hold.kept_share == pytest.approx(52 / 60)


def test_objects_that_nobody_touches_are_not_held():
    assert object_holds(*rollouts(0.5, touched=(0, 0)), 0) == ()


def test_words_of_an_outcome():
    words = [
        Performance(4.0, False, kept_share=1.0),
        Performance(4.0, False, kept_share=0.9),
        Performance(4.0, False),
        Performance(3.9, True, kept_share=0.5),
        Performance(1.4, False, lost=True, kept_share=0.2),
    ]
    assert [one.outcome for one in words] == ["held strictly", "held", "stood", "fell at 3.9 s", "lost at 1.4 s"]
    assert [one.whole for one in words] == [True, True, True, False, False]


@pytest.mark.parametrize("robot", ["unitree_g1", "unitree_h2", "unitree_g1_dex3"])
def test_what_the_skin_touches_is_touched_in_simulation(robot):
    """Parts hold all of a link's skin, and bulge beyond a hand's by millimetres."""
    model = MODELS[robot]
    for body, parts in parts_by_body(model).items():
        skin = skin_of(model).by_link[body]
        frame = model.body_frames.frames[body]
        turn = frame.rotation.T @ skin.frame.rotation
        points = skin.points @ turn.T + frame.rotation.T @ (skin.frame.position - frame.position)
        hulls = [scipy.spatial.ConvexHull(corners, qhull_options="QJ") for corners in parts]
        if not hulls:
            continue
        inside = [(points @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1) for hull in hulls]
        assert np.min(inside, axis=0).max() < 1e-3
        if len(parts) == HAND_PARTS or "hand" in body:
            middles = np.concatenate(
                [corners[hull.simplices].mean(axis=1) for corners, hull in zip(parts, hulls, strict=True)]
            )
            back = (middles - frame.rotation.T @ (skin.frame.position - frame.position)) @ turn
            assert np.quantile(skin.solid.distances(back), 0.9) < 4e-3


def test_a_held_box_does_not_creep():
    """Two palms press a box of 1 kg with twice the force that it needs: it sinks by less than 1 mm/s."""
    model = MODELS["unitree_g1"]
    clip = make("carry_box")
    motion = plain_motion(model, standing_qpos(model, clip.frames))
    physics = Physics(object_mass=1.0)
    scene = scene_of(motion, model, clip.objects, physics)
    simulated = compiled(scene)
    description = mujoco.MjSpec()
    option = description.option
    option.timestep, option.integrator = simulated.opt.timestep, simulated.opt.integrator
    option.cone, option.impratio = simulated.opt.cone, simulated.opt.impratio
    (item,) = scene_objects(motion, [track.geometry for track in clip.objects], physics)
    add_object(description, item, physics)
    half = float(item.shape.box.half[1]) * item.scale
    for side in (-1.0, 1.0):
        palm = description.worldbody.add_body(pos=[0.0, side * (half + 0.0199), 0.0])
        palm.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0.0, -side, 0.0], name=f"slide{side}")
        palm.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.05, 0.02, 0.05], mass=1.0, **hand_contacts(physics))
        actuator = description.add_actuator(target=f"slide{side}", trntype=mujoco.mjtTrn.mjTRN_JOINT)
        actuator.gainprm[0] = 1.0
    held = description.compile()
    assert creep(held) < 1e-3
    held.opt.cone, held.opt.impratio = mujoco.mjtCone.mjCONE_PYRAMIDAL, 1.0
    assert creep(held) > 3e-3  # What it is better than.


def creep(held):
    """Return how fast a box sinks between palms that press with twice the force that it needs [m/s]."""
    data, heights = mujoco.MjData(held), []
    data.ctrl[:] = 9.81 / 0.8
    for _ in range(300):
        mujoco.mj_step(held, data)
        heights.append(data.qpos[2])
    return abs(heights[-1] - heights[99]) / (200 * held.opt.timestep)


def test_a_simulation_begins_with_its_object_on_the_floor():
    model, clip = MODELS["unitree_g1"], make("carry_box")
    motion = plain_motion(model, standing_qpos(model, clip.frames))
    places = np.tile([1.0, 0.0, 0.0], (clip.frames, 1, 1))
    motion = replace(motion, object_pos=places, object_quat=np.tile(se3.IDENTITY_QUAT, (clip.frames, 1, 1)))
    scene = scene_of(motion, model, clip.objects, Physics(object_mass=1.0))
    reference = reference_of(scene, motion, forces_of(motion, model, [track.geometry for track in clip.objects]))
    heights = [scene.objects[0].height(pose) for pose in object_poses(reference.qpos[:2], model.n)[:, 0]]
    assert heights[0] == pytest.approx(0.0, abs=1e-12) and heights[1] < -0.01
