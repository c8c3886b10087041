"""The page docs/paper.md, made from measured figures alone."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import paper_figures
from scores import HIGHER_IS_BETTER, SCORES, p_value

Measured = Mapping[str, Any]
PERFORMED = (
    "sub8_largebox_001",
    "sub6_trashcan_046",
    "sub8_suitcase_002",
    "sub1_tripod_000",
    "sub1_clothesstand_000",
    "sub2_largetable_000",
    "sub6_smalltable_010",
)
"""Motions of two hands, one of most kinds of objects; those of the small box and the monitor are of one hand."""

REFINED = (
    ("pose_deg", "body pose deviation [deg]"),
    ("direction_deg", "link velocity direction [deg]"),
    ("object_cm", "object off its path [cm]"),
    ("gap_cm", "contact-point gap [cm]"),
    ("hand_deg", "relative hand orientation change [deg]"),
    ("jerk", "body jerk [m/s³]"),
)
OURS = ("surface", "landmark")
NAMES = {"surface": "this project", "landmark": "this project, `--contact landmark`"}


def page(measured: Mapping[str, Measured], reasons: Mapping[str, str]) -> str:
    """Return the page as Markdown."""
    made = {name: section(measured[name]) for name, section in SECTIONS.items() if name in measured}
    missing = [name for name in SECTIONS if name not in measured]
    both = [measured.get(name) for name in ("refinement", "refinement_of_omniretarget")]
    if both[0] is not None and both[1] is not None:
        made["refinement_of_omniretarget"] = starts(both[0], both[1])
    behind = [line for name in made for line in BEHIND.get(name, no_lines)(measured[name])]
    out = [f"- **{TITLES[name]}**: {reasons.get(name, 'has not been run')}." for name in missing]
    claims = CLAIMS
    for name, title in TITLES.items():
        if not made.get(name):
            claims = claims.replace(f"](#{title.lower().replace(' ', '-')})", "](#left-out)")
    parts = [HEAD, "## Where this project is behind\n", "\n".join(behind + list(ALWAYS_BEHIND)), claims]
    parts += [f"## {TITLES[name]}\n\n{text}" for name, text in made.items() if text]
    parts += ["## Left out\n", "\n".join(out + list(NOT_HERE))]
    return "\n".join(part.strip("\n") + "\n" for part in parts)


def table(header: Sequence[str], rows: Iterable[Sequence[str]], left: int = 1) -> str:
    """Return a table whose first columns are to the left, and numbers to the right."""
    marks = ["---"] * left + ["--:"] * (len(header) - left)
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (header, marks, *rows)) + "\n"


def number(value: float | None, scale: float = 1.0, digits: int = 1) -> str:
    return "-" if value is None else f"{scale * value:.{digits}f}"


def no_section(_: Measured) -> str:
    return ""


def no_lines(_: Measured) -> list[str]:
    return []


def peers(found: Measured) -> str:
    means, names = found["mean"], list(next(iter(found["mean"].values())))
    base = names[0]
    header = [
        "",
        *(NAMES.get(name, name) for name in names),
        *(f"{name}, in the paper" for name in paper_figures.PROGRAMS),
    ]
    header[-1] = "the paper's own"
    rows = []
    for key, title, scale, digits in SCORES:
        ours = [number(means[key][name], scale, digits) + star(found, key, name) for name in names]
        theirs = [number(value, scale, digits) for value in paper_figures.SCORES.get(key, (None,) * 3)]
        rows.append([title, *ours, *theirs])
    ratios = [number(means["cpu_seconds"][name] / means["cpu_seconds"]["landmark"], 1, 1) for name in names]
    paper_seconds = paper_figures.SCORES["cpu_seconds"]
    rows.append(
        [
            "compute time, times that of landmarks",
            *ratios,
            *(number(value / paper_seconds[-1], 1, 2) for value in paper_seconds),
        ]
    )
    failures = [f"{name}: {len(clips)} of {len(found['tried'])}" for name, clips in found["failed"].items() if clips]
    kinds = len({clip.split("_")[1] for clip in found["clips"]})
    return (
        f"Table III of the paper. {len(found['clips'])} OMOMO clips, {kinds} kinds of object, {found['frames']} frames, Unitree G1, objects at captured "
        "size; every program on the same clips in one run, one thread, judged by the same definitions and palms. The paper's columns are means of "
        "3,997 other clips of 13 kinds on its own machine: seconds compare within a run only. A dot marks a mean that a paired Wilcoxon test does not tell "
        f"from the first column's (p > 0.05). Failures: {'; '.join(failures) or 'none'}.\n\n"
        + table(header, rows)
        + "\nGMR knows no object: objects move as in the clip, scaled with its robot's path. OmniRetarget is given each object's mesh in place of its large "
        "box's, which it takes for its convex hull; its hands may touch anywhere, which the place tells. "
        f"`python benchmarks/peers.py --limit {len(found['tried'])}`; figures of each clip: `benchmarks/measured/peers.json`. First column: {NAMES[base]}, "
        "surfaces that touch ([contact.md](contact.md)).\n"
    )


def readme_table(found: Measured) -> str:
    """Return the table of README.md."""
    names = list(next(iter(found["mean"].values())))
    kinds = len({clip.split("_")[1] for clip in found["clips"]})
    title = f"{len(found['clips'])} OMOMO clips, {kinds} kinds of object, G1, objects at captured size"
    seconds = found["mean"]["cpu_seconds"]["landmark"]
    times = ("cpu_seconds", "CPU time, times that of landmarks", 1.0 / seconds, 1)
    scores = [times if score[0] == "cpu_seconds" else score for score in SCORES]
    rows = [
        [head, *(number(found["mean"][key][name], scale, digits) for name in names)]
        for key, head, scale, digits in scores
    ]
    return table([title, *(NAMES.get(name, name) for name in names)], rows)


def star(found: Measured, key: str, name: str) -> str:
    p = found["p"][key].get(name)
    return " ·" if p is not None and p > 0.05 else ""


def behind_peers(found: Measured) -> list[str]:
    """Return where our default's mean is worse than another program's of the same run, or than the paper's own."""
    lines = []
    for key, title, scale, digits in SCORES:
        means = found["mean"][key]
        own = means["surface"]
        worse = {
            name: value
            for name, value in means.items()
            if name not in OURS and value is not None and own is not None and worse_than(key, own, value)
        }
        paper = paper_figures.SCORES.get(key, (None,) * 3)[-1]
        if paper is not None and key != "cpu_seconds" and worse_than(key, own, paper):
            worse["the paper's own on other clips"] = paper
        if worse:
            others = ", ".join(
                f"{number(value, scale, digits)} by {name}{star(found, key, name) if name in means else ''}"
                for name, value in worse.items()
            )
            landmark = number(means["landmark"], scale, digits)
            lines.append(f"- **{title}**: {number(own, scale, digits)} ({landmark} with landmarks) against {others}.")
    return lines


