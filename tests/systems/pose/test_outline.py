"""Planes that touch the outline of a mask, against a sphere's cone of sight."""

import numpy as np
from numpy.testing import assert_allclose

from crossmodal.maths import se3
from crossmodal.maths.arrays import Ids, Mask
from crossmodal.maths.pinhole import Intrinsics
from crossmodal.systems.pose.outline import outline_planes

INTRINSICS = Intrinsics(
    width=320, height=240, focal_x=300.0, focal_y=310.0, center_x=155.0, center_y=121.0
)
EYE, MIDDLE, RADIUS = np.array([0.3, -0.2, 0.6]), np.array([0.5, 0.0, 0.1]), 0.06
X_WC = se3.looking_at(EYE, MIDDLE + np.array([0.05, 0.02, 0.0]))
NOTHING, NOBODY = np.zeros((240, 320), bool), np.full((240, 320), -1)
COUNT = 16


def sphere() -> Mask:
    """Pixels whose lines of sight meet the sphere."""
    d = INTRINSICS.image_rays(X_WC)
    d = d / np.linalg.norm(d, axis=-1, keepdims=True)
    to = MIDDLE - EYE
    along = d @ to
    return (along > 0.0) & (to @ to - along**2 < RADIUS**2)


def planes(own: Mask, others: Ids = NOBODY) -> np.ndarray:
    return outline_planes(own, others, INTRINSICS, X_WC[:3, :3], COUNT)


def test_the_planes_touch_what_is_seen() -> None:
    n = planes(sphere())
    assert len(n) == COUNT
    assert_allclose(np.linalg.norm(n, axis=1), 1.0)
    # The middle is a radius behind each, up to a pixel.
    assert_allclose(n @ (MIDDLE - EYE), -RADIUS, atol=1.0 / 300.0 * 0.6)


def test_a_hole_in_the_mask_changes_nothing() -> None:
    own = sphere()
    v, u = np.nonzero(own)
    holed, middle_v, middle_u = own.copy(), int(v.mean()), int(u.mean())
    holed[middle_v - 10 : middle_v + 10, middle_u - 5 : middle_u + 5] = False
    assert_allclose(planes(holed), planes(own))


def test_nothing_is_known_where_something_beside_it_reaches_as_far() -> None:
    own = sphere()
    _, u = np.nonzero(own)
    hiding = NOTHING.copy()
    hiding[90:150, u.max() - 8 : u.max() + 5] = True
    left = planes(own & ~hiding, np.where(hiding, 3, -1))
    assert 0 < len(left) < COUNT
    assert_allclose(left @ (MIDDLE - EYE), -RADIUS, atol=1.0 / 300.0 * 0.6)
    # What is not beside it hides nothing.
    apart = np.where(np.indices(own.shape)[1] > u.max() + 20, 3, -1)
    assert len(planes(own, apart)) == COUNT


def test_the_larger_part_may_be_taken_for_something_else() -> None:
    """As the bowl of a wineglass whose foot alone is known for what it is."""
    own = sphere()
    v, _ = np.nonzero(own)
    foot = own & (np.indices(own.shape)[0] > v.max() - 10)
    left = planes(foot, np.where(own & ~foot, 3, -1))
    assert 0 < len(left) < COUNT
    assert_allclose(left @ (MIDDLE - EYE), -RADIUS, atol=1.5 / 300.0 * 0.6)


def test_nothing_is_known_of_what_the_image_cuts_off() -> None:
    own = sphere()
    _, u = np.nonzero(own)
    cut = np.roll(own, INTRINSICS.width - int(u.min()) - 10, axis=1)
    cut[:, :100] = False
    assert planes(cut).shape == (0, 3)


def test_without_pixels_there_are_no_planes() -> None:
    assert planes(NOTHING).shape == (0, 3)
    assert planes(~NOTHING).shape == (0, 3)
