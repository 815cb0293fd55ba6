"""What a push does to an object: how it topples, turns, slides and what it spares."""

from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest
import shapely
import trimesh
from numpy.testing import assert_allclose
from shapely.affinity import translate

from crossmodal.models.gripper_taxels import THICKNESS, WIDTH
from crossmodal.systems.declutter.push import (
    PushConfig,
    lever,
    outlines_on_the_way,
    push_height,
)
from crossmodal.systems.port_values import Segment
from tests.systems.declutter.scenes import (
    along,
    finger_place,
    random_scene,
    rectangle,
    rotation,
    spares,
)

CONFIG = PushConfig()
LEFT = np.array([[0.0, -1.0], [1.0, 0.0]])  # A quarter turn.


def test_a_push_topples_above_the_height_of_its_balance() -> None:
    """F = mu m g, and F h = m g r about the foremost foot."""
    m, g, r, mu = 0.35, 9.81, 0.033, 0.5
    config = replace(CONFIG, foot=1.0, margin=1.0, friction=mu)
    can, d = rectangle(0, "can", (0.3, 0.0), (2.0 * r, 0.2)), np.array([1.0, 0.0])
    height = push_height(can, d, config)
    assert mu * m * g * height == pytest.approx(m * g * r)
    assert push_height(can, d, replace(config, margin=0.5)) == pytest.approx(0.033)
    assert push_height(can, d, replace(config, foot=0.5)) == pytest.approx(0.033)
    larger = rectangle(0, "can", (0.3, 0.0), (4.0 * r, 0.2))
    assert push_height(larger, d, config) == pytest.approx(2.0 * height)


@pytest.mark.parametrize("name", ["can", "cleaner", "oil", "shampoo", "spray", "wineglass"])
def test_the_outlines_of_goods_that_stand_are_not_taken_for_their_feet(name: str) -> None:
    """Whatever the direction, the foot reaches as far as is believed."""
    mesh = trimesh.load(files("crossmodal.models") / f"sdf/goods/{name}/{name}.obj", force="mesh")
    vertices = np.asarray(mesh.vertices)
    hull = shapely.MultiPoint(vertices[:, :2]).convex_hull
    low = vertices[vertices[:, 2] < vertices[:, 2].min() + 1e-3, :2]
    config = replace(CONFIG, margin=1.0, friction=1.0)  # So that the height is that reach.
    segment = Segment(number=0, contour=hull)
    for turn in np.linspace(0.0, 2.0 * np.pi, 36):
        d = rotation(turn)[:, 0]
        reach = ((low - segment.centroid) @ d).max()
        assert push_height(segment, d, config) <= reach


@pytest.mark.parametrize("seed", range(10))
def test_the_finger_stands_behind_the_object(seed: int) -> None:
    rng = np.random.default_rng(seed)
    angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, 14))
    radii = rng.uniform(0.02, 0.06, 14)
    contour = radii[:, None] * np.column_stack([np.cos(angles), np.sin(angles)]) + [0.5, 0.1]
    segment = Segment(number=0, contour=shapely.Polygon(contour))
    d = rotation(rng.uniform(0.0, 2.0 * np.pi))[:, 0]
    offset = rng.uniform(-0.01, 0.01)
    place = finger_place(segment, d, offset, CONFIG)
    assert place is not None
    point, finger = place
    box = shapely.get_coordinates(finger)
    edge = along(contour, 4000) - segment.centroid
    ahead, aside = edge @ d, edge @ (LEFT @ d)
    on_line = np.abs(aside - offset) < 3e-5
    own = point - segment.centroid
    assert own @ (LEFT @ d) == pytest.approx(offset)
    assert own @ d == pytest.approx(ahead[on_line].min(), abs=5e-4)
    in_front = np.abs(aside - offset) <= 0.5 * WIDTH
    local = (box - segment.centroid) @ np.column_stack([d, LEFT @ d])
    assert local[:, 0].max() == pytest.approx(ahead[in_front].min() - CONFIG.gap, abs=5e-5)
    assert np.ptp(local[:, 0]) == pytest.approx(2.0 * THICKNESS)
    assert_allclose([local[:, 1].min(), local[:, 1].max()], [offset - 0.0135, offset + 0.0135])
    assert segment.contour.intersection(finger).area == 0.0


def test_a_line_beside_the_object_has_no_place() -> None:
    segment = rectangle(0, "", (0.0, 0.0), (0.02, 0.02))
    assert finger_place(segment, np.array([1.0, 0.0]), 0.011, CONFIG) is None
    assert finger_place(segment, np.array([1.0, 0.0]), 0.009, CONFIG) is not None


@pytest.mark.parametrize("seed", range(40))
def test_a_motion_spares_the_target_as_at_each_of_its_instants(seed: int) -> None:
    rng = np.random.default_rng(seed)
    target, segment = random_scene(seed, count=2, spread=0.08)
    motion = 0.1 * rotation(rng.uniform(0.0, 2.0 * np.pi))[:, 0]
    hull = segment.contour.convex_hull
    steps = [translate(hull, *(share * motion)) for share in np.linspace(0.0, 1.0, 201)]
    gaps = shapely.distance(target.contour, steps)
    common = shapely.area(shapely.intersection(target.contour, steps))
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


def test_a_finger_has_no_lever_while_the_centroid_is_behind_it() -> None:
    assert [lever(x) for x in (0.0, 0.5 * WIDTH, -0.01)] == [0.0, 0.0, 0.0]
    assert lever(0.5 * WIDTH + 0.01) == pytest.approx(0.01)
    assert lever(-0.5 * WIDTH - 0.01) == pytest.approx(-0.01)


def test_a_push_beside_the_centroid_turns_as_friction_allows() -> None:
    """Normal velocities of the ellipsoid (f / F)^2 + (m / (c F))^2 = 1: v_x = f, w = m / c^2."""
    segment = rectangle(0, "box", (0.1, 0.2), (0.06, 0.08), 0.3)
    squared, b, length = (0.06**2 + 0.08**2) / 15.0, 0.02, 0.05
    d = rotation(0.7)[:, 0]
    f, m = 1.0, -b  # The force pushes b to the left of the centroid.
    v, w = f, m / squared
    rate = v - w * b  # The finger's speed.
    (outline,) = outlines_on_the_way(segment, d, b, np.array([length]))
    assert_allclose(
        shapely.get_coordinates(outline.centroid)[0] - segment.centroid, length * v / rate * d
    )
    turned = rotation(length * w / rate)
    expected = (shapely.get_coordinates(segment.contour)[0] - segment.centroid) @ turned.T
    own = shapely.get_coordinates(outline) - shapely.get_coordinates(outline.centroid)
    assert np.abs(own - expected).max(axis=1).min() < 1e-12
    straight = outlines_on_the_way(segment, d, 0.0, np.array([0.0, length]))
    assert straight[0].equals_exact(segment.contour, 1e-12, normalize=True)
    assert straight[1].equals_exact(
        translate(segment.contour, *(length * d)), 1e-12, normalize=True
    )
