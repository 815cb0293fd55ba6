"""Predicted contacts, and what they are worth, against simulation."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from crossmodal.maths import se3
from crossmodal.systems.active.believed_box import believed_box
from crossmodal.systems.active.touch_planning import (
    CRITERIA,
    TouchConfig,
    TouchPredictions,
    candidate_rays,
    expected_squared_distance,
    predict_touches,
)
from crossmodal.systems.port_values import ObjectPose
from crossmodal.systems.pose.surface import cast_rays
from crossmodal.systems.pose.target_model import TargetModel, make_target

CONFIG = TouchConfig()


@pytest.fixture(scope="module")
def model() -> TargetModel:
    mesh = trimesh.creation.box(extents=[0.06, 0.1, 0.2])
    return make_target(mesh.vertices, mesh.faces)


def believed(model: TargetModel, sigma: np.ndarray, seed: int = 0) -> ObjectPose:
    """A Gaussian about an upright pose with standard deviations (6,)."""
    rng = np.random.default_rng(seed)
    X = np.eye(4)
    X[:3, 3] = [0.5, 0.0, 0.1]
    samples = np.tile(X, (64, 1, 1))
    for n, e in enumerate(sigma * rng.normal(size=(64, 6))):
        samples[n, :3, :3] = se3.so3_exp(e[:3])
        samples[n, :3, 3] += e[3:]
    return ObjectPose(
        X=X,
        covariance=np.diag(sigma**2),
        joint=np.diag(sigma**2),
        samples=samples,
        calibration=np.zeros((64, 0)),
        modes=X[None],
        probabilities=np.ones(1),
        middle=model.middle,
    )


SURE = np.repeat([1e-4, 1e-4], 3)
DOUBTFUL = np.repeat([0.15, 0.02], 3)


def predicted(
    model: TargetModel, sigma: np.ndarray, count: int = 200, up: bool = True
) -> TouchPredictions:
    belief, rng = believed(model, sigma), np.random.default_rng(1)
    height = 0.0 if up else -np.inf
    rays = candidate_rays(belief, model, CONFIG, count, rng, height=height)
    return predict_touches(belief, model, *rays, CONFIG, rng)


def test_candidates_come_from_all_sides_but_from_below(model: TargetModel) -> None:
    rays = predicted(model, SURE, 400)
    starts, directions = rays.starts, rays.directions
    for axis, sign in ((0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0), (2, -1.0)):
        assert np.any(directions[:, axis] * sign > 0.99)
    assert not np.any(directions[:, 2] > 0.5)
    assert starts[:, 2].min() > CONFIG.clearance
    assert_allclose(np.linalg.norm(directions, axis=1), 1.0)


def test_what_is_sure_to_be_met_head_on_is_feasible(model: TargetModel) -> None:
    rays = predicted(model, SURE)
    assert rays.feasible(CONFIG).mean() > 0.9
    assert_allclose(rays.distances[:, rays.feasible(CONFIG)], CONFIG.standoff, atol=2e-3)
    assert predicted(model, DOUBTFUL).feasible(CONFIG).mean() < 0.7


def test_rows_are_derivatives_of_the_distance(model: TargetModel) -> None:
    rays = predicted(model, np.repeat([0.05, 5e-3], 3), 20)
    k, step = 3, 1e-5
    X = rays.poses[k]
    met = np.isfinite(rays.distances[k])
    at = rays.starts + np.where(met, rays.distances[k], 0.0)[:, None] * rays.directions
    for axis in range(6):
        e = step * np.eye(6)[axis]
        Y = X.copy()
        Y[:3, :3] = X[:3, :3] @ se3.so3_exp(e[:3])
        Y[:3, 3] += e[3:]
        p, d = (rays.starts - Y[:3, 3]) @ Y[:3, :3], rays.directions @ Y[:3, :3]
        reach = np.full(len(p), 1.0)
        found, samples = cast_rays(
            np.ascontiguousarray(p), np.ascontiguousarray(d), reach, model.surface, False
        )
        n = model.surface.normals[samples]
        same = met & np.isfinite(found)
        on_surface = p + np.where(same, found, 0.0)[:, None] * d
        # By how far the point that was met lies outside of the moved surface.
        height = np.einsum("ri,ri->r", (at - Y[:3, 3]) @ Y[:3, :3] - on_surface, n)
        assert_allclose(height[same] / step, rays.rows[k, same, axis], atol=2e-3)


@pytest.mark.parametrize("name", ["log-det", "expected-adi"])
def test_what_nobody_doubts_teaches_nothing(model: TargetModel, name: str) -> None:
    """Only the position along x is unknown, so that only faces across x teach anything."""
    sigma = np.full(6, 1e-6)
    sigma[3] = 5e-3
    rays = predicted(model, sigma)
    gains = CRITERIA[name](rays, model, 1e-3, np.random.default_rng(0))
    along = np.abs(rays.directions[:, 0]) > 0.99
    assert np.median(gains[along]) > 1000.0 * np.median(gains[~along])


# Of two errors that all contacts share: 3 mm along x and y together, 20 mrad about W's z.
SHARED = np.array([[0.0, 0.0, 0.0, 3e-3, 3e-3, 0.0], [0.0, 0.0, 0.02, 0.0, 0.0, 0.0]]).T


def with_errors(model: TargetModel, sigma: np.ndarray) -> ObjectPose:
    """A belief in which the pose has to do with two errors of the calibration."""
    belief, rng = believed(model, sigma), np.random.default_rng(5)
    mixed = np.eye(8) + 0.2 * rng.normal(size=(8, 8))
    mixed[:, :6] *= sigma
    return replace(belief, joint=mixed.T @ mixed, calibration=np.zeros((64, 2)))


def after(C: np.ndarray, j: np.ndarray, noise: float) -> np.ndarray:
    """The covariance C once the scalar j e was measured."""
    return C - np.outer(C @ j, C @ j) / (noise**2 + j @ C @ j)


@pytest.mark.parametrize("name", ["log-det", "expected-adi"])
@pytest.mark.parametrize("shared", [False, True])
def test_the_gain_is_what_a_kalman_filter_gains(
    model: TargetModel, name: str, shared: bool
) -> None:
    """Of the whole covariance, of which that of the pose as the arm meets it counts."""
    sigma, noise = np.array([0.02, 0.01, 0.03, 4e-3, 2e-3, 3e-3]), 1e-3
    belief, rng = believed(model, sigma), np.random.default_rng(1)
    if shared:
        belief = with_errors(model, sigma).as_met(SHARED)
    belief = replace(belief, samples=np.tile(belief.X, (64, 1, 1)))
    starts, directions = candidate_rays(belief, model, CONFIG, 30, rng)
    rays = predict_touches(belief, model, starts, directions, CONFIG, rng)
    gains = CRITERIA[name](rays, model, noise, np.random.default_rng(0))
    points, normals = model.surface.points, model.surface.normals
    J = np.concatenate([-np.cross(points, normals), -normals], axis=1)
    expected = []
    before = belief.joint[:6, :6]
    for j in rays.rows[0]:
        then = after(before, j, noise)
        if name == "log-det":
            fall = 0.5 * (np.linalg.slogdet(before)[1] - np.linalg.slogdet(then)[1])
        else:
            fall = np.mean(np.einsum("ni,ij,nj->n", J, before - then, J))
        expected.append(fall)
    assert_allclose(gains, expected, rtol=1e-6)


@pytest.mark.parametrize("name", ["log-det", "expected-adi"])
def test_how_the_arm_meets_a_face_is_learnt_once(model: TargetModel, name: str) -> None:
    """A second touch of the same face teaches little, although its place in W stays unknown."""
    sigma = np.repeat([1e-3, 1e-2], 3)
    belief = believed(model, sigma)
    # Contacts are off by 5 mm along each axis.
    displaced = np.vstack([np.zeros((3, 3)), 5e-3 * np.eye(3)])
    belief = replace(
        belief, joint=np.diag(np.append(sigma**2, np.ones(3))), calibration=np.zeros((64, 3))
    )
    rng = np.random.default_rng(0)
    along = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    starts = np.array([0.5, 0.0, 0.1]) - 0.15 * along

    def gains(belief: ObjectPose) -> tuple[np.ndarray, np.ndarray]:
        rays = predict_touches(belief.as_met(displaced), model, starts, along, CONFIG, rng)
        return CRITERIA[name](rays, model, 1e-4, rng), rays.rows[0, 0]

    first, row = gains(belief)
    measured = row @ belief.change_as_met(displaced)
    told = replace(belief, joint=after(belief.joint, measured, 1e-4))
    # What is left of the first coordinate: 5 mm against 10 mm, in parallel.
    assert np.sqrt(told.joint[3, 3]) == pytest.approx(1e-2 / np.sqrt(5.0), rel=0.02)
    second, _ = gains(told)
    # It is a measurement of the same again, which halves a variance far below what it was.
    assert second[0] < 0.1 * first[0]
    assert second[1] > 0.9 * first[1]  # Another face still tells as much.


def test_the_believed_box_holds_the_object_at_all_poses(model: TargetModel) -> None:
    belief = believed(model, np.repeat([0.2, 0.02], 3))
    turned = se3.exp(np.array([0.3, -0.2, 0.8, 0.1, 0.0, 0.2]))
    belief = replace(
        belief, X=turned @ belief.X, samples=np.einsum("ij,njk->nik", turned, belief.samples)
    )
    low, high = believed_box(belief, model.hull)
    everything = []
    for X in [belief.X, *belief.samples]:
        p_W = model.hull @ X[:3, :3].T + X[:3, 3]
        everything.append((p_W - belief.X[:3, 3]) @ belief.X[:3, :3])
    corners = np.concatenate(everything)
    assert_allclose(corners.min(axis=0), low, atol=1e-12)  # And it is no larger.
    assert_allclose(corners.max(axis=0), high, atol=1e-12)


def test_the_box_of_a_sure_pose_is_the_object_s(model: TargetModel) -> None:
    low, high = believed_box(believed(model, SURE), model.hull)
    assert_allclose(high - low, [0.06, 0.1, 0.2], atol=2e-3)


@pytest.mark.parametrize(("finger", "earlier"), [(0.0, 0.0), (0.02, 0.01)])
def test_a_finger_meets_a_corner_before_its_middle_does(
    model: TargetModel, finger: float, earlier: float
) -> None:
    """It comes along the diagonal of the box's section, 15 mm beside the corner.

    Its faces are at 45 deg, so that its middle meets one 15 mm farther than the corner is; points
    of its rim 5 mm beside the corner meet faces 5 mm farther.
    """
    belief = believed(model, np.full(6, 1e-9))
    d, across = np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0), np.array([1.0, -1.0, 0.0]) / np.sqrt(2.0)
    corner = np.array([0.47, -0.05, 0.1])
    start = corner - 0.1 * d + 0.015 * across
    config = TouchConfig(finger=finger)
    rng = np.random.default_rng(0)
    rays = predict_touches(belief, model, start[None], d[None], config, rng)
    assert_allclose(rays.distances, 0.115 - earlier, atol=3e-3)
    assert_allclose(rays.incidence, np.sqrt(0.5), atol=0.05)


def test_a_finger_touches_what_its_middle_passes_by(model: TargetModel) -> None:
    belief, rng = believed(model, np.full(6, 1e-9)), np.random.default_rng(0)
    start, down = np.array([[0.5, 0.06, 0.3]]), np.array([[0.0, 0.0, -1.0]])
    for finger, share in ((0.0, 0.0), (0.02, 1.0)):
        config = TouchConfig(finger=finger)
        rays = predict_touches(belief, model, start, down, config, rng)
        assert_allclose(rays.hit, share)
        assert_allclose(rays.distances[np.isfinite(rays.distances)], 0.1, atol=4e-3)


def test_tilted_approaches_come_from_above_and_aim_at_the_same_points(model: TargetModel) -> None:
    belief = believed(model, DOUBTFUL)
    level, tilted = (
        candidate_rays(belief, model, config, 300, np.random.default_rng(2))
        for config in (CONFIG, TouchConfig(tilt=45.0))
    )
    aims = [starts + CONFIG.standoff * directions for starts, directions in (level, tilted)]
    assert_allclose(aims[0], aims[1], atol=1e-12)
    assert_allclose(np.linalg.norm(tilted[1], axis=1), 1.0)
    sideways = np.abs(level[1][:, 2]) < 0.9
    angles = np.rad2deg(np.arcsin(-tilted[1][sideways, 2]))
    assert angles.min() >= 0.0
    assert 40.0 < angles.max() <= 45.0 + 1e-6
    cosines = np.einsum("ri,ri->r", level[1], tilted[1])[sideways]
    assert_allclose(np.rad2deg(np.arccos(cosines)), angles, atol=1e-6)
    assert_allclose(tilted[1][~sideways], level[1][~sideways])


def test_the_squared_distance_is_that_of_small_displacements(model: TargetModel) -> None:
    """Of many poses at once, and the same as the mean over displaced surfaces."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec([0.3, -0.8, 1.1]).as_matrix()
    C = np.diag(np.array([0.02, 0.01, 0.03, 4e-3, 2e-3, 3e-3]) ** 2)
    found = expected_squared_distance(np.array([C, 4.0 * C]), np.array([pose, pose]), model)
    assert found.shape == (2,)
    assert found[1] == pytest.approx(4.0 * found[0])
    e = np.random.default_rng(0).multivariate_normal(np.zeros(6), C, 400)
    points, normals = model.surface.points, model.surface.normals
    moves = np.cross(e[:, None, :3], points) + (e[:, 3:] @ pose[:3, :3])[:, None]
    squared = np.mean(np.sum(moves * normals, axis=2) ** 2)
    assert found[0] == pytest.approx(squared, rel=0.15)
