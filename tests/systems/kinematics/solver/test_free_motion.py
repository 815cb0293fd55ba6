"""The evidence of a free motion against one dense Gaussian of all poses."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation
from scipy.stats import multivariate_normal

from crossmodal.maths import se3
from crossmodal.systems.kinematics.joint_filters import JointFilters, JointFiltersConfig
from crossmodal.systems.kinematics.keyframes import pose_keyframes
from crossmodal.systems.kinematics.keyframes.pose_keyframes import Keyframes
from crossmodal.systems.kinematics.solver import free_motion
from crossmodal.systems.port_values import JointType

WALK = np.repeat([0.09, 0.01], 3)
ACCELERATION = np.repeat([1.0, 0.1], 3)
JERK = np.repeat([1.0, 0.1], 3)
FIRST = np.array([np.repeat([0.1, 0.02], 3), np.repeat([0.4, 0.04], 3)])
MOTION = free_motion.free_motion(np.array([WALK, ACCELERATION, JERK]), FIRST)
MODELS = range(MOTION.order.size)
NONE = np.zeros(7)
OUTLIERS = np.array([0.02, *np.repeat([1.0, 0.09], 3)])
R = 1e-6 * np.eye(6)
SKEWED = np.diag([1e-6, 1e-6, 1e-6, 1e-5, 1e-6, 4e-6])
TURNED = Rotation.from_rotvec([0.3, -0.8, 0.5]).as_matrix()


def _keyframes(
    shifts: np.ndarray, outliers: np.ndarray = NONE, noise: np.ndarray = R, turned: bool = False
) -> Keyframes:
    """Poses that differ in translation only, so that the motion is linear."""
    kf = pose_keyframes.empty_keyframes(len(shifts), len(MODELS))
    for k, shift in enumerate(shifts):
        X = np.eye(4)
        X[:3, :3] = TURNED if turned else np.eye(3)
        X[:3, 3] = shift
        pose_keyframes.append(kf, X, noise, 0.1 * k, outliers)
    return kf


def _path(model: int, axis: int, times: np.ndarray) -> np.ndarray:
    """Covariance (N, N) of where a body is along one axis, from where it started."""
    S = MOTION.noise[model, axis]
    s, t = np.minimum.outer(times, times), np.maximum.outer(times, times)
    order = MOTION.order[model]
    if order == 0:
        return S * s
    outer = np.outer(times, times)
    if order == 1:
        return FIRST[0, axis] * outer + S * s**2 * (t / 2.0 - s / 6.0)
    first = FIRST[0, axis] * outer + FIRST[1, axis] * outer**2 / 4.0
    d = t - s
    return first + S / 4.0 * (s**5 / 5.0 + d * s**4 / 2.0 + d**2 * s**3 / 3.0)


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("model", MODELS)
def test_the_evidence_is_that_of_the_dense_problem(model: int, turned: bool) -> None:
    rng, n = np.random.default_rng(0), 6
    shifts, times = np.cumsum(0.01 * rng.normal(size=(n, 3)), axis=0), 0.1 * np.arange(n)
    kf = _keyframes(shifts, noise=SKEWED, turned=turned)
    kf.pending[0] = 1
    found = free_motion.log_evidences(kf, MOTION, NONE, np.ones((len(MODELS), n)))[:, model]
    T = TURNED if turned else np.eye(3)
    noise = np.zeros((6, 6))
    noise[:3, :3], noise[3:, 3:] = T @ SKEWED[:3, :3] @ T.T, T @ SKEWED[3:, 3:] @ T.T
    z = np.hstack([np.zeros((n, 3)), shifts - shifts[0]])
    for size, value in zip((n - 1, n), found, strict=True):
        # Given the first pose, whose place is not known before.
        C = np.kron(np.eye(size - 1) + 1.0, noise)
        for axis in range(6):
            C[axis::6, axis::6] += _path(model, axis, times[:size])[1:, 1:]
        expected = multivariate_normal(cov=C).logpdf(z[1:size].ravel())
        own = -0.5 * kf.log_det[1:size].sum() - 3.0 * (size - 1) * np.log(2.0 * np.pi)
        assert_allclose(value, expected - own + 0.5 * kf.log_det[0], rtol=1e-6)


def test_a_pose_that_jumps_back_and_forth_is_an_outlier() -> None:
    inlier, shifts = np.ones(20), np.zeros((20, 3))
    shifts[10, 1] = 0.3
    free_motion.free_evidence(_keyframes(shifts, OUTLIERS), MOTION, OUTLIERS, inlier)
    assert inlier[10] < 0.1
    assert (np.delete(inlier, 10) > 0.9).all()


@pytest.mark.parametrize("model", MODELS)
def test_the_likeliest_model_is_that_of_the_motion(model: int) -> None:
    rng, n = np.random.default_rng(1), 60
    shifts = np.cumsum(np.sqrt(0.1 * MOTION.noise[model, 3:]) * rng.normal(size=(n, 3)), axis=0)
    for _ in range(MOTION.order[model]):
        shifts = 0.1 * np.cumsum(shifts, axis=0)
    still = MOTION._replace(noise=MOTION.noise * np.repeat([1e-10, 1.0], 3))
    kf = _keyframes(shifts, noise=1e-4 * R)
    free_motion.explain(kf, still, NONE, np.ones(n))
    assert np.argmax(kf.explained) == model


def test_a_body_that_turns_evenly_about_itself_has_a_velocity() -> None:
    """At large angles too, where neither axis nor rate are known before."""
    kf = pose_keyframes.empty_keyframes(40, len(MODELS))
    for k in range(40):
        X = se3.exp(np.array([0.2, 0.1, 0.15, 0.0, 0.0, 0.0]) * k)
        pose_keyframes.append(kf, X, R, 0.1 * k, NONE)
    inside = free_motion.log_evidences(kf, MOTION, NONE, np.ones((len(MODELS), 40)))
    assert inside[1, 3:].min() > inside[1, :3].max() + 50.0
    assert np.argmax(inside[1]) in (5, 8)


def _rest_and_free(memory: int) -> float:
    """By how much rest is likelier than a free motion, for a body that rests."""
    filters, rng = JointFilters(JointFiltersConfig(memory=memory)), np.random.default_rng(2)
    noise = np.repeat([0.01, 0.003], 3)
    covariance = np.diag(noise**2)
    state = filters.start(np.eye(4), covariance, 0.0)
    for k in range(1, 100):
        state = filters.update(state, se3.exp(noise * rng.normal(size=6)), covariance, k / 15.0)
    models = filters.belief(state).models
    return models[JointType.RIGID].log_evidence - models[JointType.DISCONNECTED].log_evidence


def test_what_averaging_hides_is_remembered() -> None:
    """The evidence of rest over a free motion is the same with few keyframes and with many.

    But for what the bound of a joint's loss makes it too sure of a joint, two fifths at most.
    """
    assert_allclose(_rest_and_free(16), _rest_and_free(100), rtol=0.4)


def test_averaging_is_no_evidence_for_a_free_motion() -> None:
    """However smoothly a real joint deviates from its path."""
    filters, noise = JointFilters(JointFiltersConfig()), np.repeat([0.01, 0.003], 3)
    state = filters.start(np.eye(4), np.diag(noise**2), 0.0)
    for k in range(1, 150):
        X = se3.exp(np.array([0.0, 0.0, 0.0, 2e-3 * k, 3e-3 * np.sin(0.1 * k), 0.0]))
        state = filters.update(state, X, np.diag(noise**2), k / 15.0)
        assert (state.keyframes.free <= 0.0).all()
    assert filters.belief(state).type == JointType.PRISMATIC


def test_what_pends_is_explained_as_if_asked_for_at_once() -> None:
    """While no keyframes are averaged, how often it is asked for changes nothing."""
    rng, n = np.random.default_rng(3), 8
    shifts = np.cumsum(0.01 * rng.normal(size=(n, 3)), axis=0)
    values = []
    for every in (1, 4):
        kf = _keyframes(shifts[:2], OUTLIERS)
        kf = pose_keyframes.Keyframes._make(
            np.concatenate([x, np.zeros((n - 2, *x.shape[1:]), x.dtype)]) if len(x) == 2 else x
            for x in kf
        )
        for k in range(2, n):
            pose_keyframes.append(kf, se3.exp(np.r_[0, 0, 0, shifts[k]]), R, 0.1 * k, OUTLIERS)
            if k % every == 0:
                free_motion.explain(kf, MOTION, OUTLIERS, np.ones(n))
        assert_allclose(kf.free, 0.0, atol=1e-9)
        values.append(free_motion.free_evidence(kf, MOTION, OUTLIERS, np.ones(n)))
    assert_allclose(values[0], values[1], rtol=1e-12)
