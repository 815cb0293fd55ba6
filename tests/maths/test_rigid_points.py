"""The Jacobian of points that move with a body, against finite differences."""

import numpy as np
from numpy.testing import assert_allclose

from crossmodal.maths import se3
from crossmodal.maths.rigid_points import pose_jacobian


def test_pose_jacobian_is_the_derivative_of_a_moved_point() -> None:
    points = np.random.default_rng(1).normal(size=(5, 3))
    J, step = pose_jacobian(points), 1e-6
    for i in range(6):
        ahead, behind = se3.exp(step * np.eye(6)[i]), se3.exp(-step * np.eye(6)[i])
        difference = points @ (ahead - behind)[:3, :3].T + (ahead - behind)[:3, 3]
        assert_allclose(J[:, :, i], difference / (2.0 * step), atol=1e-8)
