"""The exponential and logarithm without temporary matrices against those of `se3`."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from crossmodal.maths import se3
from crossmodal.maths.se3_in_place import perturb, pose_difference, relative_log


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 0.5, 3.0, np.pi - 1e-6])
def test_perturb_and_relative_log_are_exp_and_log(angle: float) -> None:
    rng = np.random.default_rng(0)
    axis = rng.normal(size=3)
    xi = np.concatenate([angle * axis / np.linalg.norm(axis), rng.normal(size=3)])
    A, B, back = se3.exp(rng.normal(size=6)), np.empty((4, 4)), np.empty(6)
    perturb(A, xi, B)
    assert_allclose(B, A @ se3.exp(xi), atol=1e-12)
    relative_log(A, B, back)
    assert_allclose(back, xi, atol=1e-7)


def test_the_difference_of_two_poses_is_rotation_and_translation_apart() -> None:
    rng = np.random.default_rng(1)
    A, w, p, out = se3.exp(rng.normal(size=6)), rng.normal(size=3), rng.normal(size=3), np.empty(6)
    B = np.eye(4)
    B[:3, :3], B[:3, 3] = se3.exp(np.concatenate([w, np.zeros(3)]))[:3, :3], p
    pose_difference(A, A @ B, out)
    assert_allclose(out, np.concatenate([w, p]), atol=1e-12)


def test_perturb_may_write_into_its_argument() -> None:
    A, xi = se3.exp(np.arange(6.0) / 5.0), np.arange(6.0) / 7.0
    expected = A @ se3.exp(xi)
    perturb(A, xi, A)
    assert_allclose(A, expected)
