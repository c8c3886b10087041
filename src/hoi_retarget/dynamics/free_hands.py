"""Two free hands with objects, simulated: a test of holds, without the body.

Each hand is the robot's own, a rigid body on springs towards its palm's path, and gives forces that the object needs,
in friction cones half as wide where its skin touches. Nothing can fall or be out of reach: holds alone lose objects.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import mujoco
import numpy as np
import scipy  # its modules are loaded where they are first used
from jaxtyping import Float
from mujoco import rollout

from hoi_retarget.clip.clip import Clip
from hoi_retarget.dynamics import physics_scene
from hoi_retarget.dynamics.feasibility import not_free
from hoi_retarget.dynamics.inverse_dynamics import movement_of
from hoi_retarget.dynamics.object_support import ObjectLoad, object_load
from hoi_retarget.dynamics.physics_settings import Physics
from hoi_retarget.dynamics.robot_parts import LINK_PARTS, convex_parts
from hoi_retarget.motion.motion import Motion
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.filters import closed_and_opened, nearest_active, seconds_to_frames, smoothstep_around
from hoi_retarget.objects.distance_field import DistanceField, distance_field
from hoi_retarget.robots.model import Kinematics, RobotModel
from hoi_retarget.robots.skin import LinkSkin, pose_at_home, skins_from
from hoi_retarget.robots.spec import PALMS

KEPT_M, KEPT_DEG, KEPT_SHARE = 0.1, 20.0, 0.95
"""An object is kept that is within these of its path in this share of the time in which it is touched."""
MASS, INERTIA = 1.0, 0.004  # Of a hand [kg, kg m^2].
STIFFNESS, DAMPING, LARGEST_FORCE = 400.0, 40.0, 60.0
"""Of a spring along each axis [N/m, N s/m, N], about those of an arm,"""
TURN_STIFFNESS, TURN_DAMPING, LARGEST_MOMENT = 10.0, 0.5, 5.0  # and about it, as of a wrist [N m/rad, N m s/rad, N m].
PRESSED = 0.002  # Hands go so far into what they touch [m]: 0.8 N;
CLEAR, APPROACH_SECONDS = 0.06, 0.12  # they come from so far off the surface [m], and leave, in this time.
FLICKER_SECONDS = 0.2  # Labels that are off for less do not mean that a hand lets go.
AWAY = 10.0  # Height of a hand that touches nothing [m].
FRICTION_SHARE, LARGEST_GIVEN = 0.5, 40.0
"""Of the friction, with which given forces are found, and the largest of a hand [N]."""
TIMESTEP, ITERATIONS = 0.004, 50  # Of the simulation [s], of its solver.
SKIN_POINTS, PATCH_POINTS, PATCH_DEPTH, LARGEST_GAP = 400, 6, 0.005, 0.01
"""Of a hand, of those that touch, how much farther off than the nearest these may be, and that one at most [m]."""
FACING = 0.5  # Cosine between skin and surface from which on they face each other.
HAND_PARTS = 18  # Convex parts of a hand that is one link.


@dataclass(frozen=True)
class KeptObject:
    """How an object fares in two free hands, in the time in which it is labelled to be touched."""

    name: str
    shape: str  # What collides, in words.
    off_m: float  # From its path, on average [m],
    off_deg: float  # and turned.
    kept_share: float
    lost_after: float | None  # First time at which it is not near its path [s].

    @property
    def kept(self) -> bool:
        """Whether it stays near its path."""
        return self.kept_share >= KEPT_SHARE

    @property
    def near(self) -> bool:
        """Whether it is near its path on average."""
        return self.off_m <= KEPT_M and self.off_deg <= KEPT_DEG

    def __str__(self) -> str:
        kept = self.lost_after is None or self.kept
        found = f"keep the {self.name}" if kept else f"lose the {self.name} at {self.lost_after:.1f} s"
        off = f"{100 * self.off_m:.1f} cm and {self.off_deg:.0f} degrees off on average"
        return f"two free hands {found}: {off}, as {self.shape}"


@dataclass(frozen=True, eq=False)
class Touch:
    """A palm on an object: its pose and where its skin touches, in the object's frame."""

    position: Float[np.ndarray, "3"]  # [m]
    rotation: Float[np.ndarray, "3 3"]
    points: Float[np.ndarray, "P 3"]  # On the surface [m].
    inward: Float[np.ndarray, "P 3"]  # Directions into the object there.
    middle: Float[np.ndarray, "3"]  # Of all skin that touches [m]; the palm's place where none does.
    object: int = 0

    @property
    def outward(self) -> Float[np.ndarray, "3"]:
        """Unit vector away from the object; zero where it does not touch."""
        mean = -self.inward.sum(axis=0)
        return mean / max(float(np.linalg.norm(mean)), 1e-9)


