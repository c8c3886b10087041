"""Reads people of the SOMA skeleton as Kimodo writes them: `.npz`, one person of 77 joints without objects.

`posed_joints` (T, 77, 3) are places in metres, y up, `local_rot_mats` (T, 77, 3, 3) rotations in the parents' frames,
counted from a T-pose that looks along +z. The joints' names and tree are the skeleton's and stand in no file; neither
does the rate, 30 frames a second. BVH of this skeleton, as BONES-SEED's, is read as any other. GEM-X's `.pt` has angles
of this skeleton and numbers of a body model, which is not read: that is told.

Cites: the `.npz` files and the rig beside them that Kimodo and GEM-X publish.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ClipError
from hoi_retarget.files.bvh_file import bvh_of_rotations
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.readers.bvh import recording_of
from hoi_retarget.readers.fields import npz_fields
from hoi_retarget.readers.object_files import quats_of
from hoi_retarget.readers.reader import Reader, SourceRecording

FORMAT = "soma"
LICENCE = "that of the data, which the file does not state"
FPS = 30.0
PLACES, ROTATIONS = "posed_joints", "local_rot_mats"
MAX_OFF = 0.01  # Between places and those that rotations give [m]; 2e-6 in a published file.
_GEM_X = "body_params_global"
_TRUNK = ("Hips", "Spine1", "Spine2", "Chest", "Neck1", "Neck2", "Head", "HeadEnd", "Jaw", "LeftEye", "RightEye")
_ARM, _LEG = ("Shoulder", "Arm", "ForeArm", "Hand"), ("Leg", "Shin", "Foot", "ToeBase", "ToeEnd")
_FINGERS = {"Thumb": "123", "Index": "1234", "Middle": "1234", "Ring": "1234", "Pinky": "1234"}
_ENDS = (*(f"Hand{finger}{number}" for finger, count in _FINGERS.items() for number in (*count, "End")),)
_LIMBS = [*(side + joint for side in ("Left", "Right") for joint in (*_ARM, *_ENDS))]
NAMES = (*_TRUNK, *_LIMBS, *(side + joint for side in ("Left", "Right") for joint in _LEG))
_BRANCHES = {"Jaw": "Head", "LeftEye": "Head", "RightEye": "Head"}
_BRANCHES |= {
    f"{side}{joint}": base for side in ("Left", "Right") for joint, base in (("Shoulder", "Chest"), ("Leg", "Hips"))
}
_BRANCHES |= {f"{side}Hand{finger}1": f"{side}Hand" for side in ("Left", "Right") for finger in _FINGERS}
PARENTS = (-1, *(NAMES.index(_BRANCHES.get(name, before)) for before, name in pairwise(NAMES)))
"""Each joint's parent is the one before it, but where a limb or a finger begins."""


def holds(file: SourceFile) -> bool:
    """Return whether an `.npz` file has places and rotations of joints, or a torch file GEM-X's body."""
    if file.suffix == ".npz":
        return file.array_names >= {PLACES, ROTATIONS}
    return isinstance(file.torch, dict) and isinstance(file.torch.get(_GEM_X), dict)


def record(file: SourceFile, options: ReadOptions) -> SourceRecording:
    """Return the recording in a file; raises `ClipError` where its places are not those of its rotations."""
    if file.suffix != ".npz":
        raise ClipError(
            f"{file.path}: a reconstruction by GEM-X, whose bones' lengths are in SOMA's body model, which is not "
            "read. Export its skeleton as BVH, or as Kimodo has it: .npz with posed_joints and local_rot_mats."
        )
    fields, joints = npz_fields(file, file.path), len(NAMES)
    places = fields.array(PLACES, ("T", joints, 3), "places of the SOMA skeleton's joints")
    matrices = fields.array(ROTATIONS, (len(places), joints, 3, 3), "rotations of the joints")
    quats = quats_of(file.path, ROTATIONS, matrices.reshape(-1, 3, 3)).reshape(-1, joints, 4)
    motion = bvh_of_rotations(NAMES, PARENTS, _offsets(places, matrices), places[:, 0], quats, rate=FPS)
    if (off := np.linalg.norm(motion.poses()[0] - places, axis=2)).max(initial=0.0) > MAX_OFF:
        raise ClipError(
            f"{file.path}: {NAMES[off.max(axis=0).argmax()]} is {off.max():.3g} m from where the first frame's bones "
            f"and {ROTATIONS} put it. Expected places of one body and rotations that turn columns. Save them again."
        )
    return replace(
        recording_of(file.path, motion),
        description="motion of one person of the SOMA skeleton",
        fps_stated=False,
        licence=LICENCE,
        notes=(f"{FPS:g} frames a second, as Kimodo makes them; the file does not state it.",),
    )


def _offsets(places: np.ndarray, matrices: np.ndarray) -> np.ndarray:
    """Return the joints in their parents' frames [m], the first at the origin, as in the first frame."""
    world, offsets = np.empty_like(matrices[0]), np.zeros_like(places[0])
    for joint, parent in enumerate(PARENTS):
        world[joint] = matrices[0, joint] if parent < 0 else world[parent] @ matrices[0, joint]
        if parent >= 0:
            offsets[joint] = world[parent].T @ (places[0, joint] - places[0, parent])
    return offsets


READER = Reader(FORMAT, record, holds=holds)
