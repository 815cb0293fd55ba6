"""What objects on a table leave to others: where an arm must not go, and where things may stand.

Places are in W's x and y, see `port_values.declutter`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from scipy.spatial.transform import Rotation
from shapely.affinity import affine_transform

from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import number
from crossmodal.systems.port_values import Boxes, PosePrior, Segment, of_mesh


@dataclass(kw_only=True)
class AroundConfig:
    """How cautious to be."""

    # Height of an object of which nobody knows it: that of the tallest goods.
    unknown_top: float = number(0.3, above=0.0, at_most=2.0, unit="m")
    # By which a box is wider, to each side, than what was seen, and higher.
    margin: float = number(0.01, at_least=0.0, at_most=0.2, unit="m")
    # An object is put down so far from all others, farther than `DeclutterConfig.near`, or it would
    # be in the way again; and never nearer than the least distance, which fingers need to let go.
    apart: float = number(0.12, above=0.0, at_most=1.0, unit="m")
    least_apart: float = number(0.03, above=0.0, at_most=1.0, unit="m")
    # Between places that are looked at.
    step: float = number(0.02, at_least=1e-3, at_most=0.5, unit="m")
    # Of the middle of what is seen of an object, along each axis; the standard deviation.
    middle_error: float = number(0.01, above=0.0, at_most=1.0, unit="m")


def boxes_around(segments: Sequence[Segment], table: float, config: AroundConfig) -> Boxes:
    """Boxes on the table that hold objects, as obstacles.

    Args:
        segments: The objects.
        table: z of the table's plane in W, [m].
        config: With the margin.

    Returns:
        Edges (3,) [m] and poses X_WB (4, 4) of the boxes' middles.
    """
    return tuple(_box(segment, table, config) for segment in segments)


def _box(segment: Segment, table: float, config: AroundConfig) -> tuple[Array, Array]:
    long, short, angle = _edges(segment)
    height = _top(segment, config) + config.margin
    X_WB = np.eye(4)
    X_WB[:3, :3] = _about_z(angle)
    X_WB[:2, 3] = shapely.get_coordinates(segment.box.centroid)[0]
    X_WB[2, 3] = table + 0.5 * height
    return np.array([long + 2.0 * config.margin, short + 2.0 * config.margin, height]), X_WB


def free_places(
    segment: Segment,
    p_WE: Array,
    others: Sequence[Segment],
    target: Segment,
    eye: Array,
    area: shapely.Geometry,
    config: AroundConfig,
) -> Array:
    """Where a grasped object may be put down, the best place first.

    There it keeps a distance from all others and does not hide the target. Places that are far
    enough from all are best, among them the nearest; then those that are farther from the others.

    Args:
        segment: The object, where it was.
        p_WE: Where the gripper's frame E was when it took it (2,), in W, [m].
        others: All other objects, the target too.
        target: The target.
        eye: From where the target is seen (3,), x and y in W and height above the table, [m].
        area: Within which the arm can put things down, all of them on the table.
        config: With the distances.

    Returns:
        Places (K, 2) of E in W, [m]. The object is not turned, by as much as it is known.
    """
    x0, y0, x1, y1 = area.bounds
    x, y = np.arange(x0, x1, config.step), np.arange(y0, y1, config.step)
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    outline = shapely.get_coordinates(segment.contour.convex_hull)
    put = shapely.polygons(outline[None] + (places - p_WE)[:, None])
    hides = line_of_sight(target, eye, _top(segment, config))
    away = shapely.distance(put, shapely.union_all([other.contour for other in others]))
    is_free = (
        shapely.covers(area, put) & (away >= config.least_apart) & ~shapely.intersects(put, hides)
    )
    near = np.minimum(away, config.apart)
    way = np.linalg.norm(places - p_WE, axis=1)
    order = np.lexsort([way.round(9), -near.round(9)])
    return np.asarray(places[order[is_free[order]]])


def line_of_sight(target: Segment, eye: Array, height: float) -> shapely.Geometry:
    """Where something of that height [m] hides the foot of a target from an eye (3,).

    A ray from the foot is lower than the height on the share height / eye_z of its way.
    """
    share = min(height / eye[2], 1.0)
    foot = target.contour.convex_hull
    stretch = [1.0 - share, 0.0, 0.0, 1.0 - share, share * eye[0], share * eye[1]]
    ends = affine_transform(foot, stretch) if share < 1.0 else shapely.Point(eye[:2])
    return shapely.GeometryCollection([foot, ends]).convex_hull


def guess_of_pose(
    segment: Segment, hull: Array, middle: Array, table: float, config: AroundConfig
) -> PosePrior:
    """A first guess of an object's pose from its outline, turned in any way.

    What is seen is the middle of the object up to what others hide, half of that by which the
    outline is shorter than the object. If the outline is longer than the object is wide, it lies,
    its longest axis along the outline's.

    Args:
        segment: The object.
        hull: Corners of its model's convex hull (H, 3) about the model's middle, [m].
        middle: p_OM (3,) of the model, [m].
        table: z of the table's plane in W, [m].
        config: With the error of what is seen.
    """
    long, _, angle = _edges(segment)
    extents = np.ptp(hull, axis=0)
    up, longest = 2, int(np.argmax(extents))
    R = _about_z(angle)
    if longest == up and long > np.hypot(*extents[:2]):
        R = R @ Rotation.from_rotvec([0.0, 0.5 * np.pi, 0.0]).as_matrix()
    X_WM = np.eye(4)
    X_WM[:3, :3] = R
    X_WM[:2, 3] = segment.centroid
    X_WM[2, 3] = table - float(np.min(hull @ R[2]))
    hidden = max(float(extents[longest]) - long, 0.0)
    return PosePrior(
        X=of_mesh(X_WM, middle),
        rotation_sigma=np.inf,
        # Uniform within half of it, to both sides.
        translation_sigma=float(np.hypot(config.middle_error, 0.5 * hidden / np.sqrt(3.0))),
    )


def _top(segment: Segment, config: AroundConfig) -> float:
    return segment.top if np.isfinite(segment.top) else config.unknown_top


def _about_z(angle: float) -> Array:
    return np.asarray(Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix())


def _edges(segment: Segment) -> tuple[float, float, float]:
    """Lengths of the box's longer and shorter edge, [m], and the angle of the longer one, [rad]."""
    corners = shapely.get_coordinates(segment.box)
    edges = np.diff(corners[:3], axis=0)
    lengths = np.linalg.norm(edges, axis=1)
    x, y = edges[np.argmax(lengths)]
    return float(lengths.max()), float(lengths.min()), float(np.arctan2(y, x))
