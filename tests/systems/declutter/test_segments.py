"""Outlines on the table from masks, by cameras whose images are made by hand."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array, Mask
from crossmodal.maths.pinhole import Intrinsics
from crossmodal.maths.polygons import area, distance
from crossmodal.systems.declutter.segments import on_plane, segment_of_mask, with_known_numbers
from crossmodal.systems.port_values import Segment
from tests.systems.declutter.scenes import rectangle, rotation

CAMERA = Intrinsics(
    width=640, height=480, focal_x=600.0, focal_y=600.0, center_x=319.5, center_y=239.5
)
TABLE = 0.2
MIDDLE = np.array([0.5, 0.1])


def above(height: float = 0.8) -> Array:
    eye = np.array([*MIDDLE, TABLE + height])
    return se3.looking_at(eye, eye - [0.0, 0.0, 1.0])


def aslant() -> Array:
    return se3.looking_at(np.array([0.0, 0.1, TABLE + 0.6]), np.array([*MIDDLE, TABLE]))


def pixels_of(places: Array, z: float, X_WC: Array) -> Array:
    p_W = np.column_stack([places, np.full(len(places), z)])
    return CAMERA.project((p_W - X_WC[:3, 3]) @ X_WC[:3, :3])


def box_image(corners: Array, top: float, X_WC: Array) -> tuple[Mask, Array]:
    """Mask and depth of an upright prism over corners (N, 2), by the rays through all pixels."""
    mask, depth = np.zeros((480, 640), bool), np.full((480, 640), np.inf)
    for z in np.linspace(TABLE, TABLE + top, 200):  # Slices, from the table on.
        slice_ = np.zeros((480, 640), np.uint8)
        cv2.fillPoly(slice_, [np.round(pixels_of(corners, z, X_WC)).astype(np.int32)], 1)
        v, u = np.nonzero(slice_)
        ones = np.ones(len(u))
        rays = np.column_stack([(u - 319.5) / 600.0, (v - 239.5) / 600.0, ones]) @ X_WC[:3, :3].T
        reach = (z - X_WC[2, 3]) / rays[:, 2]
        depth[v, u] = np.minimum(depth[v, u], reach)
        mask[v, u] = True
    return mask, depth


SHAPE = np.array([[-0.05, -0.03], [0.05, -0.03], [0.05, 0.03], [-0.05, 0.03]]) @ rotation(0.4).T


@pytest.mark.parametrize("X_WC", [above(), aslant()], ids=["above", "aslant"])
def test_pixels_lie_on_their_planes(X_WC: Array) -> None:
    places = MIDDLE + SHAPE
    for z in (TABLE, TABLE + 0.1):
        uv = pixels_of(places, z, X_WC)
        assert_allclose(on_plane(uv, CAMERA, X_WC, np.full(4, z)), places, atol=1e-12)


def test_a_pixel_that_shows_no_table_is_refused() -> None:
    level = se3.looking_at(np.array([0.0, 0.0, 0.5]), np.array([1.0, 0.0, 0.5]))
    with pytest.raises(ValueError, match="does not meet the plane"):
        on_plane(np.array([[320.0, 100.0]]), CAMERA, level, np.zeros(1))


@pytest.mark.parametrize("height", [0.5, 0.8, 1.2])
def test_a_flat_object_is_as_large_from_everywhere(height: float) -> None:
    X_WC = above(height)
    mask, _ = box_image(MIDDLE + SHAPE, 0.0, X_WC)
    segment = segment_of_mask(4, "sponge", mask, CAMERA, X_WC, TABLE)
    assert (segment.number, segment.name) == (4, "sponge")
    assert np.isnan(segment.top)
    pixel = height / 600.0
    assert_allclose(segment.centroid, MIDDLE, atol=pixel)
    assert area(segment.contour) == pytest.approx(0.006, rel=0.08)
    for corner in MIDDLE + SHAPE:
        assert np.linalg.norm(segment.box - corner, axis=1).min() < 3.0 * pixel
    assert len(segment.pixels) == len(segment.contour) < 12


def test_depth_puts_a_high_object_where_it_stands() -> None:
    X_WC = aslant()
    mask, depth = box_image(MIDDLE + SHAPE, 0.08, X_WC)
    without = segment_of_mask(0, "box", mask, CAMERA, X_WC, TABLE)
    segment = segment_of_mask(0, "box", mask, CAMERA, X_WC, TABLE, depth)
    assert segment.top == pytest.approx(0.08, abs=2e-3)
    assert_allclose(segment.centroid, MIDDLE, atol=6e-3)
    assert np.linalg.norm(without.centroid - MIDDLE) > 0.02
    assert area(segment.contour) == pytest.approx(0.006, rel=0.15)
    assert area(without.contour) > 1.5 * 0.006


def test_where_no_depth_was_measured_the_table_is_taken() -> None:
    mask, depth = box_image(MIDDLE + SHAPE, 0.08, above())
    depth[:] = np.nan
    depth[::2] = 0.0
    segment = segment_of_mask(0, "glass", mask, CAMERA, above(), TABLE, depth)
    assert segment == segment_of_mask(0, "glass", mask, CAMERA, above(), TABLE)


def test_an_object_in_two_parts_has_what_lies_between() -> None:
    mask = np.zeros((480, 640), bool)
    mask[200:220, 200:260] = mask[200:220, 300:360] = True
    segment = segment_of_mask(0, "marker", mask, CAMERA, above(), TABLE)
    pixel = 0.8 / 600.0
    assert area(segment.contour) == pytest.approx(159 * 19 * pixel**2, rel=1e-6)


def test_an_empty_mask_is_refused() -> None:
    with pytest.raises(ValueError, match="no pixel"):
        segment_of_mask(0, "", np.zeros((480, 640), bool), CAMERA, above(), TABLE)


def test_a_single_pixel_is_a_point() -> None:
    mask = np.zeros((480, 640), bool)
    mask[100, 200] = True
    segment = segment_of_mask(0, "", mask, CAMERA, above(), TABLE)
    assert area(segment.box) == pytest.approx(0.0, abs=1e-12)
    assert distance(segment.contour, segment.contour) == 0.0


def numbers(segments: tuple[Segment, ...]) -> list[int]:
    return [segment.number for segment in segments]


def test_objects_keep_their_numbers() -> None:
    known = (
        rectangle(4, "can", (0.0, 0.0)),
        rectangle(7, "can", (0.1, 0.0)),
        rectangle(9, "box", (0.2, 0.0)),
    )
    seen = (
        rectangle(0, "box", (0.23, 0.0)),
        rectangle(1, "can", (0.09, 0.01)),
        rectangle(2, "can", (0.05, 0.0)),  # As near to 7 as to 4, but 7 is another's.
        rectangle(3, "sponge", (0.2, 0.0)),  # Nothing of its class was there.
        rectangle(4, "can", (0.9, 0.0)),  # Too far from all cans.
    )
    found = with_known_numbers(seen, known, reach=0.15)
    assert numbers(found) == [9, 7, 4, 10, 11]
    assert [replace(new, number=old.number) for new, old in zip(found, seen, strict=True)] == [
        *seen
    ]


def test_without_known_objects_numbers_begin_at_zero() -> None:
    seen = (rectangle(5, "can", (0.0, 0.0)), rectangle(6, "can", (0.1, 0.0)))
    assert numbers(with_known_numbers(seen, (), reach=0.1)) == [0, 1]
    assert with_known_numbers((), seen, reach=0.1) == ()
