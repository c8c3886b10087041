"""Whether MuJoCo can draw without a screen here; tests that need it skip, saying so, where it cannot."""

import os
import subprocess
import sys
from functools import cache

import pytest

_PROBE = "import mujoco; mujoco.Renderer(mujoco.MjSpec().compile(), 16, 16).close()"


def need_drawing(backend: str) -> None:
    """Skip the test unless MuJoCo draws with a backend; this asks MuJoCo alone, nothing of the project."""
    if why := trouble(backend):
        pytest.skip(f"MuJoCo cannot draw with MUJOCO_GL={backend} here: {why}")


@cache
def trouble(backend: str) -> str:
    """Return why MuJoCo cannot draw with a backend; nothing where it can."""
    done = subprocess.run(
        [sys.executable, "-c", _PROBE],
        env={**os.environ, "MUJOCO_GL": backend},
        capture_output=True,
        text=True,
        check=False,
    )
    return done.stderr.strip().splitlines()[-1] if done.returncode else ""
