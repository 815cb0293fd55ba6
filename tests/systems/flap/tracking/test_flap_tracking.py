"""The flap's plane in rendered depth images with the camera's noise."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from synthetic_flap import Errors, Laboratory, ideal_depth, measured_depth, pose

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.consistency import chi_square_bounds
from crossmodal.systems.flap.tracking.flap_region import (
    InverseDepth,
    ahead,
    fit_local_planes,
    inverse_depth,
    normals,
)
from crossmodal.systems.flap.tracking.flap_tracking import FlapTrack, track_flap
from crossmodal.systems.flap.tracking.flap_tracking_config import (
    FlapTrackingConfig,
    check_flap_tracking,
)
from crossmodal.systems.flap.tracking.plane_fit import fit_plane, world_plane
from crossmodal.systems.flap.tracking.tool_segmentation import angle_between
from crossmodal.systems.port_values import UNKNOWN_FINGERTIP, unseen

EXACT = Errors(
    camera_rotation=0.0, camera_translation=0.0, depth_scale=0.0, focal_length=0.0,
    arm_rotation=0.0, arm_translation=0.0, taxels=0.0,
)  # fmt: skip
CONFIG = FlapTrackingConfig()


class Tracker:
    """Tracks the flap of a laboratory, after two images at rest."""

    def __init__(self, seed: int = 0, edge_on: float | None = None) -> None:
        self.lab = Laboratory(seed, EXACT, edge_on)
        self.rng = np.random.default_rng(seed)
        self.track = FlapTrack(plane=unseen("none yet"))
        for _ in range(2):
            self(0.0, touching=False)

    def __call__(
        self, degrees: float, touching: bool = True, hidden: Array | None = None
    ) -> FlapTrack:
        theta = np.deg2rad(degrees)
        depth = measured_depth(ideal_depth(self.lab.tool, theta, self.lab.X_WC_true), self.rng)
        contact = self.lab.contact(theta, 0.08) if touching else UNKNOWN_FINGERTIP
        p_WE = self.lab.tool.p_WK + np.array([0.0, 0.0, 0.1])
        self.track = track_flap(self.track, depth, hidden, p_WE, contact, self.lab.camera, CONFIG)
        return self.track

    def error(self, degrees: float) -> Array:
        """Of (n, d), (4,)."""
        n, d, _ = self.lab.tool.plane(np.deg2rad(degrees), self.lab.X_WC_true[:3, 3])
        plane = self.track.plane
        return np.append(plane.n_W - n, plane.d - d)


def test_the_choice_of_pixels_ahead_of_the_pad_does_not_tilt_what_is_fitted_to_them() -> None:
    rng, m = np.random.default_rng(5), np.array([0.3, 1.0, 1.1])  # Slanted, 0.9 m away.
    x, y = np.linspace(-0.05, 0.05, 60), np.linspace(-0.05, 0.05, 60)
    w = m[0] * x + (m[1] * y + m[2])[:, None]
    direction = np.array([0.0, 1.0, -1.0]) / np.sqrt(2.0)
    p_CQ = np.array([0.0, -0.01, 0.91])
    tilts = []
    for _ in range(200):
        noise = 0.004 * rng.normal(size=w.shape)  # Some 3 mm of depth.
        image = InverseDepth(w + noise, np.ones(w.shape, bool), x, y)
        fit = fit_plane(image, ahead(image, m, p_CQ, direction, 0.04), 10)
        assert fit is not None
        assert fit.size > 300
        tilts.append(fit.m_C - m)
    tilts = np.array(tilts)
    assert np.all(np.abs(tilts.mean(axis=0)) < 4.0 * tilts.std(axis=0) / np.sqrt(len(tilts)))


@pytest.mark.parametrize("degrees", [0.0, 5.0, 15.0, 45.0, 80.0, 120.0])
def test_the_flap_is_found_at_any_angle_to_the_bracket(degrees: float) -> None:
    tracker = Tracker()
    plane = tracker(degrees).plane
    assert plane.seen, plane.why
    limit = 0.06 if degrees < 10.0 else 0.025
    assert np.linalg.norm(tracker.error(degrees)[:3]) < limit
    p_FK = tracker.lab.tool.frame(np.deg2rad(degrees)).T @ (plane.p_WF - tracker.lab.tool.p_WK)
    assert 0.0 < p_FK[0] < tracker.lab.tool.length


def test_planes_are_as_wrong_as_they_say() -> None:
    total, count = 0.0, 0
    for seed in range(6):
        tracker = Tracker(seed)
        for degrees in (3.0, 30.0, 60.0, 90.0, 110.0):
            plane = tracker(degrees).plane
            assert plane.seen, plane.why
            e = tracker.error(degrees)
            total += float(e @ np.linalg.pinv(plane.covariance, rcond=1e-9) @ e)
            count += 1
    low, high = chi_square_bounds(3 * count, 0.99)
    assert low < total < high


def test_nothing_is_reported_of_a_flap_to_which_no_finger_points() -> None:
    tracker = Tracker()
    assert tracker.track.plane.why == "where the finger is is not known"
    assert tracker.track.rest_W is not None
    assert angle_between(tracker.track.rest_W, tracker.lab.tool.frame(0.0)[:, 1]) < 0.03


@pytest.mark.parametrize("hangs", [0.0, 4.0])
def test_a_flap_that_was_never_touched_is_what_lies_ahead_of_the_finger(hangs: float) -> None:
    """A loose one need not hang parallel to the bracket; the finger waits 3 cm before its edge."""
    tracker = Tracker()
    theta = np.deg2rad(hangs)
    X_WS = tracker.lab.contact(theta, 0.0).X_WS.copy()
    X_WS[:3, 3] -= 0.04 * X_WS[:3, 1]
    depth = measured_depth(ideal_depth(tracker.lab.tool, theta, tracker.lab.X_WC_true), tracker.rng)
    p_WE = tracker.lab.tool.p_WK + np.array([0.0, 0.0, 0.1])
    finger = replace(UNKNOWN_FINGERTIP, X_WS=X_WS)
    tracker.track = track_flap(tracker.track, depth, None, p_WE, finger, tracker.lab.camera, CONFIG)
    assert tracker.track.plane.seen, tracker.track.plane.why
    assert np.linalg.norm(tracker.error(hangs)[:3]) < 0.06


def untouched(
    tracker: Tracker,
    off: Array,
    hidden: Array | None = None,
    clearance: float = 0.03,
    added: Callable[[Array], None] = lambda depth: None,
) -> FlapTrack:
    """The track of a finger that waits before the edge, turned by `off` (3,) about it."""
    X_WS = tracker.lab.contact(0.0, 0.0).X_WS.copy()
    X_WS = X_WS @ pose(se3.so3_exp(off), np.zeros(3))
    X_WS[:3, 3] -= (0.01 + clearance) * X_WS[:3, 1]
    depth = measured_depth(ideal_depth(tracker.lab.tool, 0.0, tracker.lab.X_WC_true), tracker.rng)
    added(depth)
    p_WE = tracker.lab.tool.p_WK + np.array([0.0, 0.0, 0.1])
    finger = replace(UNKNOWN_FINGERTIP, X_WS=X_WS)
    return track_flap(tracker.track, depth, hidden, p_WE, finger, tracker.lab.camera, CONFIG)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("angle", np.deg2rad([-10.0, 0.0, 10.0]))
def test_the_free_edge_is_seen_however_the_finger_is_turned(axis: int, angle: float) -> None:
    tracker = Tracker(3)
    plane = untouched(tracker, angle * np.eye(3)[axis]).plane
    tool = tracker.lab.tool
    assert plane.edge_W @ tool.k_W > np.cos(np.deg2rad(2.0))
    p_FG = tool.frame(0.0).T @ (plane.p_WG - tool.p_WK)
    assert_allclose(p_FG[:2], [tool.length, tool.front], atol=0.004)
    assert abs(p_FG[2]) < 0.02


@pytest.mark.parametrize("clearance", [0.02, 0.03, 0.05])
def test_the_flap_is_what_lies_beyond_its_edge_however_far_the_finger_is(clearance: float) -> None:
    """What is farther from the edge than a short flap is long may be the bracket's."""
    tracker = Tracker(3)
    plane, tool = untouched(tracker, np.zeros(3), clearance=clearance).plane, tracker.lab.tool
    p_FF = tool.frame(0.0).T @ (plane.p_WF - tool.p_WK)
    assert p_FF[0] == pytest.approx(tool.length - 0.5 * CONFIG.region.flap_length, abs=0.004)


