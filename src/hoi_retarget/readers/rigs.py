"""What the bones of well-known skeletons are called, and which joint of `skeleton` each is."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from hoi_retarget.errors import ClipError
from hoi_retarget.files.bvh import END
from hoi_retarget.human.skeleton import LEFT_FINGERS, RIGHT_FINGERS


@dataclass(frozen=True)
class Rig:
    """Names of bones, without what a file puts before all of them."""

    title: str
    pelvis: str
    sides: tuple[str, str]
    """What stands before the names of a left and of a right limb."""
    limbs: dict[str, tuple[str, ...]]
    """Joint without its side -> what it may be called."""
    toe_height: float = 0.0
    """Of the toe joints over the soles [m]; most rigs have them on the soles, for a hinge."""

    def bones(self) -> dict[str, tuple[str, ...]]:
        """Return joint -> its possible names, without spine and fingers."""
        # A foot without toes may have an end.
        limbs = self.limbs | {"foot": (*self.limbs["foot"], f"{self.limbs['ankle'][0]}{END}")}
        sided = {
            f"{side}_{joint}": tuple(f"{prefix}{name}" for name in names)
            for side, prefix in zip(("left", "right"), self.sides, strict=True)
            for joint, names in limbs.items()
        }
        return {"pelvis": (self.pelvis,), "neck": ("Neck",), "head": ("Head",), **sided}


_LIMBS = ("hip", "knee", "ankle", "foot", "collar", "shoulder", "elbow", "wrist")


def _rig(title: str, pelvis: str, sides: tuple[str, str], bones: str, toe_height: float = 0.0) -> Rig:
    names = (tuple(bone.split("|")) for bone in bones.split())
    return Rig(title, pelvis, sides, dict(zip(_LIMBS, names, strict=True)), toe_height)


RIGS = (
    _rig("LAFAN1 and Mixamo", "Hips", ("Left", "Right"), "UpLeg Leg Foot ToeBase|Toe Shoulder Arm ForeArm Hand"),
    _rig("Xsens MVN", "Hips", ("Left", "Right"), "Hip Knee Ankle Toe Collar Shoulder Elbow Wrist"),
    _rig("SMPL", "Pelvis", ("L_", "R_"), "Hip Knee Ankle Foot|Toe Collar Shoulder Elbow Wrist", 0.025),
)


@dataclass(frozen=True)
class RiggedSkeleton:
    """Which of a file's joints are which of `skeleton.JOINTS`."""

    rig: Rig
    joints: Mapping[str, int]
    """Of the body without the spine, and of all fingers where they are there."""
    spine: tuple[int, ...]
    """From above the pelvis to below the neck."""


def skeleton_of(names: Sequence[str], parents: Sequence[int]) -> RiggedSkeleton:
    """Return the skeleton of a known rig, from the names and parents of all joints, root first; raises `ClipError`."""
    lacking: list[tuple[Rig, list[str]]] = []
    for rig in RIGS:
        prefix = names[0].removesuffix(rig.pelvis) if names[0].endswith(rig.pelvis) else ""
        # The first of a name counts: ends of limbs may repeat one.
        places = {name.removeprefix(prefix): index for index, name in reversed(list(enumerate(names)))}
        bones = rig.bones()
        found = {
            joint: next((places[name] for name in called if name in places), -1) for joint, called in bones.items()
        }
        spine = _between(found["pelvis"], found["neck"], parents)
        if spine and min(found.values()) >= 0:
            return RiggedSkeleton(rig, found | _fingers(rig, places), spine)
        lacking.append((rig, [bones[joint][0] for joint, index in found.items() if index < 0]))
    nearest, missing = min(lacking, key=lambda item: len(item[1]))
    raise ClipError(
        f"the skeleton is none that is known ({', '.join(rig.title for rig in RIGS)}): of the names of "
        f"{nearest.title} it lacks {', '.join(missing[:4]) or 'a spine'}{', ...' if len(missing) > 4 else ''}, and has "
        f"{', '.join(names[:6])}, .... Rename its bones, or convert it to the layout in docs/sources.md"
    )


def _between(pelvis: int, neck: int, parents: Sequence[int]) -> tuple[int, ...]:
    """Return the joints from above the pelvis to below the neck, none where the neck is not above it."""
    chain: list[int] = []
    joint = parents[neck] if neck >= 0 else -1
    while joint >= 0 and joint != pelvis:
        chain.append(joint)
        joint = parents[joint]
    return tuple(reversed(chain)) if joint == pelvis else ()


def _fingers(rig: Rig, places: Mapping[str, int]) -> dict[str, int]:
    """Return all finger joints, such as `LeftHandIndex1` for that of `LeftHand`; none where some are missing."""
    found: dict[str, int] = {}
    for side, prefix, fingers in zip(("left", "right"), rig.sides, (LEFT_FINGERS, RIGHT_FINGERS), strict=True):
        for joint in fingers:
            name = f"{prefix}{rig.limbs['wrist'][0]}{joint.removeprefix(f'{side}_').title()}"
            if name not in places:
                return {}
            found[joint] = places[name]
    return found