def worse_than(key: str, own: float, other: float) -> bool:
    return own < other if key in HIGHER_IS_BETTER else own > other


def horizon(found: Measured) -> str:
    results = {(row["horizon"], row["clearance"] > 0): row for row in found["results"]}
    unit = results[("windowed:60:3", False)]["seconds_a_clip"]
    paper_unit = paper_figures.HORIZON[("windowed:60:3", False)][1]
    rows = []
    for key, row in results.items():
        paper = paper_figures.HORIZON.get(key)
        theirs = ("-",) * 5 if paper is None else (
            f"{paper[0]}/{paper_figures.HORIZON_CLIPS}", f"{paper[1] / paper_unit:.2f}", str(paper[2]), str(paper[3]), str(paper[4])
        )  # fmt: skip
        figures = row["figures"]
        ours = (
            f"{row['solved']}/{row['clips']}",
            f"{row['seconds_a_clip'] / unit:.2f}",
            f"{row['megabytes']:.0f}",
            number(figures["link_velocity_direction_deg"]),
            number(figures["joint_jerk_radps3"], 1, 0),
        )
        rows.append(
            [
                key[0],
                "with" if key[1] else "without",
                *(f"{mine} / {his}" for mine, his in zip(ours, theirs, strict=True)),
            ]
        )
    header = [
        "horizon",
        "collision cost",
        "solved",
        "time, times the windows'",
        "memory [MB]",
        "velocity direction [deg]",
        "joint jerk [rad/s³]",
    ]
    first = found["results"][0]
    return (
        f"Table VII of the paper (Appendix B). Ours / the paper's. {first['clips']} OMOMO clips at captured size, {first['frames']} frames, against the ten longest "
        "clips of each of 13 objects; medians. Our memory is that of the largest clip, the paper's a median.\n\n"
        + table(header, rows, left=2)
        + "\n`python benchmarks/horizon.py --limit 11 --clearance 1000 --object-scale 1.0`; `benchmarks/measured/horizon.json`.\n"
    )


