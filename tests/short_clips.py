"""Short clips, which take less time to write and to read."""

from dataclasses import replace

from hoi_retarget.clip.clip import Clip


def cut(clip: Clip, stop: int, first: int = 0) -> Clip:
    """The frames of a clip from one up to another, without its contacts."""
    frames = slice(first, stop)
    people = tuple(
        replace(person, joint_positions=person.joint_positions[frames], joint_quats=person.joint_quats[frames])
        for person in clip.people
    )
    tracks = tuple(
        replace(track, positions=track.positions[frames], quats=track.quats[frames]) for track in clip.objects
    )
    return replace(clip, people=people, objects=tracks, contacts=())
