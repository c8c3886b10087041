"""Every cost term: its Jacobian against finite differences on the manifold, its assembly against dense."""

from dataclasses import replace

import numpy as np
import pytest

from hoi_retarget.errors import ArgumentError
from hoi_retarget.numerics import se3
from hoi_retarget.retargeting.config import Scaling, Weights
from hoi_retarget.retargeting.targets import make_targets
from hoi_retarget.retargeting.trajopt.normal import assemble
from hoi_retarget.retargeting.trajopt.problem import FrameRows, PairRows, Rows, StencilRows, Term, cost, cost_by_term
from hoi_retarget.retargeting.trajopt.terms.site_pose import (
    LYING_FACTOR,
    SOLE_REACH,
    RelativeRotation,
    stance_terms,
    torso_terms,
    trunk_terms,
)
from hoi_retarget.robots.model import Kinematics
from synthetic import make
from trajectories import MODELS, all_terms, sunk_qpos, term_classes, terms_by_class

FRAMES = 7
CLASSES = term_classes()


@pytest.fixture(params=list(MODELS))
def model(request):
    return MODELS[request.param]


def residuals(term: Term, kinematics: Kinematics) -> np.ndarray:
    """Return all weighted residuals of a term as one vector."""
    return np.concatenate([(np.sqrt(part.weight) * part.residual).ravel() for part in term.rows(kinematics)])


def twists(part: FrameRows | PairRows, kinematics: Kinematics) -> np.ndarray:
    """Return the derivative (T, 6, nv) of the twist that rows depend on."""
    if isinstance(part, FrameRows):
        return kinematics.jacobian(part.frame)
    lever = (kinematics.point(part.of.frame) - kinematics.point(part.other)).T[:, :, None]
    other = kinematics.jacobian(part.other)
    other[:, :3] += np.cross(other[:, 3:], lever, axis=1)
    return kinematics.jacobian(part.of.frame) - other


def dense_jacobian(part: Rows, kinematics: Kinematics) -> np.ndarray:
    """Return a row kind's weighted Jacobian by all T nv coordinates, from its definition."""
    nv, frames = kinematics.model.nv, len(kinematics.qpos)
    count, rows = part.residual.shape
    dense = np.zeros((count, rows, frames, nv))
    if isinstance(part, FrameRows | PairRows):
        site = twists(part, kinematics)
        part = part.of if isinstance(part, PairRows) else part
        for i, t in enumerate(range(frames) if part.frames is None else part.frames):
            if part.by_linear is not None:
                dense[:, i, t] += part.by_linear[:, :, i] @ site[t, :3]
            if part.by_angular is not None:
                dense[:, i, t] += part.by_angular[:, :, i] @ site[t, 3:]
        dense *= np.sqrt(np.broadcast_to(part.weight, rows))[None, :, None, None]
        return dense.reshape(count * rows, frames * nv)
    for i in range(rows):
        if isinstance(part, StencilRows):
            for offset, coefficient in enumerate(part.coefficients):
                dense[np.arange(count), i, i + offset, np.arange(nv)[part.columns]] = coefficient
        else:
            for offset, block in enumerate(part.jacobian):
                dense[:, i, i + offset, list(part.columns)] = block[:, :, i]
    return np.sqrt(part.weight) * dense.reshape(count * rows, frames * nv)


def test_the_cost_tables_use_every_term_there_is(model):
    """So that the tests below see every one of them, also one that is new."""
    assert terms_by_class(model, FRAMES, np.random.default_rng(0)).keys() == CLASSES.keys()
    assert all(isinstance(term, Term) for term in all_terms(model, FRAMES, np.random.default_rng(0)))


@pytest.mark.parametrize("name", CLASSES)
def test_jacobian_agrees_with_finite_differences(model, name):
    rng = np.random.default_rng(1)
    qpos = sunk_qpos(model, FRAMES, rng)
    kinematics = model.forward(qpos)
    direction = rng.normal(size=(FRAMES, model.nv))
    step = 3e-7  # so short that hardly ever a sample enters a capsule in between, which renumbers the rows
    ahead = model.forward(model.integrate(qpos, step * direction))
    behind = model.forward(model.integrate(qpos, -step * direction))
    for term in terms_by_class(model, FRAMES, rng)[name]:
        analytic = np.concatenate([dense_jacobian(part, kinematics) for part in term.rows(kinematics)])
        numeric = (residuals(term, ahead) - residuals(term, behind)) / (2 * step)
        assert np.abs(numeric).max() > 1e-2, f"the direction must move the residual of {term.name}"
        tolerance = 1e-6 * np.abs(numeric).max()
        np.testing.assert_allclose(analytic @ direction.ravel(), numeric, atol=tolerance, err_msg=term.name)


@pytest.mark.parametrize("base", ["left_palm", "left_knee"])
def test_rotation_seen_from_any_link_agrees_with_finite_differences(model, base):
    """The pelvis need not be on the root link: of robots without a waist, or with one below the trunk, it is not."""
    rng = np.random.default_rng(5)
    qpos = sunk_qpos(model, FRAMES, rng)
    term = RelativeRotation("torso", "torso", base, np.zeros((3, 3, FRAMES)), 1.0)
    direction, step = rng.normal(size=(FRAMES, model.nv)), 1e-6
    ahead, behind = (residuals(term, model.forward(model.integrate(qpos, s * direction))) for s in (step, -step))
    numeric = (ahead - behind) / (2 * step)
    (part,) = term.rows(model.forward(qpos))
    analytic = dense_jacobian(part, model.forward(qpos)) @ direction.ravel()
    np.testing.assert_allclose(analytic, numeric, atol=1e-6 * np.abs(numeric).max())


