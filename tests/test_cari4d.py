"""CARI4D's reconstructions: what is written is read, each convention matters, nothing is executed or guessed."""

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import cari4d_writer as writer
from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ArgumentError, BodyModelError, ClipError, GeometryError, ReadError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.files.torch_file import parse_torch
from hoi_retarget.human.skeleton import FEET, HANDS
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.readers import can_be_clip, cari4d, read_clip, reader_of
from source_people import assert_same_objects, assert_same_people, body_values, write_models
from synthetic import make
from torch_writer import archive, torch_entries

CLIP = make("carry_box", seconds=4.5)
GENDERS = ("male", "female", "neutral")


@pytest.fixture(scope="module")
def models(tmp_path_factory) -> Path:
    return write_models(tmp_path_factory.mktemp("models"), CLIP.people, "smplh", GENDERS)


@pytest.fixture(scope="module")
def meshes(tmp_path_factory) -> Path:
    return writer.write_mesh(tmp_path_factory.mktemp("meshes"), CLIP)


def with_shape(clip: Clip, points: np.ndarray) -> Clip:
    track = clip.objects[0]
    return replace(clip, objects=(replace(track, geometry=ObjectGeometry(points, faces=track.geometry.faces)),))


# Bodies with a corner that moves the mean away from the middle of the box.
LOPSIDED = with_shape(
    CLIP, CLIP.objects[0].geometry.points + np.where(np.arange(len(CLIP.objects[0].geometry.points))[:, None], 0, 0.04)
)


# What is written is read


def test_a_video_is_read_as_it_was_written(tmp_path, models):
    centre = LOPSIDED.objects[0].geometry.points.mean(axis=0)
    path = writer.write(tmp_path / f"{writer.VIDEO}.pth", writer.prediction(LOPSIDED, centre=centre))
    objects = writer.write_mesh(tmp_path / "meshes", LOPSIDED, offset=(0.3, -0.2, 0.1))
    clip = read_clip(path, ReadOptions(objects=objects, body_models=models))
    assert_same_people(clip, LOPSIDED)
    assert_same_objects(clip, LOPSIDED)
    assert (clip.name, clip.fps, clip.frames) == (writer.VIDEO, 30.0, LOPSIDED.frames)
    assert (clip.source.format, clip.source.licence) == (cari4d.FORMAT, cari4d.LICENCE)
    assert any("taken as 30 frames a second" in note for note in clip.source.notes)
    assert any("mean of its vertices" in note for note in clip.source.notes)
    assert any("taken to be level" in note for note in clip.source.notes)
    assert not cari4d.READER.floor_at_zero


def test_contacts_are_those_of_the_hands_at_their_own_places(tmp_path, models, meshes):
    path = writer.write(tmp_path / f"{writer.VIDEO}.pth", writer.prediction(CLIP))
    clip = read_clip(path, ReadOptions(objects=meshes, body_models=models))
    tracks = {track.part: track for track in clip.contacts}
    assert set(tracks) == {*HANDS, *FEET}
    for part in HANDS:
        true = next(track for track in CLIP.contacts if track.part == part)
        assert np.array_equal(tracks[part].active, true.active)
        own = clip.objects[0].to_object(clip.people[0].part_position(part))
        # The object's origin is the mean of the mesh's vertices, which is that of the box.
        np.testing.assert_allclose(tracks[part].contact_points[true.active], own[true.active], atol=1e-12)
        np.testing.assert_allclose(own[true.active], true.contact_points[true.active], atol=0.06)
    assert not any(tracks[part].active.any() for part in FEET)


def test_left_and_right_scores_are_not_exchanged(tmp_path, models, meshes):
    values = writer.prediction(CLIP)
    values["contact_logits"] = np.stack([np.full(CLIP.frames, 0.1), np.full(CLIP.frames, -0.1)], axis=1)
    clip = read_clip(
        writer.write(tmp_path / "a_Sub01_box.pth", values), ReadOptions(objects=meshes, body_models=models)
    )
    assert {track.part: bool(track.active.all()) for track in clip.contacts if track.part in HANDS} == {
        "left_hand": True,
        "right_hand": False,
    }


