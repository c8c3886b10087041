"""What is left of a reconstruction's errors when contacts are fixed, and what the robot makes of them?

Errors of known size are planted into synthetic clips: joints and object tremble, hands that hold sink in and come off
from frame to frame, the body wanders against the object. True places are those of the clip before that.
"""

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.edits import ContactEdits, Edit, FixAll, Move, SnapAll, apply, segments_of
from hoi_retarget.clip.label_contacts import label_contacts
from hoi_retarget.numerics import se3
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.retarget import retarget
from hoi_retarget.robots import load_robot
from hoi_retarget.robots.model import RobotModel

sys.path.append(str(Path(__file__).parents[1] / "tests"))  # Noise of known size belongs to the tests.
from common import pin_threads, show, write_json

from synthetic import make
from video_noise import Noise, reconstructed

JITTER, ALTERNATION, DRIFT = 0.01, 0.03, 0.10  # [m]
NOISES: dict[str, tuple[str, Noise]] = {
    "jitter": ("carry_box", Noise(jitter=JITTER)),
    "alternation": ("carry_box", Noise(alternation=ALTERNATION)),
    "drift, off the surface": ("push_table", Noise(drift=(0.0, 0.0, DRIFT))),
    "drift, into a thin plate": ("push_table", Noise(drift=(0.0, 0.0, -DRIFT))),
    "drift, along the surface": ("push_table", Noise(drift=(0.0, DRIFT, 0.0))),
    "drift, as the box turns": ("carry_box", Noise(drift=(0.0, DRIFT, 0.0))),
    "all three": ("carry_box", Noise(JITTER, ALTERNATION, (0.0, DRIFT, 0.0))),
}
EDITS: dict[str, tuple[Edit, ...]] = {"as read": (), "fixed": (FixAll(),), "fixed, snapped": (FixAll(), SnapAll())}
BY_HAND = "fixed, moved by hand"
CENTIMETRE = 2
"""Decimals [m] of what a person moves a contact by, who sees where it should be."""


@dataclass(frozen=True)
class Arguments:
    """Plant errors, fix contacts, retarget."""

    robot: str = "unitree_g1"
    seeds: int = 5
    """How often each error is planted anew."""
    json: Path | None = None


def edited(clip: Clip, edits: tuple[Edit, ...]) -> Clip:
    asked = ContactEdits.of(clip)
    for edit in edits:
        asked = asked.adding(edit)
    return apply(clip, asked)


def errors(clip: Clip, truth: Clip) -> tuple[np.ndarray, np.ndarray]:
    """Return how far contact points are from the true ones, and the nearest points of the surface from each other."""
    points, places = [], []
    for own, true in zip(segments_of(clip), segments_of(truth), strict=True):
        surface = surface_of(truth.objects[own.object].geometry)
        points.append(np.linalg.norm(own.points - true.points, axis=1))
        nearest = surface.closest_points(own.points) - surface.closest_points(true.points)
        places.append(np.linalg.norm(nearest, axis=1))
    return np.concatenate(points), np.concatenate(places)


def contact_errors(seeds: int) -> list[dict[str, Any]]:
    rows = []
    for name, (scene, noise) in NOISES.items():
        truth = make(scene)
        clips = [reconstructed(truth, noise, seed=seed) for seed in range(seeds)]
        found = {kind: [errors(edited(clip, edits), truth) for clip in clips] for kind, edits in EDITS.items()}
        relabelled = [replace(clip, contacts=label_contacts(clip)) for clip in clips]
        rows.append(
            {
                "error": name,
                "scene": scene,
                "as_read_mean": float(np.mean([points.mean() for points, _ in found["as read"]])),
                "as_read_max": float(np.max([points.max() for points, _ in found["as read"]])),
                "fixed_max": float(np.max([points.max() for points, _ in found["fixed"]])),
                "snapped_place_max": float(np.max([places.max() for _, places in found["fixed, snapped"]])),
                "segments": len(segments_of(truth)),
                "segments_by_geometry": float(np.mean([len(segments_of(clip)) for clip in relabelled])),
            }
        )
    return rows