def test_where_the_robot_ends_the_flap_there_is_no_edge() -> None:
    """The finger's mask rises into the flap from the side: what it cuts off is no edge."""
    tracker = Tracker(3)
    tool, camera = tracker.lab.tool, tracker.lab.camera
    corners = [tool.p_WK + tool.frame(0.0) @ [t, 0.006, z] for t, z in ((0.08, 0.1), (0.08, -0.1))]
    u, v = camera.intrinsics.project(
        (np.array(corners) - camera.X_WC[:3, 3]) @ camera.X_WC[:3, :3]
    ).T
    hidden = np.zeros((480, 640), np.uint8)
    rows, columns = np.indices(hidden.shape)
    left, right, edge = u.min(), u.max(), v.mean()
    slope = (columns - left) / (right - left)
    hidden[(rows > edge + 10.0 - 60.0 * (slope - 0.4)) & (slope > 0.4)] = 255
    half = untouched(tracker, np.zeros(3), hidden).plane
    assert half.edge_W @ tool.k_W > np.cos(np.deg2rad(2.0))
    all_along = np.where(rows > edge - 5.0, np.uint8(255), np.uint8(0))
    plane = untouched(tracker, np.zeros(3), all_along).plane
    assert plane.seen
    assert np.isnan(plane.edge_W).all()


