"""Human-object interaction recordings to humanoid robot motions.

    import hoi_retarget as hr

    clip = hr.open_clip("builtin:carry_box")
    robot = hr.load_robot("unitree_g1")
    motion = hr.retarget(clip, robot, hr.Config(weights=hr.Weights(jerk=2e-3)))
    hr.save(motion, "carry_box.npz")

Names are imported when they are first asked for; `docs/api.md` has a line on each.
"""

import ast
from functools import cache
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

# ruff: noqa: F401  # names that other programs import
if TYPE_CHECKING:
    from hoi_retarget.batch.manifest import read_manifest as read_manifest
    from hoi_retarget.cli import main as main
    from hoi_retarget.clip.augment import augment as augment
    from hoi_retarget.clip.clip import Augmentation as Augmentation
    from hoi_retarget.clip.clip import Clip as Clip
    from hoi_retarget.clip.clip import ContactTrack as ContactTrack
    from hoi_retarget.clip.clip import QualityWarning as QualityWarning
    from hoi_retarget.clip.edits import ContactEdits as ContactEdits
    from hoi_retarget.clip.edits import apply as apply_edits
    from hoi_retarget.clip.read_options import ReadOptions as ReadOptions
    from hoi_retarget.errors import HoiRetargetError as HoiRetargetError
    from hoi_retarget.evaluation.figures import FIGURES as FIGURES
    from hoi_retarget.evaluation.figures import evaluate as evaluate
    from hoi_retarget.evaluation.thresholds import verdict_of as verdict_of
    from hoi_retarget.human.person import Person as Person
    from hoi_retarget.human.skeleton import JOINTS as JOINTS
    from hoi_retarget.motion.motion import Motion as Motion
    from hoi_retarget.motion.motion import Stage as Stage
    from hoi_retarget.motion.motion_report import Report as Report
    from hoi_retarget.motion.result_file import load as load
    from hoi_retarget.motion.result_file import save as save
    from hoi_retarget.motion.write_export import write_export as export
    from hoi_retarget.objects.track import ObjectGeometry as ObjectGeometry
    from hoi_retarget.objects.track import ObjectJoint as ObjectJoint
    from hoi_retarget.objects.track import ObjectTrack as ObjectTrack
    from hoi_retarget.readers.body_parameters import person_from_smplx as person_from_smplx
    from hoi_retarget.readers.open import clip_of as clip_of
    from hoi_retarget.readers.open import open_clip as open_clip
    from hoi_retarget.retargeting.config import Config as Config
    from hoi_retarget.retargeting.config import Horizon as Horizon
    from hoi_retarget.retargeting.config import IkConfig as IkConfig
    from hoi_retarget.retargeting.config import Scaling as Scaling
    from hoi_retarget.retargeting.config import Weights as Weights
    from hoi_retarget.retargeting.retarget import retarget as retarget
    from hoi_retarget.retargeting.retarget import retarget_people as retarget_people
    from hoi_retarget.retargeting.solve import Solution as Solution
    from hoi_retarget.retargeting.solve import solve as solve
    from hoi_retarget.retargeting.trajopt.solvers.solver import BandedInteriorPoint as BandedInteriorPoint
    from hoi_retarget.retargeting.trajopt.solvers.solver import KeepStart as KeepStart
    from hoi_retarget.robots import ROBOTS as ROBOTS
    from hoi_retarget.robots import load_robot as load_robot
    from hoi_retarget.robots.model import RobotModel as RobotModel
    from hoi_retarget.robots.spec import RobotSpec as RobotSpec
    from hoi_retarget.studio.scene.curves import named_curves as curves
    from hoi_retarget.studio.share.clip_page import player as player

__version__ = version("hoi-retarget")


@cache
def _homes() -> dict[str, tuple[str, str]]:
    """Return the module of every public name and its name there: the imports above, which type checkers read, too."""
    tree = ast.parse(Path(__file__).read_text(encoding="utf-8"))
    found = (node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom))
    return {
        name.asname: (str(node.module), name.name) for node in found for name in node.names if name.asname is not None
    }


def __getattr__(name: str) -> Any:
    """Import a public name when it is first asked for: the command line's help needs none of them."""
    if name == "__all__":
        return __dir__()
    if name not in _homes():
        raise AttributeError(f"hoi_retarget has no {name!r}. It has: {', '.join(__dir__())}.")
    module, original = _homes()[name]
    globals()[name] = value = getattr(import_module(module), original)
    return value


def __dir__() -> list[str]:
    return ["__version__", *_homes()]
