"""What the robot believes of its camera and its arm comes from the scenario alone."""

import numpy as np
from numpy.testing import assert_allclose

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.crossmodal.episode_parts import make_calibration
from crossmodal.diagrams.crossmodal.station.start_warnings import unclaimed_errors
from crossmodal.diagrams.run.calibration import Calibration


def calibration(*overrides: str) -> Calibration:
    return make_calibration(load_scenario("drawer", overrides)[1])


def test_the_camera_is_the_scenarios_and_the_arm_has_seven_joints() -> None:
    believed = calibration()
    assert believed.arm.model.num_positions() == 7
    assert believed.arm.joint_offset_std.shape == (7,)
    assert_allclose(believed.camera.intrinsics.focal_x, 320 / np.tan(np.deg2rad(29)))
    assert_allclose(believed.camera.X_PC.translation(), [-0.05, 0.4, 1.42])
    assert believed.camera.base_frame == "world"


def test_the_arms_base_stands_where_its_model_has_it() -> None:
    arm = calibration().arm
    base = arm.model.GetFrameByName("base").CalcPoseInWorld(arm.model.CreateDefaultContext())
    assert_allclose(base.GetAsMatrix4(), arm.X_WBase.GetAsMatrix4(), atol=1e-12)


def test_neither_the_seed_nor_the_true_errors_change_what_is_believed() -> None:
    one, other = calibration(), calibration("seed=5", "calibration.errors.camera_rotation=0.1")
    assert one.camera.X_PC.IsExactlyEqualTo(other.camera.X_PC)
    assert one.camera.intrinsics == other.camera.intrinsics
    assert one.arm.X_WBase.IsExactlyEqualTo(other.arm.X_WBase)


def test_how_well_it_is_known_is_what_the_scenario_says_that_is_believed() -> None:
    believed = calibration(
        "calibration.believed.camera_translation=0.02", "calibration.believed.arm_rotation=0.03"
    )
    assert_allclose(np.diag(believed.camera.pose_covariance)[3:], 0.02**2)
    assert_allclose(np.diag(believed.arm.covariance)[:3], 0.03**2)


def test_errors_that_the_robot_does_not_know_of_are_named() -> None:
    wrong = "calibration.errors.camera_rotation=0.01"
    _, scenario = load_scenario("drawer", [wrong, "calibration.errors.latency=0.01"])
    (line,) = unclaimed_errors(scenario)
    assert "camera_rotation, latency;" in line
    known = ["calibration.believed.camera_rotation=0.02"]
    assert unclaimed_errors(load_scenario("drawer", [wrong, *known])[1]) == []
    for name in ("drawer", "drawer-miscalibrated", "cupboard-door-miscalibrated"):
        assert unclaimed_errors(load_scenario(name)[1]) == []