@lru_cache(maxsize=16)
def palm_skin(model: RobotModel, site: str) -> tuple[Float[np.ndarray, "P 3"], Float[np.ndarray, "P 3"]]:
    """Return points of a hand's skin in its palm's frame, as in the home pose [m], and their normals."""
    return _joined([(skin, *pose_at_home(model, site, skin.frame)) for skin in skins_from(model, site)])


def bent_skin(
    kinematics: Kinematics, site: str, frame: int
) -> tuple[Float[np.ndarray, "P 3"], Float[np.ndarray, "P 3"]]:
    """Return the same with fingers as in a frame of a trajectory."""
    if not kinematics.model.spec.fingers:
        return palm_skin(kinematics.model, site)
    turn, place = kinematics.site_rotation(site)[frame].T, kinematics.site_position(site)[frame]
    return _joined(
        [
            (
                skin,
                turn @ kinematics.orientation(skin.frame)[:, :, frame],
                turn @ (kinematics.point(skin.frame)[:, frame] - place),
            )
            for skin in skins_from(kinematics.model, site)
        ]
    )


def _joined(
    placed: Sequence[tuple[LinkSkin, np.ndarray, np.ndarray]],
) -> tuple[Float[np.ndarray, "P 3"], Float[np.ndarray, "P 3"]]:
    count = SKIN_POINTS // len(placed)
    points = np.concatenate([skin.points[:count] @ turn.T + origin for skin, turn, origin in placed])
    return points, np.concatenate([skin.normals[:count] @ turn.T for skin, turn, _ in placed])


def touch_of(
    skin: tuple[Float[np.ndarray, "P 3"], Float[np.ndarray, "P 3"]],
    field: DistanceField,
    position: Float[np.ndarray, "3"],
    rotation: Float[np.ndarray, "3 3"],
    scale: float = 1.0,
) -> Touch:
    """Return a palm on an object with the spread points at which its skin faces the surface, and is near it.

    Args: `skin`: of the hand, as `palm_skin` returns it; `field`: of the object; `position`: of the palm in the
    object's frame [m]; `rotation`: likewise; `scale`: of the object over its field.
    """
    points = skin[0] @ rotation.T + position
    distances, normals = field.distances_and_normals(points / scale)
    distances = scale * distances
    facing = np.einsum("pi,pi->p", normals, skin[1] @ rotation.T) < -FACING
    near = np.flatnonzero(facing & (distances < PATCH_DEPTH + np.clip(distances.min(), 0.0, LARGEST_GAP)))
    if not near.size:
        return Touch(position, rotation, np.zeros((0, 3)), np.zeros((0, 3)), position)
    kept = near[spread(points[near], int(distances[near].argmin()))]
    surface = points - distances[:, None] * normals
    return Touch(position, rotation, surface[kept], -normals[kept], surface[near].mean(axis=0))


def spread(points: Float[np.ndarray, "K 3"], first: int) -> list[int]:
    """Return the indices of a few points: the first one, then the farthest from those before each."""
    kept, away = [first], np.full(len(points), np.inf)
    while len(kept) < min(PATCH_POINTS, len(points)):
        away = np.minimum(away, np.linalg.norm(points - points[kept[-1]], axis=1))
        kept.append(int(away.argmax()))
    return kept


