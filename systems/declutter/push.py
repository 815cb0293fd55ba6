"""What a straight, quasi-static push does: where the finger fits, what moves along, what is met.

All places are in W's x and y, see `port_values.declutter`. The finger is a box with a palm above
it, which comes down where it is free. The palm juts out beyond the closed fingers; where it would
meet something, as a high object itself, the fingers are opened: then the one in front is below the
palm's edge, and what is high is before both. Which push is made is chosen in `push_planning`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from crossmodal.maths.arrays import Array, Mask
from crossmodal.maths.validation import number
from crossmodal.models.gripper_taxels import PALM, PALM_ABOVE, THICKNESS, WIDTH
from crossmodal.systems.declutter.fingers import fingers_at
from crossmodal.systems.declutter.segments import INNER
from crossmodal.systems.port_values import Segment

LENGTH = 1e-6  # Lengths that differ by less are alike, [m].

_AREA = 1e-6  # So are areas, [m^2].
_INSIDE = 1e-3  # Of an outline, where it is certainly met, [m].
_TURNED = 0.5 * np.pi  # Farther nothing is turned: the finger has gone by.


@dataclass(kw_only=True)
class PushConfig:
    """The push, and what an object stands."""

    # Free way of the finger before it meets the object, which may be nearer than it seems: two
    # standard deviations of what camera and arm, each 3 mm off, make of it.
    gap: float = number(0.009, at_least=0.0, at_most=0.1, unit="m")
    # Of the push, from the contact on, at least; it is as long as it takes.
    shortest: float = number(0.06, above=0.0, at_most=1.0, unit="m")
    # Of the push, from the contact on, at most.
    longest: float = number(0.2, above=0.0, at_most=1.0, unit="m")
    # Distance from the target to which it takes the object: beyond mu_d by more than outlines err,
    # and by as much as what turns when pushed stays behind.
    clear: float = number(0.15, at_least=0.0, at_most=1.0, unit="m")
    # Least distance of the finger and of the object from the target, throughout the push.
    clearance: float = number(0.005, at_least=0.0, at_most=0.1, unit="m")
    # From the direction away from the clutter, to both sides.
    largest_turn: float = number(180.0, at_least=0.0, at_most=180.0, unit="deg")
    # Coefficient between objects and table.
    friction: float = number(0.5, above=0.0, at_most=2.0)
    # Tangent of the angle between the push and the normal of the object's rear, up to which the
    # finger does not slide: 0.7 of a coefficient of friction of 0.5.
    sticks: float = number(0.35, above=0.0, at_most=2.0)
    # Share of the outline's extent that the foot has at least: of the goods that stand, that of the
    # spray bottle has .59, that of the wineglass .88.
    foot: float = number(0.55, above=0.0, at_most=1.0)
    # Share of the toppling height that is used; so friction may be .7.
    margin: float = number(0.7, above=0.0, at_most=1.0)
    # Of the fingers' ends above the table, which may be 2 mm higher than believed, and the arm some
    # 4 mm lower. Their outer taxels are 6 mm above them.
    lowest: float = number(0.006, at_least=0.0, at_most=0.5, unit="m")
    # By which the fingers' ends are below an object's top at least.
    grip: float = number(0.01, at_least=0.0, at_most=0.5, unit="m")
    # What is not higher may be turned over: it does not fall.
    low: float = number(0.03, at_least=0.0, at_most=0.5, unit="m")
    # Between palm and what it passes over; heights err by as much.
    above: float = number(0.01, at_least=0.0, at_most=0.5, unit="m")


def push_height(segment: Segment, direction: Array, config: PushConfig) -> float:
    """Highest place above the table [m] at which a push is safe not to topple an object.

    A quasi-static push balances friction, F = mu m g, and turns the object about its foremost foot,
    r ahead of its centre of mass, by F h against m g r. So it topples above r / mu, whatever the
    centre's height; a margin of that is used. Seen is the outline alone, an upper bound: a
    wineglass's bulb is wider than its foot. So r is a share of the outline's extent from its
    centroid, ahead or behind, whichever is smaller: where something juts out on one side, as a
    spray bottle's nozzle, there is no foot.

    Args:
        segment: To be pushed.
        direction: Of the push (2,), a unit vector.
        config: With that share, the margin and the friction.
    """
    along = (shapely.get_coordinates(segment.contour) - segment.centroid) @ direction
    r = config.foot * min(along.max(), -along.min())
    return float(config.margin * r / config.friction)


def finger_places(
    segment: Segment, direction: Array, offsets: Array, config: PushConfig, opening: float = 0.0
) -> tuple[Array, Array]:
    """Where the finger pushes and where it stands before, for those lines that meet the object.

    Args:
        segment: To be pushed.
        direction: Of the push (2,), a unit vector.
        offsets: Of the finger's middle to the left of the line through the centroid (N,), [m].
        config: Of the push.
        opening: Of each finger, [m]. At zero both count as one, else it is the one in front.

    Returns:
        The hindmost points (P, 2) of the contour on the finger's lines along the push, and the
        finger's edges (P, 4), see `rectangles`: as far forward as its width allows, less the gap.
    """
    frame = push_frame(direction)
    own = shapely.transform(segment.contour, lambda p: (p - segment.centroid) @ frame.T)
    back, _, front, _ = own.bounds
    ends = np.array([[[back, offset], [front, offset]] for offset in offsets]).reshape(-1, 2, 2)
    hindmost = shapely.bounds(shapely.intersection(own, shapely.linestrings(ends)))[:, 0]
    offsets, hindmost = (of[np.isfinite(hindmost)] for of in (offsets, hindmost))
    right, left = offsets - 0.5 * WIDTH, offsets + 0.5 * WIDTH
    wide = shapely.intersection(own, shapely.box(back, right, front, left))
    rear = shapely.bounds(wide)[:, 0] - config.gap
    points = segment.centroid + np.column_stack([hindmost, offsets]) @ frame
    depth = THICKNESS if opening else 2.0 * THICKNESS
    return points, np.column_stack([rear - depth, right, rear, left])


def slopes(segment: Segment, direction: Array, points: Array) -> Array:
    """Of the contour at points (N, 2) where a finger pushes, across the push: its sides' tangents.

    They are taken over a finger's width to both sides, since outlines err. A finger slides along an
    object that is steeper than their coefficient of friction, and what is round rolls away from it.

    Args:
        segment: To be pushed.
        direction: Of the push (2,), a unit vector.
        points: Hindmost ones along the push.
    """
    frame = push_frame(direction)
    own = shapely.transform(segment.contour, lambda p: (p - segment.centroid) @ frame.T)
    back, right, front, left = own.bounds
    middle = (points - segment.centroid) @ frame[1]
    sides = np.clip(middle[:, None] + [-WIDTH, WIDTH], right + _INSIDE, left - _INSIDE)
    lines = np.stack(np.broadcast_arrays([[back, front]], sides[..., None]), axis=-1)
    hindmost = shapely.bounds(shapely.intersection(own, shapely.linestrings(lines)))[..., 0]
    return np.asarray(np.diff(hindmost)[:, 0] / np.diff(sides)[:, 0])


def rectangles(segment: Segment, direction: Array, edges: Array) -> Array:
    """Polygons (...) of rectangles along a push.

    Args:
        segment: To be pushed.
        direction: Of the push (2,), a unit vector.
        edges: Back and front along the push, right and left of it, from the object's centroid, in
            the order back, right, front, left (..., 4), [m].
    """
    corners = edges[..., [[0, 1], [2, 1], [2, 3], [0, 3]]]
    return np.asarray(shapely.polygons(segment.centroid + corners @ push_frame(direction)))


def lever(offset: float) -> float:
    """Of a push beside the centroid [m]: zero as long as that is behind the finger's flat face.

    Args:
        offset: Of the finger's middle to the left of the line through the centroid, [m].
    """
    return float(np.sign(offset) * max(abs(offset) - 0.5 * WIDTH, 0.0))


def torque_per_force(segment: Segment) -> float:
    """The greatest ones of friction below an object, [m]."""
    edges = np.diff(shapely.get_coordinates(segment.box)[:3], axis=0)
    return float(np.sqrt(np.square(edges).sum() / 15.0))


def outlines_on_the_way(
    segment: Segment, direction: Array, lever: float, lengths: Array, size: float = 1.0
) -> Array:
    """The hulls (K,) of an object's outline after so long pushes.

    The push is quasi-static; friction's greatest forces and torques are taken to lie on an
    ellipsoid. Then the object goes along the push by c^2 / (c^2 + b^2) of its length and turns by
    b / (c^2 + b^2) per length, where b is the lever and c the ratio of greatest torque and force,
    for a rectangle with the edges e about sqrt((e_1^2 + e_2^2) / 15).
    Source of the ellipsoid: R. D. Howe and M. R. Cutkosky, IJRR 1996.

    Args:
        segment: The object.
        direction: Of the push (2,), a unit vector.
        lever: By which it passes the centroid on the left, [m].
        lengths: Of the pushes (K,), [m].
        size: Of the outline; smaller ones do not meet what only touches the object.
    """
    squared = torque_per_force(segment) ** 2
    whole = squared + lever**2
    turns = np.clip(-lever / whole * lengths, -_TURNED, _TURNED)
    c, s = np.cos(turns), np.sin(turns)
    R = np.moveaxis(np.array([[c, -s], [s, c]]), -1, 0)
    own = size * (shapely.get_coordinates(segment.contour.convex_hull) - segment.centroid)
    gone = squared / whole * lengths[:, None] * direction
    corners = own @ np.moveaxis(R, 1, 2) + (segment.centroid + gone)[:, None]
    return np.asarray(shapely.polygons(corners))


def spared(outlines: Array, target: Segment, clearance: float) -> Mask:
    """Up to which instants (K,) an object with these hulls (K,) has left the target alone.

    It keeps the clearance [m], and where it is closer from the start it comes no closer. Where it
    touches the target or lies over a part of it, it never lies over a larger part.
    """
    gaps = shapely.distance(outlines, target.contour)
    if gaps[0] > LENGTH:
        fine = gaps > min(clearance, gaps[0]) - LENGTH
    else:
        over = shapely.area(shapely.intersection(target.contour, outlines))
        fine = over <= over[0] + _AREA
    return np.asarray(np.logical_and.accumulate(fine))


def stays(outlines: Array, table: shapely.Geometry) -> Mask:
    """Up to which instants (K,) an object with these hulls (K,) is not farther off the table."""
    off = shapely.area(shapely.difference(outlines, table))
    return np.asarray(np.logical_and.accumulate(off <= off[0] + _AREA))


def first_met(
    segment: Segment, others: Sequence[Segment], direction: Array, lever: float, lengths: Array
) -> Array:
    """At which of so long pushes (K,) others (N,) are first met, without those only touched."""
    outlines = outlines_on_the_way(segment, direction, lever, lengths, INNER)
    meets = shapely.intersects(prepared_contours(others)[:, None], outlines)
    return np.where(meets.any(axis=1), meets.argmax(axis=1), len(lengths))


def hand_heights(
    segment: Segment,
    others: Sequence[Segment],
    direction: Array,
    fingers: Array,
    ways: Array,
    config: PushConfig,
    opening: float = 0.0,
) -> Array:
    """Least heights (N,) of the fingers' ends above the table [m] at which the palm meets nothing.

    Infinite, where the finger meets another object before its own one, where the other finger meets
    any, and where the palm would be above one whose height is not known.

    Args:
        segment: To be pushed.
        others: All others.
        direction: Of the push (2,), a unit vector.
        fingers: Edges of the finger where it comes down (N, 4), see `rectangles`.
        ways: Of the finger (N,), [m].
        config: With the distance between palm and objects.
        opening: Of each finger, [m].
    """
    contours = prepared_contours(others)
    tops = np.nan_to_num([other.top for other in others], nan=np.inf)
    along, across = 0.5 * np.array(PALM)
    right, front, left = fingers[:, 1:].T
    middle, sides = finger_middles(fingers, opening).T
    palms = np.column_stack([middle - along, sides - across, middle + along, sides + across])
    # The object goes ahead of the finger: what the palm is above, it is above all the way.
    below = _swept_meets(segment, direction, palms, ways, contours)
    highest = np.where(below, tops, 0.0).max(axis=1, initial=0.0)
    if np.isfinite(segment.top):
        above_own = shapely.intersects(rectangles(segment, direction, palms), segment.contour)
        highest = np.maximum(highest, np.where(above_own, segment.top, 0.0))
    least = np.maximum(config.lowest, highest + config.above - PALM_ABOVE)
    gaps = np.full(len(fingers), config.gap)
    meets = _swept_meets(segment, direction, fingers, gaps, contours).any(axis=1)
    if opening:
        behind = front - 2.0 * opening - THICKNESS  # Front of the other finger.
        other = np.column_stack([behind - THICKNESS, right, behind, left])
        meets |= _swept_meets(segment, direction, other, ways, contours).any(axis=1)
    return np.asarray(np.where(meets, np.inf, least))


def has_room(
    middles: Sequence[Array] | Array,
    others: Sequence[Segment],
    direction: Array,
    opening: float,
    config: PushConfig,
) -> Mask:
    """Whether fingers around middles (N, 2) in W are as far from others as from their object."""
    fingers = np.array([fingers_at(middle, direction, opening) for middle in middles])
    apart = shapely.distance(fingers[:, None], prepared_contours(others))
    return np.asarray(apart.min(axis=1, initial=np.inf) >= config.gap - LENGTH)


def finger_middles(fingers: Array, opening: float) -> Array:
    """Middles (N, 2) between the fingers, along a push and to its left, see `rectangles`."""
    return np.column_stack(
        [fingers[:, 2] - opening - THICKNESS, 0.5 * (fingers[:, 1] + fingers[:, 3])]
    )


def swept_edges(edges: Array, ways: Array) -> Array:
    """Of rectangles (N, 4) that go forward by ways (N,), [m]: what they pass."""
    return np.asarray(edges + ways[:, None] * [0.0, 0.0, 1.0, 0.0])


def prepared_contours(segments: Sequence[Segment]) -> Array:
    """Of objects (N,), prepared to be compared with many other shapes."""
    contours = np.array([segment.contour for segment in segments], object)
    shapely.prepare(contours)
    return contours


def push_frame(direction: Array) -> Array:
    """Unit vectors along a push and to its left, as rows (2, 2)."""
    return np.array([direction, [-direction[1], direction[0]]])


def _swept_meets(
    segment: Segment, direction: Array, edges: Array, ways: Array, contours: Array
) -> Array:
    """Which rectangles (N, 4) meet which contours (M,) on their ways forward (N,): (N, M)."""
    passed = rectangles(segment, direction, swept_edges(edges, ways))
    return np.asarray(shapely.intersects(contours, passed[:, None]))
