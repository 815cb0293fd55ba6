"""Motions that explain two outlines of an object."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from shapely.affinity import rotate, translate

from crossmodal.systems.declutter.displacement import displacement
from crossmodal.systems.port_values import Segment
from tests.systems.declutter.scenes import rectangle

BOTTLE = Segment(  # With a neck at its one end, 24 cm long.
    number=0,
    contour=shapely.union(shapely.box(0.0, 0.0, 0.18, 0.07), shapely.box(0.18, 0.02, 0.24, 0.05)),
)


def moved(x: float, y: float = 0.0, angle: float = 0.0) -> Segment:
    """The bottle, turned about its middle by an angle [deg]."""
    contour = rotate(BOTTLE.contour, angle, origin="centroid")
    return replace(BOTTLE, contour=translate(contour, x, y))


@pytest.mark.parametrize("way", [(0.03, 0.0), (0.0, 0.03), (-0.08, 0.0), (0.2, -0.1)])
def test_a_motion_is_found_along_the_object_as_across_it(way: tuple[float, float]) -> None:
    found = displacement(BOTTLE, moved(*way))
    assert found == pytest.approx(np.hypot(*way), rel=0.3, abs=5e-3)
    assert found > 0.02


def test_a_turn_is_as_long_as_the_way_of_its_points() -> None:
    for angle in (30.0, 90.0, 180.0):
        points = shapely.get_coordinates(BOTTLE.contour.segmentize(0.003))
        radius = np.sqrt(np.square(points - points.mean(axis=0)).sum(axis=1).mean())
        found = displacement(BOTTLE, moved(0.0, angle=angle))
        assert found == pytest.approx(radius * np.deg2rad(angle), rel=0.4)


def test_what_rests_has_not_moved_however_much_of_it_is_seen() -> None:
    part = replace(BOTTLE, contour=shapely.box(0.12, 0.0, 0.2, 0.07).intersection(BOTTLE.contour))
    assert displacement(BOTTLE, part) == displacement(part, BOTTLE) == 0.0
    other = replace(BOTTLE, contour=shapely.box(0.0, 0.0, 0.15, 0.07))
    assert displacement(part, other) < 0.05  # What both show is little.


@pytest.mark.parametrize("seed", range(10))
def test_the_rim_of_a_mask_flickers(seed: int) -> None:
    rng = np.random.default_rng(seed)
    edge = shapely.get_coordinates(BOTTLE.contour.segmentize(0.01))[:-1]
    noisy = shapely.Polygon(edge + rng.normal(0.0, 0.003, edge.shape)).buffer(0.0)
    spike = shapely.box(0.1, 0.07, 0.105, 0.12)
    assert displacement(BOTTLE, replace(BOTTLE, contour=noisy)) < 0.01
    assert displacement(BOTTLE, replace(BOTTLE, contour=noisy.union(spike))) < 0.01


def test_a_part_that_moves_moves() -> None:
    part = rectangle(1, "can", (0.49, 0.0), (0.02, 0.04))
    assert displacement(part, translated(part, 0.05)) == pytest.approx(0.05, abs=6e-3)


def test_something_smaller_than_a_cell_has_a_place() -> None:
    grain = rectangle(1, "", (0.5, 0.0), (0.001, 0.001))
    assert displacement(grain, grain) == 0.0
    assert displacement(grain, translated(grain, 0.05)) == pytest.approx(0.05, abs=6e-3)


def test_a_thing_has_gone_if_the_table_is_bare_where_it_was() -> None:
    """The image ends at x = 0.15, and the bottle has gone 8 cm along itself."""
    image = shapely.box(-0.3, -0.3, 0.15, 0.3)
    gone = moved(0.08)
    part = replace(gone, contour=gone.contour.intersection(image))
    bare = image.difference(gone.contour)
    assert displacement(BOTTLE, part) == 0.0  # It could as well be half hidden.
    assert displacement(BOTTLE, part, bare) == pytest.approx(0.08, abs=0.02)
    # What rests has not moved, and what is hidden may be there.
    assert displacement(BOTTLE, BOTTLE, image.difference(BOTTLE.contour)) == 0.0
    half = replace(BOTTLE, contour=BOTTLE.contour.intersection(image))
    assert displacement(BOTTLE, half, image.difference(BOTTLE.contour)) == 0.0
    # A mask that lacks a part makes nothing move.
    assert displacement(BOTTLE, half, shapely.box(-1, -1, 1, 1).difference(half.contour)) < 0.01


def translated(segment: Segment, x: float) -> Segment:
    return replace(segment, contour=translate(segment.contour, x, 0.0))
