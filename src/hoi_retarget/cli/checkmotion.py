"""`hoi-retarget check-motion`: what a robot-motion file is, and what contradicts what it claims."""

from dataclasses import asdict

from hoi_retarget.cli.commands import CheckMotion
from hoi_retarget.cli.jobs import check_json, write_json
from hoi_retarget.cli.terminal import say
from hoi_retarget.motion.check import CheckedMotion, Finding, check
from hoi_retarget.motion.formats import MotionFile, read
from hoi_retarget.robots import load_robot

_MARKS = {"ok": "ok", "note": "note", "unknown": "unknown", "contradiction": "WRONG"}


def execute(command: CheckMotion) -> int:
    """Describe a file; return 1 when something contradicts what it claims."""
    model = load_robot(command.robot)
    check_json(command.json, command.file.iterdir() if command.file.is_dir() else [command.file])
    file = read(command.file)
    checked = check(file, model)
    _describe(file, checked)
    for finding in checked.findings:
        if not finding.follows:
            _show(finding)
            for other in checked.findings:
                if other.follows == finding.subject and finding.level == "contradiction":
                    say(f"{'':9}follows: {_told(other)}")
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


def _show(finding: Finding) -> None:
    say(f"{_MARKS[finding.level]:9}{_told(finding)}")
    if finding.advice:
        say(f"{'':9}-> {finding.advice}")


def _told(finding: Finding) -> str:
    return f"{finding.subject} ({finding.claim}): {finding.numbers}"


def _conclusion(checked: CheckedMotion) -> str:
    wrong = [finding for finding in checked.contradictions if not finding.follows]
    if not wrong:
        return "Nothing contradicts what the file claims."
    subjects = ", ".join(dict.fromkeys(finding.subject for finding in wrong))
    return (
        f"{len(wrong)} thing{'s' if len(wrong) > 1 else ''} contradict{'' if len(wrong) > 1 else 's'} it: {subjects}."
    )


def facts(checked: CheckedMotion) -> dict[str, object]:
    """Return what was found, for machines."""
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
        "findings": [asdict(finding) for finding in checked.findings],
    }
