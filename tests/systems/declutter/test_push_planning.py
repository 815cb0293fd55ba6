"""The best push of an object, against brute force over directions, places and instants."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
from numpy.testing import assert_allclose
from shapely.affinity import scale, translate

from crossmodal.maths.arrays import Array
from crossmodal.models.gripper_taxels import THICKNESS, TRAVEL, WIDTH
from crossmodal.systems.declutter.push import (
    PushConfig,
    finger_places,
    lever,
    slopes,
)
from crossmodal.systems.declutter.push_planning import away_from_clutter, plan_pushes, push_length
from crossmodal.systems.port_values import Push, Segment
from tests.systems.declutter.scenes import (
    finger_place,
    random_scene,
    rectangle,
    rotation,
    spares,
)

CONFIG = PushConfig()


def plan_push(*args: Any) -> Push:
    """The best one."""
    return plan_pushes(*args)[0]


def swept(shape: shapely.Geometry, motion: Array) -> shapely.Geometry:
    """The hull of what a shape passes in a straight motion."""
    return shapely.union(shape, translate(shape, *motion)).convex_hull


LEFT = np.array([[0.0, -1.0], [1.0, 0.0]])  # A quarter turn.


def covers(shape: shapely.Geometry, step: float = 1e-3) -> Callable[[shapely.Geometry], bool]:
    """Whether another shape has points of a grid within this one."""
    left, bottom, right, top = shape.bounds
    x, y = np.meshgrid(np.arange(left, right, step), np.arange(bottom, top, step))
    inside = shapely.contains_xy(shape, x, y)
    return lambda other: bool(shapely.contains_xy(other, x[inside], y[inside]).any())


@pytest.mark.parametrize("seed", range(10))
def test_the_direction_is_away_from_the_weighted_clutter(seed: int) -> None:
    first, *others = random_scene(seed)
    v = np.zeros(2)
    for other in others:
        way = other.centroid - first.centroid
        v += way / (way @ way + WIDTH**2)
    expected = -v / np.linalg.norm(v)
    found = away_from_clutter(first, others, others[0])
    assert_allclose(found, expected, atol=1e-12)


def test_nearer_objects_weigh_more() -> None:
    pushed = rectangle(0, "can", (0.0, 0.0))
    near, far = rectangle(1, "can", (0.06, 0.0)), rectangle(2, "can", (-0.2, 0.0))
    assert_allclose(away_from_clutter(pushed, [near, far], far), [-1.0, 0.0], atol=1e-12)


def test_an_object_at_the_same_place_does_not_decide() -> None:
    pushed, over = rectangle(0, "can", (0.0, 0.0)), rectangle(1, "can", (0.0, 1e-4))
    beside = rectangle(2, "can", (0.08, 0.0))
    direction = away_from_clutter(pushed, [over, beside], over)
    assert direction @ [-1.0, 0.0] > 0.99


def test_between_two_objects_it_goes_away_from_the_target() -> None:
    pushed = rectangle(0, "can", (0.5, 0.1))
    sides = [rectangle(1, "can", (0.5, 0.2)), rectangle(2, "wineglass", (0.5, 0.0))]
    assert_allclose(away_from_clutter(pushed, sides, sides[1]), [0.0, 1.0], atol=1e-9)


@pytest.mark.parametrize("angle", [0.0, 0.4, -1.2, 2.5])
def test_at_the_target_s_place_it_goes_along_the_shorter_edge(angle: float) -> None:
    pushed = rectangle(0, "can", (0.5, 0.1), (0.12, 0.04), angle)
    same = rectangle(1, "wineglass", (0.5, 0.1))
    direction = away_from_clutter(pushed, [same], same)
    assert abs(direction @ rotation(angle)[:, 1]) == pytest.approx(1.0)
    assert tuple(np.round(direction, 9)) > (0.0, 0.0)


@pytest.mark.parametrize(
    ("base", "least", "height"),
    [(0.0, 0.08, 0.04 - 0.0195), (0.05, 0.13, 0.09 - 0.0195), (0.0, 0.02, CONFIG.lowest)],
)
def test_glass_is_pushed_where_it_is_for_certain(base: float, least: float, height: float) -> None:
    """At half the height that it has at least, on what is seen through it."""
    wide = rectangle(0, "wineglass", (0.1, 0.0), (0.1, 0.06))
    pushed = replace(wide, top=0.3, is_glass=True, base=base, least_top=least)
    target = rectangle(1, "", (0.0, 0.0))
    push = plan_push(pushed, [target], target, CONFIG)
    assert push.height == pytest.approx(height, abs=1e-4)


@pytest.mark.parametrize(
    ("top", "height"),
    [
        (0.04, CONFIG.lowest),
        (0.08, 0.04 - 0.0195),  # The middle of the outer taxels is at half the object's height,
        (0.12, 0.7 * 0.55 * 0.03 / 0.5),  # unless it would topple.
        (np.nan, CONFIG.lowest),
    ],
)
def test_a_push_is_at_half_the_height_if_that_is_safe(top: float, height: float) -> None:
    pushed = replace(rectangle(0, "can", (0.1, 0.0), (0.06, 0.04)), top=top)
    target = rectangle(1, "", (0.0, 0.0))
    push = plan_push(pushed, [target], target, CONFIG)
    assert_allclose(push.direction, [1.0, 0.0], atol=1e-12)
    assert push.height == pytest.approx(height, abs=1e-4)


def test_what_would_topple_falls_ahead_and_not_on_the_target() -> None:
    slender = replace(rectangle(0, "marker", (0.1, 0.0), (0.008, 0.008)), top=0.11)
    target = rectangle(1, "wineglass", (0.0, 0.0))
    push = plan_push(slender, [target], target, CONFIG)
    assert (push.why, push.topples, push.height) == ("", True, CONFIG.lowest)
    # To the sides it would still be spared by the push, but not by the fall.
    ring = rectangle(1, "wineglass", (0.26, 0.0), (0.02, 0.4))
    straight = replace(CONFIG, largest_turn=0.0)
    behind = [ring, *300 * [rectangle(2, "can", (0.0, 0.0))]]  # So many that it goes along x.
    assert plan_push(slender, behind, ring, straight).why == "every push sweeps the target"
    assert plan_push(replace(slender, top=0.05), behind, ring, straight).why == ""


def test_what_is_low_may_be_turned_over_and_what_is_steady_does_not_topple() -> None:
    slender = rectangle(0, "marker", (0.1, 0.0), (0.008, 0.008))
    target = rectangle(1, "wineglass", (0.0, 0.0))
    push = plan_push(replace(slender, top=0.014), [target], target, CONFIG)
    assert (push.why, push.topples, push.height) == ("", False, CONFIG.lowest)
    wide = rectangle(0, "can", (0.1, 0.0), (0.06, 0.06))
    assert not plan_push(wide, [target], target, CONFIG).topples


def test_a_palm_passes_over_things_or_they_are_met() -> None:
    """On both sides of the finger's way is something that the palm reaches."""
    pushed, target = rectangle(0, "can", (0.1, 0.0), (0.06, 0.06)), rectangle(1, "", (0.0, 0.0))
    config = replace(CONFIG, largest_turn=0.0, foot=1.0, margin=1.0)
    for top, why in ((0.12, ""), (0.14, ""), (0.2, "every push meets something else")):
        sides = [replace(rectangle(2, "box", (0.15, y)), top=top) for y in (0.05, -0.05)]
        lying_ahead = [target, *sides, *300 * [target]]  # So many that it turns nothing.
        push = plan_push(replace(pushed, top=0.1), lying_ahead, target, config)
        assert push.why == why
        if not why:
            assert push.height == pytest.approx(max(top + 0.01 - 0.118, 0.05 - 0.0195), abs=1e-3)


