"""What a page shows of result files: each on its own."""

from dataclasses import replace

import pytest

from hoi_retarget.motion.result_file import save
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.retarget import retarget
from hoi_retarget.studio.share.load_results import load_results
from synthetic import make
from trajectories import MODELS

CLIP = make("carry_box", fps=15.0, seconds=3.0)


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("results")
    motion = retarget(CLIP, MODELS["unitree_g1"], Config())
    for name in ("one.npz", "two.npz"):
        save(motion, folder / name)
    return folder / "one.npz", folder / "two.npz"


def layers(content) -> list[bool]:
    return [shown.clip is not None for _, _, shown in content]


def test_a_damaged_mesh_costs_its_own_result_the_human_and_the_other_nothing(results, tmp_path):
    mesh = tmp_path / "box.obj"
    mesh.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n")
    box = CLIP.objects[0]
    damaged = replace(box, geometry=ObjectGeometry(points=box.geometry.points, mesh_path=mesh))
    clips = iter([replace(CLIP, objects=(damaged,)), CLIP])
    notices = []
    content = load_results(results, notices.append, find_clip=lambda _: next(clips))
    assert layers(content) == [False, True]
    (notice,) = notices
    assert "one.npz" in notice and "box.obj" in notice


def test_what_is_no_result_is_told_and_hides_no_other(results, tmp_path):
    (tmp_path / "bad.npz").write_bytes(b"PK")
    notices = []
    paths = [tmp_path / "bad.npz", tmp_path / "absent.npz", results[0]]
    assert layers(load_results(paths, notices.append, find_clip=lambda _: CLIP)) == [True]
    assert len(notices) == 2
    assert load_results([tmp_path / "absent.npz"], notices.append) == []
