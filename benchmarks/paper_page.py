"""The page docs/paper.md, made from measured figures alone."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import paper_figures
from scores import HIGHER_IS_BETTER, SCORES, mean, p_value

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
IN_README = ("touch_share", "relative_hand_rotation_deg", "stance_slide_mps", "body_jerk_mps3")
"""Figures of README's table; docs/paper.md has all."""
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
    marks = "|" + "---|" * left + "--:|" * (len(header) - left)
    first, *others = ("| " + " | ".join(cells) + " |" for cells in (header, *rows))
    return "\n".join((first, marks, *others)) + "\n"


def number(value: float | None, scale: float = 1.0, digits: int = 1) -> str:
    return "-" if value is None else f"{scale * value:.{digits}f}"


def no_section(_: Measured) -> str:
    return ""


def no_lines(_: Measured) -> list[str]:
    return []


def peers(found: Measured) -> str:
    names = list(next(iter(found["mean"].values())))
    base = names[0]
    ours = ["", *(NAMES.get(name, name) for name in names)]
    in_paper = [
        f"{title} (in the paper)" if title in paper_figures.PROGRAMS else title for title in [*ours, "the paper's own"]
    ]
    of_the_paper, beyond = [], []
    for key, title, scale, digits in SCORES:
        row = [title, *(cell(found, key, name, scale, digits) + star(found, key, name) for name in names)]
        if key in paper_figures.SCORES:
            theirs = [number(value, scale, digits) for value in paper_figures.SCORES[key]]
            known = dict(zip(paper_figures.PROGRAMS, theirs, strict=True))
            cells = [
                f"{text} ({known[name]})" if name in known else text
                for name, text in zip(["", *names], row, strict=True)
            ]
            of_the_paper.append([*cells, theirs[-1]])
        else:
            beyond.append(row)
    failures = [f"{name}: {len(clips)} of {len(found['tried'])}" for name, clips in found["failed"].items() if clips]
    kinds = len({clip.split("_")[1] for clip in found["clips"]})
    return (
        f"Table III of the paper. {len(found['clips'])} OMOMO clips, {kinds} kinds of object, {found['frames']} frames, G1, objects at captured "
        "size; one thread, same definitions, all programs in one run, after which our columns were measured again, in CPU time of landmarks. The paper's figures are means of 3,997 other clips on its own machine. "
        "A dot: a paired Wilcoxon test finds no difference from the first column (p > 0.05). "
        f"{drawn_words(found)}Failures: {'; '.join(failures) or 'none'}.\n\n"
        + table(in_paper, of_the_paper)
        + "\nFigures that the paper does not have:\n\n"
        + table(ours, beyond)
        + f"\nFirst column: {NAMES[base]}, [surfaces that touch](contact.md). GMR knows no object; objects move as in the clip, scaled with its robot's path. "
        "OmniRetarget takes each object for its convex hull. "
        f"`python benchmarks/peers.py{drawn_option(found)}`; every clip: `benchmarks/measured/peers.json`.\n"
    )


def drawn(found: Measured, name: str) -> list[int] | None:
    """Return the indices of a program's clips where it did not run on all."""
    columns = [figures[name] for figures in found["figures"].values()]
    done = [any(value is not None for value in values) for values in zip(*columns, strict=True)]
    return None if all(done) else [index for index, there in enumerate(done) if there]


def beside(found: Measured, key: str, name: str) -> float | None:
    """Return the first column's mean on the clips of another."""
    some, base = drawn(found, name), next(iter(found["mean"][key]))
    if some is None:
        return found["mean"][key][base]
    return mean([found["figures"][key][base][index] for index in some])


def cell(found: Measured, key: str, name: str, scale: float, digits: int) -> str:
    """Return the mean of a figure; of a program that ran on some clips alone, with the first column's on these."""
    text = number(found["mean"][key][name], scale, digits)
    return text if drawn(found, name) is None else f"{text}/{number(beside(found, key, name), scale, digits)}"


def drawn_option(found: Measured) -> str:
    some = drawn(found, "OmniRetarget") if "OmniRetarget" in found["failed"] else None
    return "" if some is None else f" --drawn {len(some) + len(found['failed']['OmniRetarget'])}"