def memory(found: Measured) -> str:
    rows = []
    for item in (item for items in found["results"].values() for item in items):
        if "failed" in item:
            rows.append([item["horizon"], str(item["frames"]), item["failed"], "-"])
        else:
            rows.append(
                [
                    item["horizon"],
                    str(item["frames"]),
                    f"{1e3 * item['seconds']['all'] / item['frames']:.2f}",
                    f"{item['megabytes']:.0f}",
                ]
            )
    return (
        "A built-in clip played forth and back, each length in a process of its own with 2 GB of address space. The paper's whole-clip solves are killed at 16 GB "
        "in 43 of 130 clips with the collision cost.\n\n"
        + table(["horizon", "frames", "CPU [ms/frame]", "peak memory [MB]"], rows)
        + "\n`python benchmarks/scaling.py --horizons whole windowed:60:15 --sizes 2000 10000 20000 --memory-limit 2`; `benchmarks/measured/memory.json`.\n"
    )


def augmentation(found: Measured) -> str:
    rows = []
    for row in found["means"]:
        rows.append(
            [
                row["robot"],
                f"x{row['size']:g}",
                number(row["contact_gap_m"], 1e3),
                number(row["touch_share"], 1e2, 0),
                number(row["touch_place_m"], 1e3, 0),
                f"{number(row['penetration_mean_m'], 1e3)}, {number(row['penetration_p95_m'], 1e3)}",
                number(row["body_jerk_mps3"], 1, 0),
                f"{row['clips_with_unreached']} of {row['clips']}",
                f"{row['solved']} of {row['clips']}",
            ]
        )
    clips = sorted({item["clip"] for item in found["clips"]})
    header = ["robot", "size", "gap of landmarks [mm]", "hands that touch [%]", "place on the scaled surface [mm]", "penetration, mean, p95 [mm]",
              "jerk [m/s³]", "clips with a contact out of reach", "solved"]  # fmt: skip
    return (
        "Sec. IV-C of the paper shows a box and a chair and gives no figures. Here the shortest clip of every kind of object at hand "
        f"({', '.join(clips)}), sizes on top of the scale that suits the robot; means of clips.\n\n"
        + table(header, rows, left=2)
        + "\n![A G1 and an H2 with a box and a chair of a quarter to one and a half of their size](images/sizes.png)\n\n"
        "`python benchmarks/augmentation.py --picture sizes.png`; `benchmarks/measured/augmentation.json`.\n"
    )


