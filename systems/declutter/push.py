"""How to push an object over the table: away from the others, past the target, without toppling.

A push is straight and quasi-static. All places are in W's x and y, see `port_values.declutter`.
Source: section II-B.1 of the paper on active visuo-tactile perception in clutter. Beyond it, the
push leaves the target alone and is low enough; the paper's finger is a box of pixels, ours one of
metres, and it stands where no other object does wherever some direction allows that.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.polygons import (
    area,
    clipped,
    convex_hull,
    distance,
    intersection_over_union,
)
from crossmodal.maths.validation import number
from crossmodal.systems.port_values import NO_PUSH, Push, Segment

SWEEPS = "sweeps the target"
TOPPLES = "topples it"

_VANISHES = 1e-6  # Of the sum of lengths: a shorter sum of vectors is one of rounding errors.
_LENGTH = 1e-6  # Lengths that differ by less are alike, [m];
_AREA = 1e-6  # so are areas, [m^2].
_STEP = 0.002  # Of the instants of a motion at which an overlap is looked at, [m].


@dataclass(kw_only=True)
class PushConfig:
    """The finger, the push, and what an object stands."""

    # Of the closed gripper's two fingers: across and along the push.
    width: float = number(0.027, above=0.0, at_most=0.5, unit="m")
    depth: float = number(0.028, above=0.0, at_most=0.5, unit="m")
    # Free way of the finger before it meets the object.
    gap: float = number(0.005, at_least=0.0, at_most=0.1, unit="m")
    # Of the push, from the contact on.
    length: float = number(0.1, above=0.0, at_most=1.0, unit="m")
    # Farthest place of the finger beside the line through the centroid; 15 mm turn an object by
    # 64 degrees within 10 cm, 5 mm hardly do.
    aside: float = number(0.005, at_least=0.0, at_most=0.1, unit="m")
    # Places of the finger that are compared, along the contour from one such end to the other.
    places: int = number(5, at_least=1, at_most=1001)
    # Least distance of the finger and of the object from the target, throughout the push.
    clearance: float = number(0.005, at_least=0.0, at_most=0.1, unit="m")
    # Steps and end of the directions to both sides of that away from the clutter.
    turn_step: float = number(10.0, at_least=0.1, at_most=90.0, unit="deg")
    largest_turn: float = number(90.0, at_least=0.0, at_most=180.0, unit="deg")
    # Coefficient between objects and table, and the share of the toppling height that is used.
    friction: float = number(0.5, above=0.0, at_most=2.0)
    margin: float = number(0.5, above=0.0, at_most=1.0)
    # Above the table, at which a finger can push.
    lowest: float = number(0.01, at_least=0.0, at_most=0.5, unit="m")


def away_from_clutter(
    segment: Segment, others: Sequence[Segment], target: Segment | None, width: float
) -> Array:
    """The unit vector (2,) d = -v / |v| with v = sum_i w_i v_i, v_i the way to another's centroid.

    The paper leaves w_i open. It is 1 / (|v_i|^2 + width^2): the influence |w_i v_i| falls with
    the distance, yet two centroids that nearly coincide, which say nothing, do not decide. Where v
    vanishes, d is the way from the target, and without one along the box's shorter edge.

    Args:
        segment: To be pushed.
        others: All others, the target too.
        target: None where there is none.
        width: Of the finger, [m].
    """
    ways = np.array([other.centroid - segment.centroid for other in others]).reshape(-1, 2)
    squared = np.square(ways).sum(axis=1)
    weights = 1.0 / (squared + width**2)
    v = weights @ ways
    if np.linalg.norm(v) > _VANISHES * (weights @ np.sqrt(squared)):
        return np.asarray(-v / np.linalg.norm(v))
    if target is not None:
        v = target.centroid - segment.centroid
        if np.linalg.norm(v) > _LENGTH:
            return np.asarray(-v / np.linalg.norm(v))
    edges = np.diff(segment.box[:3], axis=0)
    lengths = np.linalg.norm(edges, axis=1)
    if lengths.max() <= _LENGTH:
        return np.array([1.0, 0.0])
    longer = edges[np.argmax(lengths)] / lengths.max()
    across = np.array([longer[1], -longer[0]])
    return across if tuple(np.round(across, 9)) > (0.0, 0.0) else -across


def push_height(half_extent: float, friction: float, margin: float = 1.0) -> float:
    """Highest place above the table [m] at which a quasi-static push does not topple an object.

    The push balances friction, F = mu m g, and turns the object about its foremost foot by F h
    against m g r: h <= margin r / mu.

    Args:
        half_extent: r, from below the centre of mass to the foremost foot, along the push, [m].
        friction: mu, between object and table; above zero.
        margin: Share of that height, 0 to 1.
    """
    return margin * half_extent / friction


def finger_place(
    segment: Segment, direction: Array, offset: float, config: PushConfig
) -> tuple[Array, Array] | None:
    """Where the finger pushes and where it stands before; None where its line misses the object.

    Args:
        segment: To be pushed.
        direction: Of the push (2,), a unit vector.
        offset: Of the finger's middle to the left of the line through the centroid, [m].
        config: Of the push.

    Returns:
        The hindmost point (2,) of the contour on the finger's line along the push, and the corners
        (4, 2) of the finger's box: as far forward as its width allows, less the gap.
    """
    frame = np.array([direction, [-direction[1], direction[0]]])  # Along the push and left of it.
    own = (segment.contour - segment.centroid) @ frame.T
    hindmost = _rear(own, offset, offset)
    if not np.isfinite(hindmost):
        return None
    right, left = offset - 0.5 * config.width, offset + 0.5 * config.width
    front = _rear(own, right, left) - config.gap
    back = front - config.depth
    box = np.array([[back, right], [front, right], [front, left], [back, left]])
    place = segment.centroid + np.array([hindmost, offset]) @ frame
    return place, segment.centroid + box @ frame


def _rear(own: Array, right: float, left: float) -> float:
    """Least first coordinate of a polygon (N, 2) where the second one is within; else infinite."""
    along, aside = own.T
    along_after, aside_after = np.concatenate([own[1:], own[:1]]).T
    found = [along[(aside >= right) & (aside <= left)]]
    for side in (right, left):
        met = (aside > side) != (aside_after > side)
        share = (side - aside[met]) / (aside_after[met] - aside[met])
        found.append(along[met] + share * (along_after[met] - along[met]))
    return float(min(part.min(initial=np.inf) for part in found))


def swept(points: Array, motion: Array) -> Array:
    """The hull (H, 2) of what points (N, 2) pass in a straight motion (2,)."""
    return convex_hull(np.concatenate([points, points + motion]))


def spares(segment: Segment, target: Segment, motion: Array, clearance: float) -> bool:
    """Whether an object that moves straight by `motion` (2,), [m], leaves the target alone.

    Its hull keeps the clearance [m], and where it is closer from the start it comes no closer.
    Where it touches the target or lies over a part of it, it never lies over a larger part.
    """
    before = convex_hull(segment.contour)
    gap = distance(before, target.contour)
    if gap > _LENGTH:
        strip = swept(segment.contour, motion)
        return distance(strip, target.contour) > min(clearance, gap) - _LENGTH
    shares = np.linspace(0.0, 1.0, 1 + int(np.ceil(np.linalg.norm(motion) / _STEP)))
    over = [area(clipped(target.contour, before + share * motion)) for share in shares]
    return max(over) <= over[0] + _AREA


def plan_push(
    segment: Segment, others: Sequence[Segment], target: Segment | None, config: PushConfig
) -> Push:
    """The push of an object, or why there is none.

    Directions are tried from that away from the clutter outwards, to the left first, until one
    spares the target and lets the finger stand where no other object is. If the latter is so for
    none, it is the one whose finger overlaps the others least. Among the places of the finger, the
    one of least overlap is taken, then the one nearest to the line through the centroid.

    Args:
        segment: To be pushed.
        others: All others, the target too.
        target: None where there is none.
        config: Of the push.
    """
    away = away_from_clutter(segment, others, target, config.width)
    best, failures = NO_PUSH, set[str]()
    for turn in _turns(config):
        c, s = np.cos(turn), np.sin(turn)
        direction = np.array([[c, -s], [s, c]]) @ away
        ahead = float(((segment.contour - segment.centroid) @ direction).max())
        height = push_height(ahead, config.friction, config.margin)
        if height < config.lowest:
            failures.add(TOPPLES)
            continue
        motion = config.length * direction
        if target is not None and not spares(segment, target, motion, config.clearance):
            failures.add(SWEEPS)
            continue
        for offset, overlap, point, finger in _places(segment, others, target, direction, config):
            if best.why or overlap < best.overlap:
                best = Push(
                    point=point,
                    direction=direction,
                    length=config.length,
                    height=height,
                    finger=finger,
                    offset=offset,
                    turned=turn,
                    overlap=overlap,
                )
        if best.overlap == 0.0:
            return best
        failures.add(SWEEPS)
    return best if not best.why else Push(why=f"every push {' or '.join(sorted(failures))}")


def _turns(config: PushConfig) -> Iterator[float]:
    """Of directions, from the least on, to the left before the right, [rad]."""
    yield 0.0
    for step in range(1, int(config.largest_turn / config.turn_step + 1e-9) + 1):
        turn = float(np.deg2rad(step * config.turn_step))
        yield turn
        if turn < np.pi:
            yield -turn


def _places(
    segment: Segment,
    others: Sequence[Segment],
    target: Segment | None,
    direction: Array,
    config: PushConfig,
) -> Iterator[tuple[float, float, Array, Array]]:
    """Offset, overlap, point and finger for each place that spares the target, middle first."""
    offsets = np.linspace(-config.aside, config.aside, config.places)
    if config.places == 1:
        offsets = np.zeros(1)
    way = (config.gap + config.length) * direction
    for offset in sorted(offsets.tolist(), key=abs):
        place = finger_place(segment, direction, offset, config)
        if place is None:
            continue
        point, finger = place
        strip = swept(finger, way)
        if target is not None and distance(strip, target.contour) < config.clearance:
            continue
        overlaps = [intersection_over_union(other.contour, finger) for other in others]
        # Places that differ by rounding errors are alike.
        yield offset, round(sum(overlaps) / max(len(overlaps), 1), 9), point, finger
