"""Screws and their Jacobians against the exponential and finite differences."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from crossmodal.maths import se3
from crossmodal.maths.vectors import normal_basis
from crossmodal.systems.kinematics.solver.joint_geometry import (
    BENT_SLIDE,
    PARAMETERS,
    PRISMATIC,
    REVOLUTE,
    RIGID,
    SCREW,
    child_pose,
    dimension,
    jacobian,
    retract,
    screw_twists,
    turns,
)

MODELS = [PRISMATIC, REVOLUTE, SCREW, RIGID]


def _parameters(kind: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    rng = np.random.default_rng(seed)
    a = rng.normal(size=3)
    a /= np.linalg.norm(a)
    c = rng.normal(size=3)
    c -= a * (a @ c)
    pitch = rng.normal() if kind == SCREW else 0.0
    return se3.exp(0.3 * rng.normal(size=6)), a, c if turns(kind) else np.zeros(3), pitch


def _pose(
    kind: int, Y: np.ndarray, a: np.ndarray, c: np.ndarray, pitch: float, q: float
) -> np.ndarray:
    X = np.empty((4, 4))
    child_pose(kind, Y, a, c, pitch, q, X)
    return X


@pytest.mark.parametrize("q", [0.0, 1e-6, -0.7, 3.0, 7.0])
def test_the_child_moves_along_the_exponential_of_the_screw(q: float) -> None:
    for kind in MODELS:
        Y, a, c, pitch = _parameters(kind)
        twist = {
            PRISMATIC: np.concatenate([np.zeros(3), a]),
            REVOLUTE: np.concatenate([a, np.cross(c, a)]),
            SCREW: np.concatenate([a, np.cross(c, a) + pitch * a]),
            RIGID: np.zeros(6),
        }[kind]
        assert_allclose(_pose(kind, Y, a, c, pitch, q), se3.exp(q * twist) @ Y, atol=1e-12)


@pytest.mark.parametrize("kind", [PRISMATIC, REVOLUTE, SCREW])
@pytest.mark.parametrize("q", [0.0, 1e-5, -0.4, 1.5, np.pi])
def test_jacobians_agree_with_finite_differences(kind: int, q: float) -> None:
    h = 1e-6
    for seed in range(3):
        Y, a, c, pitch = _parameters(kind, seed)
        G, J = np.zeros((6, 6)), np.zeros((6, 6))
        screw_twists(kind, Y, a, c, pitch, G)
        jacobian(kind, G, pitch, q, J)
        X = se3.inverse(_pose(kind, Y, a, c, pitch, q))
        expected = [se3.log(X @ _pose(kind, Y, a, c, pitch, q + h)) / h]
        for i in range(6, dimension(kind)):
            step = np.zeros(PARAMETERS)
            step[i] = h
            moved = (Y.copy(), a.copy(), c.copy())
            changed = retract(kind, *moved, pitch, step)
            expected.append(se3.log(X @ _pose(kind, *moved, changed, q)) / h)
        assert_allclose(J[: len(expected)], expected, atol=2e-5)


@pytest.mark.parametrize("q", [0.0, -0.4, 1.5])
def test_a_slide_bends_by_its_curvature(q: float) -> None:
    """Its twist per metre is (k, a), as that of a hinge at the distance 1 / |k|."""
    Y, a, c, _ = _parameters(PRISMATIC)
    G, J, h = np.zeros((6, 6)), np.zeros((6, 6)), 1e-6
    screw_twists(BENT_SLIDE, Y, a, c, 0.0, G)
    jacobian(BENT_SLIDE, G, 0.0, q, J)
    X = se3.inverse(_pose(BENT_SLIDE, Y, a, c, 0.0, q))
    assert dimension(BENT_SLIDE) == dimension(PRISMATIC) + 2
    for i in range(2):
        bent = [se3.exp(q * np.concatenate([k * normal_basis(a)[i], a])) @ Y for k in (h, -h)]
        expected = (se3.log(X @ bent[0]) - se3.log(X @ bent[1])) / (2.0 * h)
        assert_allclose(J[3 + i], expected, atol=1e-8)


@pytest.mark.parametrize("kind", MODELS)
def test_any_step_leaves_a_unit_axis_and_a_point_normal_to_it(kind: int) -> None:
    Y, a, c, pitch = _parameters(kind)
    retract(kind, Y, a, c, pitch, np.random.default_rng(1).normal(size=PARAMETERS))
    assert_allclose(np.linalg.norm(a), 1.0)
    assert_allclose(a @ c, 0.0, atol=1e-12)
    assert_allclose(Y[:3, :3] @ Y[:3, :3].T, np.eye(3), atol=1e-12)