def drawn_words(found: Measured) -> str:
    """Return a sentence for each program that did not run on all clips."""
    programs = {name: some for name in next(iter(found["mean"].values())) if (some := drawn(found, name)) is not None}
    return "".join(
        f"{name}: {len(some)} of {len(some) + len(found['failed'][name])} clips drawn by lot, the others failed; after the slash "
        "the first column's mean on these. "
        for name, some in programs.items()
    )


def readme_table(found: Measured) -> str:
    """Return the table of README.md."""
    names = list(next(iter(found["mean"].values())))
    kinds = len({clip.split("_")[1] for clip in found["clips"]})
    title = f"{len(found['clips'])} OMOMO clips, {kinds} kinds of object, G1, objects at captured size"
    known = {score[0]: score for score in SCORES}
    scores = [known[name] for name in IN_README]
    rows = [[head, *(cell(found, key, name, scale, digits) for name in names)] for key, head, scale, digits in scores]
    words = drawn_words(found)
    return table([title, *(NAMES.get(name, name) for name in names)], rows) + (f"\n{words.strip()}\n" if words else "")


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
            if name not in OURS
            and value is not None
            and (ours := beside(found, key, name)) is not None
            and worse_than(key, ours, value)
        }
        paper = paper_figures.SCORES.get(key, (None,) * 3)[-1]
        if paper is not None and key != "cpu_seconds" and worse_than(key, own, paper):
            worse["the paper (other clips)"] = paper
        if worse:
            others = ", ".join(
                f"{number(value, scale, digits)} by {name}{star(found, key, name) if name in means else ''}"
                for name, value in worse.items()
            )
            landmark = number(means["landmark"], scale, digits)
            lines.append(f"- **{title}**: {number(own, scale, digits)} (landmarks: {landmark}) against {others}.")
    return lines


def worse_than(key: str, own: float, other: float) -> bool:
    return own < other if key in HIGHER_IS_BETTER else own > other


def horizon(found: Measured) -> str:
    results = {(row["horizon"], row["clearance"] > 0): row for row in found["results"]}
    unit = results[("windowed:60:3", False)]["seconds_a_clip"]
    paper_unit = paper_figures.HORIZON[("windowed:60:3", False)][1]
    rows, unsolved = [], []
    for key, row in results.items():
        name = f"{key[0]}, collision cost" if key[1] else key[0]
        if row["solved"] < row["clips"]:
            unsolved.append(f"{name} ({row['solved']} of {row['clips']})")
        paper = paper_figures.HORIZON.get(key)
        if paper is None:
            continue
        if paper[0] < paper_figures.HORIZON_CLIPS:
            unsolved.append(f"the paper's {name} ({paper[0]} of {paper_figures.HORIZON_CLIPS})")
        theirs = (f"{paper[1] / paper_unit:.2f}", *map(str, paper[2:5]))
        figures = row["figures"]
        ours = (
            f"{row['seconds_a_clip'] / unit:.2f}",
            f"{row['megabytes']:.0f}",
            number(figures["link_velocity_direction_deg"]),
            number(figures["joint_jerk_radps3"], 1, 0),
        )
        rows.append([name, *(f"{mine}, {his}" for mine, his in zip(ours, theirs, strict=True))])
    header = ["horizon", "time, times the windows'", "memory [MB]", "velocity direction [deg]", "joint jerk [rad/s³]"]
    first = found["results"][0]
    return (
        f"Table VII of the paper (Appendix B): ours, then the paper's. {first['clips']} OMOMO clips at captured size, {first['frames']} frames, against the ten longest "
        f"of each of 13 objects; medians, but our memory is the largest clip's. Not all clips are solved by: {', '.join(unsolved) or 'none'}.\n\n"
        + table(header, rows)
        + "\n`python benchmarks/horizon.py --limit 11 --clearance 1000 --object-scale 1.0`; with further horizons, `benchmarks/measured/horizon.json`.\n"
    )


def peak(item: Measured) -> str:
    return item.get("failed") or f"{number(item.get('megabytes'), 1.0, 0)} MB"


