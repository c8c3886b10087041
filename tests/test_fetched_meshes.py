"""The maker's meshes: what their digests say or nothing at all, and in every picture from then on."""

import hashlib
import subprocess
import zipfile
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import trimesh

from hoi_retarget.cli import main
from hoi_retarget.cli import robots as robots_command
from hoi_retarget.errors import ReadError
from hoi_retarget.robots import ROBOTS, fetched_meshes, load_robot, robot
from hoi_retarget.robots.fetched_meshes import (
    SOURCES,
    MeshSource,
    fetch_meshes,
    mesh_names,
    read_repository,
    read_wheel,
)
from hoi_retarget.studio.scene.drawing import Solid
from hoi_retarget.studio.scene.robot_shapes import robot_parts

G1 = ROBOTS["unitree_g1"]
NAMES = mesh_names(G1)
BALL = trimesh.creation.icosphere(subdivisions=5, radius=0.05)
CONTENT = trimesh.exchange.stl.export_stl(BALL)
INSIDE = "some/assets/"


@pytest.fixture
def robots(tmp_path, monkeypatch):
    monkeypatch.setenv("HOI_RETARGET_ROBOTS", str(tmp_path / "robots"))
    return tmp_path / "robots"


def files_in(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def in_wheel(monkeypatch, tmp_path, names=NAMES, **changes):
    """Let the G1's meshes come from a wheel that pip has, and return pip's commands."""
    path, commands = tmp_path / "it.whl", []
    with zipfile.ZipFile(path, "w") as archive:
        for name in names:
            archive.writestr(INSIDE + name, CONTENT)
        archive.writestr("some/code.py", "raise SystemExit")
        archive.writestr("../outside.STL", CONTENT)

    def run(command, **_):
        commands.append(command)
        (Path(command[command.index("--dest") + 1]) / "it.whl").write_bytes(path.read_bytes())
        return subprocess.CompletedProcess(command, 0, "", "")

    monkeypatch.setattr(subprocess, "run", run)
    wheel = {"sha256": hashlib.sha256(path.read_bytes()).hexdigest(), "folder": INSIDE} | changes
    source = MeshSource("it 1.0 of a test", "some terms", lambda names: read_wheel("it==1.0", **wheel, names=names))
    monkeypatch.setattr(fetched_meshes, "SOURCES", dict(SOURCES) | {G1.name: source})
    return commands


def drawn():
    model = load_robot("unitree_g1")
    return robot_parts(model, model.forward(model.home_qpos[None]), None)


def test_pictures_show_them_from_then_on_until_they_are_removed(robots, monkeypatch, tmp_path, capsys):
    own = [type(part) for part in drawn()]
    assert Solid not in own
    commands = in_wheel(monkeypatch, tmp_path)
    assert main(["robots", "meshes", "g1"]) == 0
    said = capsys.readouterr().out
    assert "it 1.0" in said and "Terms: some terms." in said
    assert {"--no-deps", "--only-binary=:all:", "it==1.0"} <= set(commands[0])
    assert files_in(robots) == sorted(f"unitree_g1/meshes/{name}" for name in (*NAMES, "LICENCE.txt"))
    solids = drawn()
    assert len(solids) == len(NAMES)
    for solid in solids:
        assert isinstance(solid, Solid)
        assert len(solid.faces) <= 2500 < len(BALL.faces), "made coarser"
        np.testing.assert_allclose(
            np.linalg.norm(solid.vertices - solid.vertices.mean(axis=0), axis=1), 0.05, atol=2e-3
        )
    assert main(["robots", "list"]) == 0, "they are no robot"
    assert capsys.readouterr().out.count("unitree_g1 ") == 1
    assert main(["robots", "meshes", "g1", "--remove"]) == 0
    assert [type(part) for part in drawn()] == own
    assert files_in(robots) == []


@pytest.mark.parametrize(
    ("names", "changes", "says"),
    [
        (NAMES, {"sha256": "0" * 64}, "its SHA-256 is"),
        (NAMES[1:], {}, "not the archive that was expected"),
        (NAMES, {"folder": "elsewhere/"}, "not the archive that was expected"),
    ],
)
def test_another_wheel_leaves_nothing_behind(robots, monkeypatch, tmp_path, capsys, names, changes, says):  # noqa: PLR0917
    in_wheel(monkeypatch, tmp_path, names, **changes)
    assert main(["robots", "meshes", "g1"]) == 1
    error = capsys.readouterr().err
    assert says in error and error.count("\n") == 1
    assert not robots.exists()


def test_without_network_there_is_one_clear_error(robots, monkeypatch, capsys):
    monkeypatch.setattr(
        subprocess, "run", lambda command, **_: subprocess.CompletedProcess(command, 1, "", "ERROR: No matching one")
    )
    monkeypatch.setattr(fetched_meshes, "urlopen", lambda *_, **__: (_ for _ in ()).throw(OSError("no route")))
    for name, says in (("g1", "No matching one. Check the network."), ("h2", "no route). Check the network, or name")):
        assert main(["robots", "meshes", name]) == 1
        error = capsys.readouterr().err
        assert says in error and error.count("\n") == 1
    assert not robots.exists()


def test_files_of_a_repository_are_what_their_digests_say(robots, tmp_path):
    own = tmp_path / "repository"
    own.mkdir()
    for name in NAMES:
        (own / name).write_bytes(CONTENT)
    digests = tmp_path / "digests"
    digests.write_text("".join(f"{hashlib.sha256(CONTENT).hexdigest()}  {name}\n" for name in NAMES))
    read = partial(read_repository, own.as_uri() + "/", digests)
    fetch_meshes(G1, read, "terms")
    assert fetched_meshes.fetched_meshes(G1) == robots / "unitree_g1" / "meshes"
    (own / NAMES[-1]).write_bytes(CONTENT[:-1] + b"x")
    fetched_meshes.remove_meshes(G1)
    with pytest.raises(ReadError, match=rf"{NAMES[-1]}: its SHA-256"):
        fetch_meshes(G1, read, "terms")
    assert fetched_meshes.fetched_meshes(G1) is None
    assert files_in(robots) == []


def test_folder_of_the_user_is_taken_whole_or_not_at_all(robots, tmp_path, capsys):
    own = tmp_path / "checkout" / "deep"
    own.mkdir(parents=True)
    for name in NAMES[1:]:
        (own / name).write_bytes(CONTENT)
    assert main(["robots", "meshes", "g1", "--folder", str(own.parent)]) == 1
    assert f"1 mesh files are not there: {NAMES[0]}" in capsys.readouterr().err
    (own / NAMES[0]).write_bytes(b"solid nothing")
    assert main(["robots", "meshes", "g1", "--folder", str(own.parent)]) == 1
    assert f"{NAMES[0]} of Unitree G1, 29 joints: it has no surface" in capsys.readouterr().err
    assert not robots.exists()
    (own / NAMES[0]).write_bytes(CONTENT)
    assert main(["robots", "meshes", "g1", "--folder", str(own.parent)]) == 0


@pytest.mark.parametrize("name", SOURCES)
def test_each_mesh_has_its_digest(name):
    read = SOURCES[name].read
    assert isinstance(read, partial)
    if read.func is read_repository:
        address, digests = read.args
        lines = [line.split() for line in digests.read_text().splitlines()]
        assert {file for _, file in lines} >= set(mesh_names(robot(name)))
        assert all(len(bytes.fromhex(digest)) == 32 for digest, _ in lines)
        assert address.startswith("https://")
    else:
        assert len(bytes.fromhex(read.args[1])) == 32


def test_the_demo_fetches_them_once_and_goes_on_without_a_network(robots, monkeypatch, tmp_path, capsys):
    asked = []

    def read(names):
        asked.append(names)
        if len(asked) == 1:
            raise ReadError("no network.")
        return dict.fromkeys(names, CONTENT)

    monkeypatch.setattr(fetched_meshes, "SOURCES", {"unitree_g1": MeshSource("a place", "some terms", read)})
    robots_command.fetch_look_once(G1)
    assert "plainer robot: no network." in capsys.readouterr().err and not files_in(tmp_path)
    for _ in range(2):
        robots_command.fetch_look_once(G1)
    assert len(asked) == 2 and fetched_meshes.fetched_meshes(G1) is not None
    assert capsys.readouterr().out.count("some terms") == 1
