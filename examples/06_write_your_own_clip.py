"""Write a recording of your own as a clip, and retarget it; docs/sources.md describes every array.

Run it with `python examples/06_write_your_own_clip.py`; a built-in clip stands in for the recording.
"""

import tempfile
from pathlib import Path

import numpy as np

import hoi_retarget as hr


def write_clip(path: Path) -> None:
    """Write one person and one object; put your own arrays in the place of the recording's."""
    recording = hr.open_clip("builtin:carry_box")
    person, box = recording.people[0], recording.objects[0]
    np.savez(
        path,
        clip_schema=1,
        name="my clip",
        licence="CC BY 4.0",
        up="z",
        unit="m",
        fps=recording.fps,
        joint_names=np.array(hr.JOINTS),
        joint_pos=person.joint_positions[:, None],  # (T, P, J, 3): one person
        joint_quat=person.joint_quats[:, None],  # wxyz
        object_names=np.array(["box"]),
        object_pos=box.positions[:, None],  # (T, O, 3): one object
        object_quat=box.quats[:, None],
        object_0_points=box.geometry.points,
        segment_part=np.array([track.part for track in recording.contacts]),
        segment_frames=np.array([track.segments[0] for track in recording.contacts]),
    )


with tempfile.TemporaryDirectory() as folder:
    write_clip(Path(folder) / "my_clip.npz")
    hr.main(["inspect", f"{folder}/my_clip.npz"])
    hr.main(["run", f"{folder}/my_clip.npz", "--out", f"{folder}/results"])
