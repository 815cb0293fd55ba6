"""Which of the objects in an image is the one that is sought."""

import numpy as np
import shapely

from crossmodal.maths.arrays import Array
from crossmodal.systems.port_values import Bodies, Segment, Segments


def target_segment(
    scene: Segments, name: str, place: Array, reach: float, others: Bodies, is_glass: bool
) -> Segment | None:
    """The object of that class where it is thought to be, or what is seen in its place.

    Of several the one that covers most of the table. A class may be told wrongly, from near and
    aside above all; then it is what covers the place, where no other object is known to be. Glass
    is not found so: what is seen through it has other depths.

    Args:
        scene: All objects of the image.
        name: Of the class.
        place: Where its middle is thought to be (2,), in W, [m].
        reach: How far from there it is at most, [m].
        others: Bodies that hold all others.
        is_glass: Whether a camera looks through it.
    """
    at = shapely.Point(place)
    near = [s for s in scene.segments if s.name == name and s.contour.distance(at) <= reach]
    hulls = [shapely.MultiPoint(np.asarray(body)[:, :2]).convex_hull for body in others]
    if not near and not is_glass and not any(hull.distance(at) == 0.0 for hull in hulls):
        near = [s for s in scene.segments if s.contour.contains(at) and not s.is_glass]
    return min(near, key=lambda s: (-round(s.contour.area, 9), s.number), default=None)