def test_what_is_higher_than_the_palm_is_pushed_by_opened_fingers() -> None:
    pushed = rectangle(0, "can", (0.1, 0.0), (0.06, 0.06))
    target = rectangle(1, "", (-0.2, 0.0))
    closed = plan_push(replace(pushed, top=0.13), [target], target, CONFIG)
    assert (closed.why, closed.opening) == ("", 0.0)
    assert_allclose(closed.place, shapely.get_coordinates(closed.finger.centroid)[0], atol=1e-12)
    high = replace(pushed, top=0.2)
    push = plan_push(high, [target], target, CONFIG)
    assert (push.why, push.opening) == ("", TRAVEL)
    # The finger in front stands where the closed ones would, but is half as deep.
    front = (shapely.get_coordinates(push.finger) - high.centroid) @ push.direction
    assert np.ptp(front) == pytest.approx(THICKNESS)
    ahead = float((push.place - high.centroid) @ push.direction)
    assert front.max() == pytest.approx(ahead + TRAVEL + THICKNESS)
    # The palm's edge is above it, and the other finger behind must have room.
    behind = push.place - (TRAVEL + 0.5 * THICKNESS) * push.direction
    wall = replace(rectangle(2, "box", tuple(behind), (0.01, 0.2)), top=0.02)
    config = replace(CONFIG, largest_turn=0.0)
    others = [target, wall, *300 * [target]]  # So many that the wall turns nothing.
    assert plan_push(high, others[:1], target, config).why == ""
    assert plan_push(high, others, target, config).why == "every push meets something else"


