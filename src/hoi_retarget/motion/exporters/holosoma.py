"""holosoma's whole-body tracking file: joints and bodies by name, optionally with one object."""

import numpy as np

from hoi_retarget.motion.exporters.encoding import rate, to_npz
from hoi_retarget.motion.exporters.format import Format, Take, Written
from hoi_retarget.numerics import se3

_WORLD = "world"  # MuJoCo's body 0, which holosoma's converter writes too.
# Links of holosoma's converter that hang fixed on others and that our models do not have.
_ABSENT_LINKS = (
    "pelvis_contour_link",
    "waist_support_link",
    *(
        f"{side}_{name}_link"
        for side in ("left", "right")
        for name in ("ankle_intermediate_1", *(f"ankle_roll_sphere_{ball}" for ball in range(1, 6)))
    ),
    *(f"{side}_{name}_link" for side in ("left", "right") for name in ("rubber_hand", "thumb", "pinky")),
)


def write(take: Take) -> Written:
    """Return the file of one motion."""
    trajectory, links = take.trajectory, take.links
    velocity = (trajectory.root_lin_vel, trajectory.root_ang_vel, trajectory.joint_vel)
    still = np.zeros((trajectory.frames, 1, 3))
    names = [_WORLD, *links.names]
    bodies = {
        "body_pos_w": [still, links.pos],
        "body_quat_w": [np.tile(se3.IDENTITY_QUAT, (trajectory.frames, 1, 1)), links.quat],
        "body_lin_vel_w": [still, links.com_lin_vel],
        "body_ang_vel_w": [still, links.ang_vel],
    }
    thing: dict[str, np.ndarray] = {}
    if take.object is not None:
        thing = {
            "object_pos_w": trajectory.object_pos[:, take.object],
            "object_quat_w": trajectory.object_quat[:, take.object],
            "object_lin_vel_w": trajectory.object_lin_vel[:, take.object],
            "object_ang_vel_w": trajectory.object_ang_vel[:, take.object],
        }
        names.append(f"{take.object_name}_link")
        for name, parts in bodies.items():
            parts.append(thing[name.replace("body", "object")][:, None])
    arrays = {
        "fps": np.array([rate(trajectory.fps)]),
        "joint_pos": trajectory.qpos,
        "joint_vel": np.concatenate(velocity, axis=1),
        **{name: np.concatenate(parts, axis=1) for name, parts in bodies.items()},
        **thing,
        "joint_names": np.array(take.model.joint_names, dtype=np.str_),
        "body_names": np.array(names, dtype=np.str_),
    }
    return Written(
        files={".npz": to_npz({**arrays, **take.contacts})},
        joint_names=take.model.joint_names,
        body_names=tuple(names),
        quaternions="wxyz",
        linear_velocity_of="centres of mass",
        notes=_notes(take),
    )


def _notes(take: Take) -> tuple[str, ...]:
    if take.model.spec.name != "unitree_g1":
        return ()
    return (
        "The G1 of holosoma's published files has its waist's roll and pitch axes 9 and 10 mm off those of rev_1_0, by "
        "which these bodies are placed: those above the waist lie up to 10 mm from where holosoma's model has them.",
        f"Fixed links that holosoma's converter adds are not in the file: {', '.join(_ABSENT_LINKS)}.",
    )


FORMAT = Format(
    name="holosoma",
    title="holosoma, whole-body tracking",
    suffix=".npz",
    fps=50.0,
    place_for_object=True,
    contacts_inside=True,
    robots=(),
    write=write,
)
