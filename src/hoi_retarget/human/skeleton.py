"""The human side's vocabulary: joint names, their tree, and the parts that can touch.

The joints are those of SMPL-X in its order, without jaw and eyes (52 of 55), which are
also the 52 of SMPL-H. A joint's world rotation follows SMPL-X: identity for all joints is
the T-pose that stands along +y and looks along +z.
"""

from dataclasses import dataclass

_FINGERS = tuple(f"{finger}{bone}" for finger in ("index", "middle", "pinky", "ring", "thumb") for bone in (1, 2, 3))
LEFT_FINGERS = tuple(f"left_{name}" for name in _FINGERS)
RIGHT_FINGERS = tuple(f"right_{name}" for name in _FINGERS)

# (joint, parent) in SMPL-X order.
_BODY = (
    ("pelvis", None),
    ("left_hip", "pelvis"),
    ("right_hip", "pelvis"),
    ("spine1", "pelvis"),
    ("left_knee", "left_hip"),
    ("right_knee", "right_hip"),
    ("spine2", "spine1"),
    ("left_ankle", "left_knee"),
    ("right_ankle", "right_knee"),
    ("spine3", "spine2"),
    ("left_foot", "left_ankle"),
    ("right_foot", "right_ankle"),
    ("neck", "spine3"),
    ("left_collar", "spine3"),
    ("right_collar", "spine3"),
    ("head", "neck"),
    ("left_shoulder", "left_collar"),
    ("right_shoulder", "right_collar"),
    ("left_elbow", "left_shoulder"),
    ("right_elbow", "right_shoulder"),
    ("left_wrist", "left_elbow"),
    ("right_wrist", "right_elbow"),
)

JOINTS: tuple[str, ...] = (*(name for name, _ in _BODY), *LEFT_FINGERS, *RIGHT_FINGERS)
JOINT_INDEX: dict[str, int] = {name: index for index, name in enumerate(JOINTS)}


def _finger_parent(name: str) -> str:
    side, bone = name.split("_")
    return f"{side}_wrist" if bone.endswith("1") else f"{side}_{bone[:-1]}{int(bone[-1]) - 1}"


PARENT: dict[str, str | None] = {
    **dict(_BODY),
    **{name: _finger_parent(name) for name in (*LEFT_FINGERS, *RIGHT_FINGERS)},
}

LIMBS: tuple[tuple[str, str], ...] = (
    ("pelvis", "neck"),
    *(
        (f"{side}_{first}", f"{side}_{second}")
        for side in ("left", "right")
        for first, second in (
            ("hip", "knee"),
            ("knee", "ankle"),
            ("ankle", "foot"),
            ("shoulder", "elbow"),
            ("elbow", "wrist"),
        )
    ),
)
"""The body in eleven straight pieces, each from joint to joint."""

# Standing height over the length of the chain hip-knee + knee-ankle + pelvis-to-head joint:
# reproduces the stated heights of ten OMOMO subjects within 2.2 cm.
HEIGHT_OVER_CHAIN = 1.204


@dataclass(frozen=True)
class Part:
    """A part of the body that can touch an object.

    The contact point is the mean of `point_joints`, its orientation that of `rotation_joint`;
    a source that labels joints labels the part in contact when any of `label_joints` is.
    """

    name: str
    point_joints: tuple[str, ...]
    rotation_joint: str
    label_joints: tuple[str, ...]


PARTS: dict[str, Part] = {
    part.name: part
    for part in (
        Part("left_hand", ("left_wrist", "left_middle3"), "left_wrist", LEFT_FINGERS),
        Part("right_hand", ("right_wrist", "right_middle3"), "right_wrist", RIGHT_FINGERS),
        Part("left_foot", ("left_ankle",), "left_ankle", ("left_ankle", "left_foot")),
        Part("right_foot", ("right_ankle",), "right_ankle", ("right_ankle", "right_foot")),
    )
}
HANDS = ("left_hand", "right_hand")
FEET = ("left_foot", "right_foot")
