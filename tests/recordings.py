"""Recordings of every reader's format: synthetic clips in the files of their sources."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import actor_writer
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
import mvnx_writer
import omomo_writer
import own_layout_writer
import parahome_writer
import people_writer
import soma_writer
import synthetic
from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.readers import own_layout, read_clip
from mesh_writer import write_mesh
from short_clips import tiled
from source_people import write_models
from torch_writer import torch_bytes


@dataclass(frozen=True)
class Recording:
    """Where a clip is, and what it is read with."""

    path: Path
    """Its file or folder."""
    objects: Path | None = None
    body_models: Path | None = None
    main: str = ""
    """The file by which a folder is recognized."""

    @property
    def main_file(self) -> Path:
        """The file by which the recording is recognized."""
        return self.path / self.main

    def below(self, root: Path, other: Path) -> "Recording":
        """Return the recording where all of one folder was copied into another."""
        objects, models = (
            None if path is None else other / path.relative_to(root) for path in (self.objects, self.body_models)
        )
        return Recording(other / self.path.relative_to(root), objects, models, self.main)

    def read(self) -> Clip:
        """Return the clip."""
        return read_clip(self.path, ReadOptions(objects=self.objects, body_models=self.body_models))


Writer = Callable[[Path, int], Recording]
"""Writes so many frames into a folder."""
WRITERS: dict[str, Writer] = {}
"""Name of a format, perhaps with a comma and a variant of it -> its writer."""


def writes(kind: str) -> Callable[[Writer], Writer]:
    """Return a decorator that registers a function as the writer of a format, or of a variant after a comma."""

    def register(writer: Writer) -> Writer:
        WRITERS[kind] = writer
        return writer

    return register


def format_of(kind: str) -> str:
    """Return the format of a variant."""
    return kind.partition(",")[0]


def scene(name: str, frames: int) -> Clip:
    """Return a synthetic clip, played forth and back until it is long enough."""
    return tiled(synthetic.make(name), frames)


def called(clip: Clip, *names: str) -> Clip:
    """Return a clip with other names of its objects."""
    return replace(
        clip, objects=tuple(replace(track, name=name) for track, name in zip(clip.objects, names, strict=True))
    )


@writes("intermimic-591")
def intermimic(folder: Path, frames: int) -> Recording:
    clip = scene("carry_box", frames)
    intermimic_writer.write_clip(clip, folder / "sub1_box_000.pt")
    return Recording(folder / "sub1_box_000.pt", objects=_meshes(folder, clip))


@writes("intermimic-multi-object")
def intermimic_objects(folder: Path, frames: int) -> Recording:
    clip = scene("carry_box", frames)
    table = scene("push_table", frames).objects[0]
    clip = called(replace(clip, objects=(*clip.objects, table)), "box", "table")
    (folder / "clip.pt").write_bytes(torch_bytes(intermimic_writer.dictionary_of(clip)))
    return Recording(folder / "clip.pt", objects=_meshes(folder, clip))


@writes("theia-594")
def theia(folder: Path, frames: int) -> Recording:
    clip = scene("carry_box", frames)
    clip = called(replace(clip, objects=2 * clip.objects), "cup", "kettle")
    (folder / "sub1_cup+kettle_000.pt").write_bytes(torch_bytes(intermimic_writer.theia_columns_of(clip)))
    return Recording(folder / "sub1_cup+kettle_000.pt", objects=_meshes(folder, clip))


@writes("physhoi-331")
def physhoi(folder: Path, frames: int) -> Recording:
    clip = scene("carry_box", frames)
    (folder / "toss.pt").write_bytes(torch_bytes(intermimic_writer.physhoi_columns_of(clip)))
    return Recording(folder / "toss.pt")


def _meshes(folder: Path, clip: Clip) -> Path:
    for track in clip.objects:
        write_mesh(folder / "meshes" / track.name / f"{track.name}.obj", track.geometry)
    return folder / "meshes"


@writes("hoi-retarget-clip")
def joints(folder: Path, frames: int) -> Recording:
    own_layout.write(scene("carry_table", frames), folder / "clip.npz")
    return Recording(folder / "clip.npz")


@writes("hoi-retarget-clip, a folder")
def folder_of_joints(folder: Path, frames: int) -> Recording:
    (folder / "clip").mkdir()
    own_layout.write(scene("carry_box", frames), folder / "clip" / "clip.npz")
    return Recording(folder / "clip", main="clip.npz")


@writes("hoi-retarget-clip, parameters")
def parameters(folder: Path, frames: int) -> Recording:
    arrays = own_layout_writer.parameter_arrays(scene("carry_table", frames), "smplx", folder / "models")
    np.savez(folder / "clip.npz", **arrays)
    return Recording(folder / "clip.npz", body_models=folder / "models")


@writes("core4d")
def core4d(folder: Path, frames: int) -> Recording:
    path, models, _ = core4d_writer.write_world(folder, scene("carry_table", frames))
    return Recording(path, body_models=models, main="person1_poses.npz")


@writes("cari4d")
def cari4d(folder: Path, frames: int) -> Recording:
    clip = scene("carry_box", frames)
    models = write_models(folder / "models", clip.people, "smplh", ["male"])
    path = cari4d_writer.write(folder / f"{cari4d_writer.VIDEO}.pth", cari4d_writer.prediction(clip))
    return Recording(path, objects=cari4d_writer.write_mesh(folder / "meshes", clip), body_models=models)


@writes("behave")
def behave(folder: Path, frames: int) -> Recording:
    clip = called(scene("move_chair", frames), behave_writer.CATEGORY)
    behave_writer.write_mesh(folder, clip)
    models = write_models(folder / "models", clip.people, "smplh", [behave_writer.GENDER])
    path = behave_writer.write_files(folder, behave_writer.files_of(clip))
    return Recording(path, body_models=models, main="smpl_fit_all.npz")


@writes("intercap")
def intercap(folder: Path, frames: int) -> Recording:
    seen = intercap_writer.in_camera(called(scene("move_chair", frames), intercap_writer.NAME))
    results, model = intercap_writer.results_of(seen)
    path = intercap_writer.write_results(folder, results)
    intercap_writer.write_saved_mesh(path, seen)
    return Recording(path, body_models=intercap_writer.write_model(folder, model))


@writes("grab")
def grab(folder: Path, frames: int) -> Recording:
    clip = tiled(grab_writer.clip_on_table(), frames)
    members, model = grab_writer.members_of(clip)
    grab_writer.write_tools(folder, clip, model)
    models = grab_writer.write_model(folder / "models", model)
    return Recording(grab_writer.write_members(folder, members), body_models=models)


@writes("interact-canonical")
def interact(folder: Path, frames: int) -> Recording:
    path, models = interact_writer.write_sequence(folder, scene("push_table", frames), "omomo")
    return Recording(path, body_models=models, main="human.npz")


@writes("interact-canonical, of BEHAVE")
def interact_of_behave(folder: Path, frames: int) -> Recording:
    path, models = interact_writer.write_sequence(folder, scene("move_chair", frames), "behave")
    return Recording(path, body_models=models, main="human.npz")


@writes("hodome")
def hodome(folder: Path, frames: int) -> Recording:
    path, models = hodome_writer.write_sequence(folder, scene("drag_suitcase", frames), "subject01_suitcase")
    return Recording(path, body_models=models)


@writes("imhd")
def imhd(folder: Path, frames: int) -> Recording:
    path, models = imhd_writer.write_recording(folder, scene("drag_suitcase", frames))
    return Recording(path, body_models=models)


@writes("omomo")
def omomo(folder: Path, frames: int) -> Recording:
    clip = scene("push_table", frames)
    omomo_writer.write_scan(folder, "largetable_cleaned_simplified", clip.objects[0])
    models = write_models(folder / "models", clip.people, "smplx", ["male"], shapes=16)
    values = omomo_writer.clip_values(clip, "sub3_largetable_007")
    return Recording(omomo_writer.write_clips(folder, [values]), body_models=models)


@writes("humoto")
def humoto(folder: Path, frames: int) -> Recording:
    return Recording(glb_writer.humoto(scene("move_chair", frames)).write(folder / "moving_a_chair-1.glb"))


@writes("parahome")
def parahome(folder: Path, frames: int) -> Recording:
    clip = called(scene("move_chair", frames), "chair_base")
    other = synthetic.make("move_chair", seconds=1.0, height=1.5).people[0]
    models = parahome_writer.write_model(folder / "models", other, clip.people[0])
    path = parahome_writer.write_recording(folder, clip, {f"0 {frames}": "Move the chair"})
    return Recording(path, body_models=models, main="joint_positions.pkl")


@writes("amass")
def amass(folder: Path, frames: int) -> Recording:
    path, models = people_writer.write_amass(folder, scene("carry_box", frames), "smplh")
    return Recording(path, body_models=models)


@writes("bvh")
def bvh(folder: Path, frames: int) -> Recording:
    clip, rig = scene("carry_box", frames), bvh_writer.Rig(bvh_writer.MIXAMO)
    return Recording(bvh_writer.write_person(folder / "walk.bvh", clip, rig))


@writes("soma")
def soma(folder: Path, frames: int) -> Recording:
    return Recording(soma_writer.write_soma(folder / "walk.npz", scene("carry_box", frames)))


@writes("mvnx")
def mvnx(folder: Path, frames: int) -> Recording:
    return Recording(mvnx_writer.write_mvnx(folder / "walk.mvnx", scene("carry_box", frames)))


@writes("hiphi")
def hiphi(folder: Path, frames: int) -> Recording:
    return Recording(actor_writer.write_hiphi(folder, scene("carry_box", frames), "Bringing-carry_0001"))


@writes("omnicontact")
def omnicontact(folder: Path, frames: int) -> Recording:
    return Recording(actor_writer.write_omnicontact(folder, scene("push_table", frames), "2026"))


@writes("gvhmr")
def gvhmr(folder: Path, frames: int) -> Recording:
    path, models = people_writer.write_gvhmr(folder, scene("carry_box", frames))
    return Recording(path, body_models=models)
