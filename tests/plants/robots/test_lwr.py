import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant

from crossmodal.maths.arrays import Array
from crossmodal.plants.robots.arm_with_hand import make_arm_with_load
from crossmodal.plants.robots.lwr import LWR_WITH_FINGERTIP

D = (0.3105, 0.0, 0.4, 0.0, 0.39, 0.0, 0.078)
ALPHA = np.deg2rad([90, -90, -90, 90, 90, -90, 0])


@pytest.fixture(scope="module")
def arm() -> MultibodyPlant:
    return make_arm_with_load(LWR_WITH_FINGERTIP, RigidTransform())


def flange(q: Array) -> RigidTransform:
    """X_WFlange by the Denavit-Hartenberg parameters."""
    X = RigidTransform()
    for angle, d, alpha in zip(q, D, ALPHA, strict=True):
        X = X @ RigidTransform(RotationMatrix.MakeZRotation(angle), np.zeros(3))
        X = X @ RigidTransform(RotationMatrix.MakeXRotation(alpha), np.array([0.0, 0.0, d]))
    return X


@pytest.mark.parametrize("seed", range(5))
def test_the_flange_is_where_the_denavit_hartenberg_parameters_put_it(
    arm: MultibodyPlant, seed: int
) -> None:
    q = np.random.default_rng(seed).uniform(-2.0, 2.0, 7)
    context = arm.CreateDefaultContext()
    arm.SetPositions(context, q)
    found = arm.GetFrameByName("tool_plate").CalcPoseInWorld(context)
    assert_allclose(found.GetAsMatrix4(), flange(q).GetAsMatrix4(), atol=1e-9)


def test_the_joints_turn_by_170_and_120_degrees(arm: MultibodyPlant) -> None:
    upper = np.rad2deg(arm.GetPositionUpperLimits())
    assert_allclose(upper, [170, 120, 170, 120, 170, 120, 170], atol=0.01)
    assert_allclose(arm.GetPositionLowerLimits(), -np.deg2rad(upper), atol=1e-9)


def test_the_finger_points_along_the_flange_s_axis(arm: MultibodyPlant) -> None:
    context = arm.CreateDefaultContext()
    X_FlangeS = arm.GetFrameByName("end_effector").CalcPose(
        context, arm.GetFrameByName("tool_plate")
    )
    assert_allclose(X_FlangeS.rotation().col(2), [0, 0, 1], atol=1e-9)
    assert_allclose(X_FlangeS.translation(), [0, 0, 0.155], atol=1e-9)