def memory(found: Measured) -> str:
    items = {(item["horizon"], item["frames"]): item for results in found["results"].values() for item in results}
    sizes = sorted({frames for _, frames in items})
    lines = [
        f"- `{name}`: {', '.join(peak(items.get((name, size), {})) for size in sizes)}"
        for name in dict.fromkeys(name for name, _ in items)
    ]
    return (
        f"Peak memory of a built-in clip played forth and back for {', '.join(map(str, sizes))} frames, each in its own process with 2 GB of address space. "
        "In the paper, 43 of 130 whole clips with the collision cost are killed at 16 GB.\n\n"
        + "\n".join(lines)
        + "\n\n`python benchmarks/scaling.py --horizons whole windowed:60:15 --sizes 2000 10000 20000 --memory-limit 2`; `benchmarks/measured/memory.json`.\n"
    )


def augmentation(found: Measured) -> str:
    robots = list(dict.fromkeys(row["robot"] for row in found["means"]))
    means = {(row["size"], row["robot"]): row for row in found["means"]}
    columns = (
        ("hands that touch [%]", "touch_share", 1e2, 0),
        ("place on the surface [mm]", "touch_place_m", 1e3, 0),
        ("penetration, mean [mm]", "penetration_mean_m", 1e3, 1),
        ("jerk [m/s³]", "body_jerk_mps3", 1.0, 0),
        ("solved", "solved", 1.0, 0),
    )
    rows = [
        [f"x{size:g}", *(", ".join(number(means[size, robot][key], scale, digits) for robot in robots) for _, key, scale, digits in columns)]
        for size in dict.fromkeys(size for size, _ in means)
    ]  # fmt: skip
    clips = len({item["clip"] for item in found["clips"]})
    unreached = [
        f"{row['clips_with_unreached']:.0f} clip at x{size:g} ({robot})"
        for (size, robot), row in means.items()
        if row["clips_with_unreached"]
    ]
    return (
        f"Sec. IV-C of the paper shows a box and a chair, without figures. Here the shortest clip of each of {clips} kinds of object; "
        f"sizes multiply the robot's default scale; means of clips, {', then '.join(robots)}. Contacts are out of reach in {', '.join(unreached) or 'none'}.\n\n"
        + table(["size", *(title for title, *_ in columns)], rows)
        + "\n![A G1 and an H2 with a box and a chair of a quarter to one and a half of their size](images/sizes.png)\n\n"
        "`python benchmarks/augmentation.py --picture sizes.png`; `benchmarks/measured/augmentation.json`.\n"
    )


def video(found: Measured) -> str:
    lines = [
        f"- {row['contacts']}: {number(row['slip'], 1e3, 0)} mm/s, {number(row['gap'], 1e3)} mm (largest {number(row['gap_max'], 1e3)}), "
        f"{number(row['place'], 1e3, 0)} mm, {number(row['jerk'])} m/s³, {number(row['unreached'])} not reached"
        for row in found["robot"]
        if row["error"] == "all three"
    ]
    return (
        "Sec. IV-D of the paper shows one table, without figures. No reconstructed video was at hand: three errors of known size (each alone: [video.md](video.md)) are planted into a "
        "built-in clip. Slip, gap, distance of the palms from the true place, jerk and number of contacts not reached; *fixed*: one point per contact, the paper's remedy; *moved*: that point at its true place:\n\n"
        + "\n".join(lines)
        + "\n\n`python benchmarks/video.py`; `benchmarks/measured/video.json`.\n"
    )


def pairs(found: Measured) -> str:
    rows = [
        [
            f"{row['clip']}, {row['robots'].replace(',', ', ')}",
            "-" if row["hands_m"] is None else f"{number(row['hands_m'], 1e3)}, {number(row['hands_max_m'], 1e3)}",
            f"{number(row['depth_alone_m'], 1e3)} → {number(row['depth_m'], 1e3)}",
            ", ".join(number(share, 1e2, 0) for share in row["touch_share"]),
        ]
        for row in found["pairs"]
    ]
    header = ["", "hands' wander from each other, off the people's: mean, largest [mm]", "penetration, alone → together [mm]", "hands that touch [%]"]  # fmt: skip
    return (
        "The paper leaves collisions between robots out; here robots keep out of each other. "
        f"In step with one object and one clock: {sum(row['in_step'] for row in found['pairs'])} of {len(found['pairs'])}. "
        "carry_table is synthetic; the others are two recordings in one world, joints 4 cm apart.\n\n"
        + table(header, rows)
        + "\n`python benchmarks/pairs.py`; `benchmarks/measured/pairs.json`.\n"
    )


