"""Robots of several people who move the same objects: they are shown together."""

from collections.abc import Hashable, Sequence
from hashlib import sha256

from hoi_retarget.motion.motion import Motion


def shared_objects(motion: Motion) -> str:
    """Return a digest of a motion's clip and of the paths and sizes of its objects; empty without objects."""
    if not motion.object_names:
        return ""
    origin = f"{motion.report.clip}\0{motion.report.source.sha256}\0".encode(errors="replace")
    arrays = (motion.object_pos, motion.object_quat, motion.object_scale)
    return sha256(origin + b"".join(array.tobytes() for array in arrays)).hexdigest()


def group_people(objects: Sequence[Hashable], people: Sequence[int]) -> tuple[int, ...]:
    """Return, for each motion, the index of the first one that it is shown with: its own where it is alone.

    Args:
        objects: What tells the objects of each from others; none where that is empty.
        people: Whose motion each is: a second one of the same person stands apart.
    """
    hosts: list[int] = []
    groups: dict[Hashable, dict[int, set[int]]] = {}
    for index, (own, person) in enumerate(zip(objects, people, strict=True)):
        fitting = groups.setdefault(own, {}) if own else {}
        host = next((host for host, members in fitting.items() if person not in members), index)
        fitting.setdefault(host, set()).add(person)
        hosts.append(host)
    return tuple(hosts)
