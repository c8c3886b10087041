"""`hoi-retarget bench`: milliseconds a frame by stage, on this machine."""

import tempfile
from pathlib import Path

from hoi_retarget.cli.commands import Bench
from hoi_retarget.cli.jobs import check_json, write_json
from hoi_retarget.cli.terminal import Working, say, show_table
from hoi_retarget.errors import ArgumentError
from hoi_retarget.retargeting.multi_person import retarget_people, write
from hoi_retarget.robots import load_robot
from hoi_retarget.synthetic import make

SCENE = "carry_box"
STAGES = {
    "targets": "targets",
    "ik": "inverse kinematics",
    "trajectory": "trajectory optimization",
    "metrics": "figures of merit",
    "write": "result file",
}


def execute(command: Bench) -> int:
    """Time the pipeline and print a table."""
    if command.repeats < 1:
        raise ArgumentError(f"--repeats is {command.repeats}; at least one run is needed.")
    check_json(command.json)
    model = load_robot(command.robot)
    clip = make(SCENE, seconds=command.seconds)
    runs = []
    with tempfile.TemporaryDirectory() as folder, Working("timing", command.repeats) as working:
        for _ in range(command.repeats):
            (motion,) = retarget_people(clip, [model])
            (motion,) = write([motion], [Path(folder) / "bench.npz"])
            runs.append(motion.report.cpu_seconds)
            working.advance()
    best = min(runs, key=lambda seconds: sum(seconds.values()))
    rows = [(title, *_texts(best.get(name, 0.0), clip.frames)) for name, title in STAGES.items()]
    total = sum(best.values())
    say(f"{model.spec.name}, {clip.frames} frames at {clip.fps:g} frames/s; CPU time, fastest of {command.repeats}.")
    show_table([("stage", "ms a frame", "s in all"), *rows, ("all", *_texts(total, clip.frames))])
    say(f"{clip.frames / total:.0f} frames a second, {clip.frames / total / clip.fps:.0f} times real time.")
    write_json(
        command.json, {"robot": model.spec.name, "frames": clip.frames, "fps": clip.fps, "cpu_seconds": dict(best)}
    )
    return 0


def _texts(seconds: float, frames: int) -> tuple[str, str]:
    return f"{1e3 * seconds / frames:.3f}", f"{seconds:.3f}"