def test_what_would_topple_is_not_pushed_if_nobody_knows_how_high_it_is() -> None:
    slender = replace(rectangle(0, "can", (0.0, 0.0), (0.008, 0.008)), top=np.nan)
    target = rectangle(1, "wineglass", (0.2, 0.0))
    push = plan_push(slender, [target], target, CONFIG)
    assert push.why == "every push topples it"
    assert np.isnan(push.point).all()
    # Its diagonal is longer, and the table may be smoother.
    smooth = replace(CONFIG, friction=0.2)
    assert plan_push(slender, [target], target, smooth).why == ""


def offset_of(push: Push, segment: Segment) -> float:
    """Of the finger to the left of the line through the centroid, [m]."""
    return float((push.point - segment.centroid) @ (LEFT @ push.direction))


def brute_force(
    segment: Segment, others: list[Segment], target: Segment, config: PushConfig
) -> Push | None:
    """Of all turns in which the finger comes down where it is free, that which meets the fewest.

    Those come first in which it does not slide along the object, then those in which it has room
    where it comes down. Instants of the ways are looked at. What is met goes along and must spare
    the target, too.
    """
    away = away_from_clutter(segment, others, target)
    steps = round(config.largest_turn / 10.0)
    inner = scale(segment.contour.convex_hull, 0.8, 0.8, origin="centroid")
    found: list[tuple[bool, bool, int, int, Push]] = []
    turns = sorted(range(-steps, steps + 1), key=lambda step: (abs(step), -step))
    for rank, step in enumerate(turns):
        d = rotation(np.deg2rad(10.0 * step)) @ away
        if not spares(segment, target, config.longest * d, config.clearance):
            continue
        fine: list[tuple[bool, bool, int, int, Push]] = []
        objects = [translate(inner, *(x * d)) for x in np.linspace(0.0, config.longest, 131)]
        for offset in (0.0, 0.005, -0.005, 0.01, -0.01):
            place = finger_place(segment, d, offset, config)
            if place is None:
                continue
            way = np.linspace(0.0, config.longest + config.gap, 141)[:, None] * d
            fingers = [translate(place[1], *shift) for shift in way]
            if min(finger.distance(target.contour) for finger in fingers) < config.clearance:
                continue
            first = fingers[: int(config.gap / (config.longest + config.gap) * 140) + 1]
            if any(f.intersects(other.contour) for f in first for other in others):
                continue
            met = [
                other
                for other in others
                if other is not target
                and (
                    any(one.intersects(other.contour) for one in objects)
                    or any(covers(f)(other.contour) for f in fingers)
                )
            ]
            motion = config.longest * d
            if all(spares(other, target, motion, config.clearance) for other in met):
                narrow = min(place[1].distance(other.contour) for other in others) < config.gap
                slides = abs(steepness(segment, d, place[0])) > config.sticks
                fine.append((slides, narrow, len(met), rank, Push(direction=d, point=place[0])))
        found += sorted(fine, key=lambda each: each[:2])[:1]
    return min(found, key=lambda each: each[:4])[4] if found else None