def test_without_scores_contacts_are_left_to_others(tmp_path, models, meshes):
    for index, change in enumerate(({}, {"contact_logits": np.zeros((CLIP.frames, 2))})):
        values = {key: value for key, value in writer.prediction(CLIP).items() if key != "contact_logits"} | change
        clip = read_clip(
            writer.write(tmp_path / f"{index}.pth", values), ReadOptions(objects=meshes, body_models=models)
        )
        assert clip.contacts == ()
        assert "The file has no scores of contacts." in clip.source.notes


def test_the_optimization_rests_hands_in_the_models_mean(tmp_path, models, meshes):
    values = body_values(CLIP.people, "smplh")
    path = writer.write(tmp_path / "optimized.pth", writer.prediction(CLIP, hands=values))
    clip = read_clip(path, ReadOptions(objects=meshes, body_models=models))
    hand = slice(22, 52)
    np.testing.assert_allclose(
        clip.people[0].joint_positions[:, :22], CLIP.people[0].joint_positions[:, :22], atol=1e-6
    )
    local = se3.quat_multiply(se3.quat_conjugate(clip.people[0].quat("left_wrist")), clip.people[0].quat("left_index1"))
    mean = se3.exp(np.tile(values["hands_meanl"][:3], (clip.frames, 1)))
    assert se3.angle_between(local, mean).max() < 1e-6
    assert np.abs(clip.people[0].joint_positions[:, hand] - CLIP.people[0].joint_positions[:, hand]).max() > 0.005
    assert any("Hands are not stored" in note for note in clip.source.notes)


@pytest.mark.parametrize(
    ("folder", "name", "gender"),
    [
        (".", "Date03_Sub06_box_lift", "female"),
        (".", "Date03_Sub05_box_lift", "male"),
        ("neutral", "kitchen_box", "neutral"),
        (".", "kitchen_box_female", "female"),
    ],
)
def test_the_gender_is_told_by_names(tmp_path, meshes, folder, name, gender):
    only = write_models(tmp_path / "models", CLIP.people, "smplh", [gender])
    values = writer.prediction(CLIP, sequence=name)
    path = writer.write(tmp_path / folder / "result.pth", values)
    objects = writer.write_mesh(tmp_path / "meshes", CLIP, sequence=name)
    named = {} if "Sub" in name else {"object_name": "box"}
    clip = read_clip(path, ReadOptions(objects=objects, body_models=only, **named))
    assert f"The body is {gender}, as names tell." in clip.source.notes
    assert clip.objects[0].name == "box"


def test_a_sequence_of_behave_has_its_own_rate_and_mesh_frame(tmp_path, models):
    for fps in (30.0, 1.0):
        values = writer.prediction(LOPSIDED, sequence=writer.BEHAVE)
        values["frames"] = writer.time_names(writer.BEHAVE, LOPSIDED.frames, fps)
        path = writer.write(tmp_path / "behave.pth", values)
        objects = writer.write_mesh(tmp_path / "meshes", LOPSIDED, sequence=writer.BEHAVE)
        clip = read_clip(path, ReadOptions(objects=objects, body_models=models))
        assert clip.fps == fps
        assert_same_objects(clip, LOPSIDED)
    # Read as a video's, whose mesh is centred, the box would be elsewhere.
    values["frames"] = writer.index_names(writer.BEHAVE, LOPSIDED.frames)
    clip = read_clip(writer.write(path, values), ReadOptions(objects=objects, body_models=models))
    with pytest.raises(AssertionError):
        assert_same_objects(clip, LOPSIDED)