def test_what_a_mask_leaves_of_the_finger_before_the_edge_is_not_the_flap() -> None:
    """It is in the flap's plane, where the finger waits before a half of the edge."""
    tracker = Tracker(3)
    tool, camera = tracker.lab.tool, tracker.lab.camera
    n, d, _ = tool.plane(0.0, tracker.lab.X_WC_true[:3, 3])

    def left_of_finger(depth: Array) -> None:
        for along in np.linspace(0.02, 0.07, 40):
            for across in np.linspace(0.008, 0.016, 12):
                p_W = tool.p_WK + tool.frame(0.0) @ [tool.length + across, 0.0, along]
                p_W = p_W + n * (d - n @ p_W)
                p_C = camera.X_WC[:3, :3].T @ (p_W - camera.X_WC[:3, 3])
                column, row = np.rint(camera.intrinsics.project(p_C[None])[0]).astype(int)
                depth[row, column] = p_C[2]

    plane = untouched(tracker, np.zeros(3), added=left_of_finger).plane
    assert plane.edge_W @ tool.k_W > np.cos(np.deg2rad(2.0))


def test_one_surface_that_nobody_touches_is_not_the_flap() -> None:
    tracker = Tracker()
    tracker(0.0)
    plane = tracker(3.0, touching=False).plane
    assert not plane.seen
    assert plane.why == "one surface only"
    assert np.isnan(plane.n_W).all()


@pytest.mark.parametrize("degrees", [20.0, 110.0])
def test_a_flap_that_was_swung_away_from_the_finger_is_seen_where_it_is(degrees: float) -> None:
    tracker = Tracker()
    tracker(40.0)
    plane = tracker(degrees, touching=False).plane
    assert plane.seen, plane.why
    assert np.linalg.norm(tracker.error(degrees)[:3]) < 0.06


def test_a_flap_that_is_edge_on_is_not_seen_and_then_shows_its_back() -> None:
    tracker = Tracker(edge_on=np.deg2rad(62.0))
    assert tracker(30.0).plane.seen
    assert not tracker(62.0).plane.seen
    plane = tracker(100.0).plane
    assert plane.seen
    front = tracker.lab.tool.frame(np.deg2rad(100.0))[:, 1]
    assert plane.n_W @ front < -0.999


def test_what_the_robot_hides_is_left_out() -> None:
    tracker = Tracker()
    hidden = np.zeros((480, 640), np.uint8)
    assert tracker(45.0, hidden=hidden).plane.seen
    points = tracker.track.plane.points
    hidden[:, 320:] = 255
    assert 0.2 * points < tracker(45.0, hidden=hidden).plane.points < 0.8 * points
    hidden[:] = 255
    assert tracker(45.0, hidden=hidden).plane.why == "no flat surface"


def test_a_region_that_the_camera_does_not_see_is_said() -> None:
    tracker = Tracker()
    behind = tracker.lab.X_WC[:3, 3] + 0.5 * tracker.lab.X_WC[:3, 2] * -1.0
    track = replace(tracker.track, p_WC=behind)
    depth = np.ones((480, 640), np.float32)
    after = track_flap(track, depth, None, behind, UNKNOWN_FINGERTIP, tracker.lab.camera, CONFIG)
    assert after.plane.why == "the camera does not look there"
    nowhere = np.full(3, np.nan)
    after = track_flap(
        FlapTrack(plane=unseen("")), depth, None, nowhere, UNKNOWN_FINGERTIP,
        tracker.lab.camera, CONFIG,
    )  # fmt: skip
    assert after.plane.why == "where the tool is is not known"


def test_local_normals_of_an_exact_plane_are_exact() -> None:
    intrinsics = np.array([500.0, 500.0, 99.5, 79.5])
    n, d = np.array([0.3, -0.5, -0.81]), -0.9
    n /= np.linalg.norm(n)
    u, v = np.meshgrid(np.arange(200), np.arange(160))
    rays = np.dstack([(u - 99.5) / 500.0, (v - 79.5) / 500.0, np.ones(u.shape)])
    depth = d / (rays @ n)
    image = inverse_depth(depth, intrinsics, (10, 150, 20, 180), None)
    planes = fit_local_planes(image, 20, 4, 0.6)
    assert len(planes.m_C) > 500
    np.testing.assert_allclose(normals(planes.m_C), np.tile(n, (len(planes.m_C), 1)), atol=1e-6)
    fit = fit_plane(image, image.valid, 100)
    assert fit is not None
    n_W, d_W, _ = world_plane(fit, np.eye(3), np.eye(4))
    np.testing.assert_allclose(n_W, n, atol=1e-7)
    assert d_W == pytest.approx(d)


def test_impossible_configurations_are_refused() -> None:
    with pytest.raises(ValueError, match=r"stride = 3 .*even"):
        check_flap_tracking(FlapTrackingConfig(stride=3))
    with pytest.raises(ValueError, match=r"least_angle = 0"):
        check_flap_tracking(FlapTrackingConfig(least_angle=0.0))
