"""What is around an object: bodies that hold the others, free places; and where about it is."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely

from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import number, numbers
from crossmodal.systems.declutter.segments import inner_part
from crossmodal.systems.port_values import Bodies, PosePrior, Segment, of_mesh

_LEAST = 1e-5  # Area of the base of a body, [m^2]; below a camera, [m].


@dataclass(kw_only=True)
class AroundConfig:
    """Of the table, and how far to keep away."""

    # Two opposite corners, x and y in W, of the part of the table where objects may be put down.
    corners: np.ndarray = numbers(
        np.array([[0.3, -0.35], [0.7, 0.35]]), at_least=-10.0, at_most=10.0, unit="m", shape=(2, 2)
    )
    # Around it, where objects are seen, too, and may be in the way.
    beyond: float = number(0.15, at_least=0.0, at_most=10.0, unit="m")
    # Between places that are tried.
    step: float = number(0.02, at_least=1e-3, at_most=1.0, unit="m")
    # Least free way between objects.
    margin: float = number(0.02, at_least=0.0, at_most=1.0, unit="m")
    # Objects that are farther apart do not hang together.
    near: float = number(0.1, at_least=0.0, at_most=10.0, unit="m")
    # Height of an object of which none was measured.
    unknown_top: float = number(0.3, above=0.0, at_most=2.0, unit="m")
    # Of an object, along its longer edge, which is in a body of its own.
    slab: float = number(0.05, above=0.0, at_most=10.0, unit="m")
    # Of the middle of what is seen of an object, along each axis; the standard deviation.
    middle_error: float = number(0.015, above=0.0, at_most=1.0, unit="m")


def top_of(segment: Segment, config: AroundConfig) -> float:
    """Height of an object above the table, [m]."""
    return segment.top if np.isfinite(segment.top) else config.unknown_top


def bodies_around(segments: Sequence[Segment], height: float, config: AroundConfig) -> Bodies:
    """Vertices (N, 3) [m] in W of upright prisms that hold objects, from the table up.

    Along an object there is one after the other, so that together they are not much larger than it
    is, though each is convex.

    Args:
        segments: The objects.
        height: Of the table in W, [m].
        config: With the height of objects whose height is unknown.
    """
    bodies = []
    for segment in segments:
        corners = shapely.get_coordinates(segment.box)[:4]
        along, across = corners[1] - corners[0], corners[3] - corners[0]
        if np.linalg.norm(along) < np.linalg.norm(across):
            along, across = -across, along
        length = float(np.linalg.norm(along))
        c, s = along / length
        frame = np.array([[c, -s], [s, c]])
        outline = shapely.transform(segment.contour, lambda p, frame=frame: p @ frame)
        left, low, _, high = outline.bounds
        ends = left + np.linspace(0.0, length, max(round(length / config.slab), 1) + 1)
        for start, end in pairwise(ends):
            part = outline.intersection(shapely.box(start, low, end, high)).convex_hull
            if part.is_empty:
                continue
            if part.area < _LEAST:
                part = part.buffer(np.sqrt(_LEAST))
            base = shapely.get_coordinates(part) @ frame.T
            bodies.append(
                np.vstack(
                    [
                        np.column_stack([base, np.full(len(base), height + z)])
                        for z in (0.0, top_of(segment, config))
                    ]
                )
            )
    return tuple(bodies)


def passed_heights(
    segment: Segment, others: Sequence[Segment], places: Array, config: AroundConfig
) -> Array:
    """How high that is (K,) which an object passes over on straight ways to places, [m].

    What it touches when it sets out is beside it, and is not passed over unless it lies ahead.

    Args:
        segment: The object.
        others: All others.
        places: Where its centroid goes (K, 2), [m].
        config: With the height of objects whose height is unknown.
    """
    own = shapely.get_coordinates(inner_part(segment))
    ways = (places - segment.centroid)[:, None]
    passed = shapely.convex_hull(
        shapely.multipoints(np.concatenate([own + 0.0 * ways, own + ways], axis=1))
    )
    found = np.zeros(len(places))
    for other in others:
        over = shapely.intersects(passed, other.contour)
        found = np.where(over, np.maximum(found, top_of(other, config)), found)
    return found


def free_places(
    segment: Segment, others: Sequence[Segment], target: Segment, config: AroundConfig
) -> Array:
    """Places (K, 2) of its centroid where an object may be put down, turned as it is.

    Those where it hangs on nothing come first, then the nearest one.

    Args:
        segment: The object.
        others: All others, the target too.
        target: From which it keeps away so far that it does not hang on it.
        config: Of the table and of distances, [m].
    """
    low, high = config.corners
    axes = [np.arange(a, b + 1e-9, config.step) for a, b in zip(low, high, strict=True)]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    outline = shapely.get_coordinates(segment.contour.convex_hull) - segment.centroid
    there = shapely.polygons(places[:, None] + outline)
    shapely.prepare(there)
    apart = np.min([shapely.distance(there, other.contour) for other in others], axis=0)
    # Outlines of two images differ: what is put down hangs on the target in neither.
    clear = shapely.distance(there, target.contour) > config.near + 2.0 * config.margin
    free = clear & (apart > config.margin)
    far = np.linalg.norm(places - segment.centroid, axis=1)
    order = np.lexsort((far, apart <= config.near))
    return np.asarray(places[order[free[order]]])


def guess_of(
    segment: Segment, middle: Array, edges: Array, height: float, eye: Array, config: AroundConfig
) -> PosePrior:
    """Where about a known object is of which a part was seen; it may be turned in any way.

    The part that others hide is as long as the object is longer than what was seen; then the
    object's middle is anywhere within half of that, to both sides of the middle of what was seen.
    Glass, of which no height is seen, stands on any of its sides, and what is outlined of it is
    anywhere on the line of sight from where it is outlined up to its top.

    Args:
        segment: The object.
        middle: p_OM (3,) of its model, [m].
        edges: Of the model's bounding box (3,), [m].
        height: Of the table in W, [m].
        eye: p_WC (3,) of the camera that saw it, [m].
        config: With the height of objects whose height is unknown, and the outlines' error.
    """
    sides = np.diff(shapely.get_coordinates(segment.box), axis=0)
    seen = float(np.linalg.norm(sides, axis=1).max())
    lowest = highest = top_of(segment, config)
    spread = np.zeros(2)
    if segment.is_glass:
        lowest, highest = edges.min(), edges.max()
        outlined, top = segment.base + 0.5 * np.sort(edges)[1], segment.base + highest
        rising = (top - outlined) / max(eye[2] - height - outlined, _LEAST)
        spread = 0.5 * min(rising, 1.0) * (eye[:2] - segment.centroid)
    else:
        seen = max(seen, highest)
    hidden = max(edges.max() - seen, 0.0, 0.5 * (highest - lowest))
    X_WM = np.eye(4)
    X_WM[:3, 3] = [*(segment.centroid + spread), height + 0.25 * (lowest + highest)]
    ends = np.array([0.5 * hidden, np.linalg.norm(spread)])  # Of uniform distributions.
    return PosePrior(
        X=of_mesh(X_WM, middle),
        rotation_sigma=np.inf,
        translation_sigma=float(np.sqrt(config.middle_error**2 + np.square(ends).sum() / 3.0)),
    )