def test_every_other_frame_of_a_video_halves_the_rate(tmp_path, models, meshes):
    values = writer.prediction(CLIP)
    values["frames"] = [f"{writer.VIDEO}/{2 * index:06d}" for index in range(CLIP.frames)]
    clip = read_clip(writer.write(tmp_path / "a.pth", values), ReadOptions(objects=meshes, body_models=models))
    assert clip.fps == 15.0


def test_a_shape_that_varies_is_that_of_each_frame(tmp_path, models, meshes):
    values = writer.prediction(CLIP)
    values["betas"] = values["betas"] + np.where(np.arange(CLIP.frames)[:, None] % 2, 0.5, 0.0)
    clip = read_clip(writer.write(tmp_path / "a.pth", values), ReadOptions(objects=meshes, body_models=models))
    off = np.abs(clip.people[0].joint_positions - CLIP.people[0].joint_positions).max(axis=(1, 2))
    assert off[::2].max() < 1e-6
    assert off[1::2].min() > 1e-3
    assert any("betas change by up to 0.5" in note for note in clip.source.notes)


def test_meshes_are_found_as_cari4d_names_them(tmp_path, models):
    path = writer.write(tmp_path / f"{writer.VIDEO}.pth", writer.prediction(CLIP))
    for folder in (
        f"{writer.VIDEO}_000_align",
        f"{writer.VIDEO}_t0003.000_k1_rgba",
        f"{writer.VIDEO}.0.color.mp4_012_rgba",
    ):
        objects = tmp_path / folder[-12:]
        source = writer.write_mesh(tmp_path / "written", CLIP)
        (objects / folder).mkdir(parents=True)
        mesh = next(source.glob("*/*_align.obj"))
        (objects / folder / "x_align.obj").write_bytes(mesh.read_bytes())
        assert read_clip(path, ReadOptions(objects=objects, body_models=models)).objects[0].geometry.faces is not None
    # Beside the recording, or in the plain layout.
    writer.write_mesh(tmp_path, CLIP)
    assert_same_objects(read_clip(path, ReadOptions(body_models=models)), CLIP)
    (tmp_path / "plain" / "box").mkdir(parents=True)
    (tmp_path / "plain" / "box" / "box.obj").write_bytes(mesh.read_bytes())
    assert_same_objects(read_clip(path, ReadOptions(objects=tmp_path / "plain", body_models=models)), CLIP)


def test_the_mesh_of_a_sequence_with_a_longer_name_is_not_taken(tmp_path, models):
    path = writer.write(tmp_path / f"{writer.VIDEO}.pth", writer.prediction(CLIP))
    for other in (f"{writer.VIDEO}1", f"{writer.VIDEO}_hand"):
        writer.write_mesh(tmp_path / "meshes", CLIP, sequence=other)
    with pytest.raises(GeometryError, match="there is no mesh"):
        read_clip(path, ReadOptions(objects=tmp_path / "meshes", body_models=models))


def test_a_mesh_without_its_true_size_is_doubted(tmp_path, models):
    points = CLIP.objects[0].geometry.points
    large = with_shape(CLIP, points * 2.0 / np.ptp(points, axis=0).max())
    path = writer.write(tmp_path / f"{writer.VIDEO}.pth", writer.prediction(CLIP))
    clip = read_clip(path, ReadOptions(objects=writer.write_mesh(tmp_path, large), body_models=models))
    assert any("metric meshes" in note for note in clip.source.notes)


def test_the_outline_needs_neither_meshes_nor_models(tmp_path):
    path = writer.write(tmp_path / f"{writer.VIDEO}.pth", writer.prediction(CLIP))
    file = SourceFile(path)
    assert reader_of(file) is cari4d.READER
    assert can_be_clip(path)
    facts = cari4d.READER.outline(file)
    assert (facts.frames, facts.fps, facts.fps_stated, facts.people) == (CLIP.frames, 30.0, False, 1)
    assert (facts.skeleton, facts.objects) == ("SMPL-H male, 10 betas", ("box",))
    assert facts.contacts == "scores of the hands"


