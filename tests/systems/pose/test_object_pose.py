"""The pose of an object as a wrongly calibrated arm meets it."""

from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from crossmodal.maths import se3
from crossmodal.systems.port_values import UNKNOWN_POSE, ObjectPose
from crossmodal.systems.port_values.pose import deviations

# By which twist in W an arm is displaced per error of its base: rotations, then translations.
BASE = np.diag(np.repeat([5e-3, 3e-3], 3))
ERRORS = np.array([0.4, -1.0, 0.7, 1.2, -0.3, 0.5])


def believed(X: np.ndarray, errors: np.ndarray) -> ObjectPose:
    """A pose with errors of a calibration, each sample of which is off by noise of mean zero."""
    noise = np.random.default_rng(0).normal(size=(32, len(errors)))
    return replace(
        UNKNOWN_POSE,
        known=True,
        X=X,
        joint=np.eye(6 + len(errors)),
        samples=np.tile(X, (32, 1, 1)),
        calibration=errors + noise - noise.mean(axis=0),
    )


def pose() -> np.ndarray:
    X = np.eye(4)
    X[:3, :3] = Rotation.from_rotvec([0.3, -0.5, 1.1]).as_matrix()
    X[:3, 3] = [0.5, -0.1, 0.12]
    return X


def moved(X: np.ndarray, e: np.ndarray) -> np.ndarray:
    """X after a step (6,), rotation in O and translation in W."""
    Y = X.copy()
    Y[:3, :3] = X[:3, :3] @ Rotation.from_rotvec(e[:3]).as_matrix()
    Y[:3, 3] += e[3:]
    return Y


def test_an_arm_meets_the_object_where_it_believes_itself_to_be_then() -> None:
    """What it measures is displaced back by the belief; the way there is the inverse."""
    X = pose()
    met = believed(X, ERRORS).as_met(BASE)
    assert_allclose(se3.exp(BASE @ ERRORS) @ met.X, X, atol=1e-12)
    assert np.linalg.norm(met.X[:3, 3] - X[:3, 3]) > 3e-3


def test_its_covariance_is_that_of_small_errors() -> None:
    """Samples are of the joint Gaussian, in which pose and errors have to do with each other."""
    X, rng = pose(), np.random.default_rng(1)
    root = 1e-3 * rng.normal(size=(12, 12))
    root[6:] *= 1e3
    drawn = rng.normal(size=(20_000, 12)) @ root.T
    belief = replace(
        believed(X, np.zeros(6)),
        joint=root @ root.T,
        samples=np.array([moved(X, e) for e in drawn[:, :6]]),
        calibration=drawn[:, 6:],
    )
    met = belief.as_met(BASE)
    scale = np.sqrt(np.diag(met.joint)[:6])
    assert_allclose(
        met.covariance / np.outer(scale, scale),
        met.joint[:6, :6] / np.outer(scale, scale),
        atol=0.05,
    )


def test_errors_that_nothing_is_known_of_displace_nothing() -> None:
    belief = believed(pose(), np.zeros(0))
    assert_allclose(belief.as_met(BASE).X, belief.X)


def test_its_change_is_the_derivative_by_pose_and_errors() -> None:
    X, step = pose(), 1e-6
    change = believed(X, ERRORS).change_as_met(BASE)
    exact = 0.0 * ERRORS
    met = believed(X, exact).as_met(BASE).X
    numeric = np.zeros((6, 12))
    for axis, e in enumerate(step * np.eye(6)):
        numeric[:, axis] = deviations(met, believed(moved(X, e), exact).as_met(BASE).X[None])[0]
        numeric[:, 6 + axis] = deviations(met, believed(X, e).as_met(BASE).X[None])[0]
    assert_allclose(change, numeric / step, atol=1e-6)
