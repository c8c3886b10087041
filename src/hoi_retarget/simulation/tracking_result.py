"""The simulated motion as a result: its stage, the causes of its fall, and a file for a controller."""

import hashlib
import json
from collections.abc import Iterator
from dataclasses import asdict, replace
from functools import lru_cache
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float

from hoi_retarget.dynamics.feasibility import Infeasibility
from hoi_retarget.dynamics.physics_scene import PhysicsScene, compiled
from hoi_retarget.dynamics.physics_settings import Refinement
from hoi_retarget.files import npz
from hoi_retarget.motion.motion import ARRAYS, SIMULATED, ContactForces, Motion, Stage
from hoi_retarget.motion.performance import Performance
from hoi_retarget.simulation.refine import Refined
from hoi_retarget.simulation.rollout import TICK, Reference, Rollout, interpolated, object_errors, object_poses

FORMAT = "hoi-retarget performed motion 1"
_MAX_OBJECT_ERROR = 0.1  # Of a firmly held object [m].
_CAUSE_S, _FALL_S = 1.0, 0.3  # Causes of a fall are looked for so long before it; the last part is the fall itself.
_MIN_FORCE = 1e-9  # [N]


def simulated_motion(motion: Motion, scene: PhysicsScene, rollout: Rollout) -> Motion:
    """Return a motion with the simulated one as one more stage, at its own frames, and the simulated objects.

    Frames after its end, as after a fall, are left out. The last frame may be less than a tick after the last simulated
    one. Figures and warnings, which are those of the reference, are left out.
    """
    n, frames = scene.model.n, motion.frames
    if len(rollout.qpos) <= int((frames - 1) / motion.fps / TICK + 1e-9):
        frames = int(TICK * (len(rollout.qpos) - 1) * motion.fps + 1e-9) + 1
    times = np.arange(frames) / motion.fps
    robot = _at(rollout.qpos[:, : 7 + n], rollout.qvel[:, : 6 + n], times)
    objects = np.zeros((frames, len(scene.objects), 7))
    for index, poses in enumerate(np.moveaxis(object_poses(rollout.qpos, n), 1, 0)):
        objects[:, index] = _at(poses, rollout.qvel[:, 6 + n + 6 * index :][:, :6], times)
    kept = {name: getattr(motion, name)[:frames] for name in ARRAYS if name != "object_scale"}
    before = np.concatenate([motion.object_pos, motion.object_quat], axis=2)[:frames]
    earlier = [replace(stage, qpos=stage.qpos[:frames], objects=before) for stage in motion.stages]
    if frames < motion.frames:
        earlier = [replace(stage, windows=()) for stage in earlier]
    report = replace(
        motion.report,
        figures={},
        unreached_contacts=None,
        sunk_links=(),
        orientation_flips=None,
        trunk_turns=(),
        config={**motion.report.config, "physics": asdict(scene.physics)},
    )
    performed = Stage(SIMULATED, robot, forces=_drawn_forces(scene, rollout, times))
    kept |= {"object_pos": objects[..., :3], "object_quat": objects[..., 3:]}
    return replace(motion, stages=(*earlier, performed), report=report, **kept)


def why_it_ended(
    scene: PhysicsScene, reference: Reference, rollout: Rollout, fps: float, found: tuple[Infeasibility, ...]
) -> str:
    """Return possible causes of a fall, or of a loss, in words: lost objects, torques at limits, missing forces.

    Args: `scene`: robot and objects; `reference`: the reference; `rollout`: the simulated motion, up to the fall, or
    soon after the loss; `fps`: frames a second of the motion, for the frames in words; `found`: shortcomings of the
    motion by inverse dynamics.
    """
    reasons = [*_lost(scene, reference, rollout, fps), *_at_limits(scene, rollout)]
    fall = len(rollout.qpos) * TICK * fps
    begin = fall - _CAUSE_S * fps
    reasons += [str(item) for item in found if item.first_frame <= fall and item.last_frame >= begin][:2]
    slipped = "the object slipped" if rollout.fell_after is None else "the robot lost its balance"
    return "; ".join(reasons) or f"no single cause is seen: {slipped}"


def controller_file(  # noqa: PLR0913  # each is a part of the file
    motion: Motion, scene: PhysicsScene, refined: Refined, performance: Performance, *, settings: Refinement, seed: int
) -> bytes:
    """Return a simulated motion for a controller, as the content of an .npz file at 50 ticks a second.

    Args: `motion`: the motion before its refinement; `scene`: robot and objects; `refined`: the refined motion;
    `performance`: its duration and its certificate; `settings`: samples and iterations of the search; `seed`: of the
    random numbers.
    """
    rollout, drives, simulated = refined.rollout, scene.actuators, compiled(scene)
    facts: dict[str, Any] = {
        "format": FORMAT,
        "clip": motion.report.clip,
        "robot": motion.robot,
        "robot_sha256": hashlib.sha256(scene.model.spec.mjcf.read_bytes()).hexdigest(),
        "mujoco": mujoco.__version__,
        "seed": seed,
        "refinement": asdict(settings),
        "physics": asdict(scene.physics),
        "objects": [
            {"name": item.body.name, "body": item.body_name, "mass": item.body.mass, "shape": item.shape.text}
            for item in scene.objects
        ],
        "outcome": performance.outcome,
        "fell_after": rollout.fell_after,
        "cause": performance.cause,
        "certificate": performance.certificate and asdict(performance.certificate),
    }
    values: dict[str, Any] = {
        "qpos": rollout.qpos,
        "qvel": rollout.qvel,
        "targets": rollout.targets,
        "gains": refined.gains.astype(np.float32),
        "contact_forces": contact_forces(scene, rollout).astype(np.float32),
        "bodies": np.array([simulated.body(index).name for index in range(1, simulated.nbody)]),
        "joint_names": np.array(motion.joint_names),
        "stiffness": drives.stiffness,
        "damping": drives.damping,
        "armature": drives.armature,
        "torque_limits": drives.torque,
        "tick": np.float64(TICK),
    }
    for name, lead in (("lead_in", refined.lead_in), ("lead_out", refined.lead_out)):
        if lead is not None:
            values |= {f"{name}_{item}": getattr(lead.rollout, item) for item in ("qpos", "qvel", "targets")}
            values[f"{name}_gains"] = lead.gains.astype(np.float32)
            facts[f"{name}_fell_after"] = lead.rollout.fell_after
    values["facts"] = np.str_(json.dumps(facts, allow_nan=False))
    return npz.encode(values)


