"""Two free hands with objects, simulated: whether the holds of a motion keep an object, whatever the body can do.

Each hand is the robot's own, a rigid body on springs towards its palm's path in the motion, and gives the forces that
the object needs. Nothing can fall over or be out of reach, so what is lost here is lost by the holds.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float

from hoi_retarget.clip.clip import Clip
from hoi_retarget.dynamics.contact_forces import Forces
from hoi_retarget.dynamics.feasibility import forces_on_clip, held_by_others
from hoi_retarget.dynamics.inverse_dynamics import movement_of
from hoi_retarget.dynamics.physics_settings import Physics
from hoi_retarget.motion.motion import Motion
from hoi_retarget.numerics import se3
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.robots.spec import PALMS
from hoi_retarget.simulation.physics_scene import PhysicsScene, scene_description, scene_of
from hoi_retarget.simulation.rollout import TICK, Reference, object_poses, reference_of, with_weaker_grip

KEPT_M, KEPT_DEG, KEPT_SHARE = 0.1, 20.0, 0.95
"""An object is kept that is within these of its path in this share of the time in which it is touched."""
MASS, INERTIA = 1.0, 0.004
"""Of a hand [kg, kg m^2]."""
STIFFNESS, DAMPING, LARGEST_FORCE = 400.0, 40.0, 60.0
"""Of a spring [N/m, N s/m, N], about those of an arm,"""
TURN_STIFFNESS, TURN_DAMPING, LARGEST_MOMENT = 10.0, 0.5, 5.0
"""and of a wrist [N m/rad, N m s/rad, N m]."""
TIMESTEP, FRICTION_STIFFNESS, ITERATIONS = 0.002, 10.0, 50
"""Of the simulation [s, MuJoCo's impratio, of its solver]: held objects must not creep by the simulator's own slip."""


@dataclass(frozen=True)
class KeptObject:
    """How an object fares in two free hands, in the time in which it is labelled to be touched."""

    name: str
    shape: str
    """What collides, in words."""
    off_m: float
    """From its path, on average [m],"""
    off_deg: float
    """and turned."""
    kept_share: float
    lost_after: float | None
    """First time at which it is not near its path [s]."""

    def __str__(self) -> str:
        kept = self.lost_after is None or self.kept_share >= KEPT_SHARE
        found = f"keep the {self.name}" if kept else f"lose the {self.name} at {self.lost_after:.1f} s"
        off = f"{100 * self.off_m:.1f} cm and {self.off_deg:.0f} degrees off on average"
        return f"two free hands {found}: {off}, as {self.shape}"


def kept_objects(motion: Motion, clip: Clip, model: RobotModel, physics: Physics) -> tuple[KeptObject, ...]:
    """Return how the objects that hands of this robot alone are labelled to touch fare in two free hands.

    Args:
        motion: The motion, of two frames or more.
        clip: It was made from this one.
        model: Its robot.
        physics: Masses and frictions.

    Raises:
        RobotError: A base carries the robot, or a joint's torque has no limit.
        GeometryError: An object's mesh cannot be read.
    """
    scene = scene_of(motion, model, [track.geometry for track in clip.objects], physics)
    forces = forces_on_clip(motion, clip, model, with_weaker_grip(physics))
    reference = reference_of(scene, motion, forces)
    frames = np.round(TICK * motion.fps * np.arange(len(reference.qpos))).astype(int)
    poses = _simulated(scene, reference, _given(motion, model, forces, physics)[frames])
    expected = object_poses(reference.qpos, model.n)
    off = np.linalg.norm(poses[:, :, :3] - expected[:, :, :3], axis=2)
    turned = np.degrees(se3.angle_between(poses[:, :, 3:], expected[:, :, 3:]))
    hands = reference.touched[:, [column for column, site in enumerate(reference.links) if site in PALMS]]
    found = []
    for index in np.unique(hands[hands >= 0]).tolist():
        touched = (reference.touched == index).any(axis=1)
        if held_by_others(clip, motion.person)[frames[touched], index].any():
            continue
        lost = touched & ((off[:, index] > KEPT_M) | (turned[:, index] > KEPT_DEG))
        off_m, off_deg = (float(values[touched, index].mean()) for values in (off, turned))
        kept, after = float(1.0 - lost[touched].mean()), TICK * int(lost.argmax()) if lost.any() else None
        shape = scene.objects[index].shape.text
        found.append(KeptObject(motion.object_names[index], shape, off_m, off_deg, kept, after))
    return tuple(found)


def _given(motion: Motion, model: RobotModel, forces: Forces, physics: Physics) -> Float[np.ndarray, "T 2 6"]:
    """Return the force [N] and moment about the palm [N m] that each hand gives to objects in every frame."""
    given = np.zeros((motion.frames, len(PALMS), 6))
    # The points are those of the smoothed motion.
    kinematics = model.forward(movement_of(motion.qpos, motion.fps, physics.smoothing).qpos)
    for number, point in enumerate(forces.points):
        if point.name in PALMS and point.object is not None:
            force = -np.where(point.active[:, None], forces.on_robot[:, number], 0.0)
            arm = point.position - kinematics.site_position(point.name)
            given[:, PALMS.index(point.name)] += np.concatenate([force, np.cross(arm, force)], axis=1)
    return given


def _simulated(
    scene: PhysicsScene, reference: Reference, given: Float[np.ndarray, "K 2 6"]
) -> Float[np.ndarray, "K O 7"]:
    """Return the objects' poses at all ticks."""
    simulated, first, last = _hands_and_objects(scene), 7 + scene.model.n, 6 * len(scene.objects)
    data, steps = mujoco.MjData(simulated), round(TICK / TIMESTEP)
    sites = [simulated.site(f"{palm}_free").id for palm in PALMS]
    bodies, own_quat = simulated.site_bodyid[sites], simulated.site_quat[sites]
    kinematics = scene.model.forward(reference.qpos[:, :first])
    place = np.stack([kinematics.site_position(palm) for palm in PALMS], axis=1)
    turn = np.stack([se3.quat_continuous(se3.matrix_to_quat(kinematics.site_rotation(palm))) for palm in PALMS], axis=1)
    velocity = np.gradient(place, TICK, axis=0)
    rate = se3.log(se3.quat_multiply(turn[1:], se3.quat_conjugate(turn[:-1]))) / TICK
    quat = se3.quat_multiply(turn[0], se3.quat_conjugate(own_quat))
    begin = np.concatenate([place[0] - se3.rotate(quat, simulated.site_pos[sites]), quat], axis=1)
    # MuJoCo has bodies in the order in which they were added: objects, then hands.
    data.qpos[:], data.qvel[:last] = np.append(reference.qpos[0, first:], begin), reference.qvel[0, first - 1 :]
    poses = [data.qpos.copy()]
    mujoco.mj_forward(simulated, data)
    for tick in range(len(place) - 1):
        for later in np.arange(steps) / steps:
            goal = se3.quat_normalize((1.0 - later) * turn[tick] + later * turn[tick + 1])
            off = (1.0 - later) * place[tick] + later * place[tick + 1] - data.site_xpos[sites]
            now = se3.quat_multiply(data.xquat[bodies], own_quat)
            apart = se3.log(se3.quat_multiply(goal, se3.quat_conjugate(now)))
            speed = data.qvel[last:].reshape(-1, 6)
            turning = se3.rotate(data.xquat[bodies], speed[:, 3:])
            moving = speed[:, :3] + np.cross(turning, data.site_xpos[sites] - data.xpos[bodies])
            force = STIFFNESS * off + DAMPING * (velocity[tick] - moving) + given[tick, :, :3]
            moment = TURN_STIFFNESS * apart + TURN_DAMPING * (rate[tick] - turning) + given[tick, :, 3:]
            data.xfrc_applied[bodies, :3] = _limited(force, LARGEST_FORCE)
            data.xfrc_applied[bodies, 3:] = _limited(moment, LARGEST_MOMENT)
            mujoco.mj_step(simulated, data)
        poses.append(data.qpos.copy())
    return object_poses(np.array(poses), -7)[:, : len(scene.objects)]


def _limited(vectors: Float[np.ndarray, "2 3"], largest: float) -> Float[np.ndarray, "2 3"]:
    return vectors * np.minimum(1.0, largest / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12))


