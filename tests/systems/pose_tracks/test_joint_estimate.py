"""Joints from whole tracks: right, as sure as they say, the same in whatever form poses come."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from crossmodal import joints
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.systems.pose_tracks.joint_estimate import JointEstimate, nearest_configuration

SLIDE = np.array([0.0, 0.0, 0.0, 0.6, 0.0, 0.8])
HINGE = np.array([0.0, 0.0, 1.0, 0.4, -0.1, 0.0])
SCREW = np.array([0.0, 0.0, 1.0, 0.4, 0.0, 0.02])
SIGMA = np.repeat([0.01, 0.003], 3)
START = se3.exp(np.array([0.2, -0.1, 0.3, 0.5, 0.1, 0.4]))
TIMES = np.arange(120) / 15.0


def _opened(largest: float, times: Array = TIMES) -> Array:
    """To and fro once."""
    return 0.5 * largest * (1.0 - np.cos(2.0 * np.pi * times / 8.0))


def _poses(S: Array, q: Array, seed: int, sigma: Array = SIGMA) -> Array:
    noise = np.random.default_rng(seed).standard_normal((len(q), 6)) * sigma
    return np.array([se3.exp(S * a) @ START @ se3.exp(e) for a, e in zip(q, noise, strict=True)])


def _quaternions(poses: Array) -> Array:
    return np.hstack([poses[:, :3, 3], Rotation.from_matrix(poses[:, :3, :3]).as_quat()])


@pytest.mark.parametrize(
    ("S", "joint", "largest"),
    [
        (SLIDE, joints.JointType.PRISMATIC, 0.3),
        (HINGE, joints.JointType.REVOLUTE, 1.2),
        (SCREW, joints.JointType.SCREW, 3.0),
    ],
)
def test_a_joint_is_found_with_the_noise_of_its_poses(
    S: Array, joint: joints.JointType, largest: float
) -> None:
    q = _opened(largest)
    found = joints.estimate(TIMES, _poses(S, q, seed=1))
    assert found.type == joint
    assert_allclose(found.track.deviations[0], SIGMA, rtol=0.25)
    assert_allclose(found.S_P, S, atol=0.02)
    assert_allclose(found.limits, (0.0, largest), atol=0.03)
    assert_allclose(found.pose(q[40]), _poses(S, q[40:41], 0, 0.0 * SIGMA)[0], atol=0.015)
    assert np.sqrt(np.mean(found.distance[:, 1] ** 2)) < 3.0 * SIGMA[3]


@pytest.mark.parametrize(
    ("S", "joint"), [(HINGE, joints.JointType.REVOLUTE), (SCREW, joints.JointType.SCREW)]
)
def test_positions_alone_show_a_joint_that_turns_more_than_once(
    S: Array, joint: joints.JointType
) -> None:
    times = np.arange(240) / 30.0
    found = joints.estimate(times, _poses(S, _opened(9.0, times), seed=1)[:, :3, 3])
    assert found.type == joint
    assert_allclose(found.S_P, S, atol=0.02)
    assert_allclose(found.limits, (0.0, 9.0), atol=0.1)
    if joint == joints.JointType.SCREW:
        assert abs(found.model.pitch - 0.02) < 3.0 * np.sqrt(found.model.pitch_variance)


@pytest.mark.parametrize("given", [SIGMA, None])
def test_configuration_and_axis_are_as_far_off_as_they_say(given: Array | None) -> None:
    q, off, axis = _opened(1.0), [], []
    for seed in range(12):
        found = joints.estimate(TIMES, _poses(HINGE, q, seed), given)
        off.append((found.q - q) / found.q_deviation)
        axis.append(np.linalg.norm(found.axis_P - HINGE[:3]) / found.axis_deviation)
    assert np.mean(np.abs(off) < 2.0) > 0.9
    assert 0.4 < np.mean(np.square(off)) < 1.5
    assert 0.3 < np.mean(np.square(axis)) < 2.0


def test_matrices_quaternions_and_positions_are_one_motion() -> None:
    poses = _poses(HINGE, _opened(1.2), seed=3)
    by_matrix = joints.estimate(TIMES, poses, SIGMA)
    by_quaternion = joints.estimate(TIMES, _quaternions(poses), SIGMA[[0, 3]])
    assert_allclose(by_quaternion.S_P, by_matrix.S_P, atol=1e-6)
    by_position = joints.estimate(TIMES, poses[:, :3, 3])
    assert by_position.type == joints.JointType.REVOLUTE
    assert abs(by_position.axis_P @ HINGE[:3]) > np.cos(np.deg2rad(2.0))
    assert np.isnan(by_position.distance[:, 0]).all()


@pytest.mark.parametrize("unit", [1e-3, 1e-6, 1e-9])
def test_stamps_since_1970_are_times_in_any_unit(unit: float) -> None:
    poses = _poses(HINGE, _opened(1.2), seed=3)
    by_seconds = joints.estimate(TIMES, poses)
    stamps = np.round((1_700_000_000.0 + TIMES) / unit).astype(np.int64)
    form = {1e-3: "ms", 1e-6: "us", 1e-9: "ns"}[unit]
    for times in (stamps, stamps.astype(f"datetime64[{form}]")):
        found = joints.estimate(times, poses)
        assert_allclose(np.diff(found.track.times), np.diff(TIMES), atol=2e-3)
        assert_allclose(found.S_P, by_seconds.S_P, atol=1e-3)


def test_one_pose_that_is_sent_again_and_again_before_the_body_is_found_counts_once() -> None:
    poses = _poses(HINGE, _opened(1.2), seed=3)
    poses[:8] = np.eye(4)
    found = joints.estimate(TIMES, poses)
    assert found.type == joints.JointType.REVOLUTE
    assert found.belief.skipped == {"measurement repeated": 7}


def test_a_body_on_a_parent_that_moves_as_well() -> None:
    """Both are measured in A, at other times; the parent wanders and turns."""
    late = TIMES[5:-5] + 0.02
    way = np.array([0.3, 0.1, 0.5, 0.4, -0.2, 0.1])
    X_AP = np.array([se3.exp(way * 0.1 * t) for t in TIMES])
    X_AB = np.array(
        [
            se3.exp(way * 0.1 * t) @ X
            for t, X in zip(late, _poses(SLIDE, _opened(0.3, late), seed=4), strict=True)
        ]
    )
    child, parent = joints.pose_track(late, X_AB), joints.pose_track(TIMES, X_AP)
    found = joints.estimate_track(joints.relative_track(parent, child))
    assert found.type == joints.JointType.PRISMATIC
    assert_allclose(found.axis_P, SLIDE[3:], atol=0.02)
    with pytest.raises(ValueError, match="less than two times in common"):
        joints.relative_track(joints.pose_track(TIMES + 100.0, X_AP), child)
    with pytest.raises(ValueError, match="has no rotations"):
        joints.relative_track(joints.pose_track(TIMES, X_AP[:, :3, 3]), child)


def test_repeats_know_more_than_one_and_no_more_than_they_agree() -> None:
    tracks = [
        joints.pose_track(TIMES, _poses(HINGE, _opened(1.0), seed), SIGMA) for seed in range(4)
    ]
    one, all_four = joints.estimate_track(tracks[0]), joints.estimate_repeats(tracks)
    assert all_four.type == joints.JointType.REVOLUTE
    assert len(all_four.q) == 4 * len(TIMES)
    assert 0.35 * one.axis_deviation < all_four.axis_deviation < 0.9 * one.axis_deviation
    error = np.linalg.norm(all_four.axis_P - HINGE[:3])
    assert error < 3.0 * all_four.axis_deviation
    tilted = np.array([se3.exp(np.array([0.1, 0, 0, 0, 0, 0])) @ X for X in tracks[1].X_AB])
    other = joints.pose_track(TIMES, tilted, SIGMA)
    apart = joints.estimate_repeats([tracks[0], other])
    assert apart.axis_deviation > 0.03
    with pytest.raises(ValueError, match="no track"):
        joints.estimate_repeats([])


def test_a_body_that_rests_and_one_that_nothing_holds() -> None:
    rests = joints.estimate(TIMES, _poses(HINGE, 0.0 * TIMES, seed=5))
    assert rests.type == joints.JointType.RIGID
    assert np.isnan(rests.q).all()
    assert np.nanmax(rests.distance[:, 1]) < 0.02
    steps = np.random.default_rng(6).standard_normal((len(TIMES), 6)) * 0.05
    free = [START]
    for step in steps[1:]:
        free.append(free[-1] @ se3.exp(step))
    assert joints.estimate(TIMES, np.array(free), SIGMA).type == joints.JointType.DISCONNECTED


def test_poses_that_are_missing_are_left_out() -> None:
    poses = _poses(HINGE, _opened(1.2), seed=7)
    poses[[0, 30, 31]] = np.nan
    found = joints.estimate(TIMES, poses)
    assert found.type == joints.JointType.REVOLUTE
    assert np.flatnonzero(np.isnan(found.q)).tolist() == [0, 30, 31]
    with pytest.raises(ValueError, match="less than two of 120 poses can be used; of 120: pose"):
        joints.estimate(TIMES, np.full((len(TIMES), 4, 4), np.nan))


@pytest.mark.parametrize(
    ("times", "poses", "deviations", "message"),
    [
        (TIMES, np.zeros((120, 5)), None, "need times"),
        (TIMES[:3], np.zeros((120, 3)), None, "need times"),
        (TIMES, np.zeros((120, 3)), np.ones(3), "deviations have shape"),
        (TIMES, np.zeros((120, 3)), np.array([0.0, 1.0]), "above zero"),
    ],
)
def test_arrays_of_other_shapes_are_refused(
    times: Array, poses: Array, deviations: Array | None, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        joints.estimate(times, poses, deviations)


def test_the_nearest_configuration_of_a_pose_on_the_path_is_its_own() -> None:
    for q in (-2.0, 0.3, 2.5):
        X = np.ascontiguousarray(se3.exp(SCREW * q) @ START)
        near = nearest_configuration(SCREW, START, X, np.diag(SIGMA**-2), q + 0.4)
        assert_allclose(near, q, atol=1e-8)


def test_its_sign_is_that_of_most_of_the_motion() -> None:
    found: JointEstimate = joints.estimate(TIMES, _poses(-HINGE, _opened(1.2), seed=8))
    assert np.median(found.q) > 0.0
    assert_allclose(found.model.axis_P, found.axis_P)
    assert_allclose(found.axis_P, -HINGE[:3], atol=0.02)
