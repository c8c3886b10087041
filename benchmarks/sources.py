"""Synthetic clips in the files of every source that is read, as the tests write them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from common import tiled

import behave_writer
import bvh_writer
import cari4d_writer
import core4d_writer
import glb_writer
import grab_writer
import hodome_writer
import imhd_writer
import interact_writer
import intercap_writer
import intermimic_writer
import omomo_writer
import own_layout_writer
import parahome_writer
import people_writer
from hoi_retarget import synthetic
from hoi_retarget.clip.clip import Clip
from hoi_retarget.readers import (
    amass,
    behave,
    bvh,
    cari4d,
    core4d,
    grab,
    gvhmr,
    hodome,
    humoto,
    imhd,
    interact,
    intercap,
    intermimic,
    intermimic_objects,
    omomo,
    own_layout,
    parahome,
    physhoi,
    theia,
)
from mesh_writer import write_mesh
from source_people import write_models
from torch_writer import torch_bytes


@dataclass(frozen=True)
class Recording:
    """Where a clip is, and what it is read with."""

    path: Path
    objects: Path | None = None
    body_models: Path | None = None


def scene(name: str, frames: int) -> Clip:
    """Return a synthetic clip, played forth and back until it is long enough."""
    return tiled(synthetic.make(name), frames)


def called(clip: Clip, *names: str) -> Clip:
    """Return a clip with other names of its objects."""
    return replace(
        clip, objects=tuple(replace(track, name=name) for track, name in zip(clip.objects, names, strict=True))
    )


def _intermimic(folder: Path, frames: int) -> Recording:
    clip = scene("carry_box", frames)
    intermimic_writer.write_clip(clip, folder / "sub1_box_000.pt")
    return Recording(folder / "sub1_box_000.pt", objects=_meshes(folder, clip))


def _intermimic_objects(folder: Path, frames: int) -> Recording:
    clip = scene("carry_box", frames)
    table = scene("push_table", frames).objects[0]
    clip = called(replace(clip, objects=(*clip.objects, table)), "box", "table")
    (folder / "clip.pt").write_bytes(torch_bytes(intermimic_writer.dictionary_of(clip)))
    return Recording(folder / "clip.pt", objects=_meshes(folder, clip))


def _theia(folder: Path, frames: int) -> Recording:
    clip = scene("carry_box", frames)
    clip = called(replace(clip, objects=2 * clip.objects), "cup", "kettle")
    (folder / "sub1_cup+kettle_000.pt").write_bytes(torch_bytes(intermimic_writer.theia_columns_of(clip)))
    return Recording(folder / "sub1_cup+kettle_000.pt", objects=_meshes(folder, clip))


def _physhoi(folder: Path, frames: int) -> Recording:
    clip = scene("carry_box", frames)
    (folder / "toss.pt").write_bytes(torch_bytes(intermimic_writer.physhoi_columns_of(clip)))
    return Recording(folder / "toss.pt")


def _meshes(folder: Path, clip: Clip) -> Path:
    for track in clip.objects:
        write_mesh(folder / "objects" / track.name / f"{track.name}.obj", track.geometry)
    return folder / "objects"


def _joints(folder: Path, frames: int) -> Recording:
    own_layout.write(scene("carry_table", frames), folder / "clip.npz")
    return Recording(folder / "clip.npz")


def _parameters(folder: Path, frames: int) -> Recording:
    arrays = own_layout_writer.parameter_arrays(scene("carry_table", frames), "smplx", folder / "models")
    np.savez(folder / "clip.npz", **arrays)
    return Recording(folder / "clip.npz", body_models=folder / "models")


def _core4d(folder: Path, frames: int) -> Recording:
    path, models, _ = core4d_writer.write_world(folder, scene("carry_table", frames))
    return Recording(path, body_models=models)


def _cari4d(folder: Path, frames: int) -> Recording:
    clip = scene("carry_box", frames)
    models = write_models(folder / "models", clip.people, "smplh", ["male"])
    path = cari4d_writer.write(folder / f"{cari4d_writer.VIDEO}.pth", cari4d_writer.prediction(clip))
    return Recording(path, objects=cari4d_writer.write_mesh(folder / "meshes", clip), body_models=models)


def _behave(folder: Path, frames: int) -> Recording:
    clip = called(scene("move_chair", frames), behave_writer.CATEGORY)
    behave_writer.write_mesh(folder, clip)
    models = write_models(folder / "models", clip.people, "smplh", [behave_writer.GENDER])
    return Recording(behave_writer.write_files(folder, behave_writer.files_of(clip)), body_models=models)


def _intercap(folder: Path, frames: int) -> Recording:
    seen = intercap_writer.in_camera(called(scene("move_chair", frames), intercap_writer.NAME))
    results, model = intercap_writer.results_of(seen)
    path = intercap_writer.write_results(folder, results)
    intercap_writer.write_saved_mesh(path, seen)
    return Recording(path, body_models=intercap_writer.write_model(folder, model))


def _grab(folder: Path, frames: int) -> Recording:
    clip = tiled(grab_writer.clip_on_table(), frames)
    members, model = grab_writer.members_of(clip)
    grab_writer.write_tools(folder, clip, model)
    models = grab_writer.write_model(folder / "models", model)
    return Recording(grab_writer.write_members(folder, members), body_models=models)


def _interact(folder: Path, frames: int) -> Recording:
    path, models = interact_writer.write_sequence(folder, scene("push_table", frames), "omomo")
    return Recording(path, body_models=models)


def _hodome(folder: Path, frames: int) -> Recording:
    path, models = hodome_writer.write_sequence(folder, scene("drag_suitcase", frames), "subject01_suitcase")
    return Recording(path, body_models=models)


def _imhd(folder: Path, frames: int) -> Recording:
    path, models = imhd_writer.write_recording(folder, scene("drag_suitcase", frames))
    return Recording(path, body_models=models)


def _omomo(folder: Path, frames: int) -> Recording:
    clip = scene("push_table", frames)
    omomo_writer.write_scan(folder, "largetable_cleaned_simplified", clip.objects[0])
    models = write_models(folder / "models", clip.people, "smplx", ["male"], shapes=16)
    values = omomo_writer.clip_values(clip, "sub3_largetable_007")
    return Recording(omomo_writer.write_clips(folder, [values]), body_models=models)


def _humoto(folder: Path, frames: int) -> Recording:
    return Recording(glb_writer.humoto(scene("move_chair", frames)).write(folder / "moving_a_chair-1.glb"))


def _parahome(folder: Path, frames: int) -> Recording:
    clip = called(scene("move_chair", frames), "chair_base")
    other = synthetic.make("move_chair", seconds=1.0, height=1.5).people[0]
    models = parahome_writer.write_model(folder / "models", other, clip.people[0])
    return Recording(
        parahome_writer.write_recording(folder, clip, {f"0 {frames}": "Move the chair"}), body_models=models
    )


def _amass(folder: Path, frames: int) -> Recording:
    path, models = people_writer.write_amass(folder, scene("carry_box", frames), "smplh")
    return Recording(path, body_models=models)


def _bvh(folder: Path, frames: int) -> Recording:
    clip, rig = scene("carry_box", frames), bvh_writer.Rig(bvh_writer.MIXAMO)
    return Recording(bvh_writer.write_person(folder / "walk.bvh", clip, rig))


def _gvhmr(folder: Path, frames: int) -> Recording:
    path, models = people_writer.write_gvhmr(folder, scene("carry_box", frames))
    return Recording(path, body_models=models)


SOURCES: Mapping[str, Callable[[Path, int], Recording]] = {
    intermimic.FORMAT: _intermimic,
    intermimic_objects.FORMAT: _intermimic_objects,
    theia.FORMAT: _theia,
    physhoi.FORMAT: _physhoi,
    own_layout.FORMAT: _joints,
    f"{own_layout.FORMAT}, parameters": _parameters,
    core4d.FORMAT: _core4d,
    cari4d.FORMAT: _cari4d,
    behave.FORMAT: _behave,
    intercap.FORMAT: _intercap,
    grab.FORMAT: _grab,
    interact.FORMAT: _interact,
    hodome.FORMAT: _hodome,
    imhd.FORMAT: _imhd,
    omomo.FORMAT: _omomo,
    humoto.FORMAT: _humoto,
    parahome.FORMAT: _parahome,
    amass.FORMAT: _amass,
    bvh.FORMAT: _bvh,
    gvhmr.FORMAT: _gvhmr,
}
"""What writes so many frames of each format into a folder of their own; people are two where the format has two."""