@dataclass(frozen=True, eq=False)
class FreeHands:
    """Objects of a motion of T frames, and two free hands of a robot."""

    model: RobotModel
    objects: tuple[physics_scene.SceneObject, ...]
    poses: Float[np.ndarray, "T O 7"]  # Of the objects: positions [m] and rotations.
    loads: tuple[ObjectLoad, ...]
    fps: float
    physics: Physics

    def keep(
        self, hands: tuple[Sequence[Touch | None], Sequence[Touch | None]], every: int = 1, off: float = 0.0
    ) -> dict[int, KeptObject]:
        """Return the outcome of each object that is touched, by its index.

        A hand comes to what it touches along the surface's normal, and leaves so; it is `off` the surface [m]. Forces
        are found in each `every`-th frame, and count for the next ones, too.
        """
        frames = len(self.poses)
        turns = se3.quat_to_matrix(self.poses[:, :, 3:].reshape(-1, 4)).reshape(frames, -1, 3, 3)
        positions, quats = np.tile([0.0, 0.0, AWAY], (frames, 2, 1)), np.tile(np.eye(4)[0], (frames, 2, 1))
        for number, touches in enumerate(hands):
            active = np.array([touch is not None for touch in touches])
            if not active.any():
                continue
            nearest = nearest_active(active)
            held = [touch for touch in (touches[frame] for frame in nearest) if touch is not None]
            index = np.array([touch.object for touch in held])
            apart = CLEAR * (1.0 - smoothstep_around(active, seconds_to_frames(APPROACH_SECONDS, self.fps)))
            apart = apart + (off - PRESSED) * active
            local = np.array([touch.position for touch in held])
            local += apart[:, None] * np.array([touch.outward for touch in held])
            turn = turns[np.arange(frames), index]
            positions[:, number] = self.poses[np.arange(frames), index, :3] + np.einsum("tij,tj->ti", turn, local)
            rotations = turn @ np.array([touch.rotation for touch in held])
            quats[:, number] = se3.quat_continuous(se3.matrix_to_quat(rotations))
        given = np.zeros((frames, 2, 6))
        for frame in range(0, frames, every):
            for index in range(len(self.objects)):
                on_it = {n: touch for n, own in enumerate(hands) if (touch := own[frame]) and touch.object == index}
                _, forces = self.forces(frame, list(on_it.values())) if on_it else (0.0, [])
                for number, (points, own) in zip(on_it, forces, strict=True):
                    moments = np.cross(points - positions[frame, number], own)
                    wrench = np.append(own.sum(axis=0), moments.sum(axis=0))
                    size = float(np.linalg.norm(wrench[:3]))
                    given[frame : frame + every, number] += wrench * (LARGEST_GIVEN / max(size, LARGEST_GIVEN))
        found = self._simulated(positions, quats, given)
        touched = {touch.object for own in hands for touch in own if touch}
        return {index: self._outcome(index, found[:, index], hands) for index in sorted(touched)}

    def forces(self, frame: int, touches: Sequence[Touch]) -> tuple[float, list[tuple[np.ndarray, np.ndarray]]]:
        """Return the share of its weight that an object lacks, and each hand's points [m] and forces on it [N]."""
        index, ends = touches[0].object, np.cumsum([len(touch.points) for touch in touches])[:-1]
        turn = se3.quat_to_matrix(self.poses[frame, index, None, 3:])[0]
        points = np.concatenate([touch.points for touch in touches]) @ turn.T + self.poses[frame, index, :3]
        inward = np.concatenate([touch.inward for touch in touches]) @ turn.T
        friction = FRICTION_SHARE * self.physics.hand_friction
        missing, forces = self.loads[index].hand_forces(frame, points, inward, friction)
        return missing, list(zip(np.split(points, ends), np.split(forces, ends), strict=True))

    def _simulated(
        self,
        positions: Float[np.ndarray, "T 2 3"],
        quats: Float[np.ndarray, "T 2 4"],
        given: Float[np.ndarray, "T 2 6"],
    ) -> Float[np.ndarray, "T O 7"]:
        """Return the poses of the objects in hands on springs towards a path."""
        data, frames, count = mujoco.MjData(self.compiled), len(positions), len(self.objects)
        for index in range(count):
            data.qpos[7 * index : 7 * index + 7] = self.poses[0, index]
            start = movement_of(self.poses[:, index], self.fps, self.physics.smoothing).qvel[0]
            data.qvel[6 * index : 6 * index + 6] = start
        # The hands come last; their frames are those of the palms.
        data.qpos[7 * count :] = np.concatenate([positions[0], quats[0]], axis=1).ravel()
        state = np.empty(mujoco.mj_stateSize(self.compiled, mujoco.mjtState.mjSTATE_FULLPHYSICS))
        mujoco.mj_getState(self.compiled, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        given = scipy.ndimage.gaussian_filter1d(given, 1.0, axis=0, mode="constant")
        rate = np.zeros_like(positions)
        rate[:-1] = self.fps * se3.log(se3.quat_multiply(se3.quat_conjugate(quats[:-1]), quats[1:]))
        velocity = self.fps * np.gradient(positions, axis=0)
        goals = positions + (DAMPING * velocity + given[:, :, :3]) / STIFFNESS
        leads = (TURN_DAMPING * rate + se3.rotate_inverse(quats, given[:, :, 3:])) / TURN_STIFFNESS
        springs, goal_positions, goal_quats = np.concatenate([goals, leads], axis=2), positions, quats
        control = np.concatenate([part.reshape(frames, -1) for part in (springs, goal_positions, goal_quats)], axis=1)
        steps = self.fps * TIMESTEP * np.arange(int((frames - 1) / self.fps / TIMESTEP) + 1)
        low = np.minimum(steps.astype(int), frames - 2)
        share = (steps - low)[:, None]
        control = (1.0 - share) * control[low] + share * control[low + 1]
        kinds = (mujoco.mjtState.mjSTATE_CTRL, mujoco.mjtState.mjSTATE_MOCAP_POS, mujoco.mjtState.mjSTATE_MOCAP_QUAT)
        spec = sum(int(kind) for kind in kinds)
        states, _ = rollout.rollout(self.compiled, data, state[None], control[None], control_spec=spec)
        at = np.clip(np.round(np.arange(frames) / self.fps / TIMESTEP).astype(int), 1, len(steps)) - 1
        found = states[0, at, 1 : 1 + 7 * count].reshape(frames, count, 7)
        return np.concatenate([self.poses[:1], found[1:]])

    def _outcome(
        self, index: int, found: Float[np.ndarray, "T 7"], hands: Sequence[Sequence[Touch | None]]
    ) -> KeptObject:
        by_hand = [[touch is not None and touch.object == index for touch in own] for own in hands]
        touched = np.array(by_hand).any(axis=0)
        item, expected = self.objects[index], self.poses[:, index]
        off = np.nan_to_num(np.linalg.norm(found[:, :3] - expected[:, :3], axis=1), nan=np.inf)
        turned = np.nan_to_num(np.degrees(se3.angle_between(found[:, 3:], expected[:, 3:])), nan=180.0)
        lost = touched & ((off > KEPT_M) | (turned > KEPT_DEG))
        return KeptObject(
            item.body.name,
            item.shape.text,
            float(off[touched].mean()),
            float(turned[touched].mean()),
            float(1.0 - lost[touched].mean()),
            float(lost.argmax()) / self.fps if lost.any() else None,
        )

    @cached_property
    def compiled(self) -> mujoco.MjModel:
        """Objects on a floor with the hands, each a free body about its palm, on springs."""
        description = mujoco.MjSpec()
        option, world = description.option, description.worldbody
        option.timestep, option.iterations, option.impratio = TIMESTEP, ITERATIONS, physics_scene.FRICTION_STIFFNESS
        option.integrator, option.cone = mujoco.mjtIntegrator.mjINT_IMPLICITFAST, mujoco.mjtCone.mjCONE_ELLIPTIC
        world.add_geom(
            type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 1.0], **physics_scene.floor_contacts(self.physics)
        )
        world.add_site(name="world_origin")
        for item in self.objects:
            physics_scene.add_object(description, item, self.physics)
        for palm in PALMS:
            hand = world.add_body(name=palm, gravcomp=1.0)
            hand.add_freejoint()
            hand.explicitinertial, hand.mass, hand.inertia = True, MASS, [INERTIA] * 3
            hand.add_site(name=palm)
            world.add_body(name=f"{palm}_goal", mocap=True).add_site(name=f"{palm}_goal")
            for number, corners in enumerate(hand_parts(self.model, palm)):
                description.add_mesh(name=f"{palm}_part{number}").uservert = corners.reshape(-1)
                shape = {"type": mujoco.mjtGeom.mjGEOM_MESH, "meshname": f"{palm}_part{number}", "mass": 0.0}
                hand.add_geom(**shape, **physics_scene.hand_contacts(self.physics))
            for axis, gear in enumerate(np.eye(6)):
                place = axis < 3
                spring = description.add_actuator(
                    name=f"{palm}_{axis}",
                    trntype=mujoco.mjtTrn.mjTRN_SITE,
                    target=palm,
                    refsite="world_origin" if place else f"{palm}_goal",
                    gear=gear,
                )
                spring.set_to_position(kp=STIFFNESS if place else TURN_STIFFNESS, kv=DAMPING if place else TURN_DAMPING)
                limit = LARGEST_FORCE if place else LARGEST_MOMENT
                spring.forcelimited, spring.forcerange = mujoco.mjtLimited.mjLIMITED_TRUE, [-limit, limit]
        return description.compile()


