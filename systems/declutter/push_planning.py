"""How to push an object over the table: away from the others, past the target, without toppling.

Source: section II-B.1 of the paper on active visuo-tactile perception in clutter. Beyond it, the
push leaves the target alone, is low enough and as long as it takes. The paper's finger is a box of
pixels that overlaps others as little as possible; ours is one of metres that comes down where it is
free. On their way finger and object may meet others, as few as possible, that go along and leave
the target alone, too.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely

from crossmodal.maths.arrays import Array
from crossmodal.models.gripper_taxels import ARRAYS, TRAVEL, WIDTH, gripper_taxels
from crossmodal.systems.declutter.push import (
    LENGTH,
    PushConfig,
    finger_middles,
    finger_places,
    first_met,
    hand_heights,
    has_room,
    lever,
    outlines_on_the_way,
    prepared_contours,
    push_frame,
    push_height,
    rectangles,
    slopes,
    spared,
    stays,
    swept_edges,
    torque_per_force,
)
from crossmodal.systems.port_values import Push, Segment

SWEEPS = "sweeps the target"
TOPPLES = "topples it"
MEETS = "meets something else"
LEAVES = "takes it too far aside"

_STEP = 0.01  # Between instants of a motion that are looked at, [m].
_LONGER = 0.02  # Between lengths that are tried, [m].
_TURN = 10.0  # Between directions that are tried, [deg].
_OUT = 90.0  # Farther from the way out of the clutter they go into it, [deg].
_ASIDE = 0.005  # Between places of the finger that are tried, [m].
_BESIDE = 0.01  # Likewise of those beside which the centroid passes, [m].
# Middle of the outer taxels above the fingers' ends, [m].
_LAYOUT = gripper_taxels()
_TAXELS = -float(_LAYOUT.p_FS[_LAYOUT.array == ARRAYS.index("left_outer"), 2].mean())


class _Found(NamedTuple):
    """A push, the best one first."""

    topples: bool
    slides: bool
    is_narrow: bool  # For the fingers, where they come down.
    met: int
    is_short: bool
    push: Push


def plan_pushes(
    segment: Segment,
    others: Sequence[Segment],
    target: Segment,
    config: PushConfig,
    table: shapely.Geometry | None = None,
) -> tuple[Push, ...]:
    """The pushes of an object that spare the target, the best one first; or one that says why not.

    There is one at most in each direction. Those come first that do not topple the object, then
    those whose finger does not slide along it, then those whose fingers have room beside others
    where they come down, then those in which the fewest others are met, then those that take it out
    of the way, then those nearest to the direction away from the clutter, to the left before to the
    right; into the clutter where no other is possible. Where the centroid cannot be ahead of the
    finger in any direction, the finger turns the object as it goes; then it may meet nothing, for
    what turns against other things slides off the finger.

    Args:
        segment: To be pushed.
        others: All others, the target too.
        target: The target.
        config: Of the push.
        table: The part of it to which objects may be pushed, in W; None for anywhere.
    """
    away = away_from_clutter(segment, others, target)
    found, failures = list[_Found](), set[str]()
    turns = _both_sides(config.largest_turn, _TURN)
    out, into = turns[np.abs(turns) <= _OUT], turns[np.abs(turns) > _OUT]
    for is_beside, tried in ((False, out), (False, into), (True, out), (True, into)):
        for turn in np.deg2rad(tried):
            c, s = np.cos(turn), np.sin(turn)
            direction = np.array([[c, -s], [s, c]]) @ away
            wanted = push_length(segment, others, target, direction, config)
            for opening in (0.0, TRAVEL):  # Fingers are opened where closed ones meet something.
                best = _push(
                    segment, others, target, direction, wanted, is_beside, opening, config, table
                )
                if best != MEETS:
                    break
            if not isinstance(best, str):
                if not (is_beside and best.met):
                    found.append(best)
            elif not is_beside:
                failures.add(best)
        if found:
            return tuple(each.push for each in sorted(found, key=lambda each: each[:-1]))
    return (Push(why=f"every push {' or '.join(sorted(failures))}"),)


def away_from_clutter(segment: Segment, others: Sequence[Segment], target: Segment) -> Array:
    """The unit vector (2,) d = -v / |v| with v = sum_i w_i v_i, v_i the way to another's centroid.

    The paper leaves w_i open. It is 1 / (|v_i|^2 + w^2), w the finger's width: the influence
    |w_i v_i| falls with the distance, yet two centroids that nearly coincide, which say nothing, do
    not decide. Where v vanishes, d is the way from the target, and where that does, too, along the
    box's shorter edge.

    Args:
        segment: To be pushed.
        others: All others, the target too.
        target: The target.
    """
    ways = np.array([other.centroid - segment.centroid for other in others])
    squared = np.square(ways).sum(axis=1)
    weights = 1.0 / (squared + WIDTH**2)
    for v in (weights @ ways / weights.sum(), target.centroid - segment.centroid):
        if np.linalg.norm(v) > LENGTH:
            return np.asarray(-v / np.linalg.norm(v))
    edges = np.diff(shapely.get_coordinates(segment.box)[:3], axis=0)
    lengths = np.linalg.norm(edges, axis=1)
    across = edges[np.argmin(lengths)] / lengths.min()
    return np.asarray(across if tuple(np.round(across, 9)) > (0.0, 0.0) else -across)


def push_length(
    segment: Segment,
    others: Sequence[Segment],
    target: Segment,
    direction: Array,
    config: PushConfig,
) -> float:
    """The shortest push [m] that takes an object out of the way; the longest, if none does.

    It is out of the way where it is clear of the target and lies over no other object.

    Args:
        segment: To be pushed.
        others: All others, the target too.
        target: The target.
        direction: Of the push (2,), a unit vector.
        config: Of the push.
    """
    lengths = np.append(
        np.arange(config.shortest, config.longest - LENGTH, _LONGER), config.longest
    )
    corners = shapely.get_num_coordinates(segment.contour)
    shifts = np.repeat(lengths[:, None] * direction, corners, axis=0)
    moved = shapely.transform(np.full(len(lengths), segment.contour), lambda p: p + shifts)
    out = shapely.distance(moved, target.contour) > config.clear - LENGTH
    out &= ~shapely.intersects(prepared_contours(others)[:, None], moved).any(axis=0)
    return float(lengths[np.argmax(out)] if out.any() else config.longest)


def _push(
    segment: Segment,
    others: Sequence[Segment],
    target: Segment,
    direction: Array,
    wanted: float,
    is_beside: bool,
    opening: float,
    config: PushConfig,
    table: shapely.Geometry | None,
) -> _Found | str:
    """The longest one, up to the wanted length [m], or why there is none."""
    # Glass may be less high than its top says, and lie on what is seen through it.
    top = np.fmin(segment.top, segment.least_top)
    safe = segment.base + push_height(segment, direction, config)
    topples = safe < config.lowest and not segment.top <= config.low
    falls = np.nan_to_num(segment.top, nan=np.inf) if topples else 0.0  # Ahead.
    if np.isinf(falls):
        return TOPPLES
    safe = max(safe, config.lowest)
    if np.isfinite(top):
        safe = min(safe, max(top - config.grip, config.lowest))
    # What is round is widest there, and is felt in the middle of the outer taxels.
    widest = 0.5 * (segment.base + np.nan_to_num(top)) - _TAXELS
    offsets = _offsets(segment, is_beside, config)
    points, places = finger_places(segment, direction, offsets, config, opening)
    if not len(places):
        return SWEEPS
    levers = [lever(0.5 * (right + left)) for _, right, _, left in places]
    lengths = np.arange(wanted, config.shortest - LENGTH, -_LONGER)
    instants = np.arange(0.0, wanted + falls + _STEP, _STEP)
    ends = np.ceil((lengths + falls) / _STEP - LENGTH).astype(int)
    # The longest one first, then that nearest to the line through the centroid.
    which, place = (
        k.ravel() for k in np.meshgrid(range(len(lengths)), range(len(points)), indexing="ij")
    )
    fingers, ways = places[place], config.gap + lengths[which]
    passed = rectangles(segment, direction, swept_edges(fingers, ways))
    alone = shapely.distance(passed, target.contour) >= config.clearance
    if not alone.any():
        return SWEEPS
    least = hand_heights(segment, others, direction, fingers, ways, config, opening)
    possible = np.flatnonzero(alone & (least <= safe))
    if not len(possible):
        return MEETS
    outlines = {
        beside: outlines_on_the_way(segment, direction, beside, instants)
        for beside in {levers[k] for k in place[possible]}
    }
    if table is not None:
        on = {beside: stays(way, table)[ends] for beside, way in outlines.items()}
        possible = possible[[on[levers[place[k]]][which[k]] for k in possible]]
        if not len(possible):
            return LEAVES
    fine = {beside: spared(way, target, config.clearance)[ends] for beside, way in outlines.items()}
    possible = possible[[fine[levers[place[k]]][which[k]] for k in possible]]
    met = {
        beside: first_met(segment, others, direction, beside, instants[: ends[0] + 1])
        for beside in {levers[k] for k in place[possible]}
    }
    middles = segment.centroid + finger_middles(places, opening) @ push_frame(direction)
    narrow = ~has_room(middles, others, direction, opening, config)
    slides = np.abs(slopes(segment, direction, points)) > config.sticks
    for best in possible[np.lexsort((narrow[place[possible]], slides[place[possible]]))]:
        moved = [
            other
            for other, at in zip(others, met[levers[place[best]]], strict=True)
            if other.number != target.number
            and (at <= ends[which[best]] or shapely.intersects(other.contour, passed[best]))
        ]
        # They go along at most as far.
        along = instants[: ends[which[best]] + 1]
        if all(
            spared(outlines_on_the_way(o, direction, 0.0, along), target, config.clearance)[-1]
            for o in moved
        ):
            length = float(lengths[which[best]])
            push = Push(
                point=points[place[best]],
                place=middles[place[best]],
                opening=opening,
                direction=direction,
                length=length,
                reach=float(-fingers[best, 2]),
                height=float(np.clip(widest, least[best], safe)),
                finger=rectangles(segment, direction, fingers[[best]])[0],
                meets=tuple(sorted(other.number for other in moved)),
                topples=topples,
                lever=levers[place[best]],
            )
            k = place[best]
            return _Found(
                topples, bool(slides[k]), bool(narrow[k]), len(moved), length < wanted, push
            )
    return SWEEPS


def _offsets(segment: Segment, is_beside: bool, config: PushConfig) -> Array:
    """Of the finger to the left of the line through the centroid, the nearest first, [m].

    That line is behind the finger; or, beside it, so near that the object goes farther than its
    edges turn, which is where the lever is less than the ratio of friction's torque and force.
    """
    if not is_beside:
        return _both_sides(0.5 * WIDTH, _ASIDE)
    levers = _both_sides(torque_per_force(segment), _BESIDE)[1:]
    return np.asarray(levers + np.sign(levers) * 0.5 * WIDTH)


def _both_sides(end: float, step: float) -> Array:
    """Multiples of a step up to an end, the least first, to the left before the right."""
    count = int(end / step + 1e-9)
    return step * np.array(sorted(range(-count, count + 1), key=lambda k: (abs(k), -k)))
