"""The hinge's equations: closed forms, derivatives and what they cannot know."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from synthetic_flap import INTRINSICS, Tool

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.gaussian import nees
from crossmodal.maths.vectors import normal_basis
from crossmodal.systems.depth_camera import DepthCamera
from crossmodal.systems.flap.hinge.hinge_keyframes import StackedKeyframes
from crossmodal.systems.flap.hinge.hinge_solver import (
    POINT,
    SIZE,
    HingeModel,
    Solution,
    corrected,
    first_model,
    front_normal,
    linearise,
    make_priors,
    solve,
)
from crossmodal.systems.port_values import displacement_at

TOOL = Tool(k_W=np.array([0.1, -0.99, 0.05]) / np.linalg.norm([0.1, -0.99, 0.05]))
CAMERA = np.array([0.9, 0.0, 0.1])
Q = TOOL.contact_point(0.0)
X_WC = se3.looking_at(CAMERA, TOOL.p_WK)
Z = X_WC[:3, 2]
PERFECT = DepthCamera(intrinsics=INTRINSICS, X_WC=X_WC, pose_covariance=np.zeros((6, 6)))


def frames(angles: Array) -> StackedKeyframes:
    """Exact keyframes; the flap is seen where it does not look edge-on."""
    face, n, d, c = [], [], [], []
    for theta in angles:
        normal, distance, front = TOOL.plane(theta, CAMERA)
        seen = normal @ (CAMERA - TOOL.p_WK) > 0.25
        face.append((1.0 if front else -1.0) * seen)
        n.append(normal * seen)
        d.append(distance * seen)
        c.append(TOOL.contact_point(theta))
    covariance = np.tile(np.diag(np.repeat([1e-3, 1e-4], [3, 4]) ** 2), (len(face), 1, 1))
    return StackedKeyframes(
        face=np.array(face), n_W=np.array(n), d=np.array(d), p_WC=np.array(c),
        covariance=covariance,
    )  # fmt: skip


def true_model(camera: Array | None = None, touch: Array | None = None) -> HingeModel:
    zero = np.zeros(6)
    return HingeModel(
        TOOL.k_W,
        TOOL.p_WK,
        np.array([TOOL.front, TOOL.back]),
        TOOL.contact[:2],
        zero if camera is None else camera,
        zero if touch is None else touch,
        np.zeros(2),
    )


TURN = np.linspace(0.0, 2.1, 12)


def test_a_true_hinge_explains_planes_of_both_faces_and_contacts() -> None:
    stacked = frames(TURN)
    assert set(stacked.face) == {1.0, 0.0, -1.0}
    r, _, _ = linearise(true_model(), stacked, Q, Z)
    assert_allclose(r, 0.0, atol=1e-12)


def test_jacobians_are_finite_differences() -> None:
    rng = np.random.default_rng(1)
    stacked = frames(TURN)
    error = 0.01 * rng.normal(size=(2, 6))
    model = corrected(true_model(*error), 0.02 * rng.normal(size=SIZE))
    _, J, by_measured = linearise(model, stacked, Q, Z)
    step = 1e-6
    for i in range(SIZE):
        dx = step * np.eye(SIZE)[i]
        plus = linearise(corrected(model, dx), stacked, Q, Z)[0]
        minus = linearise(corrected(model, -dx), stacked, Q, Z)[0]
        # Corrections of small rotations are of first order, and so is their Jacobian.
        assert_allclose(J[:, :, i], (plus - minus) / (2.0 * step), atol=0.03)
    exact = true_model()
    _, J, by_measured = linearise(exact, stacked, Q, Z)
    for i in range(SIZE):
        dx = step * np.eye(SIZE)[i]
        plus = linearise(corrected(exact, dx), stacked, Q, Z)[0]
        minus = linearise(corrected(exact, -dx), stacked, Q, Z)[0]
        assert_allclose(J[:, :, i], (plus - minus) / (2.0 * step), atol=1e-8)
    for i in range(7):
        moved = []
        for sign in (1.0, -1.0):
            dz = sign * step * np.eye(7)[i]
            seen = stacked.seen
            other = replace(
                stacked,
                n_W=stacked.n_W + seen[:, None] * dz[:3],
                d=stacked.d + seen * dz[3],
                p_WC=stacked.p_WC + dz[4:],
            )
            moved.append(linearise(exact, other, Q, Z)[0])
        expected = (moved[0] - moved[1]) / (2.0 * step)
        assert_allclose(by_measured[:, :, i], expected, atol=1e-8)


def test_the_contact_alone_tells_the_fronts_normal() -> None:
    for theta in TURN:
        n = front_normal(true_model(), TOOL.contact_point(theta), Q)
        assert_allclose(n, TOOL.frame(theta)[:, 1], atol=1e-12)


def _solved(stacked: StackedKeyframes) -> Solution:
    none = np.zeros(12), 1e-10 * np.eye(12)
    priors = make_priors(Q, 0.2, 0.05, (1e-3, 1e-3), none, PERFECT)
    return solve(first_model(stacked, 0.2, none[0]), stacked, priors, 40)


@pytest.mark.parametrize("turn", [0.35, 0.7, 2.1])
def test_exact_planes_and_contacts_give_the_exact_hinge(turn: float) -> None:
    model, covariance, *_ = _solved(frames(np.linspace(0.0, turn, 12)))
    assert model.k_W @ TOOL.k_W > 1.0 - 1e-5
    apart = model.p_W - TOOL.p_WK
    apart -= TOOL.k_W * (TOOL.k_W @ apart)
    assert np.linalg.norm(apart) < 3e-3 / turn
    assert np.all(np.linalg.eigvalsh(covariance) > 0.0)


def test_a_hinge_behind_the_surface_is_found_where_intersections_are_not() -> None:
    stacked = frames(np.linspace(0.0, 0.7, 12))
    stacked = replace(stacked, d=stacked.d + 0.02)  # The front, 26 mm off the hinge.
    # Lines in which the planes meet lie on the planes.
    p = np.linalg.lstsq(stacked.n_W, stacked.d, rcond=None)[0]
    intersection = p - TOOL.p_WK
    intersection -= TOOL.k_W * (TOOL.k_W @ intersection)
    model = _solved(stacked).model
    apart = model.p_W - TOOL.p_WK
    apart -= TOOL.k_W * (TOOL.k_W @ apart)
    assert np.linalg.norm(intersection) > 0.02
    assert np.linalg.norm(apart) < 0.004
    assert model.offsets[0] == pytest.approx(0.026, abs=0.004)


def test_the_axis_points_so_that_the_turn_is_positive() -> None:
    forth = first_model(frames(np.linspace(0.0, 0.6, 5)), 0.2, np.zeros(12))
    back = first_model(frames(np.linspace(0.6, 0.0, 5)), 0.2, np.zeros(12))
    assert forth.k_W @ TOOL.k_W > 0.99
    assert back.k_W @ TOOL.k_W < -0.99


def test_a_constant_displacement_of_touch_is_told_from_the_hinges_place() -> None:
    offset = np.array([0.006, 0.0, -0.004])
    stacked = frames(TURN)
    stacked = replace(stacked, p_WC=stacked.p_WC + offset)
    spread = np.diag(np.repeat([1e-5, 1e-5, 1e-6, 0.01], 3) ** 2)
    priors = make_priors(Q, 0.2, 0.05, (1e-4, 1e-4), (np.zeros(12), spread), PERFECT)
    first = first_model(stacked, 0.2, np.zeros(12))
    model, covariance, *_ = solve(first, stacked, priors, 40)
    found = displacement_at(Q, Q) @ model.touch
    across = normal_basis(TOOL.k_W)
    assert_allclose(across @ found, across @ offset, atol=5e-4)
    std = np.sqrt(np.diag(covariance)[18:])
    assert std[1] > 0.009  # Along the axis nothing says.


def _stretched(stacked: StackedKeyframes, scale: float, focal: float) -> StackedKeyframes:
    """Planes as a camera shows them whose depths and focal length are wrong by so much."""
    A = (1.0 + scale) * np.eye(3) + focal * (np.eye(3) - np.outer(Z, Z))
    n = stacked.n_W @ np.linalg.inv(A)  # Of points x that seem to be at A (x - p) + p.
    p = X_WC[:3, 3]
    d = stacked.d - stacked.n_W @ p + n @ p
    length = np.maximum(np.linalg.norm(n, axis=1), 1e-9)
    return replace(stacked, n_W=n / length[:, None], d=d / length)


def test_a_camera_that_stretches_what_it_shows_is_allowed_for() -> None:
    scale, focal = 0.004, 0.008
    stacked = _stretched(frames(TURN), scale, focal)
    stacked = replace(stacked, covariance=stacked.covariance / 100.0)
    # By how much what is near Q is displaced the registration has found; by how much it is
    # stretched about Q it has not.
    ray = Q - X_WC[:3, 3]
    known = np.zeros(12)
    known[3:6] = scale * ray + focal * (ray - Z * (Z @ ray))
    spread = 1e-8 * np.eye(12)
    errors = {}
    for camera in (PERFECT, replace(PERFECT, depth_scale_std=0.005, focal_length_std=0.005)):
        priors = make_priors(Q, 0.2, 0.05, (1e-4, 1e-4), (known, spread), camera)
        first = first_model(stacked, 0.2, known)
        model, covariance, *_ = solve(first, stacked, priors, 40)
        across = normal_basis(model.k_W)
        off = (np.eye(3) - np.outer(model.k_W, model.k_W)) @ (Q - model.p_W)
        true = (np.eye(3) - np.outer(TOOL.k_W, TOOL.k_W)) @ (Q - TOOL.p_WK)
        e, P = across @ (off - true), across @ covariance[POINT, POINT] @ across.T
        errors[camera.focal_length_std] = nees(e, P)
    assert errors[0.005] < 6.0 < errors[0.0]
    assert_allclose(model.stretch, [scale, focal], atol=1e-3)


def test_an_outlying_plane_counts_for_little() -> None:
    stacked = frames(np.linspace(0.0, 0.7, 12))
    n = stacked.n_W.copy()
    n[5] = stacked.n_W[5] + [0.0, 0.4, 0.0]
    n[5] /= np.linalg.norm(n[5])
    model = _solved(replace(stacked, n_W=n)).model
    assert model.k_W @ TOOL.k_W > np.cos(0.01)


def test_keyframes_of_two_hinges_make_the_covariance_larger() -> None:
    stacked = frames(np.linspace(0.0, 0.7, 12))
    one = _solved(stacked)
    assert one.misfit < 1.0
    tilt = se3.so3_exp(np.array([0.0, 0.0, np.deg2rad(5.0)]))
    two = np.where(np.arange(12)[:, None] < 6, stacked.n_W, stacked.n_W @ tilt.T)
    both = _solved(replace(stacked, n_W=two))
    assert both.misfit > 2.0
    assert both.covariance[0, 0] > 2.0 * one.covariance[0, 0]
