"""Whether this installation retargets and draws, the optional packages that it lacks, and commands that help."""

import platform
from importlib.metadata import version

from hoi_retarget.cli.commands import Doctor
from hoi_retarget.cli.terminal import program, say
from hoi_retarget.errors import EXTRAS, DrawingError, HoiRetargetError, install_hint


def execute_doctor(command: Doctor) -> int:
    """Show what works; return 1 where nothing can be retargeted."""
    versions = ", ".join(f"{name} {version(name)}" for name in ("hoi-retarget", "numpy", "scipy", "mujoco"))
    try:
        drawing = _drawing()
    except (ImportError, OSError, HoiRetargetError) as error:
        drawing = ""
        say(f"retargeting: fails. {error}")
    else:
        say(f"retargeting: works (Python {platform.python_version()}, {versions})")
        say(f"drawing: {drawing}")
    hints = {work: install_hint(module) for module, (_, work) in EXTRAS.items()}
    missing = [f"no {work}. {hint}" for work, hint in hints.items() if hint]
    say("; ".join(["optional: " + ", ".join(work for work, hint in hints.items() if not hint), *missing]))
    return 0 if drawing else 1


def _drawing() -> str:
    """Return whether pictures are drawn and robots look as they do; raises where the package or a robot is damaged."""
    from hoi_retarget.retargeting import retarget  # noqa: F401, PLC0415  # the whole of it may fail
    from hoi_retarget.robots import ROBOTS, load_robot, user_robots  # noqa: PLC0415  # as above
    from hoi_retarget.robots.fetched_meshes import fetched_meshes  # noqa: PLC0415  # as above
    from hoi_retarget.studio.offscreen.stage import check_can_draw  # noqa: PLC0415  # as above

    plain = [name for name in ROBOTS if fetched_meshes(load_robot(name).spec) is None]
    for name in user_robots.names():
        load_robot(name)
    looks = "; for the real look, once: " + ", ".join(f"{program()} robots meshes {name}" for name in plain)
    try:
        check_can_draw()
    except DrawingError as error:
        return f"in a browser alone. {error}"
    return "works" + (looks if plain else "")
