"""How well do contacts from geometry agree with the labels that recordings carry?

Every second recording, by name, is for choosing thresholds; the others tell how well that went. Distances are
taken from capsules around the joints, while the recordings' labels come from the body's mesh.
"""

import re
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import tyro
from common import clip_files, pin_threads, show, write_json

from hoi_retarget.clip.clip import Clip, ContactTrack
from hoi_retarget.clip.label_contacts import PROXIMITY, Proximity, label_contacts, part_object_distances, touching
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.human.skeleton import HANDS
from hoi_retarget.readers import read_clip

REACH = 15  # Frames around a recorded edge in which ours is looked for.
TOUCHES = (0.002, 0.004, 0.006, 0.008, 0.010, 0.012, 0.015, 0.020, 0.030)  # [m]


@dataclass(frozen=True)
class Arguments:
    """Label recordings anew and compare."""

    data: Path
    """Folder with recorded clips that have labels."""
    objects: Path
    limit: int | None = None
    """Only so many, spread evenly over their names."""
    json: Path | None = None


@dataclass(frozen=True, eq=False)
class Compared:
    """Both hands of one clip: what is recorded, and what each rule says."""

    name: str
    object: str
    chosen_on: bool
    frames: int
    seconds: float
    recorded: list[np.ndarray]
    by_rule: dict[str, list[np.ndarray]]


def hands(tracks: tuple[ContactTrack, ...]) -> list[np.ndarray]:
    """Return when the first person's left and right hand touch the first object."""
    found = {track.part: track.active for track in tracks if track.person == 0 and track.object == 0}
    return [found[hand] for hand in HANDS]


def compare(clip: Clip, *, chosen_on: bool) -> Compared:
    began = time.perf_counter()
    ours = hands(label_contacts(clip))
    seconds = time.perf_counter() - began
    near = [item for item in part_object_distances(clip) if item.part in HANDS]
    rules: dict[str, Proximity] = {f"{touch * 1000:g} mm": _touch(touch) for touch in TOUCHES}
    rules["no speed limit"] = replace(PROXIMITY, speed=1e6)
    rules["not steadied"] = Proximity(release=PROXIMITY.touch, speed=1e6, gap=0.0, shortest=0.0)
    return Compared(
        name=clip.name,
        object=re.sub(r"\d", "", clip.objects[0].name),
        chosen_on=chosen_on,
        frames=clip.frames,
        seconds=seconds,
        recorded=hands(clip.contacts),
        by_rule={"ours": ours, **{name: touching(clip, near, rule) for name, rule in rules.items()}},
    )


def _touch(touch: float) -> Proximity:
    return Proximity(touch=touch, release=touch + PROXIMITY.release - PROXIMITY.touch)


def f1(clips: list[Compared], rule: str) -> float:
    """Return the harmonic mean of precision and recall over frames of both hands; 1 where nobody touches."""
    pairs = [pair for clip in clips for pair in zip(clip.recorded, clip.by_rule[rule], strict=True)]
    both = sum(int((a & b).sum()) for a, b in pairs)
    either = sum(int(a.sum() + b.sum()) for a, b in pairs)
    return 2 * both / either if either else 1.0


def edge_errors(clips: list[Compared], rule: str, step: int) -> tuple[list[int], int]:
    """Return by how many frames recorded onsets (`step` 1) or releases (-1) are missed, and how many have none near."""
    errors, lost = [], 0
    for clip in clips:
        for recorded, ours in zip(clip.recorded, clip.by_rule[rule], strict=True):
            theirs, found = (np.flatnonzero(np.diff(flags.astype(int)) == step) for flags in (recorded, ours))
            for edge in theirs:
                away = np.abs(found - edge).min() if len(found) else REACH + 1
                if away <= REACH:
                    errors.append(int(away))
                else:
                    lost += 1
    return errors, lost


def edges(clips: list[Compared], rule: str, step: int) -> str:
    errors, lost = edge_errors(clips, rule, step)
    if not errors:
        return f"- ({lost} lost)"
    return f"{np.median(errors):.0f} / {np.quantile(errors, 0.9):.0f} ({lost} of {len(errors) + lost} lost)"


def rows(clips: list[Compared]) -> list[list[str]]:
    groups = {name: [clip for clip in clips if clip.object == name] for name in sorted({clip.object for clip in clips})}
    groups["chosen on"] = [clip for clip in clips if clip.chosen_on]
    groups["others"] = [clip for clip in clips if not clip.chosen_on]
    groups["all"] = clips
    table = []
    for name, members in groups.items():
        if members:
            figures = [f"{f1(members, rule):.3f}" for rule in ("ours", "not steadied")]
            table.append([name, str(len(members)), *figures, edges(members, "ours", 1), edges(members, "ours", -1)])
    return table


def sweep(clips: list[Compared]) -> list[list[str]]:
    halves = [[clip for clip in clips if clip.chosen_on is chosen_on] for chosen_on in (True, False)]
    return [[rule, *(f"{f1(half, rule):.3f}" for half in halves)] for rule in clips[0].by_rule]


def main(arguments: Arguments) -> None:
    files = clip_files(arguments.data, arguments.limit)
    clips = [
        compare(read_clip(path, ReadOptions(objects=arguments.objects)), chosen_on=index % 2 == 0)
        for index, path in enumerate(files)
    ]
    header = ["object", "clips", "F1", "not steadied", "onset median / p90 [frames]", "release"]
    table, thresholds = rows(clips), sweep(clips)
    show("Contacts from geometry against recorded labels, hands", header, table)
    show("F1 by the distance `touch`, release 5 mm farther", ["rule", "chosen on", "others"], thresholds)
    rates = sorted(1000 * clip.seconds / clip.frames for clip in clips)
    show("Time", ["ms a frame, median", "slowest"], [[f"{np.median(rates):.1f}", f"{rates[-1]:.1f}"]])
    write_json(arguments.json, {"agreement": [header, *table], "thresholds": thresholds})


if __name__ == "__main__":
    pin_threads()
    main(tyro.cli(Arguments))