def contact_forces(scene: PhysicsScene, rollout: Rollout) -> Float[np.ndarray, "K B 3"]:
    """Return the sum of contact forces on every body but the world at every tick [N], in the world."""
    simulated = compiled(scene)
    forces = np.zeros((len(rollout.qpos), simulated.nbody, 3))
    for tick, bodies, force, _ in _contacts(scene, rollout):
        forces[tick, bodies[1]] += force
        forces[tick, bodies[0]] -= force
    return forces[:, 1:]


@lru_cache(maxsize=1)
def _contacts(scene: PhysicsScene, rollout: Rollout) -> list[tuple[int, tuple[int, int], np.ndarray, np.ndarray]]:
    """Return every contact: its tick, its two bodies, the force on the second [N], and its place [m]."""
    simulated, found = compiled(scene), []
    data, wrench = mujoco.MjData(simulated), np.empty(6)
    for tick, (qpos, qvel, target) in enumerate(zip(rollout.qpos, rollout.qvel, rollout.targets, strict=True)):
        data.qpos[:], data.qvel[:], data.ctrl[:] = qpos, qvel, target
        mujoco.mj_forward(simulated, data)
        for number, contact in enumerate(data.contact):
            mujoco.mj_contactForce(simulated, data, number, wrench)
            bodies = (int(simulated.geom_bodyid[contact.geom1]), int(simulated.geom_bodyid[contact.geom2]))
            found.append((tick, bodies, contact.frame.reshape(3, 3).T @ wrench[:3], contact.pos.copy()))
    return found


def _drawn_forces(scene: PhysicsScene, rollout: Rollout, times: np.ndarray) -> ContactForces:
    """Return the forces at times, each at the nearest tick."""
    simulated = compiled(scene)
    objects = {simulated.body(item.body_name).id for item in scene.objects}
    forces = np.zeros((len(rollout.qpos), simulated.nbody, 3))
    points, sizes = np.zeros_like(forces), np.zeros(forces.shape[:2])
    for tick, bodies, force, place in _contacts(scene, rollout):
        for body, other, sign in ((bodies[1], bodies[0], 1.0), (bodies[0], bodies[1], -1.0)):
            if body != 0 and (body not in objects or other == 0):
                size = float(np.linalg.norm(force))
                forces[tick, body] += sign * force
                points[tick, body] += size * place
                sizes[tick, body] += size
    touching = np.flatnonzero((sizes > 0.0).any(axis=0))
    ticks = np.minimum(np.round(times / TICK).astype(int), len(forces) - 1)[:, None]
    points /= np.maximum(sizes, _MIN_FORCE)[..., None]
    names = tuple(simulated.body(body).name for body in touching)
    return ContactForces(names, forces[ticks, touching], points[ticks, touching])


def _at(poses: np.ndarray, speeds: np.ndarray, times: np.ndarray) -> Float[np.ndarray, "T nq"]:
    """Return the configurations of a body with a free base at times, from those at ticks."""
    if len(poses) == 1:
        return np.repeat(poses, len(times), axis=0)
    return interpolated(poses, speeds, TICK * np.arange(len(poses)), times)[0]


def _lost(scene: PhysicsScene, reference: Reference, rollout: Rollout, fps: float) -> Iterator[str]:
    errors = object_errors(rollout, reference, scene.model.n)
    for index, item in enumerate(scene.objects):
        if errors[-1, index] > _MAX_OBJECT_ERROR:
            since = len(errors) - int((errors[::-1, index] <= _MAX_OBJECT_ERROR).argmax())
            links = [
                link
                for link, touched in zip(reference.links, reference.touched[: len(errors)].T, strict=True)
                if (touched[max(0, since - 1) :] == index).any()
            ]
            hands = f", which {' and '.join(links)} should hold," if links else ""
            yield (
                f"the {item.body.name}{hands} is {100 * errors[-1, index]:.0f} cm from its place, more than "
                f"{100 * _MAX_OBJECT_ERROR:.0f} cm since frame {int(TICK * since * fps)}: see its contacts"
            )


def _at_limits(scene: PhysicsScene, rollout: Rollout) -> Iterator[str]:
    drives, n, ticks = scene.actuators, scene.model.n, len(rollout.qpos)
    when = slice(max(0, ticks - round(_CAUSE_S / TICK)), max(1, ticks - round(_FALL_S / TICK)))
    apart = rollout.targets[when] - rollout.qpos[when, 7 : 7 + n]
    torques = drives.stiffness * apart - drives.damping * rollout.qvel[when, 6 : 6 + n]
    share = (np.abs(torques) >= drives.torque).mean(axis=0)
    for joint in np.argsort(-share, kind="stable")[:2]:
        if share[joint] > 0.5:
            yield f"{scene.model.joint_names[joint]} gives all of its {drives.torque[joint]:g} N m"
