import numpy as np
import pytest
from numpy.testing import assert_allclose

from crossmodal.systems.grasping.height_map import (
    CELL,
    CELLS,
    HeightMap,
    height_map,
    highest_within,
    seen_points,
)
from tests.systems.grasping.images import CAMERA, Block, above, image_of

BOX = Block(middle=(0.03, -0.02), size=(0.08, 0.04, 0.05))
BESIDE = Block(middle=(-0.05, -0.02), size=(0.04, 0.04, 0.03))


def seen(distance: float, tilt: float, table: float) -> HeightMap:
    X_WC = above(distance, tilt)
    depth, labels = image_of([BOX, BESIDE], X_WC, table)
    return height_map(seen_points(depth, labels, CAMERA, X_WC, table), 0)


@pytest.mark.parametrize("table", [0.0, 0.1])
@pytest.mark.parametrize("tilt", [-0.5, 0.0, 0.4])
@pytest.mark.parametrize("distance", [0.6, 0.9])
def test_an_object_has_its_place_and_size_wherever_the_camera_is(
    distance: float, tilt: float, table: float
) -> None:
    view = seen(distance, tilt, table)
    rows, columns = np.nonzero(view.heights)
    places = view.places(np.column_stack([columns, rows]))
    assert_allclose(0.5 * (places.min(axis=0) + places.max(axis=0)), BOX.middle, atol=0.002)
    assert_allclose(np.ptp(places, axis=0), BOX.size[:2], atol=0.004)
    assert_allclose(view.heights[rows, columns], BOX.size[2], atol=1e-6)
    assert len(rows) * CELL**2 == pytest.approx(BOX.size[0] * BOX.size[1], rel=0.1)


def test_others_are_beside_it_and_not_in_it() -> None:
    view = seen(0.7, 0.0, 0.0)
    rows, columns = np.nonzero(view.others > 0.01)
    places = view.places(np.column_stack([columns, rows]))
    assert_allclose(0.5 * (places.min(axis=0) + places.max(axis=0)), BESIDE.middle, atol=0.002)
    assert_allclose(view.others[rows, columns], BESIDE.size[2], atol=1e-6)


def test_glass_beside_it_is_as_high_as_it_can_be() -> None:
    X_WC = above(0.7)
    depth, labels = image_of([BOX, BESIDE], X_WC)
    depth[labels == 1] = np.nan
    points = seen_points(depth, labels, CAMERA, X_WC, 0.0, {1: 0.2})
    others = height_map(points, 0).others
    assert_allclose(others[others > 0.01], 0.2)
    own = height_map(points, 1).heights
    assert_allclose(own[own > 0.0], 0.06)


def test_a_rim_that_its_mask_leaves_out_is_no_obstacle() -> None:
    X_WC = above(0.7)
    depth, labels = image_of([BOX], X_WC)
    inner = np.stack([np.roll(labels, k, axis=(0, 1)) for k in (-2, 2)]).min(axis=0)
    assert (inner != labels).any()
    assert height_map(seen_points(depth, inner, CAMERA, X_WC, 0.0), 0).others.max() < 1e-6


def test_what_is_not_measured_of_an_object_is_as_high_as_what_is_nearest() -> None:
    X_WC = above(0.7)
    depth, labels = image_of([BOX], X_WC)
    hole = (labels == 0) & (np.arange(CAMERA.width) % 3 > 0)
    depth[hole] = 0.0
    heights = seen_points(depth, labels, CAMERA, X_WC, 0.0).heights
    assert_allclose(heights[labels == 0], BOX.size[2], atol=1e-9)


@pytest.mark.parametrize("measured", ["nothing", "the table through it"])
def test_glass_is_taken_for_six_centimetres_high(measured: str) -> None:
    X_WC = above(0.7)
    depth, labels = image_of([BOX], X_WC)
    through, _ = image_of([], X_WC)
    depth[labels == 0] = through[labels == 0] + 0.002 if measured != "nothing" else np.nan
    heights = seen_points(depth, labels, CAMERA, X_WC, 0.0).heights
    assert_allclose(heights[labels == 0], 0.06)
    assert_allclose(heights[labels < 0], 0.0, atol=1e-9)


def test_without_a_return_the_height_beside_objects_is_not_known() -> None:
    X_WC = above(0.7)
    depth, labels = image_of([BOX], X_WC)
    depth[0, :] = np.inf
    heights = seen_points(depth, labels, CAMERA, X_WC, 0.0).heights
    assert np.isnan(heights[0]).all()


def test_an_object_that_no_pixel_shows_is_refused() -> None:
    X_WC = above(0.7)
    depth, labels = image_of([BOX], X_WC)
    with pytest.raises(ValueError, match="no pixel shows object 3"):
        height_map(seen_points(depth, labels, CAMERA, X_WC, 0.0), 3)


def test_the_highest_within_half_a_fingers_width() -> None:
    heights = np.zeros((CELLS, CELLS))
    heights[70, 80] = 0.04
    top = highest_within(heights)
    rows, columns = np.nonzero(top)
    away = CELL * np.hypot(rows - 70, columns - 80)
    assert away.max() <= 0.0135 + CELL
    assert len(rows) * CELL**2 == pytest.approx(np.pi * 0.0135**2, rel=0.25)
