"""Outlines on the table from masks, by cameras whose images are made by hand."""

import cv2
import numpy as np
import pytest
import shapely
from numpy.testing import assert_allclose

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array, Mask
from crossmodal.maths.pinhole import Intrinsics
from crossmodal.systems.declutter.segments import (
    bare_part,
    on_plane,
    outline,
    segment_of_mask,
    shown_part,
    still_there,
    with_known_numbers,
)
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
    assert segment.contour.area == pytest.approx(0.006, rel=0.08)
    for corner in MIDDLE + SHAPE:
        assert segment.box.exterior.distance(shapely.Point(corner)) < 3.0 * pixel
    corners = shapely.get_num_coordinates([segment.pixels, segment.contour])
    assert corners[0] == corners[1] < 20


def test_depth_puts_a_high_object_where_it_stands() -> None:
    X_WC = aslant()
    mask, depth = box_image(MIDDLE + SHAPE, 0.08, X_WC)
    without = segment_of_mask(0, "box", mask, CAMERA, X_WC, TABLE)
    segment = segment_of_mask(0, "box", mask, CAMERA, X_WC, TABLE, depth)
    assert segment.top == pytest.approx(0.08, abs=2e-3)
    assert_allclose(segment.centroid, MIDDLE, atol=6e-3)
    assert np.linalg.norm(without.centroid - MIDDLE) > 0.02
    assert segment.contour.area == pytest.approx(0.006, rel=0.15)
    assert without.contour.area > 1.5 * 0.006


def test_where_no_depth_was_measured_the_table_is_taken() -> None:
    mask, depth = box_image(MIDDLE + SHAPE, 0.08, above())
    depth[:] = np.nan
    depth[::2] = 0.0
    segment = segment_of_mask(0, "glass", mask, CAMERA, above(), TABLE, depth)
    without = segment_of_mask(0, "glass", mask, CAMERA, above(), TABLE)
    assert segment.contour == without.contour
    assert np.isnan(segment.top)


def test_any_mask_has_an_outline() -> None:
    """Ragged masks have outlines that run to and fro or cross themselves once simplified."""
    torn = np.zeros((40, 40), np.uint8)  # With mitred corners Shapely tears its outline apart.
    corners = [(18, 21), (19, 21), (22, 24), (23, 24), (24, 25), (24, 24), (23, 23), (23, 22)]
    cv2.fillPoly(torn, [np.array([*corners, (24, 21)])], 1)
    assert outline(torn > 0).area > 0.6 * torn.sum()
    rng = np.random.default_rng(0)
    for _ in range(1000):
        noise = cv2.GaussianBlur(rng.normal(size=rng.integers(3, 60, 2)), (0, 0), rng.uniform(1, 4))
        mask = noise > np.quantile(noise, rng.uniform(0.5, 0.98))
        mask = cv2.connectedComponents(mask.astype(np.uint8))[1] == 1
        if mask.any():
            shape = outline(mask)
            assert shape.is_valid
            assert 0.6 * mask.sum() < shape.area


def test_an_object_in_two_parts_has_what_lies_between() -> None:
    mask = np.zeros((480, 640), bool)
    mask[200:220, 200:260] = mask[200:220, 300:360] = True
    segment = segment_of_mask(0, "marker", mask, CAMERA, above(), TABLE)
    pixel = 0.8 / 600.0
    assert segment.contour.area == pytest.approx(160 * 20 * pixel**2, rel=1e-3)


def test_an_empty_mask_is_refused() -> None:
    with pytest.raises(ValueError, match="no pixel"):
        segment_of_mask(0, "", np.zeros((480, 640), bool), CAMERA, above(), TABLE)


@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (1, 40), (40, 1), (3, 3)])
def test_a_thin_object_is_as_wide_as_its_pixels(rows: int, columns: int) -> None:
    mask = np.zeros((480, 640), bool)
    mask[100 : 100 + rows, 200 : 200 + columns] = True
    segment = segment_of_mask(0, "", mask, CAMERA, above(), TABLE)
    pixels = shapely.box(199.5, 99.5, 199.5 + columns, 99.5 + rows)
    assert segment.pixels.symmetric_difference(pixels).area <= 0.5  # At the end of a line.
    assert segment.contour.area == pytest.approx(segment.pixels.area * (0.8 / 600.0) ** 2)


@pytest.mark.parametrize("seed", range(10))
def test_outlines_of_ragged_masks_are_valid(seed: int) -> None:
    """Blots with holes, bridges and spikes of a pixel."""
    rng = np.random.default_rng(seed)
    blot = cv2.GaussianBlur(rng.normal(size=(60, 60)), (0, 0), 3.0) > 0.02
    mask = np.zeros((480, 640), bool)
    mask[100:160, 200:260] = blot
    mask[130, 180:300] = True
    depth = np.where(mask, rng.uniform(0.6, 0.8, mask.shape), 0.0)
    for heights in (None, depth):
        segment = segment_of_mask(0, "", mask, CAMERA, aslant(), TABLE, heights)
        assert segment.pixels.is_valid
        assert segment.contour.is_valid
        assert segment.contour.area > 0.0
    v, u = np.nonzero(mask)
    assert shapely.distance(segment.pixels, shapely.points(u, v)).max() <= 1.0