def steepness(segment: Segment, d: np.ndarray, point: np.ndarray) -> float:
    """Of the rear of a convex contour around a point, from its corners and many points between."""
    rear = shapely.get_coordinates(segment.contour.exterior.segmentize(2e-4)) - segment.centroid
    along, across = rear @ d, rear @ [-d[1], d[0]]
    at = float((point - segment.centroid) @ [-d[1], d[0]])
    ends = np.clip([at - WIDTH, at + WIDTH], across.min() + 1e-3, across.max() - 1e-3)
    right, left = (along[np.abs(across - end) < 3e-4].min() for end in ends)
    return float((left - right) / (ends[1] - ends[0]))


@pytest.mark.parametrize("seed", range(12))
def test_a_plan_is_the_best_of_all(seed: int) -> None:
    config = replace(CONFIG, friction=0.1, gap=0.005, shortest=0.13, longest=0.13, grip=0.0)
    config = replace(config, largest_turn=90.0)
    scene = [replace(s, top=0.05) for s in random_scene(seed, count=6, spread=0.07)]
    target, segment = scene[0], scene[3]
    others = [other for other in scene if other is not segment]
    expected = brute_force(segment, others, target, config)
    push = plan_push(segment, others, target, config)
    if expected is None:
        assert push.why or lever(offset_of(push, segment)) != 0.0
        return
    assert push.why == ""
    assert_allclose(push.direction, expected.direction, atol=1e-12)
    offsets = [offset_of(found, segment) for found in (push, expected)]
    assert abs(offsets[0]) == pytest.approx(abs(offsets[1]))


def test_what_is_oblique_to_the_finger_is_pushed_squarely_instead() -> None:
    """A long thing whose rear is 40 deg off the way from the clutter: a bottle would roll aside."""
    bottle = rectangle(1, "oil", (0.5, 0.15), (0.3, 0.06), np.deg2rad(40.0))
    target = rectangle(0, "can", (0.5, 0.0))
    away = away_from_clutter(bottle, [target], target)
    points, _ = finger_places(bottle, away, np.zeros(1), CONFIG)
    oblique = float(slopes(bottle, away, points)[0])
    assert abs(oblique) == pytest.approx(np.tan(np.deg2rad(40.0)), rel=1e-6)
    push = plan_pushes(replace(bottle, top=0.06), [target], target, CONFIG)[0]
    assert push.why == ""
    normal = rotation(np.deg2rad(40.0))[:, 1]
    assert abs(slopes(bottle, push.direction, push.point[None])[0]) <= CONFIG.sticks
    assert push.direction @ normal > np.cos(np.arctan(CONFIG.sticks)) - 1e-9


def test_where_the_middle_is_out_of_reach_an_object_is_pushed_beside_it() -> None:
    pushed = rectangle(0, "can", (0.1, 0.0), (0.03, 0.12))
    target = rectangle(1, "wineglass", (0.0, 0.0))  # The finger does not fit between the two.
    config = replace(CONFIG, largest_turn=0.0)
    near = replace(pushed, contour=translate(pushed.contour, -0.055, 0.0))
    wide = replace(target, contour=shapely.box(-0.02, -0.012, 0.02, 0.012))
    push = plan_push(near, [wide], wide, config)
    assert push.why == ""
    assert abs(lever(offset_of(push, near))) > 0.0
    assert push.finger.distance(wide.contour) >= CONFIG.clearance
    assert lever(offset_of(plan_push(pushed, [target], target, config), pushed)) == 0.0


@pytest.mark.parametrize(
    ("gap", "beyond", "length"),
    [
        (0.0, None, 0.16),
        (0.05, None, 0.1),
        (0.2, None, 0.06),
        (0.05, 0.07, 0.16),  # It goes past what lies where it would end.
    ],
)
def test_a_push_is_as_long_as_it_takes(gap: float, beyond: float | None, length: float) -> None:
    target, pushed = rectangle(0, "", (0.0, 0.0)), rectangle(1, "", (0.04 + gap, 0.0))
    others = [target]
    if beyond is not None:
        others.append(rectangle(2, "", (0.08 + gap + beyond, 0.0)))
    found = push_length(pushed, others, target, np.array([1.0, 0.0]), CONFIG)
    assert found == pytest.approx(length)


