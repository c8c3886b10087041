"""Clips made of frames of others, which take less time to write and to read."""

from dataclasses import replace

import numpy as np

from hoi_retarget.clip.clip import Clip


def cut(clip: Clip, stop: int, first: int = 0) -> Clip:
    """The frames of a clip from one up to another, without its contacts."""
    return replace(taken(clip, np.arange(first, stop)), contacts=())


def taken(clip: Clip, frames: np.ndarray) -> Clip:
    """Return a clip made of some frames of another one, in that order."""
    people = [
        replace(person, joint_positions=person.joint_positions[frames], joint_quats=person.joint_quats[frames])
        for person in clip.people
    ]
    objects = [replace(track, positions=track.positions[frames], quats=track.quats[frames]) for track in clip.objects]
    contacts = [
        replace(track, active=track.active[frames], contact_points=track.contact_points[frames])
        for track in clip.contacts
    ]
    return replace(clip, people=tuple(people), objects=tuple(objects), contacts=tuple(contacts))


def tiled(clip: Clip, frames: int) -> Clip:
    """Return a clip of some length: another one played forth and back, so that it has no jump."""
    there_and_back = np.concatenate([np.arange(clip.frames), np.arange(clip.frames - 2, 0, -1)])
    return taken(clip, np.resize(there_and_back, frames))
