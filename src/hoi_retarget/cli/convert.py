"""`hoi-retarget convert`: any clip that can be read, in the layout of our own."""

import shlex
from dataclasses import replace
from pathlib import Path

from hoi_retarget.cli.commands import Convert
from hoi_retarget.cli.jobs import check_writable
from hoi_retarget.cli.terminal import program, say
from hoi_retarget.clip import grasp_check
from hoi_retarget.clip.clip import Clip
from hoi_retarget.errors import ArgumentError
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.readers import own_layout
from hoi_retarget.readers.open import open_clip


def execute(command: Convert) -> int:
    """Read a clip, put its objects' meshes into it, and write it."""
    if command.out.suffix.lower() != ".npz":
        raise ArgumentError(f"--out {command.out}: the file's name must end with .npz.")
    check_writable("--out", command.out.parent)
    clip = open_clip(command.clip, command)
    own_layout.write(_whole(clip), command.out)
    size = command.out.stat().st_size / 1e6
    say(f"{command.out}: {clip.frames} frames at {clip.fps:g} frames/s, {size:.1f} MB")
    # The layout leaves rotations more open than formats of others do.
    doubted = grasp_check.fatal_fault(grasp_check.grasp_figures(clip))
    words = ["run", str(command.out), *(("--grasps", "warn") if doubted else ()), "--out", "results"]
    say(f"to run: {program()} {shlex.join(words)}")
    return 0


def _whole(clip: Clip) -> Clip:
    """Return a clip that needs no other file, with a note of what it was made from."""
    tracks = tuple(replace(track, geometry=_with_triangles(track.geometry)) for track in clip.objects)
    source = clip.source
    note = f"Converted from {Path(source.path).name or clip.name} ({source.format}, SHA-256 {source.sha256})."
    return replace(clip, objects=tracks, source=replace(source, notes=(*source.notes, note)))


def _with_triangles(geometry: ObjectGeometry) -> ObjectGeometry:
    """Return a geometry that holds its mesh itself; points alone stay as they are."""
    if geometry.mesh_path is None:
        return geometry
    surface = surface_of(geometry)
    return ObjectGeometry(surface.vertices, faces=surface.faces)