def test_band_holds_the_dense_normal_equations(model):
    rng = np.random.default_rng(2)
    terms = all_terms(model, FRAMES, rng)
    kinematics = model.forward(sunk_qpos(model, FRAMES, rng))
    rows = [part for term in terms for part in term.rows(kinematics)]
    normal = assemble(kinematics, rows)
    jacobian = np.concatenate([dense_jacobian(part, kinematics) for part in rows])
    residual = np.concatenate([(np.sqrt(part.weight) * part.residual).ravel() for part in rows])
    tolerance = 1e-9 * np.abs(normal.gradient).max()
    np.testing.assert_allclose(normal.gradient.ravel(), jacobian.T @ residual, atol=tolerance)
    size = FRAMES * model.nv
    band = normal.band.reshape(size, -1)
    dense = np.zeros((size, size))
    for below in range(band.shape[1]):
        np.fill_diagonal(dense[below:], band[: size - below, below])
    lower = np.tril(jacobian.T @ jacobian)
    np.testing.assert_allclose(dense, lower, atol=1e-8 * np.abs(lower).max())


def test_costs_are_weighted_sums_of_squares(model):
    rng = np.random.default_rng(3)
    terms = all_terms(model, FRAMES, rng)
    kinematics = model.forward(sunk_qpos(model, FRAMES, rng))
    for term in terms:
        total = sum(cost(part) for part in term.rows(kinematics))
        assert total == pytest.approx(np.sum(residuals(term, kinematics) ** 2))
    linearization = {term.name: term.rows(kinematics) for term in terms}
    assert list(cost_by_term(linearization)) == [term.name for term in terms]


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


@pytest.mark.parametrize(
    ("upright", "lies"), [(1.0, 0.0), (0.5, 0.0), (0.44, 0.25), (0.38, 0.5), (0.26, 1.0), (0.0, 1.0), (-1.0, 1.0)]
)
def test_a_torso_keeps_its_rotation_the_more_the_person_lies(upright, lies):
    model = MODELS["unitree_g1"]
    kinematics = model.forward(np.tile(model.home_qpos, (20, 1)))
    targets = make_targets(make("carry_box"), model, Scaling(), contact="surface").window(0, 20)
    lean = se3.quat_to_matrix(se3.exp(np.array([0.0, np.arccos(upright), 0.0])))
    free = replace(targets, trunk_rotations=np.tile(lean, (20, 1, 1)), stance_flags=np.zeros_like(targets.stance_flags))
    weights = Weights(torso_orientation=3.0, trunk_orientation=7.0)
    term, hips, *lying = trunk_terms(weights, free, kinematics)
    assert term.weight == hips.weight == 7.0
    found = np.array([more.weight for more in lying] or [0.0])
    np.testing.assert_allclose(found, np.broadcast_to(lies * 3.0 * LYING_FACTOR, found.shape), atol=1e-9)
    assert bool(lying) >= (lies > 0)
    stands = replace(free, stance_flags=np.ones_like(free.stance_flags))
    term, hips = trunk_terms(weights, stands, kinematics)
    assert (term.weight, hips.weight, hips.site) == (7.0, 7.0, "pelvis")
    np.testing.assert_allclose(hips.rows(kinematics)[0].residual, 0.0, atol=1e-12)
    assert not tuple(trunk_terms(weights, replace(free, contact="landmark"), kinematics))


def test_a_torso_as_in_the_reference_costs_nothing_and_another_one_twice_its_squared_angle():
    model = MODELS["unitree_g1"]
    kinematics = model.forward(sunk_qpos(model, FRAMES, np.random.default_rng(0)))
    targets = make_targets(make("carry_box"), model, Scaling()).window(0, FRAMES)
    (term,) = torso_terms(Weights(torso_orientation=3.0), targets, kinematics)
    assert sum(cost(rows) for rows in term.rows(kinematics)) == pytest.approx(0.0, abs=1e-20)
    turn = se3.quat_to_matrix(se3.exp(np.array([0.0, 0.0, 1e-3])))
    turned = replace(term, target_base=np.einsum("ijt,jk->ikt", term.target_base, turn))
    expected = 3.0 * FRAMES * 2e-6
    assert sum(cost(rows) for rows in turned.rows(kinematics)) == pytest.approx(expected, rel=1e-5)


def test_an_anchored_foot_that_turns_costs_as_much_as_one_that_moves_by_its_reach():
    model = MODELS["unitree_g1"]
    kinematics = model.forward(np.tile(model.home_qpos, (FRAMES, 1)))
    targets = make_targets(make("carry_box"), model, Scaling()).window(0, FRAMES)
    share = np.linspace(0.0, 1.0, FRAMES)
    targets = replace(targets, stance_flags=np.ones((FRAMES, 2), bool), anchor_weights=np.stack([share, share], axis=1))
    found = stance_terms(Weights(stance_orientation=2.0, stance_anchor=30.0), targets, kinematics)
    weights = [term.weight for term in found if term.name.endswith("_stance_orientation")]
    np.testing.assert_allclose(weights, np.tile(2.0 + 0.5 * SOLE_REACH**2 * 30.0 * share, (2, 1)))
