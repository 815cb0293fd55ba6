"""How to push an object over the table: away from the others, past the target, without toppling.

A push is straight and quasi-static. All places are in W's x and y, see `port_values.declutter`.
Source: section II-B.1 of the paper on active visuo-tactile perception in clutter. Beyond it, the
push leaves the target alone and is low enough; the paper's finger is a box of pixels, ours one of
metres, and it stands where no other object does wherever some direction allows that.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.affinity import translate

from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import number
from crossmodal.systems.declutter.segments import intersection_over_union
from crossmodal.systems.port_values import Push, Segment

SWEEPS = "sweeps the target"
TOPPLES = "topples it"

_LENGTH = 1e-6  # Lengths that differ by less are alike, [m];
_AREA = 1e-6  # so are areas, [m^2].
_STEP = 0.002  # Of the instants of a motion at which an overlap is looked at, [m].
_TURN = 10.0  # Between directions that are tried, [deg].
_ASIDE = 0.0025  # Between places of the finger that are tried, [m].


@dataclass(kw_only=True)
class PushConfig:
    """The finger, the push, and what an object stands."""

    # Of the closed gripper's two fingers: across and along the push.
    width: float = number(0.027, above=0.0, at_most=0.5, unit="m")
    depth: float = number(0.028, above=0.0, at_most=0.5, unit="m")
    # Free way of the finger before it meets the object, which may be nearer than it seems: two
    # standard deviations of what camera and arm, each 3 mm off, make of it.
    gap: float = number(0.009, at_least=0.0, at_most=0.1, unit="m")
    # Of the push, from the contact on: what was near the target is then beyond mu_d = .1 m, by more
    # than outlines err.
    length: float = number(0.13, above=0.0, at_most=1.0, unit="m")
    # Farthest place of the finger beside the line through the centroid; 15 mm turn an object by
    # 64 degrees within 10 cm, 5 mm hardly do.
    aside: float = number(0.005, at_least=0.0, at_most=0.1, unit="m")
    # Least distance of the finger and of the object from the target, throughout the push.
    clearance: float = number(0.005, at_least=0.0, at_most=0.1, unit="m")
    # From the direction away from the clutter, to both sides; beyond 90 it is into the clutter.
    largest_turn: float = number(90.0, at_least=0.0, at_most=180.0, unit="deg")
    # Coefficient between objects and table.
    friction: float = number(0.5, above=0.0, at_most=2.0)
    # Share of the outline's extent that the foot has at least: of the goods that stand, that of the
    # spray bottle has .59, that of the wineglass .88.
    foot: float = number(0.55, above=0.0, at_most=1.0)
    # Share of the toppling height that is used; so friction may be .7.
    margin: float = number(0.7, above=0.0, at_most=1.0)
    # Above the table, at which a finger can push.
    lowest: float = number(0.01, at_least=0.0, at_most=0.5, unit="m")


def away_from_clutter(
    segment: Segment, others: Sequence[Segment], target: Segment, width: float
) -> Array:
    """The unit vector (2,) d = -v / |v| with v = sum_i w_i v_i, v_i the way to another's centroid.

    The paper leaves w_i open. It is 1 / (|v_i|^2 + width^2): the influence |w_i v_i| falls with
    the distance, yet two centroids that nearly coincide, which say nothing, do not decide. Where v
    vanishes, d is the way from the target, and where that does, too, along the box's shorter edge.

    Args:
        segment: To be pushed.
        others: All others, the target too.
        target: The target.
        width: Of the finger, [m].
    """
    ways = np.array([other.centroid - segment.centroid for other in others])
    squared = np.square(ways).sum(axis=1)
    weights = 1.0 / (squared + width**2)
    for v in (weights @ ways / weights.sum(), target.centroid - segment.centroid):
        if np.linalg.norm(v) > _LENGTH:
            return np.asarray(-v / np.linalg.norm(v))
    edges = np.diff(shapely.get_coordinates(segment.box)[:3], axis=0)
    lengths = np.linalg.norm(edges, axis=1)
    across = edges[np.argmin(lengths)] / lengths.min()
    return np.asarray(across if tuple(np.round(across, 9)) > (0.0, 0.0) else -across)


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


def finger_place(
    segment: Segment, direction: Array, offset: float, config: PushConfig
) -> tuple[Array, shapely.Polygon] | None:
    """Where the finger pushes and where it stands before; None where its line misses the object.

    Args:
        segment: To be pushed.
        direction: Of the push (2,), a unit vector.
        offset: Of the finger's middle to the left of the line through the centroid, [m].
        config: Of the push.

    Returns:
        The hindmost point (2,) of the contour on the finger's line along the push, and the finger's
        rectangle: as far forward as its width allows, less the gap.
    """
    frame = np.array([direction, [-direction[1], direction[0]]])  # Along the push and left of it.
    own = shapely.transform(segment.contour, lambda p: (p - segment.centroid) @ frame.T)
    back, right, front, left = own.bounds
    line = own.intersection(shapely.LineString([(back, offset), (front, offset)]))
    if line.is_empty:
        return None
    right, left = offset - 0.5 * config.width, offset + 0.5 * config.width
    rear = own.intersection(shapely.box(back, right, front, left)).bounds[0] - config.gap
    finger = shapely.box(rear - config.depth, right, rear, left)
    point = segment.centroid + np.array([line.bounds[0], offset]) @ frame
    return point, shapely.transform(finger, lambda p: segment.centroid + p @ frame)


def swept(shape: shapely.Geometry, motion: Array) -> shapely.Geometry:
    """The hull of what a shape passes in a straight motion (2,), [m]."""
    return shapely.GeometryCollection([shape, translate(shape, *motion)]).convex_hull


def spares(segment: Segment, target: Segment, motion: Array, clearance: float) -> bool:
    """Whether an object that moves straight by `motion` (2,), [m], leaves the target alone.

    Its hull keeps the clearance [m], and where it is closer from the start it comes no closer.
    Where it touches the target or lies over a part of it, it never lies over a larger part.
    """
    before = segment.contour.convex_hull
    gap = before.distance(target.contour)
    if gap > _LENGTH:
        return bool(swept(before, motion).distance(target.contour) > min(clearance, gap) - _LENGTH)
    shares = np.linspace(0.0, 1.0, 1 + int(np.ceil(np.linalg.norm(motion) / _STEP)))
    moved = [translate(before, *(share * motion)) for share in shares]
    over = shapely.area(shapely.intersection(target.contour, moved))
    return bool(over.max() <= over[0] + _AREA)


def plan_pushes(
    segment: Segment, others: Sequence[Segment], target: Segment, config: PushConfig
) -> tuple[Push, ...]:
    """The pushes of an object that spare the target, the best one first; or one that says why not.

    There is one in each direction whose finger stands where no other object is, from that away from
    the clutter outwards, to the left first; where there is none, the one whose finger overlaps the
    others least. Among the places of the finger, the one of least overlap is taken, then the one
    nearest to the line through the centroid.

    Args:
        segment: To be pushed.
        others: All others, the target too.
        target: The target.
        config: Of the push.
    """
    away = away_from_clutter(segment, others, target, config.width)
    found, failures = list[Push](), set[str]()
    for turn in np.deg2rad(_both_sides(config.largest_turn, _TURN)):
        c, s = np.cos(turn), np.sin(turn)
        direction = np.array([[c, -s], [s, c]]) @ away
        height = push_height(segment, direction, config)
        if height < config.lowest:
            failures.add(TOPPLES)
            continue
        pushes = _pushes(segment, others, target, direction, height, config)
        if not pushes:
            failures.add(SWEEPS)
        else:
            found.append(min(pushes, key=lambda push: push.overlap))
    if not found:
        return (Push(why=f"every push {' or '.join(sorted(failures))}"),)
    free = tuple(push for push in found if push.overlap == 0.0)
    return free or (min(found, key=lambda push: push.overlap),)


def _both_sides(end: float, step: float) -> Array:
    """Multiples of a step up to an end, the least first, to the left before the right."""
    count = int(end / step + 1e-9)
    return step * np.array(sorted(range(-count, count + 1), key=lambda k: (abs(k), -k)))


def _pushes(
    segment: Segment,
    others: Sequence[Segment],
    target: Segment,
    direction: Array,
    height: float,
    config: PushConfig,
) -> list[Push]:
    """All that spare the target, with each place of the finger, the middle one first."""
    if not spares(segment, target, config.length * direction, config.clearance):
        return []
    found, middle = [], segment.centroid @ direction
    for offset in _both_sides(config.aside, _ASIDE):
        place = finger_place(segment, direction, offset, config)
        if place is None:
            continue
        point, finger = place
        strip = swept(finger, (config.gap + config.length) * direction)
        if strip.distance(target.contour) < config.clearance:
            continue
        overlaps = [intersection_over_union(other.contour, finger) for other in others]
        found.append(
            Push(
                point=point,
                direction=direction,
                length=config.length,
                reach=float(middle - (shapely.get_coordinates(finger) @ direction).max()),
                height=height,
                finger=finger,
                overlap=round(float(np.mean(overlaps)), 9),  # Rounding errors decide nothing.
            )
        )
    return found
