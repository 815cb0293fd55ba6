"""Planes that touch the outline of a mask, against a sphere's cone of sight."""

import numpy as np
from numpy.testing import assert_allclose

from crossmodal.maths import se3
from crossmodal.maths.arrays import Mask
from crossmodal.maths.pinhole import Intrinsics
from crossmodal.systems.pose.outline import outline_planes

INTRINSICS = Intrinsics(
    width=320, height=240, focal_x=300.0, focal_y=310.0, center_x=155.0, center_y=121.0
)
EYE, MIDDLE, RADIUS = np.array([0.3, -0.2, 0.6]), np.array([0.5, 0.0, 0.1]), 0.06
X_WC = se3.looking_at(EYE, MIDDLE + np.array([0.05, 0.02, 0.0]))
NOTHING = np.zeros((240, 320), bool)
COUNT = 16


def sphere() -> Mask:
    """Pixels whose lines of sight meet the sphere."""
    d = INTRINSICS.image_rays(X_WC)
    d = d / np.linalg.norm(d, axis=-1, keepdims=True)
    to = MIDDLE - EYE
    along = d @ to
    return (along > 0.0) & (to @ to - along**2 < RADIUS**2)


def planes(own: Mask, other: Mask = NOTHING) -> np.ndarray:
    return outline_planes(own, other, INTRINSICS, X_WC[:3, :3], COUNT)


def test_the_planes_touch_what_is_seen() -> None:
    n = planes(sphere())
    assert len(n) == COUNT
    assert_allclose(np.linalg.norm(n, axis=1), 1.0)
    # The middle is a radius behind each, up to a pixel.
    assert_allclose(n @ (MIDDLE - EYE), -RADIUS, atol=1.0 / 300.0 * 0.6)


def test_a_hole_in_the_mask_changes_nothing() -> None:
    own = sphere()
    v, u = np.nonzero(own)
    holed = own.copy()
    holed[:, int(u.mean()) - 5 : int(u.mean()) + 5] = False
    inner = np.abs(np.indices(own.shape)[0] - v.mean()) < 10
    holed[~inner & own] = True
    assert_allclose(planes(holed), planes(own))


def test_nothing_is_known_of_an_end_beside_something_else() -> None:
    own = sphere()
    _, u = np.nonzero(own)
    hidden, other = own.copy(), NOTHING.copy()
    other[:, u.max() - 8 :] = True
    hidden &= ~other
    left = planes(hidden, other)
    assert 0 < len(left) < COUNT
    assert_allclose(left @ (MIDDLE - EYE), -RADIUS, atol=1.0 / 300.0 * 0.6)
    # The same at the end of the image.
    cut = np.roll(own, INTRINSICS.width - int(u.min()) - 10, axis=1)
    cut[:, :100] = False
    assert len(planes(cut)) < COUNT


def test_without_pixels_there_are_no_planes() -> None:
    assert planes(NOTHING).shape == (0, 3)
    assert planes(~NOTHING).shape == (0, 3)