def video(found: Measured) -> str:
    rows = [
        [row["error"], row["contacts"], number(row["slip"], 1e3, 0), number(row["wander"], 1e3, 0),
         f"{number(row['gap'], 1e3)} / {number(row['gap_max'], 1e3)}", number(row["place"], 1e3, 0), number(row["jerk"]), number(row["unreached"])]
        for row in found["robot"]
    ]  # fmt: skip
    header = [
        "planted error",
        "contacts",
        "slip [mm/s]",
        "wander [mm]",
        "gap, mean / largest [mm]",
        "palm off the true place [mm]",
        "jerk [m/s³]",
        "not reached",
    ]
    return (
        "Sec. IV-D of the paper shows one table and gives no figures. No reconstructed video was at hand either: errors of known size are planted into a "
        "built-in clip whose true contacts are known ([video.md](video.md)). *Fixed* is the paper's remedy, one point for each contact; *by hand* moves that point as "
        "a person would who sees where it should be, to the centimetre.\n\n"
        + table(header, rows, left=2)
        + "\n`python benchmarks/video.py`; `benchmarks/measured/video.json`.\n"
    )


def pairs(found: Measured) -> str:
    rows = [
        [
            row["clip"],
            row["robots"].replace(",", ", "),
            "yes" if row["in_step"] else "no",
            f"{number(row['hands_m'], 1e3)}, {number(row['hands_max_m'], 1e3)}",
            f"{number(row['depth_alone_m'], 1e3)} → {number(row['depth_m'], 1e3)}",
            f"{'-' if row['frames_deep_alone'] is None else row['frames_deep_alone']} → {row['frames_deep']}",
            ", ".join(number(share, 1e2, 0) for share in row["touch_share"]),
        ]
        for row in found["pairs"]
    ]
    header = ["clip", "robots", "one object, one clock", "hands relative to each other, off the people's: mean, largest [mm]", "in each other, each alone → together [mm]",
              "frames above 5 mm", "hands that touch [%]"]  # fmt: skip
    return (
        "Two people to two robots in one world. The paper leaves mutual collisions out; here robots keep out of each other.\n\n"
        + table(header, rows, left=2)
        + "\n`python benchmarks/pairs.py`; `benchmarks/measured/pairs.json`. The first clip is synthetic; in the others two recorded people were put into one world, their joints 4 cm apart.\n"
    )


def refinement(found: Measured) -> str:
    whole = [row for row in found["clips"] if row["whole"]]
    standing = [row for row in found["clips"] if row["starts_standing"]]
    rows = []
    for key, title in REFINED:
        values = [row[key] for row in whole if row[key] is not None]
        rows.append(
            [
                title,
                number(float(np.mean(values))),
                number(float(np.median(values))),
                *map(str, paper_figures.REFINED[key]),
            ]
        )
    clips = [
        [
            row["clip"],
            f"{row['performed_s']:.1f} of {row['seconds']:.1f}",
            *(number(row[key]) for key, _ in REFINED),
            number(row["cpu_per_s"]),
        ]
        for row in found["clips"]
    ]
    cpu = float(np.mean([row["cpu_per_s"] for row in found["clips"]]))
    return (
        f"Table IV of the paper: 68 clips by a policy a clip (RL) and by sampling (SBTO). Ours: `refine`, sampling on a CPU ([physics.md](physics.md)), {len(found['clips'])} "
        f"clips of two hands, one of each kind of object, 1 kg, at captured size, in convex parts (extra `physics`, without which objects are hulls and other motions fall); {len(whole)} are performed without a fall, {sum(row['whole'] for row in standing)} of the "
        f"{len(standing)} that start standing. {cpu:.1f} CPU seconds a second of motion, {max(row['memory_mb'] for row in found['clips']):.0f} MB. The paper's "
        "path error is against the human's object, ours against the reference's.\n\n"
        + table(["", "mean", "median", "the paper, RL", "the paper, SBTO"], rows)
        + "\n"
        + table(["clip", "performed [s]", *(title for _, title in REFINED), "CPU [s/s]"], clips)
        + "\n`python benchmarks/refine.py --object-mass 1`; `benchmarks/measured/refinement.json`.\n"
    )


