"""Two people, two robots, in one world: do they hold one object as the people did, and keep out of each other?

Recordings of two people are not at hand. One built-in clip has two people who carry a table. In others, two recorded
people are put into one world, the second turned by half, shifted until their joints are as near as asked.

    python benchmarks/pairs.py --data ../shared/data/omomo --objects ../shared/data/objects
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from common import pin_threads, show, write_json

import synthetic
from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.motion.motion import Motion
from hoi_retarget.numerics import se3
from hoi_retarget.readers.open import open_clip
from hoi_retarget.retargeting.config import Config, Scaling
from hoi_retarget.retargeting.retarget import retarget, retarget_people
from hoi_retarget.robots import load_robot, team
from hoi_retarget.robots.link_depths import robot_depths
from hoi_retarget.robots.model import RobotModel
from short_clips import taken

TEAMS = ("unitree_g1", "unitree_h2", "unitree_h2,unitree_g1")
TOGETHER = (
    ("sub3_largebox_003", "sub8_suitcase_002"),
    ("sub8_smallbox_000", "sub8_smallbox_002"),
    ("sub2_largetable_000", "sub8_largebox_001"),
)
SUNK = 5e-3


@dataclass(frozen=True)
class Arguments:
    """Retarget two people to two robots."""

    data: Path | None = None
    """Folder with OMOMO's clips; without it, the built-in clip alone."""
    objects: Path | None = None
    near: float = 0.04
    """Smallest distance of the joints of two recorded people put into one world [m]."""
    json: Path | None = None


def in_one_world(first: Clip, second: Clip, near: float) -> Clip:
    """Return two clips as one, the second turned by half about the vertical and put beside the first along x."""
    frames = np.arange(min(first.frames, second.frames))
    first, second = taken(first, frames), taken(second, frames)
    half = np.array([0.0, 0.0, 0.0, 1.0])
    here, there = (clip.people[0].joint_positions for clip in (first, second))
    # Hands of both are held ahead; where the first ones are nearest, the second ones shall be.
    middle = len(frames) // 2
    turned = se3.rotate(half, there)
    shift = (here[middle].mean(axis=0) - turned[middle].mean(axis=0)) * [1.0, 1.0, 0.0]
    outside, inside = 3.0, 0.0
    for _ in range(30):
        along = 0.5 * (outside + inside)
        apart = nearest(here, turned + shift + [along, 0.0, 0.0])
        outside, inside = (along, inside) if apart > near else (outside, along)
    offset = shift + np.array([outside, 0.0, 0.0])
    person = second.people[0]
    moved = replace(
        person, name="second", joint_positions=turned + offset, joint_quats=se3.quat_multiply(half, person.joint_quats)
    )
    objects = [
        replace(
            track,
            name=f"second_{track.name}",
            positions=se3.rotate(half, track.positions) + offset,
            quats=se3.quat_multiply(half, track.quats),
        )
        for track in second.objects
    ]
    contacts = [replace(track, person=1, object=track.object + len(first.objects)) for track in second.contacts]
    return replace(
        first,
        name=f"{first.name} and {second.name}",
        people=(first.people[0], moved),
        objects=(*first.objects, *objects),
        contacts=(*first.contacts, *contacts),
    )


def nearest(one: np.ndarray, other: np.ndarray) -> float:
    """Return the smallest distance of two people's joints over all frames [m]."""
    return min(float(np.linalg.norm(a[:, None] - b[None], axis=-1).min()) for a, b in zip(one, other, strict=True))


def depth(motions: tuple[Motion, ...], models: list[RobotModel]) -> tuple[float, int]:
    """Return how deep robots are in each other [m], and in how many frames more than 5 mm."""
    depths, _ = robot_depths(*(model.forward(motion.qpos) for motion, model in zip(motions, models, strict=True)))
    deepest = depths.max(axis=0, initial=0.0)
    return float(deepest.max()), int((deepest > SUNK).sum())


def measured(clip: Clip, robots: str, config: Config) -> dict[str, Any]:
    """Return what two robots do together, and how deep they would be in each other if each were solved alone."""
    specs = team(robots)
    models = [load_robot(spec.name) for spec in (specs * 2)[:2]]
    motions = retarget_people(clip, models, config)
    errors = motions[0].report.inter_robot_hand_errors
    before: tuple[float | None, int | None] = (None, None)
    if len({model.spec.name for model in models}) == 1:  # Robots of two kinds share a scaling made for both.
        alone = tuple(retarget(clip, model, config, person=person) for person, model in enumerate(models))
        before = depth(alone, models)
    after = depth(motions, models)
    figures = [motion.report.figures for motion in motions]
    return {
        "clip": clip.name,
        "robots": robots,
        "frames": clip.frames,
        "in_step": all(np.array_equal(motions[0].object_pos, motion.object_pos) for motion in motions),
        "depth_alone_m": before[0],
        "frames_deep_alone": before[1],
        "depth_m": after[0],
        "frames_deep": after[1],
        "hands_m": max((error.mean_m for error in errors), default=None),
        "hands_max_m": max((error.max_m for error in errors), default=None),
        "touch_share": [figure["touch_share"] for figure in figures],
        "contact_gap_m": [figure["contact_gap_m"] for figure in figures],
        "jerk": [figure["body_jerk_mps3"] for figure in figures],
    }


def text(row: dict[str, Any]) -> tuple[str, ...]:
    def number(value: float | None, scale: float) -> str:
        return "-" if value is None else f"{scale * value:.1f}"

    return (
        row["clip"],
        row["robots"],
        "yes" if row["in_step"] else "no",
        f"{number(row['depth_alone_m'], 1e3)} -> {number(row['depth_m'], 1e3)}",
        f"{number(row['frames_deep_alone'], 1)} -> {row['frames_deep']}",
        f"{number(row['hands_m'], 1e3)}, {number(row['hands_max_m'], 1e3)}",
        ", ".join(number(share, 1e2) for share in row["touch_share"]),
        ", ".join(number(jerk, 1.0) for jerk in row["jerk"]),
    )


def main(arguments: Arguments) -> None:
    """Measure every pair."""
    rows = [measured(synthetic.make("carry_table"), robots, Config()) for robots in TEAMS]
    if arguments.data is not None:
        options = ReadOptions(objects=arguments.objects)
        for names in TOGETHER:
            one, other = (open_clip(arguments.data / f"{name}.pt", options) for name in names)
            clip = in_one_world(one, other, arguments.near)
            rows.append(measured(clip, "unitree_g1", Config(scaling=Scaling(object_scale=1.0))))
    titles = (
        "clip",
        "robots",
        "in step",
        "in each other [mm]",
        "frames above 5 mm",
        "hands, mean, max [mm]",
        "touch [%]",
    )
    note = "In each other: solved alone -> together. Hands: on one object, mean and largest."
    show("two robots", (*titles, "jerk [m/s^3]"), [text(row) for row in rows], note)
    write_json(arguments.json, {"pairs": rows})


if __name__ == "__main__":
    pin_threads()
    main(tyro.cli(Arguments, description=__doc__))
