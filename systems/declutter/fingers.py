"""Where a gripper's fingers come down, and what is known to be there."""

import numpy as np
import shapely

from crossmodal.maths.arrays import Array
from crossmodal.models.gripper_taxels import THICKNESS, TRAVEL, WIDTH
from crossmodal.systems.port_values import Grasp, Grasps, Push, Tries

_AROUND = 0.01  # What stopped a finger reaches at least so far around where it was felt, [m].


def fingers_at(middle: Array, along: Array, opening: float) -> shapely.Geometry:
    """The rectangles in W in which the two fingers come down.

    Args:
        middle: Between them (2,), in W, [m].
        along: Unit vector (2,) along their opening.
        opening: Of each finger, [m].
    """
    across = np.array([-along[1], along[0]])
    corners = np.array([[0.0, -0.5], [1.0, -0.5], [1.0, 0.5], [0.0, 0.5]]) * [THICKNESS, WIDTH]
    corners[:, 0] += opening
    one = corners @ np.vstack([along, across])
    return shapely.multipolygons(shapely.polygons(middle + np.stack([one, -one])))


def fingers_of(way: Grasp | Push) -> shapely.Geometry:
    """Where the fingers of a grasp or a push come down, in W."""
    if isinstance(way, Push):
        return fingers_at(way.place, way.direction, way.opening)
    x = way.X_WE[:2, 0] / np.linalg.norm(way.X_WE[:2, 0])
    return fingers_at(way.X_WE[:2, 3], x, min(0.5 * way.width, TRAVEL))


def comes_down(way: Grasp | Push, tries: Tries) -> bool:
    """Whether the fingers of a grasp or a push meet nothing that has stopped one before."""
    return not shapely.intersects(fingers_of(way), tries.blocked.buffer(_AROUND))


def grasps_left(grasps: Grasps, tries: Tries) -> dict[int, tuple[Grasp, ...]]:
    """The grasps of each object, by its number, whose fingers come down."""
    return {
        number: tuple(grasp for grasp in found if comes_down(grasp, tries))
        for number, found in grasps.grasps.items()
    }