def _hands_and_objects(scene: PhysicsScene) -> mujoco.MjModel:
    """Return a scene in which the robot is its two hands, each a free body with its mass about the palm."""
    description = scene_description(scene)
    description.copy_during_attach = True
    description.option.timestep, description.option.iterations = TIMESTEP, ITERATIONS
    description.option.cone, description.option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, FRICTION_STIFFNESS
    sites, objects = {site.name: site for site in description.sites}, {item.body_name for item in scene.objects}
    robot = [body for body in description.worldbody.bodies if body.name not in objects]
    for palm in PALMS:
        hand = description.worldbody.add_frame().attach_body(sites[palm].parent, "", "_free")
        for joint in hand.find_all("joint"):
            description.delete(joint)
        hand.add_freejoint()
        hand.pos, hand.quat, hand.gravcomp = np.zeros(3), np.eye(4)[0], 1.0
        hand.explicitinertial, hand.mass, hand.fullinertia = True, MASS, [np.nan] * 6
        hand.ipos, hand.iquat, hand.inertia = sites[palm].pos, np.eye(4)[0], [INERTIA] * 3
    # Those of the robot, and their copies for the hands.
    for item in (*description.actuators, *description.sensors, *description.equalities, *description.tendons, *robot):
        description.delete(item)
    return description.compile()
