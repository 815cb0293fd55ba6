"""On which facets of their hulls objects stand."""

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import ConvexHull

from crossmodal.maths.convex import steady_directions


def test_a_block_stands_on_its_faces_and_not_where_it_would_topple() -> None:
    corners = np.array(np.meshgrid([0, 0.1], [0, 0.1], [0, 0.2]), dtype=float).reshape(3, 8).T
    hull, tilt = ConvexHull(corners), np.deg2rad(3.0)
    middle = np.array([0.05, 0.05, 0.1])
    found = np.unique(steady_directions(hull, middle, tilt).round(6) + 0.0, axis=0)
    assert_array_equal(found, np.unique(np.vstack([np.eye(3), -np.eye(3)]) + 0.0, axis=0))
    # With its mass 1 mm from the face x = 0 it topples from its ends when tilted by 0.6 deg.
    beside = steady_directions(hull, np.array([0.001, 0.05, 0.1]), tilt)
    assert_allclose(np.unique(np.abs(beside[:, 2]).round(6)), [0.0])
    # At rest, and not tilted, it stands on them still.
    at_rest = steady_directions(hull, np.array([0.001, 0.05, 0.1]))
    assert_allclose(np.unique(np.abs(at_rest[:, 2]).round(6)), [0.0, 1.0])