def starts(ours: Measured, theirs: Measured) -> str:
    """Return which references are the better start: ours, or another program's of the same clips."""
    pairs = [(own, other) for own in ours["clips"] for other in theirs["clips"] if own["clip"] == other["clip"]]
    whole = [(own, other) for own, other in pairs if own["whole"] and other["whole"]]
    rows = [
        ["performed without a fall", *(f"{sum(row['whole'] for row in side)} of {len(pairs)}" for side in zip(*pairs, strict=True)), "-"],
        ["share of the motion performed", *(number(float(np.mean([row["performed_s"] / row["seconds"] for row in side])), 1, 2) for side in zip(*pairs, strict=True)), "-"],
    ]  # fmt: skip
    for key, title in REFINED:
        values = np.array(
            [[own[key], other[key]] for own, other in whole if None not in (own[key], other[key])], dtype=float
        )
        if len(values):
            rows.append([title, *map(number, values.mean(axis=0)), number(p_value(*values.T), 1, 2)])
    return (
        f"Table IV's question: which reference is the better start? {len(pairs)} clips, the same refinement, budget and seed; OmniRetarget's motions with the recording's labels. "
        f"Figures are means over the {len(whole)} that both perform without a fall; p of a paired Wilcoxon test. In the paper, SBTO: object 19.4 against 26.9 cm, gap 9.9 against 14.1, hands 28.1 against 38.4 deg.\n\n"
        + table(["", "this project's references", "OmniRetarget's", "p"], rows)
        + "\n`benchmarks/measured/refinement_of_omniretarget.json`.\n"
    )


def behind_refinement(found: Measured) -> list[str]:
    whole = [row for row in found["clips"] if row["whole"]]
    lines = []
    for key, title in REFINED:
        own = float(np.mean([row[key] for row in whole if row[key] is not None]))
        if own > max(paper_figures.REFINED[key]):
            lines.append(
                f"- **In physics, {title}**: {own:.1f} on average against the paper's {paper_figures.REFINED[key][0]} (RL) and {paper_figures.REFINED[key][1]} (SBTO)."
            )
    return lines


def dataset(found: Measured) -> str:
    corpus = paper_figures.RELEASED_HOURS * 3600 * 30
    seconds = found["cpu_seconds"] / found["frames"]
    verdicts = ", ".join(f"{count} {level}" for level, count in found["verdicts"].items())
    made = found["released"]
    rows = [
        [
            "clips x robots, with results",
            f"{found['jobs']}, {found['solved']}",
            f"{paper_figures.RELEASED_CLIPS} clips",
        ],
        ["motion", f"{found['frames'] / 30 / 60:.1f} min", f"{paper_figures.RELEASED_HOURS} h"],
        ["verdicts", verdicts, "-"],
        ["CPU, figures and verdicts included [ms/frame]", f"{1e3 * seconds:.1f}", "-"],
        ["peak memory of all processes [MB]", f"{found['peak_megabytes']:.0f}", "-"],
        [
            "report page: CPU [s], size [MB]",
            f"{made['report']['cpu_seconds']:.1f}, {made['report']['megabytes']:.1f}",
            "-",
        ],
        [
            "Parquet with data card: CPU [s], size [MB]",
            f"{made['dataset']['cpu_seconds']:.1f}, {made['dataset']['megabytes']:.1f}",
            "-",
        ],
        [
            f"CPU for {paper_figures.RELEASED_HOURS} h of motion, one robot, extrapolated [h]",
            f"{corpus * seconds / 3600:.1f}",
            f"{corpus * paper_figures.SECONDS_A_FRAME / 3600:.0f} ¹",
        ],
    ]
    return (
        "All clips at hand for both robots at their default scales, by one specification: `batch`, `report` with verdicts, `export --to dataset`.\n\n"
        + table(["", "here", "the paper"], rows)
        + f"\n¹ At {1e3 * paper_figures.SECONDS_A_FRAME:.0f} ms a frame of the authors' released program, measured elsewhere, without figures.\n"
        + "\n`python benchmarks/batch.py --clips CLIPS --objects OBJECTS --object-scales auto`; `benchmarks/measured/dataset.json`.\n"
    )