def test_all_pushes_spare_the_target_and_stand_where_it_is_free() -> None:
    scene = list(random_scene(2, count=6, spread=0.15))
    others = [other for other in scene if other is not scene[3]]
    pushes = plan_pushes(scene[3], others, scene[0], CONFIG)
    assert len(pushes) > 2
    for push in pushes:
        strip = swept(push.finger, CONFIG.gap * push.direction)
        assert not any(strip.intersects(other.contour) for other in others)
        strip = swept(push.finger, (CONFIG.gap + push.length) * push.direction)
        met = {o.number for o in others if strip.intersects(o.contour)}
        assert met <= set(push.meets)
        assert strip.distance(scene[0].contour) >= CONFIG.clearance - 1e-9
    assert len({tuple(push.direction) for push in pushes}) == len(pushes)
    assert [len(push.meets) for push in pushes] == sorted(len(push.meets) for push in pushes)
    for push in pushes:
        assert spares(scene[3], scene[0], push.length * push.direction, CONFIG.clearance)
        beside = translate(push.finger, *(push.reach * push.direction))
        ahead = (shapely.get_coordinates(beside) - scene[3].centroid) @ push.direction
        assert ahead.max() == pytest.approx(0.0, abs=1e-12)


def test_no_push_takes_an_object_farther_off_the_table() -> None:
    """The way out of the clutter, along x, is off the table, whose edge is 4 cm ahead."""
    pushed, target = rectangle(0, "can", (0.0, 0.0)), rectangle(1, "wineglass", (-0.1, 0.0))
    table = shapely.box(-1.0, -1.0, 0.06, 1.0)
    straight = replace(CONFIG, largest_turn=0.0)
    free, *_ = plan_pushes(pushed, [target], target, straight)
    assert free.length > 0.06
    (none,) = plan_pushes(pushed, [target], target, straight, table)
    assert none.why == "every push takes it too far aside"
    pushes = plan_pushes(pushed, [target], target, CONFIG, table)
    assert len(pushes) > 5
    for push in pushes:
        moved = translate(pushed.contour, *(push.length * push.direction))
        assert table.buffer(1e-6).contains(moved)
    # What is over its edge already may not get farther.
    over = replace(pushed, contour=translate(pushed.contour, 0.05, 0.0))
    push, *_ = plan_pushes(over, [target], target, CONFIG, table)
    assert push.why == ""
    assert push.direction[0] <= 1e-9


def test_what_is_met_goes_along_and_spares_the_target_too() -> None:
    """Between the pushed object and the target lies another one."""
    pushed, between = rectangle(0, "can", (0.0, 0.0)), rectangle(1, "sponge", (0.07, 0.0))
    target = rectangle(2, "wineglass", (0.14, 0.0))
    behind = 300 * [rectangle(3, "can", (-0.2, 0.0))]  # So many that it goes along x.
    config = replace(CONFIG, largest_turn=0.0, longest=0.1)
    others = [between, target, *behind]
    assert plan_push(pushed, others, target, config).why == "every push sweeps the target"
    beyond = replace(target, contour=translate(target.contour, 0.2, 0.0))
    assert plan_push(pushed, [between, beyond, *behind], beyond, config).meets == (1,)


def test_plans_by_lot_are_straight_turned_and_refused() -> None:
    kinds = set()
    for seed in range(100):
        scene = list(random_scene(seed, count=10, spread=0.06))
        others = [other for other in scene if other is not scene[3]]
        push = plan_push(scene[3], others, scene[0], CONFIG)
        if push.why:
            kinds.add("refused")
        else:
            away = away_from_clutter(scene[3], others, scene[0])
            turned = away @ push.direction < 1.0 - 1e-9
            kinds.add("turned" if turned else "straight")
            assert np.linalg.norm(push.direction) == pytest.approx(1.0)
    assert kinds == {"straight", "turned", "refused"}


