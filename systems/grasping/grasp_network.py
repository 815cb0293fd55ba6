"""The grasps that a network sees in a height map.

The network is that of D. Morrison, P. Corke, J. Leitner, Closing the loop for robotic grasping, RSS
2018: of each cell the quality of a grasp there, the cosine and the sine of twice its angle, and its
width. Unlike there, its input are heights above the table, which is known, in cells of two
millimetres: a cell of the output depends on as much of the input as the gripper opens, and a map
has a quarter of their 300 x 300 pixels.
"""

import cv2
import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.systems.grasping.grasp_geometry import STROKE, fingertip_height
from crossmodal.systems.grasping.height_map import HeightMap, highest_within
from crossmodal.systems.onnx_network import Images

INPUT_SCALE = 10.0  # Of heights, [1/m]: the objects' are about one then.
WIDTH_SCALE = 0.15  # Of a width that is one, [m].
_BLUR = 1.0  # Standard deviation, [cells].
_PEAK = 10  # A peak of quality is the highest within so many cells;
_GRID = 5  # besides, one cell in so many along each axis counts.


def network_input(heights: Array) -> Images:
    """A map (CELLS, CELLS), [m], as the network takes it (1, CELLS, CELLS)."""
    return np.asarray(np.clip(INPUT_SCALE * heights, 0.0, 4.0)[None], np.float32)


def grasps_of_output(output: Array | Images, view: HeightMap, least: float) -> tuple[Array, Array]:
    """Grasps all over an object, those at the peaks of the quality among them, the best first.

    Args:
        output: Of the network (4, CELLS, CELLS).
        view: Of the object.
        least: Quality of a grasp, above zero.

    Returns:
        Rows (N, 5), see `grasp_geometry`, and their qualities (N,), at most one.
    """
    quality, cosine, sine, width = (cv2.GaussianBlur(o, (0, 0), _BLUR) for o in output)
    seen = highest_within(view.heights)
    quality = np.where(seen > 0.0, quality, 0.0)
    chosen = quality == cv2.dilate(quality, np.ones((2 * _PEAK + 1,) * 2, np.uint8))
    chosen[::_GRID, ::_GRID] = True
    cells = np.argwhere(chosen & (quality >= least))
    rows, columns = cells[np.argsort(-quality[tuple(cells.T)], kind="stable")].T
    places = view.places(np.column_stack([columns, rows]))
    angle = 0.5 * np.arctan2(sine[rows, columns], cosine[rows, columns])
    opening = np.clip(WIDTH_SCALE * width[rows, columns], 0.0, STROKE)
    z = fingertip_height(seen[rows, columns])
    return np.column_stack([places, angle, opening, z]), np.minimum(quality[rows, columns], 1.0)
