"""The box that holds an object at all poses that are believed in."""

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.systems.port_values import ObjectPose


def believed_box(belief: ObjectPose, hull: Array) -> tuple[Array, Array]:
    """Least and largest corner (3,) of the box that holds the object at all poses believed in.

    It has the axes of the likeliest pose, in whose frame the corners are, [m].

    Args:
        belief: About the pose.
        hull: Corners of the object's convex hull (H, 3), about its middle, [m].
    """
    R, t = belief.X[:3, :3], belief.X[:3, 3]
    X = np.concatenate([belief.samples, belief.X[None]])
    turned = ((R.T @ X[:, :3, :3]).reshape(-1, 3) @ hull.T).reshape(len(X), 3, -1)
    shift = (X[:, :3, 3] - t) @ R
    low, high = turned.min(axis=2) + shift, turned.max(axis=2) + shift
    return low.min(axis=0), high.max(axis=0)


def box_around(belief: ObjectPose, hull: Array) -> tuple[Array, Array]:
    """Edges (3,), [m], and X_WB (4, 4) of the box that `believed_box` gives."""
    low, high = believed_box(belief, hull)
    X_WB = belief.X.copy()
    X_WB[:3, 3] += X_WB[:3, :3] @ (0.5 * (low + high))
    return high - low, X_WB