def test_the_finger_moves_along_the_contour_to_where_it_is_free() -> None:
    config = replace(CONFIG, largest_turn=0.0)
    pushed = rectangle(0, "can", (0.0, 0.0), (0.06, 0.08))
    ahead = 500 * [rectangle(1, "", (0.2, 0.0))]  # So many that what is behind turns nothing.
    free = plan_push(pushed, ahead, ahead[0], config)
    assert_allclose(free.direction, [-1.0, 0.0], atol=1e-12)
    assert offset_of(free, pushed) == pytest.approx(0.0)
    # It reaches 6 mm into the finger's place, from the left as seen along the push.
    x, y = free.finger.centroid.coords[0]
    obstacle = rectangle(3, "", (x, y - 0.0135 - 0.002), (0.016, 0.016))
    blocked = plan_push(pushed, [*ahead, obstacle], ahead[0], config)
    assert blocked.why == ""
    assert offset_of(blocked, pushed) == pytest.approx(-0.01)
    nearer = finger_place(pushed, blocked.direction, -0.005, config)
    assert nearer is not None
    assert obstacle.contour.intersection(nearer[1]).area > 0.0


def test_a_push_in_which_the_object_meets_nothing_comes_first() -> None:
    pushed, target = rectangle(0, "can", (0.1, 0.0)), rectangle(1, "wineglass", (0.0, 0.0))
    ahead = replace(rectangle(2, "oil", (0.18, 0.0), (0.03, 0.03)), top=0.05)
    straight, *_ = plan_pushes(pushed, [target], target, CONFIG)
    assert_allclose(straight.direction, [1.0, 0.0], atol=1e-12)
    first, *_ = plan_pushes(pushed, [target, ahead], target, CONFIG)
    way = first.length * first.direction
    assert not swept(pushed.contour, 0.8 * way).buffer(-0.008).intersects(ahead.contour)


def test_a_push_is_turned_until_it_spares_the_target() -> None:
    """Others push the object towards the target; it goes by to the left."""
    pushed = rectangle(0, "can", (0.0, 0.0))
    target = rectangle(1, "wineglass", (0.09, 0.0))
    behind = [rectangle(2 + k, "can", (-0.045, y)) for k, y in enumerate((-0.1, 0.0, 0.1))]
    others = [target, *behind]
    away = away_from_clutter(pushed, others, target)
    assert away[0] > 0.9
    push = plan_push(pushed, others, target, CONFIG)
    assert push.why == ""
    assert away @ push.direction < np.cos(np.deg2rad(20.0))
    assert away @ LEFT.T @ push.direction > 0.0
    assert spares(pushed, target, push.length * push.direction, CONFIG.clearance)
    straight = plan_push(pushed, others, target, replace(CONFIG, largest_turn=0.0))
    assert straight.why


def test_what_others_enclose_but_on_one_side_is_pushed_into_them() -> None:
    pushed, target = rectangle(0, "can", (0.0, 0.0)), rectangle(1, "wineglass", (0.4, 0.0))
    around = [
        rectangle(2, "sponge", (-0.045, 0.0), (0.04, 0.2)),
        rectangle(3, "sponge", (0.0, 0.05)),
        rectangle(4, "sponge", (0.0, -0.05)),
    ]
    others = [target, *around]
    assert away_from_clutter(pushed, others, target)[0] > 0.0
    assert plan_push(pushed, others, target, replace(CONFIG, largest_turn=90.0)).why
    push = plan_push(pushed, others, target, CONFIG)
    assert push.why == ""
    assert push.direction[0] < 0.0
    assert 2 in push.meets


def test_a_finger_does_not_come_down_on_the_target() -> None:
    pushed = rectangle(0, "can", (0.06, 0.0))
    target = rectangle(1, "wineglass", (0.0, 0.0))  # 2 cm are free between, the finger needs 3.8.
    straight = plan_push(pushed, [target], target, replace(CONFIG, largest_turn=0.0))
    assert straight.why
    push = plan_push(pushed, [target], target, CONFIG)
    assert push.why == ""
    assert push.finger.distance(target.contour) >= CONFIG.clearance
