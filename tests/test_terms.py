"""Every cost term: its Jacobian against finite differences on the manifold, its assembly against dense."""

from pathlib import Path

import numpy as np
import pytest

import hoi_retarget.retarget.trajopt.terms as terms_package
from hoi_retarget.errors import ArgumentError
from hoi_retarget.retarget.config import Weights
from hoi_retarget.retarget.trajopt.normal import assemble
from hoi_retarget.retarget.trajopt.problem import Term, cost_by_term
from hoi_retarget.retarget.trajopt.rows import Rows, SiteRows, StencilRows, cost
from hoi_retarget.robots.model import Kinematics
from trajectories import MODELS, one_term_per_file, random_qpos

FRAMES = 7
TERM_FILES = sorted(path.stem for path in Path(terms_package.__file__).parent.glob("*.py") if path.stem != "__init__")


@pytest.fixture(params=list(MODELS))
def model(request):
    return MODELS[request.param]


def residuals(term: Term, kinematics: Kinematics) -> np.ndarray:
    """Return all weighted residuals of a term as one vector."""
    return np.concatenate([(np.sqrt(part.weight) * part.residual).ravel() for part in term.rows(kinematics)])


def dense_jacobian(part: Rows, kinematics: Kinematics) -> np.ndarray:
    """Return a row kind's weighted Jacobian by all T nv coordinates, from its definition."""
    nv, frames = kinematics.model.nv, len(kinematics.qpos)
    count, rows = part.residual.shape
    dense = np.zeros((count, rows, frames, nv))
    if isinstance(part, SiteRows):
        site = kinematics.jacobian(part.site)
        for t in range(frames):
            if part.by_linear is not None:
                dense[:, t, t] += part.by_linear[:, :, t] @ site[t, :3]
            if part.by_angular is not None:
                dense[:, t, t] += part.by_angular[:, :, t] @ site[t, 3:]
        dense *= np.sqrt(np.broadcast_to(part.weight, frames))[None, :, None, None]
        return dense.reshape(count * rows, frames * nv)
    for i in range(rows):
        if isinstance(part, StencilRows):
            for offset, coefficient in enumerate(part.coefficients):
                dense[np.arange(count), i, i + offset, np.arange(nv)[part.columns]] = coefficient
        else:
            for offset, block in enumerate(part.jacobian):
                dense[:, i, i + offset, list(part.columns)] = block[:, :, i]
    return np.sqrt(part.weight) * dense.reshape(count * rows, frames * nv)


def test_every_term_file_is_covered(model):
    assert sorted(one_term_per_file(model, FRAMES, np.random.default_rng(0))) == TERM_FILES


@pytest.mark.parametrize("name", TERM_FILES)
def test_jacobian_agrees_with_finite_differences(model, name):
    rng = np.random.default_rng(1)
    term = one_term_per_file(model, FRAMES, rng)[name]
    qpos = random_qpos(model, FRAMES, rng)
    kinematics = model.forward(qpos)
    analytic = np.concatenate([dense_jacobian(part, kinematics) for part in term.rows(kinematics)])
    direction = rng.normal(size=(FRAMES, model.nv))
    step = 1e-6
    ahead = residuals(term, model.forward(model.integrate(qpos, step * direction)))
    behind = residuals(term, model.forward(model.integrate(qpos, -step * direction)))
    numeric = (ahead - behind) / (2 * step)
    assert np.abs(numeric).max() > 1e-2, "the direction must move the residual"
    np.testing.assert_allclose(analytic @ direction.ravel(), numeric, atol=1e-6 * np.abs(numeric).max())


def test_band_holds_the_dense_normal_equations(model):
    rng = np.random.default_rng(2)
    terms = one_term_per_file(model, FRAMES, rng)
    kinematics = model.forward(random_qpos(model, FRAMES, rng))
    rows = [part for term in terms.values() for part in term.rows(kinematics)]
    normal = assemble(kinematics, rows)
    jacobian = np.concatenate([dense_jacobian(part, kinematics) for part in rows])
    residual = np.concatenate([(np.sqrt(part.weight) * part.residual).ravel() for part in rows])
    np.testing.assert_allclose(normal.gradient.ravel(), jacobian.T @ residual, atol=1e-8)
    size = FRAMES * model.nv
    band = normal.band.reshape(size, -1)
    dense = np.zeros((size, size))
    for below in range(band.shape[1]):
        np.fill_diagonal(dense[below:], band[: size - below, below])
    lower = np.tril(jacobian.T @ jacobian)
    np.testing.assert_allclose(dense, lower, atol=1e-8 * np.abs(lower).max())


def test_costs_are_weighted_sums_of_squares(model):
    rng = np.random.default_rng(3)
    terms = one_term_per_file(model, FRAMES, rng)
    kinematics = model.forward(random_qpos(model, FRAMES, rng))
    for term in terms.values():
        total = sum(cost(part) for part in term.rows(kinematics))
        assert total == pytest.approx(np.sum(residuals(term, kinematics) ** 2))
    linearization = {name: term.rows(kinematics) for name, term in terms.items()}
    assert cost_by_term(linearization).keys() == terms.keys()


def test_weights_of_the_paper():
    """Table II of the paper; a change here is a decision for docs/design.md."""
    paper = {
        "joint_position": 1, "base_position": 1, "head_position": 1, "feet_position": 100, "torso_orientation": 1,
        "object_contact": 1000, "hand_orientation": 5, "stance_height": 2000, "stance_orientation": 10, "jerk": 1e-3,
    }  # fmt: skip
    weights = Weights()
    assert {name: getattr(weights, name) for name in paper} == paper
    assert all(model.spec.posture_weight > 0 for model in MODELS.values()), "joints that no site sees would be free"


@pytest.mark.parametrize("value", [-1.0, float("nan"), float("inf")])
def test_weights_that_are_no_weights_are_refused(value):
    with pytest.raises(ArgumentError, match="jerk"):
        Weights(jerk=value)