def by_hand(clip: Clip, truth: Clip) -> tuple[Edit, ...]:
    """Return the edits of a person who gives each contact one point, and moves it to its true place."""
    fixed = edited(clip, (FixAll(),))
    moves = []
    for own, true in zip(segments_of(fixed), segments_of(truth), strict=True):
        offset = np.round(true.points.mean(axis=0) - own.points.mean(axis=0), CENTIMETRE)
        if offset.any():
            moves.append(Move(own.part, own.start, tuple(offset.tolist()), person=own.person))
    return FixAll(), *moves


def hand_motion(clip: Clip, truth: Clip, model: RobotModel) -> dict[str, float]:
    """Return what the robot's palms do on the object while they touch it, and figures of the result's report.

    `place` is the mean distance of palms from the true contacts, which the report cannot know.
    """
    motion = retarget(clip, model, Config(contact="landmark"))
    kinematics, speeds, wanders, places = model.forward(motion.qpos), [], [], []
    for segment, true in zip(segments_of(clip), segments_of(truth), strict=True):
        frames = slice(segment.start, segment.stop)
        palm = kinematics.site_position(model.spec.part_sites[segment.part])[frames]
        pose = motion.object_quat[frames, segment.object], motion.object_pos[frames, segment.object]
        points = se3.rotate_inverse(pose[0], palm - pose[1])
        speeds.append(np.linalg.norm(np.diff(points, axis=0), axis=1) * clip.fps)
        wanders.append(np.linalg.norm(points - points.mean(axis=0), axis=1).max())
        places.append(np.linalg.norm(points - motion.object_scale[segment.object] * true.points, axis=1))
    figures = motion.report.figures
    return {
        "slip": float(np.concatenate(speeds).mean()),
        "wander": float(np.max(wanders)),
        "place": float(np.concatenate(places).mean()),
        "gap": figures["contact_gap_m"],
        "gap_max": figures["contact_gap_max_m"],
        "jerk": figures["body_jerk_mps3"],
        "unreached": float(len(motion.report.unreached_contacts)),
    }


def robot_rows(model: RobotModel, seeds: int) -> list[dict[str, Any]]:
    truth = make("carry_box")
    rows: list[dict[str, Any]] = [{"error": "none", "contacts": "as read"} | hand_motion(truth, truth, model)]
    for name in ("jitter", "alternation", "drift, as the box turns", "all three"):
        clips = [reconstructed(truth, NOISES[name][1], seed=seed) for seed in range(seeds)]
        for kind in (*EDITS, BY_HAND):
            fixes = [by_hand(clip, truth) if kind == BY_HAND else EDITS[kind] for clip in clips]
            runs = [hand_motion(edited(clip, edits), truth, model) for clip, edits in zip(clips, fixes, strict=True)]
            rows.append(
                {"error": name, "contacts": kind} | {key: float(np.mean([run[key] for run in runs])) for key in runs[0]}
            )
    return rows


def main(arguments: Arguments) -> None:
    places = contact_errors(arguments.seeds)
    header = ("planted", "scene", "as read", "largest", "fixed", "fixed, snapped: place", "contacts", "by geometry")
    keys = ("as_read_mean", "as_read_max", "fixed_max", "snapped_place_max")
    show(
        "Where hands touch: distance from the true point [mm]",
        header,
        [
            (
                row["error"],
                row["scene"],
                *(f"{1e3 * row[key]:.1f}" for key in keys),
                f"{row['segments']}",
                f"{row['segments_by_geometry']:.1f}",
            )
            for row in places
        ],
    )
    motions = robot_rows(load_robot(arguments.robot), arguments.seeds)
    show(
        f"What the robot does, {arguments.robot}, carry_box",
        (
            "planted",
            "contacts",
            "slip [mm/s]",
            "wander [mm]",
            "place [mm]",
            "gap [mm]",
            "largest",
            "jerk [m/s^3]",
            "not reached",
        ),
        [
            (
                row["error"],
                row["contacts"],
                *(f"{1e3 * row[key]:.1f}" for key in ("slip", "wander", "place", "gap", "gap_max")),
                f"{row['jerk']:.1f}",
                f"{row['unreached']:.1f}",
            )
            for row in motions
        ],
    )
    write_json(arguments.json, {"contacts": places, "robot": motions})


if __name__ == "__main__":
    pin_threads()
    main(tyro.cli(Arguments))
