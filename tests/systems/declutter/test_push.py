"""Pushes against brute force over directions, places and instants."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from crossmodal.maths.arrays import Array
from crossmodal.maths.polygons import area, clipped, contains, convex_hull, distance
from crossmodal.systems.declutter.push import (
    PushConfig,
    away_from_clutter,
    finger_place,
    plan_push,
    push_height,
    spares,
)
from crossmodal.systems.declutter.segments import segment_of_contour
from crossmodal.systems.port_values import Push, Segment
from tests.systems.declutter.scenes import random_scene, rectangle, rotation

CONFIG = PushConfig()
LEFT = np.array([[0.0, -1.0], [1.0, 0.0]])  # A quarter turn.


def along(polygon: Array, count: int = 400) -> Array:
    """Points on the edges of a polygon, so many on each."""
    share = np.linspace(0.0, 1.0, count)[:, None, None]
    return np.asarray(((1 - share) * polygon + share * np.roll(polygon, -1, axis=0)).reshape(-1, 2))


def grid_iou(first: Array, second: Array, step: float = 5e-4) -> float:
    """By counting points."""
    low = np.minimum(first.min(axis=0), second.min(axis=0))
    high = np.maximum(first.max(axis=0), second.max(axis=0))
    axes = (np.arange(a, b, step) for a, b in zip(low, high, strict=True))
    grid = np.stack(np.meshgrid(*axes), axis=-1)
    one, other = contains(first, grid), contains(second, grid)
    return float((one & other).sum() / (one | other).sum())


@pytest.mark.parametrize("seed", range(10))
def test_the_direction_is_away_from_the_weighted_clutter(seed: int) -> None:
    first, *others = random_scene(seed)
    v = np.zeros(2)
    for other in others:
        way = other.centroid - first.centroid
        v += way / (way @ way + 0.027**2)
    expected = -v / np.linalg.norm(v)
    found = away_from_clutter(first, others, others[0], 0.027)
    assert_allclose(found, expected, atol=1e-12)


def test_nearer_objects_weigh_more() -> None:
    pushed = rectangle(0, "can", (0.0, 0.0))
    near, far = rectangle(1, "can", (0.06, 0.0)), rectangle(2, "can", (-0.2, 0.0))
    assert_allclose(away_from_clutter(pushed, [near, far], None, 0.027), [-1.0, 0.0], atol=1e-12)


def test_an_object_at_the_same_place_does_not_decide() -> None:
    pushed, over = rectangle(0, "can", (0.0, 0.0)), rectangle(1, "can", (0.0, 1e-4))
    beside = rectangle(2, "can", (0.08, 0.0))
    direction = away_from_clutter(pushed, [over, beside], None, 0.027)
    assert direction @ [-1.0, 0.0] > 0.99


def test_between_two_objects_it_goes_away_from_the_target() -> None:
    pushed = rectangle(0, "can", (0.5, 0.1))
    sides = [rectangle(1, "can", (0.5, 0.2)), rectangle(2, "wineglass", (0.5, 0.0))]
    assert_allclose(away_from_clutter(pushed, sides, sides[1], 0.027), [0.0, 1.0], atol=1e-9)


@pytest.mark.parametrize("angle", [0.0, 0.4, -1.2, 2.5])
def test_without_others_it_goes_along_the_shorter_edge(angle: float) -> None:
    pushed = rectangle(0, "can", (0.5, 0.1), (0.12, 0.04), angle)
    direction = away_from_clutter(pushed, [], None, 0.027)
    assert abs(direction @ rotation(angle)[:, 1]) == pytest.approx(1.0)
    assert tuple(np.round(direction, 9)) > (0.0, 0.0)
    same = rectangle(1, "wineglass", (0.5, 0.1))  # The target's centroid coincides.
    assert_allclose(away_from_clutter(pushed, [same], same, 0.027), direction)


def test_a_push_topples_above_the_height_of_its_balance() -> None:
    """F = mu m g, and F h = m g r about the foremost foot."""
    m, g, r, mu = 0.35, 9.81, 0.033, 0.5
    height = push_height(r, mu)
    assert mu * m * g * height == pytest.approx(m * g * r)
    assert push_height(r, mu, 0.5) == pytest.approx(0.033)
    assert push_height(2.0 * r, mu) == pytest.approx(2.0 * height)


def test_a_plan_is_as_high_as_the_object_is_deep_ahead() -> None:
    pushed, target = rectangle(0, "can", (0.1, 0.0), (0.06, 0.04)), rectangle(1, "", (0.0, 0.0))
    push = plan_push(pushed, [target], target, CONFIG)
    assert_allclose(push.direction, [1.0, 0.0], atol=1e-12)
    assert push.height == pytest.approx(0.5 * 0.03 / 0.5)


def test_an_object_that_would_topple_is_not_pushed() -> None:
    slender = rectangle(0, "can", (0.0, 0.0), (0.012, 0.012))
    push = plan_push(slender, [], None, CONFIG)
    assert push.why == "every push topples it"
    assert np.isnan(push.point).all()
    # Its diagonal is longer, and the table may be smoother.
    assert plan_push(slender, [], None, replace(CONFIG, friction=0.3)).why == ""


@pytest.mark.parametrize("seed", range(10))
def test_the_finger_stands_behind_the_object(seed: int) -> None:
    rng = np.random.default_rng(seed)
    angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, 14))
    radii = rng.uniform(0.02, 0.06, 14)
    contour = radii[:, None] * np.column_stack([np.cos(angles), np.sin(angles)]) + [0.5, 0.1]
    segment = segment_of_contour(0, "", contour)
    d = rotation(rng.uniform(0.0, 2.0 * np.pi))[:, 0]
    offset = rng.uniform(-0.01, 0.01)
    place = finger_place(segment, d, offset, CONFIG)
    assert place is not None
    point, box = place
    edge = along(contour, 4000) - segment.centroid
    ahead, aside = edge @ d, edge @ (LEFT @ d)
    on_line = np.abs(aside - offset) < 3e-5
    own = point - segment.centroid
    assert own @ (LEFT @ d) == pytest.approx(offset)
    assert own @ d == pytest.approx(ahead[on_line].min(), abs=5e-4)
    in_front = np.abs(aside - offset) <= 0.5 * CONFIG.width
    local = (box - segment.centroid) @ np.column_stack([d, LEFT @ d])
    assert local[:, 0].max() == pytest.approx(ahead[in_front].min() - CONFIG.gap, abs=5e-5)
    assert np.ptp(local[:, 0]) == pytest.approx(CONFIG.depth)
    assert_allclose([local[:, 1].min(), local[:, 1].max()], [offset - 0.0135, offset + 0.0135])
    assert area(clipped(contour, box)) == 0.0


def test_a_line_beside_the_object_has_no_place() -> None:
    segment = rectangle(0, "", (0.0, 0.0), (0.02, 0.02))
    assert finger_place(segment, np.array([1.0, 0.0]), 0.011, CONFIG) is None
    assert finger_place(segment, np.array([1.0, 0.0]), 0.009, CONFIG) is not None


@pytest.mark.parametrize("seed", range(40))
def test_a_motion_spares_the_target_as_at_each_of_its_instants(seed: int) -> None:
    rng = np.random.default_rng(seed)
    target, segment = random_scene(seed, count=2, spread=0.08)
    motion = 0.1 * rotation(rng.uniform(0.0, 2.0 * np.pi))[:, 0]
    hull = convex_hull(segment.contour)
    steps = [hull + share * motion for share in np.linspace(0.0, 1.0, 201)]
    gaps = np.array([distance(step, target.contour) for step in steps])
    common = [area(clipped(target.contour, step)) for step in steps]
    if gaps[0] > 0.0:
        closest = min(0.005, gaps[0])
        assert abs(gaps.min() - closest) > 1e-5 or gaps.min() == gaps[0]  # Not by a hair.
        expected = gaps.min() >= closest - 1e-5
    else:
        expected = max(common) <= common[0] + 1e-6
    assert spares(segment, target, motion, 0.005) == expected


def test_both_outcomes_are_met_by_lot() -> None:
    outcomes = []
    for seed in range(40):
        target, segment = random_scene(seed, count=2, spread=0.08)
        motion = 0.1 * rotation(np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi))[:, 0]
        outcomes.append(spares(segment, target, motion, 0.005))
    assert 5 < sum(outcomes) < 35


def test_what_touches_the_target_may_be_pushed_away_from_it_but_not_over_it() -> None:
    target, segment = rectangle(0, "", (0.0, 0.0)), rectangle(1, "", (0.04, 0.0))
    assert spares(segment, target, np.array([0.1, 0.0]), 0.005)
    assert not spares(segment, target, np.array([-0.1, 0.0]), 0.005)
    over = rectangle(1, "", (0.03, 0.0))  # A part of it is over the target.
    assert spares(over, target, np.array([0.1, 0.0]), 0.005)
    assert not spares(over, target, np.array([-0.1, 0.0]), 0.005)
    assert spares(over, target, np.array([0.0, 0.1]), 0.005)  # It goes by its side.
    apart = rectangle(1, "", (0.04 + 1e-9, 0.0))  # A rounding error more.
    assert not spares(apart, target, np.array([-0.1, 0.0]), 0.005)


def brute_force(
    segment: Segment, others: list[Segment], target: Segment, config: PushConfig
) -> tuple[float, Push | None]:
    """The first turn in which a finger stands free, or that of the least overlap, and its push.

    All turns and places are compared, overlaps by counting points.
    """
    away = away_from_clutter(segment, others, target, config.width)
    steps = round(config.largest_turn / config.turn_step)
    turns = sorted(range(-steps, steps + 1), key=lambda step: (abs(step), -step))
    found: list[tuple[float, int, float, Push]] = []
    for rank, step in enumerate(turns):
        turn = np.deg2rad(step * config.turn_step)
        d = rotation(turn) @ away
        if not spares(segment, target, config.length * d, config.clearance):
            continue
        for offset in np.linspace(-config.aside, config.aside, config.places):
            place = finger_place(segment, d, offset, config)
            if place is None:
                continue
            way = np.linspace(0.0, config.length + config.gap, 41)[:, None] * d
            gaps = [distance(place[1] + shift, target.contour) for shift in way]
            if min(gaps) < config.clearance:
                continue
            ious = [grid_iou(other.contour, place[1]) for other in others]
            push = Push(direction=d, offset=offset, turned=turn, overlap=float(np.mean(ious)))
            found.append((round(push.overlap, 9), rank, abs(offset), push))
        if any(overlap == 0.0 and found_at == rank for overlap, found_at, _, _ in found):
            break
    if not found:
        return np.inf, None
    best = min(found, key=lambda entry: entry[:3])
    return best[0], best[3]


@pytest.mark.parametrize("seed", range(12))
def test_a_plan_is_the_best_of_all(seed: int) -> None:
    config = replace(CONFIG, places=3, turn_step=30.0, friction=0.2)
    scene = list(random_scene(seed, count=6, spread=0.07))
    target, segment = scene[0], scene[3]
    others = [other for other in scene if other is not segment]
    overlap, expected = brute_force(segment, others, target, config)
    push = plan_push(segment, others, target, config)
    if expected is None:
        assert push.why == "every push sweeps the target"
        return
    assert push.why == ""
    assert push.overlap == pytest.approx(overlap, abs=2e-3)
    if overlap == 0.0:
        assert push.turned == pytest.approx(expected.turned)
        assert abs(push.offset) == pytest.approx(abs(expected.offset))
        assert_allclose(push.direction, expected.direction, atol=1e-12)


def test_plans_by_lot_are_straight_turned_crowded_and_refused() -> None:
    kinds = set()
    for seed in range(30):
        scene = list(random_scene(seed, count=10, spread=0.06))
        others = [other for other in scene if other is not scene[3]]
        push = plan_push(scene[3], others, scene[0], CONFIG)
        if push.why:
            kinds.add("refused")
        else:
            kinds.add("crowded" if push.overlap else "turned" if push.turned else "straight")
            assert abs(push.offset) <= CONFIG.aside
            assert np.linalg.norm(push.direction) == pytest.approx(1.0)
    assert kinds == {"straight", "turned", "crowded", "refused"}


def test_the_finger_moves_along_the_contour_to_where_it_is_free() -> None:
    config = replace(CONFIG, aside=0.015, places=31, largest_turn=0.0)
    pushed = rectangle(0, "can", (0.0, 0.0), (0.06, 0.08))
    ahead = 500 * [rectangle(1, "", (0.2, 0.0))]  # So many that what is behind turns nothing.
    free = plan_push(pushed, ahead, None, config)
    assert_allclose(free.direction, [-1.0, 0.0], atol=1e-12)
    assert free.offset == 0.0
    # It reaches 6 mm into the finger's place, from the left as seen along the push.
    x, y = free.finger.mean(axis=0)
    obstacle = rectangle(3, "", (x, y - 0.0135 - 0.002), (0.016, 0.016))
    blocked = plan_push(pushed, [*ahead, obstacle], None, config)
    assert blocked.overlap == 0.0
    assert -0.015 < blocked.offset < 0.0
    nearer = finger_place(pushed, blocked.direction, blocked.offset + 0.001, config)
    assert nearer is not None
    assert area(clipped(obstacle.contour, nearer[1])) > 0.0


def test_a_push_is_turned_until_it_spares_the_target() -> None:
    """Others push the object towards the target; it goes by to the left."""
    pushed = rectangle(0, "can", (0.0, 0.0))
    target = rectangle(1, "wineglass", (0.09, 0.0))
    behind = [rectangle(2 + k, "can", (-0.045, y)) for k, y in enumerate((-0.1, 0.0, 0.1))]
    others = [target, *behind]
    away = away_from_clutter(pushed, others, target, CONFIG.width)
    assert away[0] > 0.9
    push = plan_push(pushed, others, target, CONFIG)
    assert push.why == ""
    assert push.turned > np.deg2rad(20.0)
    assert spares(pushed, target, push.length * push.direction, CONFIG.clearance)
    straight = plan_push(pushed, others, target, replace(CONFIG, largest_turn=0.0))
    assert straight.why == "every push sweeps the target"


def test_a_finger_does_not_come_down_on_the_target() -> None:
    pushed = rectangle(0, "can", (0.06, 0.0))
    target = rectangle(1, "wineglass", (0.0, 0.0))  # 2 cm are free between, the finger needs 3.8.
    straight = plan_push(pushed, [target], target, replace(CONFIG, largest_turn=0.0))
    assert straight.why == "every push sweeps the target"
    push = plan_push(pushed, [target], target, CONFIG)
    assert push.why == ""
    assert distance(push.finger, target.contour) >= CONFIG.clearance