# Nothing is executed


def test_the_training_state_is_passed_over_and_no_other_object_is_built(tmp_path):
    value = parse_torch(writer.encoded(writer.prediction(CLIP)), Path("a.pth"))
    assert value["pr"]["train_state"] == {}
    assert value["pr"]["optimizer"] is None


TRAIN_STATE = b"clearning.training.training_utils\nTrainState\n"


@pytest.mark.parametrize(
    ("program", "words"),
    [
        (b"\x80\x02" + TRAIN_STATE + b".", "no value but the name"),
        (b"\x80\x02]" + TRAIN_STATE + b"a.", "no value but the name"),
        (b"\x80\x02" + TRAIN_STATE + b")R.", "not a function"),
        (b"\x80\x02" + TRAIN_STATE + b"K\x01\x85\x81.", "builds an object"),
        (b"\x80\x02ccollections\nOrderedDict\n)\x81.", "builds an object"),
        (b"\x80\x02cos\nsystem\n)\x81.", "wants to import os.system"),
        (b"\x80\x02clearning.training.training_utils\nTrainer\n)\x81.", "wants to import learning"),
        (b"\x80\x02Nb.", "not there"),
        (b"\x80\x02K\x01}b.", "not an open container"),
    ],
)
def test_programs_around_the_training_state_are_refused(program, words):
    entries = torch_entries([]) | {"clip/data.pkl": program}
    with pytest.raises(ReadError, match=words):
        parse_torch(archive(entries), Path("a.pth"))


def test_a_state_of_anything_that_runs_is_refused(tmp_path):
    class Runs:
        def __reduce__(self):
            return Path.touch, (tmp_path / "executed",)

    state = writer.TrainState()
    vars(state)["step"] = Runs()
    values = writer.prediction(CLIP) | {"train_state": state}
    with pytest.raises(ReadError, match="wants to import"):
        parse_torch(writer.encoded(values), Path("a.pth"))
    assert not (tmp_path / "executed").exists()


# What is wrong has one error


def changed(name, change):
    return lambda values: values | {name: change(values[name])}


def without(name):
    return lambda values: {key: value for key, value in values.items() if key != name}


def with_nan(values):
    values = np.array(values, dtype=float)
    values.reshape(len(values), -1)[3, 0] = np.nan
    return values


