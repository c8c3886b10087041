"""Tasks for mjlab, written by hoi-retarget: every folder in `tasks` is one, and holds data alone.

mjlab imports this package when its folder is on Python's path (PYTHONPATH); `list-envs` then shows the tasks.
"""

from importlib.metadata import version
from pathlib import Path

WRITTEN_FOR = "1.6."  # Versions of mjlab: resets of robot and objects replace a method of its motion command.


def _register() -> None:
    if not version("mjlab").startswith(WRITTEN_FOR):
        raise RuntimeError(
            f"these tasks are written for mjlab {WRITTEN_FOR}x, and {version('mjlab')} is installed. "
            f"Install it in an environment of its own: pip install 'mjlab=={WRITTEN_FOR}*'"
        )
    from .environment import register_task  # noqa: PLC0415  # not before the version is known

    for folder in sorted((Path(__file__).parent / "tasks").iterdir()):
        if (folder / "task.json").is_file():
            register_task(folder)


_register()
