import numpy as np
import pytest
from numpy.testing import assert_allclose

from crossmodal.maths.arrays import Array
from crossmodal.systems.grasping.grasp_network import (
    WIDTH_SCALE,
    grasps_of_output,
    network_input,
)
from crossmodal.systems.grasping.height_map import CELL, CELLS, HeightMap

HEIGHTS = np.zeros((CELLS, CELLS))
HEIGHTS[20:130, 20:130] = 0.06
VIEW = HeightMap(heights=HEIGHTS, others=np.zeros_like(HEIGHTS), corner=np.array([0.4, -0.3]))


def output(peaks: list[tuple[int, int, float, float, float]]) -> Array:
    """What a network says: quality in a bump about each row and column, an angle and a width."""
    rows, columns = np.indices((CELLS, CELLS))
    maps = np.zeros((4, CELLS, CELLS))
    for row, column, quality, angle, width in peaks:
        square = (rows - row) ** 2 + (columns - column) ** 2
        maps[0] = np.maximum(maps[0], quality * np.exp(-square / 50.0))
        near = square < 100
        maps[1:, near] = np.array([[np.cos(2 * angle)], [np.sin(2 * angle)], [width / WIDTH_SCALE]])
    return maps


def test_each_peak_is_a_grasp_and_the_best_is_first() -> None:
    said = output([(52, 63, 0.5, 0.3, 0.05), (91, 102, 0.9, -1.2, 0.08)])
    grasps, quality = grasps_of_output(said, VIEW, 0.1)
    first, second = 0, int(np.argmax(grasps[:, 2] > 0.0))
    for k, row, column in ((first, 91, 102), (second, 52, 63)):
        assert_allclose(grasps[k, :2], [0.4 + CELL * column, -0.3 + CELL * row], atol=1e-9)
    assert_allclose(quality[[first, second]], [0.9, 0.5], rtol=0.05)
    assert (np.diff(quality) <= 0.0).all()
    assert_allclose(grasps[[first, second], 2], [-1.2, 0.3], atol=1e-6)
    assert_allclose(grasps[[first, second], 3], [0.08, 0.05], atol=1e-6)
    assert_allclose(grasps[:, 4], 0.015)


def test_around_a_peak_there_are_grasps_a_centimetre_apart() -> None:
    grasps, quality = grasps_of_output(output([(50, 60, 0.9, 0.3, 0.05)]), VIEW, 0.3)
    beside = np.linalg.norm(grasps[:, :2] - [0.4 + CELL * 60, -0.3 + CELL * 50], axis=1)
    assert_allclose(quality, 0.9 * np.exp(-np.square(beside / CELL) / 50.0), atol=0.04)
    assert_allclose(np.sort(beside)[:9], 0.01 * np.sqrt([0, 1, 1, 1, 1, 2, 2, 2, 2]), atol=1e-9)


@pytest.mark.parametrize("place", [(50, 60, 0.05), (5, 5, 0.9)])
def test_no_grasp_of_too_low_a_quality_or_beside_the_object(
    place: tuple[int, int, float],
) -> None:
    grasps, quality = grasps_of_output(output([(*place, 0.3, 0.05)]), VIEW, 0.1)
    assert grasps.shape == (0, 5)
    assert quality.shape == (0,)


def test_quality_and_width_are_within_their_ranges() -> None:
    grasps, quality = grasps_of_output(output([(50, 60, 1.5, 0.3, 0.3)]), VIEW, 0.1)
    assert quality[0] == 1.0
    assert grasps[0, 3] == 0.14


def test_the_input_is_one_channel_of_heights_in_decimetres() -> None:
    x = network_input(HEIGHTS)
    assert x.shape == (1, CELLS, CELLS)
    assert x.dtype == np.float32
    assert x.max() == pytest.approx(0.6)