SECTIONS: dict[str, Callable[[Measured], str]] = {
    "peers": peers,
    "horizon": horizon,
    "memory": memory,
    "augmentation": augmentation,
    "video": video,
    "pairs": pairs,
    "refinement": refinement,
    "refinement_of_omniretarget": no_section,  # needs both
    "dataset": dataset,
}
BEHIND: dict[str, Callable[[Measured], list[str]]] = {"peers": behind_peers, "refinement": behind_refinement}
TITLES = {
    "peers": "The benchmark",
    "horizon": "The horizon",
    "memory": "A limit of memory",
    "augmentation": "Object sizes",
    "video": "Contacts from video",
    "pairs": "Two robots",
    "refinement": "Dynamic refinement",
    "refinement_of_omniretarget": "Dynamic refinement of other references",
    "dataset": "The data set",
}
HEAD = """# The paper, claim by claim

*HOI-Retarget: Contact-Centric Retargeting for Human-Object Interaction* says what such a system does; this page shows what this one does of it, measured. It is written by
`python benchmarks/paper.py` from the files in `benchmarks/measured`, which its steps write; with no option it writes the page again.
With recordings and the other programs' environments it measures again (`--help`). The recordings are OMOMO's in InterMimic's layout, 33 clips of 11 kinds of object;
the paper has 4,421 of 13. Its figures are quoted beside ours; they are of other clips, on another machine.
"""
ALWAYS_BEHIND = (
    "- **Sources**: the paper ran five data sets of recordings; of those, only OMOMO's and ParaHome's files were at hand here. The other readers were tested on files written in their layout.",
    "- **Real video**: the paper shows one reconstruction by CARI4D; here errors are planted.",
    "- **A released set**: the paper's 6,952 clips can be downloaded; this project releases the program, not recordings.",
)
CLAIMS = """## Claims

| the paper says | here |
|---|---|
| Eq. 1: contact targets in the object's frame, which scale with it | [method.md](method.md); [Object sizes](#object-sizes) |
| Table I: what methods can do | all that the paper's can, and dynamics: [Dynamic refinement](#dynamic-refinement) |
| Table II: cost terms and weights; limits of joints and speeds as constraints | `--contact landmark`, [method.md](method.md); departures in [design.md](design.md) |
| Sec. III-B: windows of 60 frames that share 3 | `--horizon windowed:60:3`; the default solves up to 1,000 frames at once, [The horizon](#the-horizon) |
| Sec. III-C: one point for each contact, corrected in a web interface | `--fix-segments all`, `edit`; [Contacts from video](#contacts-from-video) |
| six sources, two robots (Fig. 3) | 14 readers ([sources.md](sources.md)); G1, H2, and others from their makers' files ([robots.md](robots.md)) |
| gap 0.5 cm in place of 18.3, over four times as fast as OmniRetarget (Table III) | [The benchmark](#the-benchmark) |
| solved by IPOPT through CasADi | our own solver finds the same optimum in 1/161 of the time, 1/37 of the best statement's: [benchmarks.md](benchmarks.md#ipopt-on-the-same-problem) |
| sizes from x0.25 to x1.5 (Fig. 5) | [Object sizes](#object-sizes) |
| contacts from one camera's video (Fig. 6) | [Contacts from video](#contacts-from-video) |
| several robots in step with one object; mutual collisions left out | [Two robots](#two-robots), which keep out of each other |
| refinement in physics keeps the advantage (Table IV) | [Dynamic refinement](#dynamic-refinement), [of other references](#dynamic-refinement-of-other-references) |
| windows need less memory, whole clips fail at 16 GB (Table VII) | [The horizon](#the-horizon), [A limit of memory](#a-limit-of-memory) |
| 6,952 clips, 13.8 h, 75 objects | [The data set](#the-data-set) |
"""
NOT_HERE = (
    "- **An RL tracker's table**: no GPU. `export --to mjlab-task` writes the task ([training.md](training.md)).",
    "- **The authors' own program** beside ours: its repository was not at hand for this run. README quotes figures of it that were measured elsewhere.",
    "- **OMOMO's mop and vacuum**: no recordings of them were at hand.",
)