def test_an_outline_that_wrong_heights_cross_is_made_valid() -> None:
    """Half of the far edge seems so high that it is moved to before the near one."""
    X_WC = aslant()
    flat = MIDDLE + 0.05 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    mask, _ = box_image(flat, 0.0, X_WC)
    depth = np.where(mask, 0.0, np.nan)
    v, u = np.nonzero(mask)
    far = (v <= v.min() + 5) & (u > 320)
    depth[v[far], u[far]] = 0.4
    segment = segment_of_mask(0, "", mask, CAMERA, X_WC, TABLE, depth)
    assert shapely.get_num_geometries(segment.contour) == 2  # Triangles that meet in a point.
    assert segment.contour.is_valid
    assert segment.box.area > segment.contour.area > 0.0


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
    assert [new.contour for new in found] == [old.contour for old in seen]


def test_without_known_objects_numbers_begin_at_zero() -> None:
    seen = (rectangle(5, "can", (0.0, 0.0)), rectangle(6, "can", (0.1, 0.0)))
    assert numbers(with_known_numbers(seen, (), reach=0.1)) == [0, 1]
    assert with_known_numbers((), seen, reach=0.1) == ()


def test_an_image_shows_a_part_of_the_table() -> None:
    wide = shapely.box(-5.0, -5.0, 5.0, 5.0)
    shown = shown_part(wide, CAMERA, above(0.6), TABLE)
    x, y = np.ptp(shapely.get_coordinates(shown), axis=0)
    assert sorted([x, y]) == pytest.approx([0.479, 0.639])  # As far as its outer pixels' middles.
    assert_allclose(shapely.get_coordinates(shown.centroid)[0], MIDDLE, atol=1e-9)
    narrow = shapely.box(*(MIDDLE - 0.01), *(MIDDLE + 0.01))
    assert shown_part(narrow, CAMERA, above(0.6), TABLE).equals(narrow)


def test_where_the_horizon_is_seen_all_of_the_table_is() -> None:
    region = shapely.box(0.0, 0.0, 1.0, 1.0)
    ahead = se3.looking_at(np.array([0.0, 0.0, 0.5]), np.array([1.0, 0.0, 0.5]))
    assert shown_part(region, CAMERA, ahead, TABLE).equals(region)


def test_what_is_beyond_the_image_is_still_there() -> None:
    shown = shapely.box(0.0, 0.0, 1.0, 1.0)
    inside, seen, beyond, taken = (
        rectangle(number, "can", place)
        for number, place in enumerate([(0.5, 0.5), (0.9, 0.9), (1.2, 0.5), (1.4, 0.5)])
    )
    now = (seen, rectangle(9, "box", (1.4, 0.5), size=(0.1, 0.1)))  # It is where another was.
    (found,) = still_there((inside, seen, beyond, taken), now, shown)
    assert found.number == beyond.number
    assert found.contour == beyond.contour
    assert found.is_cut
    assert found.pixels.is_empty


def test_the_table_is_bare_where_neither_an_object_nor_a_robot_is_before_it() -> None:
    X_WC = aslant()
    region = shapely.box(-0.5, -0.5, 1.5, 0.7)
    shown = shown_part(region, CAMERA, X_WC, TABLE)
    mask, depth = box_image(MIDDLE + SHAPE, 0.2, X_WC)
    box = segment_of_mask(1, "box", mask, CAMERA, X_WC, TABLE, depth)
    robot = np.zeros_like(mask)
    robot[:, :100] = True
    bare = bare_part(shown, (box,), robot, CAMERA, X_WC, TABLE)
    rng = np.random.default_rng(0)
    low, high = np.reshape(shown.bounds, (2, 2))
    places = rng.uniform(low, high, (400, 2))
    u, v = np.round(pixels_of(places, TABLE, X_WC)).astype(int).T
    inside = (u >= 0) & (u < 640) & (v >= 0) & (v < 480)
    places, u, v = places[inside], u[inside], v[inside]
    free = ~(cv2.dilate((mask | robot).astype(np.uint8), np.ones((9, 9))) > 0)[v, u]
    found = shapely.contains_xy(bare, *places.T)
    assert found[free].mean() > 0.98
    assert not found[(mask | robot)[v, u]].any()
    # What is before the horizon hides it.
    robot[0] = True
    level = se3.looking_at(np.array([0.0, 0.1, TABLE + 0.3]), np.array([1.0, 0.1, TABLE + 0.2]))
    assert bare_part(region, (), robot, CAMERA, level, TABLE).is_empty
