"""Reader of the files for controllers that `refine` writes, by numpy alone as docs/physics.md shows it."""

import json
from pathlib import Path

import msgspec
import numpy as np

from hoi_retarget.motion.performance import Certificate
from hoi_retarget.simulation.rollout import Rollout


def read_controller_file(path: Path) -> tuple[Rollout, np.ndarray, Certificate | None, dict]:
    """Return the simulated motion, its gains, its certificate and the facts of the file."""
    with np.load(path) as file:
        arrays = dict(file)
    facts = json.loads(str(arrays["facts"]))
    assert facts["format"] == "hoi-retarget performed motion 1"
    rollout = Rollout(arrays["qpos"], arrays["qvel"], arrays["targets"], facts["fell_after"])
    return rollout, arrays["gains"], msgspec.convert(facts["certificate"], Certificate | None), facts
