import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.math import RigidTransform, RotationMatrix

from crossmodal.maths.pinhole import Intrinsics
from crossmodal.models import SDF_DIR
from crossmodal.systems.segmentation.network_input import (
    CLASSES,
    SHAPE,
    network_input,
)

CAMERA = Intrinsics(
    width=640, height=480, focal_x=577.0, focal_y=577.0, center_x=319.5, center_y=239.5
)
TABLE = 0.7
TILTED = RigidTransform(RotationMatrix.MakeXRotation(np.deg2rad(-140.0)), [0.0, -0.5, 1.3])
X_WC = TILTED.GetAsMatrix4()


def depth_of_plane(z: float) -> np.ndarray:
    """(H, W), [m], by Drake's transforms."""
    v, u = np.indices((480, 640))
    rays = np.stack([(u - 319.5) / 577.0, (v - 239.5) / 577.0, np.ones_like(u, float)])
    down = (TILTED.rotation().matrix() @ rays.reshape(3, -1))[2].reshape(480, 640)
    return (z - 1.3) / down


def test_classes_are_the_goods_that_there_are() -> None:
    goods = sorted(folder.name for folder in (SDF_DIR / "goods").iterdir() if folder.is_dir())
    assert list(CLASSES) == ["table", *goods, "other"]


@pytest.mark.parametrize("z", [0.7, 0.75, 0.9])
def test_a_level_plane_has_one_height_from_a_tilted_camera(z: float) -> None:
    x = network_input(np.zeros((480, 640, 3), np.uint8), depth_of_plane(z), None, CAMERA, X_WC, 0.7)
    assert x.shape == SHAPE
    assert_allclose(x[3], 10.0 * (z - TABLE), atol=1e-5)


def test_where_no_depth_was_measured_the_distance_of_the_table_is_still_known() -> None:
    depth = np.zeros((480, 640))
    depth[:, :10], depth[:, 10:20], depth[:, 20:30] = np.nan, np.inf, -1.0
    x = network_input(np.zeros((480, 640, 3), np.uint8), depth, None, CAMERA, X_WC, TABLE)
    assert (x[3] == 0.0).all()
    assert (x[4] == 1.0).all()
    # Nearest of two pixels is the first.
    assert_allclose(x[5], 1.0 / depth_of_plane(TABLE)[::2, ::2], rtol=1e-5)


def test_pixels_of_the_robot_are_grey_and_without_depth() -> None:
    masked = np.zeros((480, 640), bool)
    masked[:, :320] = True
    white = np.full((480, 640, 3), 255, np.uint8)
    x = network_input(white, depth_of_plane(0.8), masked, CAMERA, X_WC, TABLE)
    assert_allclose(x[:3, :, :160], 0.0, atol=0.01)
    assert_allclose(x[:3, :, 160:], 1.0)
    assert_allclose(x[4], np.repeat([[1.0, 0.0]], 160, axis=1).repeat(240, axis=0))
    assert (white == 255).all()
