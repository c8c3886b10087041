"""The reference of a task: mjlab's motion command, with objects, and with the links that touch them."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from mjlab.tasks.tracking.mdp import MotionCommand, MotionCommandCfg
from mjlab.utils.lab_api.math import (
    matrix_from_quat,
    quat_apply,
    quat_apply_inverse,
    quat_error_magnitude,
    quat_inv,
    quat_mul,
)


class ObjectMotionCommand(MotionCommand):
    """A robot's motion with O objects and C links that touch them; E environments.

    Whenever mjlab sets the robot to a frame of the reference, the objects are set to the same frame.
    """

    cfg: "ObjectMotionCommandCfg"

    def __init__(self, cfg: "ObjectMotionCommandCfg", env: Any) -> None:
        """Read the motion file, in which bodies stand as they do in the robot's MJCF."""
        super().__init__(cfg, env)
        with np.load(cfg.motion_file, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        self._check_names(arrays)
        self.objects = [env.scene[name] for name in cfg.object_names]
        self._bodies = [item.body_names.index(body) for item, body in zip(self.objects, cfg.object_bodies, strict=True)]
        self._joint_pos, self._joint_vel = (self._tensor(arrays[f"object_joint_{name}"]) for name in ("pos", "vel"))
        self._pos, self._quat, self._lin_vel, self._ang_vel = (
            self._tensor(arrays[f"object_{name}_w"]) for name in ("pos", "quat", "lin_vel", "ang_vel")
        )
        links = [self.robot.body_names.index(str(name)) for name in arrays["contact_bodies"]]
        self._links = torch.tensor(links, dtype=torch.long, device=self.device)
        self._points = self._tensor(arrays["contact_body_points"])
        flags = torch.tensor(arrays["contact_flags"], device=self.device)
        # Links without a contact are given the first object, so that there is a number to leave out.
        self._touched = torch.tensor(np.maximum(arrays["contact_object"], 0), device=self.device)
        numbers = torch.arange(len(self.objects), device=self.device)
        self._labels = flags[..., None] & (self._touched[..., None] == numbers)
        self._in_object = self._reference_in_object(arrays) if self.objects else None
        self._handled = _near(self._labels.flatten(1).any(dim=1), cfg.frames_kept_exact)
        for name in ("error_object_pos", "error_object_rot") if self.objects else ():
            self.metrics[name] = torch.zeros(self.num_envs, device=self.device)

    @property
    def object_pos_w(self) -> torch.Tensor:
        """Places of the objects in the reference [m], (E, O, 3)."""
        return self._pos[self.time_steps] + self._env.scene.env_origins[:, None]

    @property
    def object_quat_w(self) -> torch.Tensor:
        """Quaternions of the objects in the reference, (E, O, 4)."""
        return self._quat[self.time_steps]

    @property
    def simulated_object_pos_w(self) -> torch.Tensor:
        """Places of the simulated objects [m], (E, O, 3)."""
        return self.of_objects("pos")

    @property
    def simulated_object_quat_w(self) -> torch.Tensor:
        """Quaternions of the simulated objects, (E, O, 4)."""
        return self.of_objects("quat")

    def of_objects(self, name: str) -> torch.Tensor:
        """Return a property of the simulated objects' bodies in the world, such as `lin_vel`, (E, O, 3 or 4)."""
        values = [getattr(item.data, f"body_link_{name}_w") for item in self.objects]
        return torch.stack([each[:, body] for each, body in zip(values, self._bodies, strict=True)], dim=1)

    @property
    def labels(self) -> torch.Tensor:
        """Which link should touch which object, (E, C, O)."""
        return self._labels[self.time_steps]

    @property
    def link_points_w(self) -> torch.Tensor:
        """Where the points of the robot's links that touch are, (E, C, 3)."""
        quats = self.robot.data.body_link_quat_w[:, self._links]
        points = self._points.expand(self.num_envs, -1, -1)
        return self.robot.data.body_link_pos_w[:, self._links] + quat_apply(quats, points)

    @property
    def link_targets_w(self) -> torch.Tensor:
        """Where these points should be on the simulated objects: as on those of the reference, (E, C, 3)."""
        which = self._touched[self.time_steps]
        pos = torch.gather(self.simulated_object_pos_w, 1, which[..., None].expand(-1, -1, 3))
        quat = torch.gather(self.simulated_object_quat_w, 1, which[..., None].expand(-1, -1, 4))
        return pos + quat_apply(quat, self._in_object[self.time_steps])

    def touching(self, field: str = "found") -> torch.Tensor:
        """Return the contact sensors' values of links and objects, (E, C, O): counts, or forces [N]."""
        columns = []
        for number in range(len(self.objects)):
            sensor = self._env.scene[f"touch_{number}"]
            values = sensor.data.found if field == "found" else torch.linalg.norm(sensor.data.force, dim=-1)
            bodies = [name.rpartition("/")[2] for name in sensor.primary_names]
            order = [bodies.index(self.robot.body_names[link]) for link in self._links.tolist()]
            columns.append(values[:, order])
        return torch.stack(columns, dim=2)

    def _write_reference_state_to_sim(self, env_ids: torch.Tensor, *state: torch.Tensor) -> None:
        # Random offsets of the robot alone would tear hands off what they hold, or push them into it.
        exact = (
            *(values[env_ids, 0] for values in (self.body_pos_w, self.body_quat_w)),
            *(values[env_ids, 0] for values in (self.body_lin_vel_w, self.body_ang_vel_w)),
            *(values[env_ids] for values in (self.joint_pos, self.joint_vel)),
        )
        handled = self._handled[self.time_steps[env_ids], None]
        mixed = [torch.where(handled, own, given) for own, given in zip(exact, state, strict=True)]
        super()._write_reference_state_to_sim(env_ids, *mixed)
        # mjlab ends at the joints' limits, which a simulated reference may exceed a little.
        limits, reference = self.robot.data.soft_joint_pos_limits[env_ids], exact[4]
        lower, upper = torch.minimum(limits[..., 0], reference), torch.maximum(limits[..., 1], reference)
        self.robot.write_joint_state_to_sim(torch.clip(mixed[4], lower, upper), mixed[5], env_ids=env_ids)
        frames = self.time_steps[env_ids]
        for number, (item, joint) in enumerate(zip(self.objects, self.cfg.object_joints, strict=True)):
            place = self._pos[frames, number] + self._env.scene.env_origins[env_ids]
            turn, *moving = (values[frames, number] for values in (self._quat, self._lin_vel, self._ang_vel))
            if joint == "free":
                item.write_root_state_to_sim(torch.cat([place, turn, *moving], dim=-1), env_ids=env_ids)
                item.reset(env_ids=env_ids)
            elif joint == "fixed":
                if self._bodies[number] == 0:  # Others are fixed parts of it, and follow.
                    item.write_mocap_pose_to_sim(torch.cat([place, turn], dim=-1), env_ids=env_ids)
            else:
                column = [item.joint_names.index(f"{self.cfg.object_bodies[number]}_joint")]
                own = (values[frames, number, None] for values in (self._joint_pos, self._joint_vel))
                item.write_joint_state_to_sim(*own, joint_ids=column, env_ids=env_ids)

    def _update_metrics(self) -> None:
        super()._update_metrics()
        if self.objects:
            away = torch.linalg.norm(self.object_pos_w - self.simulated_object_pos_w, dim=-1)
            turned = quat_error_magnitude(self.object_quat_w, self.simulated_object_quat_w)
            self.metrics["error_object_pos"] = away.mean(dim=-1)
            self.metrics["error_object_rot"] = turned.mean(dim=-1)

    def _reference_in_object(self, arrays: dict[str, np.ndarray]) -> torch.Tensor:
        """Return the links' points in the frames of the objects that they touch in the reference [m], (T, C, 3)."""
        links = self._links.cpu().numpy()
        pos, quat = (self._tensor(arrays[f"body_{name}_w"][:, links]) for name in ("pos", "quat"))
        points = pos + quat_apply(quat, self._points.expand(len(pos), -1, -1))
        which = self._touched[..., None]
        object_pos = torch.gather(self._pos, 1, which.expand(-1, -1, 3))
        object_quat = torch.gather(self._quat, 1, which.expand(-1, -1, 4))
        return quat_apply_inverse(object_quat, points - object_pos)

    def _check_names(self, arrays: dict[str, np.ndarray]) -> None:
        for kind, there in (("body", self.robot.body_names), ("joint", self.robot.joint_names)):
            stored = tuple(arrays[f"{kind}_names"].tolist())
            if stored != tuple(there):
                raise ValueError(f"{self.cfg.motion_file}: its {kind} names are not those of the robot: {stored}.")

    def _tensor(self, values: np.ndarray) -> torch.Tensor:
        return torch.tensor(values, dtype=torch.float32, device=self.device)


@dataclass(kw_only=True)
class ObjectMotionCommandCfg(MotionCommandCfg):
    """A motion with objects."""

    object_names: tuple[str, ...] = ()  # Their entities, in the order of the motion file.
    object_bodies: tuple[str, ...] = ()
    object_joints: tuple[str, ...] = ()  # `free` where an object is none's part, and nothing fixes it.
    frames_kept_exact: int = 10  # Before and after each contact with an object, in which resets add nothing at random.

    def build(self, env: Any) -> ObjectMotionCommand:
        """Return the command of an environment."""
        return ObjectMotionCommand(self, env)


def turned_between(quat: torch.Tensor, other: torch.Tensor) -> torch.Tensor:
    """Return rotations as one frame sees the other: the first two columns of matrices, (..., 6)."""
    return matrix_from_quat(quat_mul(quat_inv(quat), other))[..., :2].flatten(-2)


def _near(flags: torch.Tensor, frames: int) -> torch.Tensor:
    """Return where a flag is set at most so many frames before or after."""
    widened = torch.nn.functional.max_pool1d(flags[None].float(), 2 * frames + 1, stride=1, padding=frames)
    return widened[0] > 0.0
