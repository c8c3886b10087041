"""Writes people as Xsens MVN's files, from a clip's person: segments that look along x, z up."""

from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from hoi_retarget.clip.clip import Clip
from hoi_retarget.human.skeleton import JOINTS
from hoi_retarget.numerics import se3
from hoi_retarget.readers.mvnx import TREE
from source_people import in_world, rest_joints

TRUNK = {"Pelvis": "pelvis", "L5": "pelvis", "L3": "spine1", "T12": "spine2", "T8": "spine3"}
LIMBS = {"Shoulder": "collar", "UpperArm": "shoulder", "ForeArm": "elbow", "Hand": "wrist"}
LIMBS |= {"UpperLeg": "hip", "LowerLeg": "knee", "Foot": "ankle", "Toe": "foot"}
JOINT_OF = {**TRUNK, "Neck": "neck", "Head": "head"}
JOINT_OF |= {f"{side}{part}": f"{side.lower()}_{joint}" for side in ("Left", "Right") for part, joint in LIMBS.items()}
FROM_OURS = se3.matrix_to_quat(np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))
HEAD_TOP = 0.18


def write_mvnx(path: Path, clip: Clip, *, segments: tuple[str, ...] = tuple(TREE), subjects: int = 1) -> Path:
    """Write a clip's first person, with segments in any order."""
    person = in_world(clip, "z").people[0]
    rest = dict(zip(JOINTS, rest_joints(person, "smplh"), strict=True))
    hips = 0.5 * (rest["left_hip"] + rest["right_hip"])
    places, quats, still = [], [], []
    for name in segments:
        joint = JOINT_OF[name]
        below = hips - rest["pelvis"] if name == "Pelvis" else np.zeros(3)
        places.append(person.position(joint) + se3.rotate(person.quat(joint), below))
        quats.append(se3.quat_multiply(person.quat(joint), se3.quat_conjugate(FROM_OURS)))
        still.append(se3.rotate(FROM_OURS, rest[joint] + below))
    frames = [frame("identity", "", np.tile(se3.IDENTITY_QUAT, (len(segments), 1)), np.array(still))]
    every = zip(np.stack(quats, axis=1), np.stack(places, axis=1), strict=True)
    frames += [frame("normal", str(index), *values) for index, values in enumerate(every)]
    top = f'<points><point label="pTopOfHead"><pos_b>0 0 {HEAD_TOP}</pos_b></point></points>'
    listed = "".join(
        f"<segment label={quoteattr(name)} id='{index}'>{top if name == 'Head' else ''}</segment>"
        for index, name in enumerate(segments, 1)
    )
    subject = (
        f'<subject label="A" frameRate="{clip.fps!r}" segmentCount="{len(segments)}"><segments>{listed}</segments>'
        f"<frames>{''.join(frames)}</frames></subject>"
    )
    path.write_text(
        '<?xml version="1.0" encoding="UTF-8"?>\n<!-- <!DOCTYPE mvnx SYSTEM "schema.dtd"> -->\n'
        f'<mvnx xmlns="http://www.xsens.com/mvn/mvnx" version="4">{subjects * subject}</mvnx>\n'
    )
    return path


def frame(kind: str, index: str, quats: np.ndarray, places: np.ndarray) -> str:
    orientation, position = (" ".join(f"{value:.9f}" for value in values.ravel()) for values in (quats, places))
    return (
        f'<frame type="{kind}" index="{index}"><orientation>{orientation}</orientation>'
        f"<position>{position}</position></frame>"
    )
