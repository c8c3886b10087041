"""Writes people of the SOMA skeleton as Kimodo does, from a clip's person."""

from pathlib import Path

import numpy as np

from bvh_writer import SOMA, SOMA_FINGERS
from hoi_retarget.clip.clip import Clip
from hoi_retarget.human.skeleton import JOINTS
from hoi_retarget.numerics import se3
from hoi_retarget.readers.soma import NAMES, PARENTS
from source_people import in_world, rest_joints

END = 0.02
"""Length of bones that no person has [m], along y."""
HEAD_TOP = 0.18


def write_soma(path: Path, clip: Clip) -> Path:
    """Write a clip's first person; joints that it has not are turned as those before them."""
    person = in_world(clip, "y").people[0]
    joints = {bone: joint for joint, bone in (SOMA | SOMA_FINGERS).items()}
    rest = dict(zip(JOINTS, rest_joints(person, "smplh"), strict=True))
    frames = len(person.joint_positions)
    world, places = np.empty((frames, len(NAMES), 3, 3)), np.empty((frames, len(NAMES), 3))
    local, at = np.empty_like(world), np.zeros((len(NAMES), 3))
    for index, (name, parent) in enumerate(zip(NAMES, PARENTS, strict=True)):
        joint = joints.get(name)
        world[:, index] = world[:, parent] if joint is None else se3.quat_to_matrix(person.quat(joint))
        if parent < 0:
            places[:, index], at[index], local[:, index] = person.position("pelvis"), rest["pelvis"], world[:, index]
            continue
        inner = name == "Neck2" or name.endswith(("Index1", "Middle1", "Ring1", "Pinky1"))
        length = HEAD_TOP if name == "HeadEnd" else 0.0 if inner else END
        at[index] = rest[joint] if joint is not None else at[parent] + [0.0, length, 0.0]
        places[:, index] = places[:, parent] + world[:, parent] @ (at[index] - at[parent])
        local[:, index] = world[:, parent].transpose(0, 2, 1) @ world[:, index]
    np.savez(path, posed_joints=places, local_rot_mats=local, global_rot_mats=world, root_positions=places[:, 0])
    return path
