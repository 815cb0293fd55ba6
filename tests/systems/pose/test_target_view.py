"""What an image shows of a box on a table: its points and no others, and what is beside it."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from seen_box import (
    INTRINSICS,
    MIDDLE,
    RADIUS,
    X_WC,
    depth_image,
    off_the_box,
    pixel_rays,
    to_box,
)

from crossmodal.maths.arrays import Array, Mask
from crossmodal.systems.pose.target_view import TargetView, TargetViewConfig, view_target

ALL = TargetViewConfig(apart=1)
NOTHING_MASKED = np.zeros((INTRINSICS.height, INTRINSICS.width), bool)


def viewed(
    depth: Array,
    masked: Mask = NOTHING_MASKED,
    X: Array = X_WC,
    height: float | None = 0.0,
    config: TargetViewConfig = ALL,
    reach: float = RADIUS + 0.02,
) -> TargetView:
    own = np.ones_like(masked)
    return view_target(depth, masked, own, INTRINSICS, X, MIDDLE, reach, height, config)


def pixels(seen: TargetView) -> tuple[Array, Array]:
    """Rows and columns (N,) of the pixels of the points."""
    p_C = (seen.p_WP - X_WC[:3, 3]) @ X_WC[:3, :3]
    u, v = np.rint(INTRINSICS.project(p_C)).astype(int).T
    return v, u


def steps_around(depth: Array) -> Array:
    """Largest difference of depth (H, W) within three by three pixels."""
    padded = np.pad(depth, 1, mode="edge")
    around = [
        padded[i : i + depth.shape[0], j : j + depth.shape[1]] for i in range(3) for j in range(3)
    ]
    return np.asarray(np.max(around, axis=0) - np.min(around, axis=0))


def test_all_of_the_box_is_seen_but_its_edges_and_its_foot() -> None:
    depth, of_box = depth_image()
    seen = viewed(depth)
    assert off_the_box(seen.p_WP).max() < 1e-5
    assert seen.p_WP[:, 2].min() > ALL.margin
    v, u = pixels(seen)
    assert_allclose(seen.depth, depth[v, u], rtol=1e-6)
    steps = steps_around(depth)
    assert steps[v, u].max() < ALL.edge
    p_W = X_WC[:3, 3] + (depth[..., None] * pixel_rays()) @ X_WC[:3, :3].T
    wanted = of_box & (steps < ALL.edge - 1e-6) & (p_W[..., 2] > ALL.margin + 1e-3)
    assert wanted.sum() > 500
    assert not (wanted & ~marked(v, u)).any()


def marked(v: Array, u: Array) -> Mask:
    image = np.zeros((INTRINSICS.height, INTRINSICS.width), bool)
    image[v, u] = True
    return image


@pytest.mark.parametrize("error", [-8e-3, -5e-3, 5e-3, 8e-3])
def test_the_table_is_none_of_it_though_the_camera_is_elsewhere(error: float) -> None:
    """Believed too high, the table would rise above the margin; too low, the box would sink."""
    depth, _ = depth_image()
    believed = X_WC.copy()
    believed[2, 3] += error
    seen = viewed(depth, X=believed)
    true = seen.p_WP - [0.0, 0.0, error]
    assert off_the_box(true).max() < 1e-5
    assert true[:, 2].min() == pytest.approx(ALL.margin, abs=3e-3)
    assert len(true) == pytest.approx(len(viewed(depth).p_WP), rel=0.01)


def test_nor_is_it_though_the_camera_is_turned() -> None:
    depth, _ = depth_image()
    believed = X_WC.copy()
    tilt = 0.01
    turn = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(tilt), -np.sin(tilt)]])
    turn = np.vstack([turn, [0.0, np.sin(tilt), np.cos(tilt)]])
    believed[:3, :3] = turn @ X_WC[:3, :3]
    believed[:3, 3] = MIDDLE + turn @ (X_WC[:3, 3] - MIDDLE)
    seen = viewed(depth, X=believed)
    true = (seen.p_WP - MIDDLE) @ turn + MIDDLE
    assert off_the_box(true).max() < 1e-5
    assert len(true) == pytest.approx(len(viewed(depth).p_WP), rel=0.02)


def test_what_is_held_up_is_all_that_is_near() -> None:
    depth, _ = depth_image()
    seen = viewed(depth, height=None)
    off = off_the_box(seen.p_WP) > 1e-4
    assert_allclose(seen.p_WP[off][:, 2], 0.0, atol=1e-5)  # Of the table, too.
    assert off.sum() > 100
    assert np.linalg.norm(seen.p_WP - MIDDLE, axis=1).max() < RADIUS + 0.02


def test_nothing_of_a_robot_counts() -> None:
    depth, _ = depth_image()
    masked = NOTHING_MASKED.copy()
    masked[:, :80] = True
    all_of_it, seen = viewed(depth), viewed(depth, masked)
    assert 0 < len(seen.p_WP) < len(all_of_it.p_WP)
    assert pixels(seen)[1].min() >= 80
    in_C = seen.passed @ X_WC[:3, :3]
    assert np.all(INTRINSICS.project(in_C)[:, 0] > 79.0)
    assert len(seen.passed) < 0.7 * len(all_of_it.passed)


@pytest.mark.parametrize("value", [0.0, np.nan, np.inf])
def test_an_image_of_nothing_shows_nothing(value: float) -> None:
    seen = viewed(np.full((INTRINSICS.height, INTRINSICS.width), value))
    assert seen.p_WP.shape == (0, 3)
    assert seen.depth.shape == (0,)
    assert seen.passed.shape == (0, 3)


def test_rays_that_passed_miss_the_object_but_not_where_it_might_be() -> None:
    depth, of_box = depth_image()
    seen = viewed(depth)
    assert_allclose(np.linalg.norm(seen.passed, axis=1), 1.0)
    met = to_box(X_WC[:3, 3], seen.passed)
    hit = np.isfinite(met)  # The foot, which cannot be told from the table.
    assert np.all(X_WC[2, 3] + met[hit] * seen.passed[hit, 2] < ALL.margin)
    to_middle = MIDDLE - X_WC[:3, 3]
    off = np.linalg.norm(np.cross(seen.passed, to_middle), axis=1)
    assert off.max() < RADIUS + 0.02
    # Nearly all pixels beside the box whose rays meet the sphere are among them.
    directions = (pixel_rays() @ X_WC[:3, :3].T).reshape(-1, 3)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    inside = np.linalg.norm(np.cross(directions, to_middle), axis=1) < RADIUS + 0.02
    could = int((inside & ~of_box.ravel() & (depth.ravel() > 0.0)).sum())
    assert 0.7 * could < len(seen.passed) <= could


def test_along_free_lines_there_is_neither_object_nor_table() -> None:
    depth, _ = depth_image()
    seen = viewed(depth)
    assert seen.free.shape == (ALL.lines, 2, 3)
    eye = X_WC[:3, 3]
    ends = np.linalg.norm(seen.free[:, 1] - eye, axis=1)
    d = (seen.free[:, 1] - eye) / ends[:, None]
    # Their ends are before what is behind: the table, or the foot that looks like it.
    assert np.all(to_box(eye, d) > ends)
    assert np.all(seen.free[:, 1, 2] > 0.0)
    # They pass close by.
    to_points = seen.p_WP - X_WC[:3, 3]
    angles = np.arccos(
        np.clip(d @ (to_points / np.linalg.norm(to_points, axis=1)[:, None]).T, -1, 1)
    )
    assert angles.min(axis=1).max() < np.deg2rad(2.0)
    assert viewed(depth, config=TargetViewConfig(lines=0)).free.shape == (0, 2, 3)


def test_points_are_as_far_apart_as_their_errors_are_independent() -> None:
    depth, _ = depth_image()
    v, u = pixels(viewed(depth, config=TargetViewConfig(apart=7)))
    assert len(v) > 20
    apart = np.maximum(np.abs(v[:, None] - v), np.abs(u[:, None] - u))
    assert apart[~np.eye(len(v), dtype=bool)].min() == 7


def test_rays_that_end_before_the_object_did_not_pass_it() -> None:
    """Something that nobody knows of hides half of the image."""
    depth, _ = depth_image()
    hidden = depth.copy()
    hidden[:, :80] = 0.15
    seen = viewed(hidden)
    assert np.all(INTRINSICS.project(seen.passed @ X_WC[:3, :3])[:, 0] > 79.0)
    assert pixels(seen)[1].min() >= 80
