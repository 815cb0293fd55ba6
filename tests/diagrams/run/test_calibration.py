"""The truth of a simulation is drawn around what the robot believes, by standard deviations."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.math import RigidTransform, RollPitchYaw

from crossmodal.diagrams.run.calibration import (
    Calibration,
    CalibrationConfig,
    CalibrationErrors,
    Camera,
    calibrated,
    draw_base,
    draw_camera,
    pose_covariance,
    realistic_errors,
)
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.pinhole import Intrinsics
from crossmodal.maths.validation import check

SEEDS = 2000
CAMERA = Camera(
    intrinsics=Intrinsics(
        width=640, height=480, focal_x=577.0, focal_y=570.0, center_x=319.0, center_y=239.0
    ),
    base_frame="arm::tool_plate",
    X_PC=RigidTransform(RollPitchYaw(0.4, -1.1, 2.0), [0.3, -0.2, 1.4]),
    depth_scale=1.02,
    registration=np.array([0.5, -0.25]),
    latency=0.03,
)


def test_the_camera_of_a_port_is_the_only_one_or_begins_its_name() -> None:
    left, wrist = (calibrated(CAMERA, CalibrationErrors(focal_length=f)) for f in (0.1, 0.2))
    assert Calibration().camera_of("color_measured") is None
    assert Calibration(cameras={"left": left}).camera_of("color_measured") is left
    both = Calibration(cameras={"left": left, "left_wrist": wrist})
    assert both.camera_of("left_depth_measured") is left
    assert both.camera_of("left_wrist_depth_measured") is wrist
    assert both.camera_of("right_depth_measured") is None


def pose_error(X: RigidTransform, believed: RigidTransform) -> Array:
    """xi (6,) in X = believed exp(xi)."""
    return np.asarray(se3.log((believed.inverse() @ X).GetAsMatrix4()))


def drawn(errors: CalibrationErrors, of: Callable[[Camera], Array]) -> Array:
    return np.array([of(draw_camera("head", CAMERA, errors, seed)) for seed in range(SEEDS)])


def test_without_errors_the_truth_is_exactly_what_is_believed() -> None:
    for seed in range(5):
        camera = draw_camera("head", CAMERA, CalibrationErrors(), seed)
        assert camera.intrinsics == CAMERA.intrinsics
        assert camera.base_frame == CAMERA.base_frame
        assert camera.X_PC.IsExactlyEqualTo(CAMERA.X_PC)
        assert camera.depth_scale == CAMERA.depth_scale
        assert_array_equal(camera.registration, CAMERA.registration)
        assert camera.latency == CAMERA.latency
        assert draw_base("arm", CAMERA.X_PC, CalibrationErrors(), seed).IsExactlyEqualTo(
            CAMERA.X_PC
        )


def test_poses_spread_by_their_standard_deviations_about_each_axis() -> None:
    errors = CalibrationErrors(camera_rotation=0.02, camera_translation=0.003)
    xi = drawn(errors, lambda camera: pose_error(camera.X_PC, CAMERA.X_PC))
    assert_allclose(xi.std(axis=0), np.repeat([0.02, 0.003], 3), rtol=0.06)
    assert_allclose(xi.mean(axis=0) / xi.std(axis=0), 0.0, atol=0.08)
    assert_allclose(np.corrcoef(xi.T), np.eye(6), atol=0.08)
    errors = CalibrationErrors(arm_rotation=0.01, arm_translation=0.004)
    bases = [draw_base("arm", CAMERA.X_PC, errors, seed) for seed in range(SEEDS)]
    xi = np.array([pose_error(X, CAMERA.X_PC) for X in bases])
    assert_allclose(xi.std(axis=0), np.repeat([0.01, 0.004], 3), rtol=0.06)


def test_the_other_errors_spread_by_their_standard_deviations() -> None:
    errors = CalibrationErrors(focal_length=0.01, depth_scale=0.02, registration=1.5, latency=0.01)
    focal = drawn(
        errors,
        lambda camera: np.array(
            [camera.intrinsics.focal_x / 577.0, camera.intrinsics.focal_y / 570.0]
        ),
    )
    assert_allclose(focal[:, 0], focal[:, 1], rtol=1e-12)  # The pixels stay as square as they are.
    assert_allclose(focal[:, 0].std(), 0.01, rtol=0.06)
    scale = drawn(errors, lambda camera: np.array([camera.depth_scale / 1.02]))
    assert_allclose([scale.mean(), scale.std()], [1.0, 0.02], atol=0.0015)
    shift = drawn(errors, lambda camera: camera.registration)
    assert_allclose(shift.mean(axis=0), CAMERA.registration, atol=0.12)
    assert_allclose(shift.std(axis=0), 1.5, rtol=0.06)
    assert abs(np.corrcoef(shift.T)[0, 1]) < 0.08


def test_no_image_is_of_the_future() -> None:
    late = drawn(CalibrationErrors(latency=0.01), lambda camera: np.array([camera.latency]))
    late = late - CAMERA.latency
    assert late.min() >= 0.0
    assert_allclose(np.sqrt(np.mean(late**2)), 0.01, rtol=0.06)


def test_every_name_and_seed_has_numbers_of_its_own() -> None:
    errors = CalibrationErrors(camera_translation=0.01, arm_translation=0.01)

    def offsets(of: Callable[[int], RigidTransform]) -> Array:
        return np.array([pose_error(of(seed), CAMERA.X_PC)[3:] for seed in range(SEEDS)])

    left, right = (
        offsets(lambda seed, name=name: draw_camera(name, CAMERA, errors, seed).X_PC)
        for name in ("left", "right")
    )
    arm = offsets(lambda seed: draw_base("left", CAMERA.X_PC, errors, seed))
    for one, other in ((left, right), (left, arm), (left[:-1], left[1:])):
        for axis in range(3):
            assert abs(np.corrcoef(one[:, axis], other[:, axis])[0, 1]) < 0.08
    again = offsets(lambda seed: draw_camera("left", CAMERA, errors, seed).X_PC)
    assert_array_equal(left, again)


def test_one_kind_of_error_leaves_the_draws_of_the_others_alone() -> None:
    both = CalibrationErrors(camera_translation=0.01, depth_scale=0.02)
    alone = CalibrationErrors(depth_scale=0.02)
    for seed in range(5):
        scales = [draw_camera("head", CAMERA, one, seed).depth_scale for one in (both, alone)]
        assert scales[0] == scales[1]


def test_what_is_believed_carries_its_covariances() -> None:
    errors = realistic_errors()
    camera = calibrated(CAMERA, errors)
    for name, value in vars(CAMERA).items():
        assert getattr(camera, name) is value
    assert_allclose(
        np.sqrt(np.diag(camera.pose_covariance)),
        np.repeat([errors.camera_rotation, errors.camera_translation], 3),
    )
    assert_allclose(camera.pose_covariance, np.diag(np.diag(camera.pose_covariance)))
    assert camera.focal_length_std == errors.focal_length
    assert camera.depth_scale_std == errors.depth_scale
    assert camera.registration_std == errors.registration
    assert camera.latency_std == errors.latency
    assert_array_equal(pose_covariance(0.0, 0.0), np.zeros((6, 6)))


@pytest.mark.parametrize("name", vars(CalibrationErrors()))
@pytest.mark.parametrize("value", [-0.001, float("nan"), float("inf")])
def test_impossible_deviations_are_refused_by_name(name: str, value: float) -> None:
    errors = CalibrationErrors()
    setattr(errors, name, value)
    with pytest.raises(ValueError, match=rf"^calibration\.errors: {name} = .*need >= 0, <"):
        check(errors, "calibration.errors")


@pytest.mark.parametrize("name", ["focal_length", "depth_scale"])
def test_a_share_that_could_turn_a_camera_inside_out_is_refused(name: str) -> None:
    errors = CalibrationErrors()
    setattr(errors, name, 0.2)
    with pytest.raises(ValueError, match=rf"{name} = 0\.2, need >= 0, < 0\.2$"):
        check(errors, "calibration.errors")


def test_the_size_of_the_errors_is_drawn_around_what_it_is_taken_to_be() -> None:
    given = realistic_errors()
    exact = CalibrationConfig(errors=given).drawn_errors(seed=1)
    assert exact == given
    config = CalibrationConfig(errors=given, spread=0.5)
    shares = np.array(
        [
            [
                drawn / std
                for drawn, std in zip(vars(one).values(), vars(given).values(), strict=True)
            ]
            for one in (config.drawn_errors(seed) for seed in range(200))
        ]
    )
    assert 0.5 <= shares.min() < 0.52
    assert 1.48 < shares.max() <= 1.5
    assert_allclose(shares.mean(axis=0), 1.0, atol=0.1)


def test_realistic_errors_are_possible() -> None:
    check(realistic_errors(), "calibration.believed")


def test_a_camera_projects_points_of_the_frame_that_carries_it() -> None:
    ahead = CAMERA.X_PC @ np.array([[0.0], [0.0], [0.7]])
    assert_allclose(CAMERA.project(ahead.T), [[319.0, 239.0]], atol=1e-9)
    right = CAMERA.X_PC @ np.array([0.07, 0.0, 0.7])
    assert_allclose(CAMERA.project(right), [[319.0 + 57.7, 239.0]], atol=1e-9)
    behind = CAMERA.X_PC @ np.array([0.0, 0.0, -0.7])
    assert np.all(np.isnan(CAMERA.project(behind)))