def refinement(found: Measured) -> str:
    whole = [row for row in found["clips"] if row["whole"]]
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
    return (
        f"Table IV of the paper: 68 clips by a policy per clip (RL) and by sampling (SBTO). Ours: [`refine`](physics.md#performed-motions) on a CPU, {len(found['clips'])} "
        f"clips of two hands, from references with simulated holds; figures of the {len(whole)} that are performed whole with their objects. "
        f"{max(row['memory_mb'] for row in found['clips']):.0f} MB. The paper's path error is against the human's object, ours against the reference's.\n\n"
        + table(["", "mean", "median", "the paper, RL", "the paper, SBTO"], rows)
        + "\n`python benchmarks/refine.py --object-mass 1`; every clip: `benchmarks/measured/two_hands.json`.\n"
    )


def starts(ours: Measured, theirs: Measured) -> str:
    """Return which references are the better start: ours, or another program's of the same clips."""
    pairs = [(own, other) for own in ours["clips"] for other in theirs["clips"] if own["clip"] == other["clip"]]
    whole = [(own, other) for own, other in pairs if own["whole"] and other["whole"]]
    sides = list(zip(*pairs, strict=True))
    performed = (f"{sum(row['whole'] for row in side)} of {len(pairs)}" for side in sides)
    shares = (number(float(np.mean([row["performed_s"] / row["seconds"] for row in side])), 1, 2) for side in sides)
    rows = [f"performed without a fall: {', '.join(performed)}", f"share of the motion performed: {', '.join(shares)}"]
    for key, title in REFINED:
        values = np.array(
            [[own[key], other[key]] for own, other in whole if None not in (own[key], other[key])], dtype=float
        )
        if len(values):
            own, other = map(number, values.mean(axis=0))
            rows.append(f"{title}: {own}, {other} (p = {number(p_value(*values.T), 1, 2)})")
    return (
        f"Which reference is the better start: this project's, or OmniRetarget's with the recording's labels? {len(pairs)} clips, same refinement (an earlier one, in an earlier scene), budget and seed; "
        f"means over the {len(whole)} performed from both, p of a paired Wilcoxon test. In the paper (SBTO): object 19.4 against 26.9 cm, gap 9.9 against 14.1, hands 28.1 against 38.4 deg.\n\n"
        + "\n".join(f"- {row}" for row in rows)
        + "\n"
        + "\n`benchmarks/measured/refinement_of_omniretarget.json`.\n"
    )


def behind_refinement(found: Measured) -> list[str]:
    whole = [row for row in found["clips"] if row["whole"]]
    worse = []
    for key, title in REFINED:
        own = float(np.mean([row[key] for row in whole if row[key] is not None]))
        if own > min(paper_figures.REFINED[key]):
            by_learning, by_sampling = paper_figures.REFINED[key]
            worse.append(f"{title} {own:.1f} ({by_learning}, {by_sampling})")
    return [f"- **In physics**, against the paper's RL and SBTO: {'; '.join(worse)}."] if worse else []


def dataset(found: Measured) -> str:
    hours, corpus = paper_figures.RELEASED_HOURS, paper_figures.RELEASED_HOURS * 3600 * 30
    seconds = found["cpu_seconds"] / found["frames"]
    verdicts = ", ".join(f"{count} {level}" for level, count in found["verdicts"].items())
    page, rows = (found["released"][name] for name in ("report", "dataset"))
    return (
        f"All clips at hand, both robots, default scales: {found['jobs']} motions, {found['solved']} with results, {found['frames'] / 30 / 60:.1f} min "
        f"(the paper: {paper_figures.RELEASED_CLIPS} clips, {hours} h).\n\n"
        f"- Verdicts: {verdicts}.\n"
        f"- `batch`: {1e3 * seconds:.1f} ms of CPU a frame, figures and verdicts included; {found['peak_megabytes']:.0f} MB in all processes.\n"
        f"- `report`: {page['cpu_seconds']:.1f} s of CPU, {page['megabytes']:.1f} MB. "
        f"`export --to dataset`: {rows['cpu_seconds']:.1f} s, {rows['megabytes']:.1f} MB of Parquet.\n"
        f"- {hours} h of motion, one robot, extrapolated: {corpus * seconds / 3600:.1f} h of CPU; by the paper's released program, without figures, "
        f"{corpus * paper_figures.SECONDS_A_FRAME / 3600:.0f} h ({1e3 * paper_figures.SECONDS_A_FRAME:.0f} ms a frame).\n"
        "\n`python benchmarks/batch.py --clips CLIPS --objects OBJECTS --object-scales auto`; `benchmarks/measured/dataset.json`.\n"
    )