MISTAKES = {
    "NaN in the pose": (changed("smpl_pose", with_nan), "pr/smpl_pose.* not finite"),
    "NaN in the object's pose": (changed("pose_abs", with_nan), "not finite"),
    "NaN in the scores": (changed("contact_logits", with_nan), "not finite"),
    "another width of pose": (changed("smpl_pose", lambda a: a[:, :69]), "69 numbers a frame, expected 72"),
    "SMPL-X's width of pose": (changed("smpl_pose", lambda a: np.pad(a, ((0, 0), (0, 9)))), "165 numbers a frame"),
    "other betas": (changed("betas", lambda a: np.pad(a, ((0, 0), (0, 6)))), "pr/betas.* expected"),
    "frames that disagree": (changed("pose_abs", lambda a: a[:-1]), "pr/pose_abs.* has shape"),
    "scores of another kind": (changed("contact_logits", lambda a: a[:, :1]), "pr/contact_logits.* has shape"),
    "scaled poses": (changed("pose_abs", lambda a: a * [[2.0], [2.0], [2.0], [1.0]]), "pr/pose_abs is no rotation"),
    "transposed matrices": (changed("pose_abs", lambda a: a.transpose(0, 2, 1)), "last row"),
    "no frames": (without("frames"), "pr/frames is no list"),
    "frames of numbers": (changed("frames", lambda a: list(range(len(a)))), "pr/frames is no list"),
    "few frames": (changed("frames", lambda a: a[:3]), "3 frame"),
    "a gap in the video": (
        changed("frames", lambda a: [*a[:9], *(f"{writer.VIDEO}/{i + 40:06d}" for i in range(len(a) - 9))]),
        "000008 is followed by 000040",
    ),
    "frames backwards": (changed("frames", lambda a: a[::-1]), "do not follow"),
    "frames called otherwise": (changed("frames", lambda a: [f"{name}.png" for name in a]), "expected times such as"),
    "frames of two videos": (changed("frames", lambda a: ["other/000000", *a[1:]]), "several videos"),
    "a name that leaves the folder": (changed("frames", lambda a: [f"{'x' * 9}\\/{n[-6:]}" for n in a]), "plain name"),
    "another up axis": (
        changed(
            "smpl_pose",
            lambda a: np.concatenate(
                [se3.log(se3.quat_multiply(se3.exp(np.array([[np.pi, 0, 0]])), se3.exp(a[:, :3]))), a[:, 3:]], axis=1
            ),
        ),
        "stands along -z",
    ),
    "no gender": (changed("frames", lambda a: [f"Date03_Sub11_box/{n[-6:]}" for n in a]), "nothing tells which body"),
    "two genders": (changed("frames", lambda a: [f"Date03_Sub01_female/{n[-6:]}" for n in a]), "contradict"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_every_mistake_has_one_error(tmp_path, models, meshes, name):
    change, words = MISTAKES[name]
    path = writer.write(tmp_path / "clip.pth", change(writer.prediction(CLIP)))
    with pytest.raises((ClipError, ReadError), match=words) as caught:
        read_clip(path, ReadOptions(objects=meshes, body_models=models))
    assert str(path) in str(caught.value)


def test_missing_companions_and_options(tmp_path, models, meshes):
    path = writer.write(tmp_path / f"{writer.VIDEO}.pth", writer.prediction(CLIP))
    with pytest.raises(BodyModelError, match="male SMPL-H body model"):
        read_clip(path, ReadOptions(objects=meshes))
    with pytest.raises(GeometryError, match=r"_align\.obj.*box\.obj"):
        read_clip(path, ReadOptions(body_models=models))
    with pytest.raises(GeometryError, match="cannot be read"):
        read_clip(path, ReadOptions(objects=tmp_path / "absent", body_models=models))
    with pytest.raises(ArgumentError, match="Leave the option out"):
        read_clip(path, ReadOptions(objects=meshes, body_models=models, object_name="crate"))
    with pytest.raises(ReadError, match="there is no male smplh model"):
        read_clip(
            path,
            ReadOptions(objects=meshes, body_models=write_models(tmp_path / "f", CLIP.people, "smplh", ["female"])),
        )
    unnamed = writer.write(tmp_path / "male" / "clip.pth", writer.prediction(CLIP, sequence="kitchen"))
    with pytest.raises(GeometryError, match="Pass --object NAME"):
        read_clip(unnamed, ReadOptions(objects=meshes, body_models=models))
    for name in ("../box", "a/b"):
        with pytest.raises(ReadError, match="no plain name"):
            read_clip(unnamed, ReadOptions(objects=meshes, body_models=models, object_name=name))
    with pytest.raises(ReadError, match="has 55 joints, as smplx has"):
        folder = write_models(tmp_path / "x", CLIP.people, "smplx", ["male"])
        (folder / "SMPLX_MALE.npz").rename(folder / "SMPLH_MALE.npz")
        read_clip(path, ReadOptions(objects=meshes, body_models=folder))


def test_other_torch_files_are_not_taken(tmp_path):
    for value in ({"pr": None}, {"pr": {"frames": []}}, [1], {"data": np.zeros((3, 591))}):
        path = tmp_path / "other.pth"
        path.write_bytes(archive(torch_entries(value)))
        assert not cari4d.holds(SourceFile(path))
    path.write_bytes(pickle.dumps({"pr": {}}))
    with pytest.raises(ReadError):
        cari4d.holds(SourceFile(path))
