"""What looks like a mistake of the input is told; a good track raises no doubt."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from crossmodal import joints
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.systems.kinematics.joint_filters_config import JointFiltersConfig
from crossmodal.systems.kinematics.measurement_errors import MeasurementErrorsConfig

N = 60
TIMES = np.arange(N) / 15
HINGE = np.array([0.0, 0.0, 1.0, 0.4, 0.0, 0.0])


def door() -> Array:
    """Positions and quaternions (N, 7) of a door, 2 mm and .3 deg wrong."""
    noise = np.repeat([0.005, 0.002], 3) * np.random.default_rng(0).standard_normal((N, 6))
    tilted = np.eye(4)
    tilted[:3, :3] = Rotation.from_rotvec([0.3, 0.2, 0.4]).as_matrix()
    X = np.array([se3.exp(0.02 * k * HINGE) @ tilted @ se3.exp(n) for k, n in enumerate(noise)])
    return np.hstack([X[:, :3, 3], Rotation.from_matrix(X[:, :3, :3]).as_quat()])


def in_millimetres(times: Array, poses: Array) -> tuple[Array, Array]:
    return times, poses * [1e3, 1e3, 1e3, 1, 1, 1, 1]


def with_w_first(times: Array, poses: Array) -> tuple[Array, Array]:
    return times, poses[:, [0, 1, 2, 6, 3, 4, 5]]


def shuffled(times: Array, poses: Array) -> tuple[Array, Array]:
    order = np.random.default_rng(1).permutation(N)
    return times[order], poses[order]


def with_some_late(times: Array, poses: Array) -> tuple[Array, Array]:
    order = np.arange(N)
    order[[20, 21, 22, 40, 41]] = [21, 22, 20, 41, 40]
    return times[order], poses[order]


def with_a_clock_set_back(times: Array, poses: Array) -> tuple[Array, Array]:
    return times - 1.5 * (times > 2.0), poses


def lost_at_first(times: Array, poses: Array) -> tuple[Array, Array]:
    elsewhere = np.array([2.0, 0, 0, 0, 0, 0, 0])
    return times, np.vstack([poses[:8] + elsewhere, poses[8:]])


@pytest.mark.parametrize(
    ("change", "type", "told"),
    [
        (lambda t, p: (t, p), "revolute", ""),
        (in_millimetres, "disconnected", "if these are millimetres, give --scale 0.001"),
        (with_w_first, "disconnected", "with w first, as qw, qx, qy, qz, the quaternions show a"),
        (shuffled, "revolute", "not in the order of their times, and were sorted"),
        (lambda t, p: (t[::-1], p[::-1]), "revolute", "were sorted"),
        (with_some_late, "revolute", "were sorted"),
        (with_a_clock_set_back, "revolute", "after pose 30 the times go back by 1.43 s"),
        (lost_at_first, "disconnected", "after pose 7 the body jumps by 1.99 m"),
        (lambda t, p: (1e3 * t, p), "revolute", "if the times are milliseconds"),
        (lambda t, p: (np.round(t), p), None, "poses have the time of the one before"),
        (lambda t, p: (t[:4], p[:4]), None, "4 poses tell little about a joint"),
    ],
)
def test_a_mistake_of_units_or_orders_is_told(
    change: Callable[[Array, Array], tuple[Array, Array]], type: str | None, told: str
) -> None:
    found = joints.estimate(*change(TIMES, door()))
    assert type in (None, found.type)
    notes = joints.doubts(found)
    assert told in " ".join(notes)
    assert bool(notes) == bool(told)


def test_all_poses_count_whose_clock_was_set_back_or_that_came_late() -> None:
    for change in (with_some_late, with_a_clock_set_back):
        found = joints.estimate(*change(TIMES, door()))
        assert not found.belief.skipped
        assert np.allclose(np.median(np.diff(found.track.times)), 1 / 15)


def test_rotations_that_are_taken_to_err_smoothly_are_told() -> None:
    """The door sags by 5 mm, by which positions show another axis than rotations."""
    times, q = np.arange(150) / 15, 1.1 * np.sin(0.5 * np.pi * np.arange(150) / 150) ** 2
    noise = np.repeat([0.005, 0.001], 3) * np.random.default_rng(0).standard_normal((150, 6))
    X = np.array([se3.exp(a * HINGE) @ se3.exp(n) for a, n in zip(q, noise, strict=True)])
    X[:, 2, 3] += 0.005 * np.sin(np.pi * q / 1.1)
    assert "rotations are taken to err smoothly" in " ".join(
        joints.doubts(joints.estimate(times, X))
    )
    trusted = JointFiltersConfig(errors=MeasurementErrorsConfig(wander=0.0))
    found = joints.estimate(times, X, config=trusted)
    assert "smoothly" not in " ".join(joints.doubts(found))
    assert np.linalg.norm(found.axis_P - HINGE[:3]) < 0.02


def test_a_deviation_in_degrees_is_told() -> None:
    found = joints.estimate(TIMES, door(), np.array([0.3, 0.002]))
    (note,) = joints.doubts(found)
    assert note.startswith("deviations of rotations were given as 0.3 rad")
    assert joints.doubts(joints.estimate(TIMES, door(), np.array([0.01, 0.002]))) == []


def test_tracks_that_are_no_repeats_are_told() -> None:
    slide = np.tile(door()[0], (N, 1))
    slide[:, 0] += 0.01 * np.arange(N)
    tracks = [joints.pose_track(TIMES, poses) for poses in (door(), slide)]
    assert "are they repeats of one motion?" in " ".join(
        joints.doubts(joints.estimate_repeats(tracks))
    )
    assert joints.doubts(joints.estimate_repeats([tracks[0], tracks[0]])) == []
