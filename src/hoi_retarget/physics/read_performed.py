"""Reads what a controller is given (`performed.performed_file`), so that its certificate can be made again."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from jaxtyping import Float

from hoi_retarget.errors import ReadError
from hoi_retarget.files import npz
from hoi_retarget.files.reading import read_bytes
from hoi_retarget.motion.performance import Certificate
from hoi_retarget.physics.performed import FORMAT
from hoi_retarget.physics.rollout import Rollout

_ARRAYS = ("qpos", "qvel", "targets", "gains")


@dataclass(frozen=True, eq=False)
class ForController:
    """A performed motion as a controller is given it."""

    rollout: Rollout
    gains: Float[np.ndarray, "K n x"]
    certificate: Certificate | None
    """None where its robustness was not examined, or the robot falls."""
    facts: Mapping[str, Any]


def read_performed(path: Path | str) -> ForController:
    """Read the file for controllers that `refine` writes; raises `ReadError`."""
    path = Path(path)
    try:
        members = npz.members(read_bytes(path))
        missing = [name for name in (*_ARRAYS, "facts") if name not in members]
        if missing:
            raise ValueError(f"it lacks {', '.join(missing)}")
        facts = json.loads(str(npz.array("facts", members["facts"], "U").reshape(()).item()))
        if facts.get("format") != FORMAT:
            raise ValueError(f"its format is {facts.get('format')!r}, not {FORMAT!r}")
        qpos, qvel, targets, gains = (npz.array(name, members[name], "f") for name in _ARRAYS)
        certificate = msgspec.convert(facts["certificate"], Certificate | None)
        return ForController(Rollout(qpos, qvel, targets, facts["fell_after"]), gains, certificate, facts)
    except (ValueError, KeyError, AttributeError, RecursionError) as error:
        raise ReadError(
            f"{path}: not a performed motion for controllers ({error}). Refine its result again."
        ) from error
