"""`hoi-retarget check-motion`: what a robot-motion file is, and what contradicts what it claims."""

import json
from dataclasses import asdict

from hoi_retarget.cli.commands import CheckMotion
from hoi_retarget.cli.jobs import check_inputs_kept, check_writable, write_file
from hoi_retarget.cli.terminal import say
from hoi_retarget.motion.check import Finding, Verdict, check
from hoi_retarget.motion.formats import MotionFile, read
from hoi_retarget.robots import load_robot

_MARKS = {"ok": "ok", "note": "note", "unknown": "unknown", "contradiction": "WRONG"}


def execute(command: CheckMotion) -> int:
    """Describe a file; return 1 when something contradicts what it claims."""
    model = load_robot(command.robot)
    if command.json is not None:
        check_writable("--json", command.json.parent)
        read_from = command.file.iterdir() if command.file.is_dir() else [command.file]
        check_inputs_kept("--json", [command.json], read_from)
    file = read(command.file)
    verdict = check(file, model)
    _describe(file, verdict)
    for finding in verdict.findings:
        _show(finding)
    say()
    say(_conclusion(verdict))
    if command.json is not None:
        write_file("--json", command.json, (json.dumps(facts(verdict), indent=1) + "\n").encode())
        say(f"written: {command.json}")
    return 1 if verdict.contradictions else 0


def _describe(file: MotionFile, verdict: Verdict) -> None:
    rate = "no rate stated" if file.fps is None else f"{file.fps:g} frames/s stated"
    say(f"{file.path}: {verdict.format}, {file.frames} frames, {rate}, as a motion of {verdict.robot}")
    say(f"  holds     {', '.join(file.contents)}")
    for item in verdict.objects:
        say(f"  object    {item.name}")
    if file.contacts is not None:
        share = ", ".join(
            f"{name} {100 * flags.mean():.0f} %"
            for name, flags in zip(file.contacts.names, file.contacts.flags.T, strict=True)
        )
        say(f"  contacts  {share}")
    say()


def _show(finding: Finding) -> None:
    say(f"{_MARKS[finding.level]:9}{finding.subject} ({finding.claim}): {finding.numbers}")
    if finding.advice:
        say(f"{'':9}-> {finding.advice}")


def _conclusion(verdict: Verdict) -> str:
    wrong = verdict.contradictions
    if not wrong:
        return "Nothing contradicts what the file claims."
    subjects = ", ".join(dict.fromkeys(finding.subject for finding in wrong))
    return (
        f"{len(wrong)} thing{'s' if len(wrong) > 1 else ''} contradict{'' if len(wrong) > 1 else 's'} it: {subjects}."
    )


def facts(verdict: Verdict) -> dict[str, object]:
    """Return a verdict for machines."""
    return {
        "file": verdict.path,
        "robot": verdict.robot,
        "format": verdict.format,
        "frames": verdict.frames,
        "stated_fps": verdict.stated_fps,
        "implied_fps": verdict.implied_fps,
        "objects": [item.name for item in verdict.objects],
        "missing_joints": list(verdict.missing_joints),
        "contradictions": len(verdict.contradictions),
        "findings": [asdict(finding) for finding in verdict.findings],
    }