def hand_parts(model: RobotModel, site: str) -> tuple[Float[np.ndarray, "_ 3"], ...]:
    """Return the corners of a hand's convex parts in its palm's frame [m], as in the home pose."""
    skins, found = skins_from(model, site), []
    for skin in skins:
        turn, origin = pose_at_home(model, site, skin.frame)
        parts = convex_parts(skin, HAND_PARTS if len(skins) == 1 else LINK_PARTS)
        found += [corners @ turn.T + origin for corners in parts]
    return tuple(found)


def kept_objects(motion: Motion, clip: Clip, model: RobotModel, physics: Physics) -> tuple[KeptObject, ...]:
    """Return the outcomes, in two free hands, of a motion's objects that hands of this robot alone are to touch.

    Raises `RobotError`: the robot's hands have no shapes; `GeometryError`: an object's mesh cannot be read.
    """
    geometries = [track.geometry for track in clip.objects]
    scales, poses = motion.object_scale.tolist(), np.concatenate([motion.object_pos, motion.object_quat], axis=2)
    loads = tuple(
        object_load(name, geometry, scale, (pose[:, :3], pose[:, 3:]), motion.fps, physics)
        for name, geometry, scale, pose in zip(
            motion.object_names, geometries, scales, poses.transpose(1, 0, 2), strict=True
        )
    )
    kinematics, hands = model.forward(motion.qpos), []
    for palm in PALMS:
        touched = np.full(motion.frames, -1)
        for index in range(len(geometries)):
            labelled = motion.labelled(index)[:, [site == palm for site in motion.contact_links]]
            touched[
                closed_and_opened(
                    np.asarray(labelled.any(axis=1)), gap=seconds_to_frames(FLICKER_SECONDS, motion.fps), shortest=1
                )
            ] = index
        positions, rotations = kinematics.site_position(palm), kinematics.site_rotation(palm)
        touches: list[Touch | None] = [None] * motion.frames
        for frame in np.flatnonzero(touched >= 0).tolist():
            index = int(touched[frame])
            turn = se3.quat_to_matrix(poses[frame, index, None, 3:])[0]
            local = turn.T @ (positions[frame] - poses[frame, index, :3]), turn.T @ rotations[frame]
            field = distance_field(geometries[index])
            touches[frame] = replace(touch_of(palm_skin(model, palm), field, *local, scales[index]), object=index)
        hands.append(touches)
    free = FreeHands(model, physics_scene.scene_objects(motion, geometries, physics), poses, loads, motion.fps, physics)
    others = not_free(clip, motion.person)
    palms = [column for column, site in enumerate(motion.contact_links) if site in PALMS]
    return tuple(
        found
        for index, found in free.keep((hands[0], hands[1])).items()
        if not others[motion.labelled(index)[:, palms].any(axis=1), index].any()
    )