SECTIONS: dict[str, Callable[[Measured], str]] = {
    "peers": peers,
    "horizon": horizon,
    "memory": memory,
    "augmentation": augmentation,
    "video": video,
    "pairs": pairs,
    "two_hands": refinement,
    "refinement": no_section,
    "refinement_of_omniretarget": no_section,  # needs both
    "dataset": dataset,
}
BEHIND: dict[str, Callable[[Measured], list[str]]] = {"peers": behind_peers, "two_hands": behind_refinement}
TITLES = {
    "peers": "The benchmark",
    "horizon": "The horizon",
    "memory": "A limit of memory",
    "augmentation": "Object sizes",
    "video": "Contacts from video",
    "pairs": "Two robots",
    "two_hands": "Dynamic refinement",
    "refinement": "Dynamic refinement, earlier",
    "refinement_of_omniretarget": "Dynamic refinement of other references",
    "dataset": "The data set",
}
HEAD = """# The paper, claim by claim

The claims of *HOI-Retarget: Contact-Centric Retargeting for Human-Object Interaction*, and this project's figures for them. `python benchmarks/paper.py` writes this page from
`benchmarks/measured`, and measures again with recordings and the other programs' environments (`--help`). The recordings are 33 OMOMO clips of 11 kinds of object in InterMimic's layout;
the paper has 4,421 of 13, so its figures are of other clips, on another machine.
The benchmark, the object sizes and the refinement are of today's motions; the other sections are of motions before the torso followed the person.
"""
ALWAYS_BEHIND = (
    "- **Sources**: the paper ran five data sets; here only OMOMO's and ParaHome's files were at hand.",
    "- **Real video**: the paper shows one reconstruction by CARI4D; here errors are planted.",
    "- **Released set**: the paper's clips can be downloaded; this project releases the program only.",
)
CLAIMS = """## Claims

- Eq. 1, contact targets in the object's frame, scaling with it: [method.md](method.md#contact-points-eq-1), [Object sizes](#object-sizes)
- Table I, abilities of methods: all of the paper's, and dynamics
- Table II, costs, weights, limits as constraints: `--contact landmark`, [method.md](method.md#trajectory-optimization-eq-2); [departures](design.md#departures-from-the-paper)
- Sec. III-B, windows of 60 frames that share 3: `--horizon windowed:60:3`; default: up to 1,000 frames at once ([The horizon](#the-horizon))
- Sec. III-C, one point per contact, corrected in a web interface: `--fix-segments all`, `edit`; [Contacts from video](#contacts-from-video)
- Six sources, two robots (Fig. 3): [14 readers](sources.md); G1, H2, and [others from their manufacturers' files](robots.md)
- Gap 0.5 cm instead of 18.3, over four times as fast as OmniRetarget (Table III): [The benchmark](#the-benchmark)
- IPOPT through CasADi: own solver, [same optimum in 1/161 of the time](benchmarks.md#ipopt-on-the-same-problem)
- Several robots in step with one object: [Two robots](#two-robots)
- Refinement in physics keeps the advantage (Table IV): [Dynamic refinement](#dynamic-refinement), [of other references](#dynamic-refinement-of-other-references)
- Windows need less memory, whole clips fail at 16 GB (Table VII): [A limit of memory](#a-limit-of-memory)
- 6,952 clips, 13.8 h, 75 objects: [The data set](#the-data-set)
"""
NOT_HERE = (
    "- **RL tracker**: no GPU. `export --to mjlab-task` writes the task ([training.md](training.md)).",
    "- **The authors' program**: its repository was not at hand for this run.",
    "- **OMOMO's mop and vacuum**: no recordings at hand.",
)
