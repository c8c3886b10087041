"""Random trajectories and every cost term there is, shared by the tests of terms and solvers."""

import importlib
import pkgutil
from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np

import hoi_retarget.retargeting.trajopt.terms as terms_package
from hoi_retarget.clip.clip import PINNED_PARTS, PosePin
from hoi_retarget.numerics import se3
from hoi_retarget.retargeting.config import IkWeights, Scaling, Weights
from hoi_retarget.retargeting.targets import Targets, make_targets, with_pins
from hoi_retarget.retargeting.trajopt.link_pairs import LinkPair, SpreadPoints
from hoi_retarget.retargeting.trajopt.problem import Term
from hoi_retarget.retargeting.trajopt.terms.posture import CoupledJoints
from hoi_retarget.retargeting.trajopt.terms.robot_clearance import RobotClearance
from hoi_retarget.retargeting.trajopt.terms.self_clearance import SelfClearance
from hoi_retarget.retargeting.trajopt.trajectory_terms import ik_terms, trajectory_terms
from hoi_retarget.robots import ROBOTS, load_robot
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.robots.skin import LinkSkin, skin_of
from synthetic import make

MODELS: dict[str, RobotModel] = {name: load_robot(name) for name in ROBOTS}
START = np.array([0.0, 0.0, 0.7])  # [m]
DEEP = np.array([0.0, 0.0, -3.0])  # [m] All of a robot is then under the floor.


def random_qpos(model: RobotModel, frames: int, rng: np.random.Generator, *, wander: float = 0.05) -> np.ndarray:
    """Return a random walk inside the joint ranges that starts anywhere."""
    middle = 0.5 * (model.lower + model.upper)
    spread = 0.4 * (model.upper - model.lower)
    theta = middle + spread * np.tanh(np.cumsum(wander * rng.normal(size=(frames, model.n)), axis=0) + rng.normal())
    turn = se3.exp(rng.normal(size=3) + np.cumsum(wander * rng.normal(size=(frames, 3)), axis=0))
    place = START + np.cumsum(wander * rng.normal(size=(frames, 3)), axis=0)
    return np.concatenate([place, turn, theta], axis=1)


def sunk_qpos(model: RobotModel, frames: int, rng: np.random.Generator) -> np.ndarray:
    """Return a random walk under the floor, where every term has a residual."""
    qpos = random_qpos(model, frames, rng)
    qpos[:, :3] += DEEP
    return qpos


def term_classes() -> dict[str, type]:
    """Return the classes of terms in the files of `terms/`, by name."""
    found = {}
    for info in pkgutil.iter_modules(terms_package.__path__):
        module = importlib.import_module(f"{terms_package.__name__}.{info.name}")
        found |= {name: kind for name, kind in vars(module).items() if _is_term(kind, module.__name__)}
    return found


def _is_term(kind: object, module: str) -> bool:
    return isinstance(kind, type) and kind.__module__ == module and hasattr(kind, "rows")


def all_terms(model: RobotModel, frames: int, rng: np.random.Generator) -> tuple[Term, ...]:
    """Return the terms of both cost tables while a standing person grasps a box, by a random reference.

    The box is where sunk robots are, so that it is in their way.
    """
    window = _grasp(model, frames)
    reference = model.forward(random_qpos(model, frames, rng))
    return (
        *trajectory_terms(Weights(), window, reference),
        *ik_terms(IkWeights(), window, model),
        *links_apart(model, frames),
        CoupledJoints("follows_later", 3, 5, 0.8, 0.1),
        CoupledJoints("follows_earlier", 5, 3, -1.2, 0.0),
    )


def links_apart(model: RobotModel, frames: int) -> Iterator[Term]:
    """Yield the clearances of a hand from the trunk, the same robot's and another's, with margins that are broken."""
    skins, every = skin_of(model).by_link, np.arange(frames)
    hand, trunk = (skins[model.body_of(site)] for site in ("left_palm", "torso"))

    def pair(link: LinkSkin, other: LinkSkin) -> LinkPair:
        few = SpreadPoints(link.points[:8], 8, np.arange(8), np.zeros(8))
        return LinkPair(link.frame, few, other.frame, other.solid, np.inf, every)

    yield SelfClearance("self_clearance", (pair(hand, trunk),), 2.0, 1e3)
    beside = model.forward(sunk_qpos(model, frames, np.random.default_rng(4)))
    yield RobotClearance("robot_clearance", beside, (pair(hand, trunk),), (pair(trunk, hand),), 3.0, 1e3)


@cache
def _grasp(model: RobotModel, frames: int) -> Targets:
    targets = make_targets(make("carry_box"), model, Scaling())
    first = int(np.argmax(targets.contact_flags[:, 0])) - frames // 2
    window = targets.window(first, first + frames)
    clip = replace(
        make("carry_box"), pins=tuple(PosePin(0, part, first, tuple(START), (0.0, 0.0, 9.0)) for part in PINNED_PARTS)
    )
    pins = with_pins(targets, clip, model, np.tile(model.home_qpos, (targets.frames, 1))).pins
    window = replace(window, pins=tuple(pin.take(slice(first, first + frames)) for pin in pins))
    return replace(window, object_pos=np.tile(START + DEEP, (frames, 1, 1)))


def terms_by_class(model: RobotModel, frames: int, rng: np.random.Generator) -> dict[str, list[Term]]:
    """Return all those terms by the names of their classes."""
    found: dict[str, list[Term]] = {}
    for term in all_terms(model, frames, rng):
        found.setdefault(type(term).__name__, []).append(term)
    return found
