"""`hoi-retarget contacts`: the contacts of a clip as a table, and edits to them."""

import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from hoi_retarget.cli.commands import Contacts
from hoi_retarget.cli.output_checks import check_json, check_writable, write_file, write_json
from hoi_retarget.cli.run_options import to_argv
from hoi_retarget.cli.terminal import program, say, show_table, warn
from hoi_retarget.clip.clip import Clip, Vector, pinned_path
from hoi_retarget.clip.edits import OPERATIONS, ContactEdits, Edit, apply, load, part_text, segments_of, to_text
from hoi_retarget.errors import ArgumentError
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.readers.open import open_clip

ALL = "all"


def execute_contacts(command: Contacts) -> int:
    """Edit a clip's contacts, show them, and write the edits."""
    new = tuple(_edits_in(command))
    if command.out is not None:
        check_writable("--out", command.out.parent)
    check_json(command.json, [command.clip])
    loaded = None if command.edits is None else load(command.edits)
    clip = open_clip(command.clip, command)
    edits = ContactEdits.of(clip) if loaded is None else loaded
    for edit in new:
        edits = edits.adding(edit)
    edited = apply(clip, edits)
    count = len(edits.edits)
    after = f", after {count} edit{'s' if count > 1 else ''}" if count else ""
    say(f"{command.clip}: {clip.frames} frames at {clip.fps:g} frames/s{after}")
    _show(edited)
    _show_pins(edited)
    write_json(command.json, facts(edited))
    if command.out is not None:
        write_file("--out", command.out, to_text(edits).encode())
        say()
        say(f"written: {command.out}")
        words = to_argv(
            {"clips": [str(command.clip)], "out": "results", **command.as_json(), "edits": str(command.out)}
        )
        say(f"to run: {program()} {shlex.join(words)}")
    return 0


def facts(clip: Clip) -> dict[str, object]:
    """Return the contacts of a clip as plain JSON values; points are in the object's frame [m]."""
    contacts = [
        {
            **{"person": item.person, "part": item.part, "object": clip.objects[item.object].name},
            **{"start": item.start, "stop": item.stop, "spread": item.spread, "points": item.points.tolist()},
            **{"hold": item.hold + 1, "turn": list(item.turn)},
        }
        for item in segments_of(clip)
    ]
    pins = [asdict(pin) for pin in clip.pins]
    return {"clip": clip.name, "frames": clip.frames, "fps": clip.fps, "contacts": contacts, "pins": pins}


def _show(clip: Clip) -> None:
    segments = segments_of(clip)
    if not segments:
        say("Nothing is touched.")
        return
    surfaces = {index: surface_of(clip.objects[index].geometry) for index in {item.object for item in segments}}
    several = len(clip.people) > 1
    header = ("part", "object", "frames", "seconds", "spread [mm]", "to surface [mm]")
    rows = [
        (
            segment.part,
            clip.objects[segment.object].name,
            f"{segment.start} to {segment.stop - 1}",
            f"{segment.frames / clip.fps:.2f}",
            f"{1e3 * segment.spread:.1f}",
            f"{1e3 * float(np.mean(surfaces[segment.object].distances(segment.points))):.1f}",
        )
        for segment in segments
    ]
    if several:
        header = ("person", *header)
        rows = [(f"p{segment.person}", *row) for segment, row in zip(segments, rows, strict=True)]
    show_table([header, *rows], words=range(several + 2))
    for segment in segments:
        if segment.hold or any(segment.turn):
            turn = " ".join(f"{angle:.1f}" for angle in segment.turn)
            say(f"{part_text(segment.person, segment.part)}, {segment}: hold {segment.hold + 1}, turned by {turn} deg")
    seconds = sum(segment.frames for segment in segments) / clip.fps
    spread = 1e3 * max(segment.spread for segment in segments)
    say(f"{len(segments)} contacts, {seconds:.2f} s in all; the farthest point is {spread:.1f} mm from its mean.")
    for index, surface in sorted(surfaces.items()):
        if not surface.exact:
            warn(f"object {clip.objects[index].name!r}: no mesh is known; its surface is the hull of its points.")


def _show_pins(clip: Clip) -> None:
    if not clip.pins:
        return
    rows = [("pinned", "frame", "place [m]", "turned [deg]", "from recording [mm]")]
    for pin in clip.pins:
        away = np.linalg.norm(pinned_path(clip.people[pin.person], pin.part)[pin.frame] - pin.position)
        place, turn = (
            "free" if vector is None else " ".join(f"{number:.{digits}f}" for number in vector)
            for vector, digits in ((pin.position, 3), (pin.turn, 1))
        )
        rows.append((part_text(pin.person, pin.part), f"{pin.frame}", place, turn, f"{1e3 * away:.0f}"))
    say()
    show_table(rows, words=(0,))


def _edits_in(command: Contacts) -> Iterator[Edit]:
    """Yield the edits in the order of the options in `Contacts`: when something touches before where it does."""
    for option, form, operation, fields in _OPTIONS:
        for word in getattr(command, option.removeprefix("--").replace("-", "_")):
            all_of_them = _KINDS.get(f"{operation}_all") if word == ALL else None
            try:
                yield all_of_them() if all_of_them else _edit(operation, form, fields, word)
            except ArgumentError as error:
                raise ArgumentError(f"{option} {word}: {error}") from error
            except ValueError as error:
                raise ArgumentError(f"{option} {word}: expected {form}.") from error


def _edit(operation: str, form: str, fields: Sequence[Callable[[str], Any]], word: str) -> Edit:
    """Return the edit that a word describes, or raise `ValueError`: too few fields, too many, or no numbers."""
    # An object's name may have colons in it.
    named, *texts = word.split(":", len(fields) if fields[-1] is str else -1)
    if not len(fields) - ("[" in form) <= len(texts) <= len(fields):
        raise ValueError
    person, dot, part = named.partition(".")
    if not (dot and person.startswith("p")):
        person, part = "p0", named
    values = [field(text) for field, text in zip(fields, texts, strict=False)]
    return _KINDS[operation](part, *values, person=int(person[1:]))


def _point(word: str) -> Vector:
    x, y, z = (float(number) for number in word.split(","))
    return (x, y, z)


_KINDS: Mapping[str, Callable[..., Edit]] = OPERATIONS
_OPTIONS: tuple[tuple[str, str, str, Sequence[Callable[[str], Any]]], ...] = (
    ("--delete", "PART:FRAME", "delete", (int,)),
    ("--merge", "PART:FRAME", "merge", (int,)),
    ("--split", "PART:FRAME:AT", "split", (int, int)),
    ("--retime", "PART:FRAME:START:STOP", "retime", (int, int, int)),
    ("--add", "PART:START:STOP:X,Y,Z[:OBJECT]", "add", (int, int, _point, str)),
    ("--fix-segments", "all or PART:FRAME", "fix", (int,)),
    ("--snap", "all or PART:FRAME", "snap", (int,)),
    ("--move", "PART:FRAME:DX,DY,DZ", "move", (int, _point)),
    ("--turn", "PART:FRAME:RX,RY,RZ", "turn_hand", (int, _point)),
    ("--hold", "PART:FRAME:RANK", "choose_hold", (int, int)),
    ("--unpin", "PART:FRAME", "unpin", (int,)),
    ("--pin", "PART:FRAME:X,Y,Z[:RX,RY,RZ]", "pin", (int, _point, _point)),
)
"""Option, form of its words (the last field in brackets may be left out), operation, and readers of its fields."""
