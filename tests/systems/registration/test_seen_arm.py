"""One look at an arm of boxes: what it tells of places that are looked at from elsewhere."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import InputPortIndex, OutputPortIndex
from pydrake.systems.sensors import ImageDepth32F
from scipy.stats import chi2

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.systems.depth_camera import DepthCamera
from crossmodal.systems.port_values import ArmOffset, StampedImage
from crossmodal.systems.registration.arm_registration import ArmRegistrationConfig
from crossmodal.systems.registration.registration_solver import CalibratedArm
from crossmodal.systems.registration.robot_view import ArmChain, RobotView
from crossmodal.systems.registration.seen_arm import ARM, LookedAt, SeenArm
from tests.documented_ports import documented_ports
from tests.systems.registration.arm_of_boxes import (
    BASES,
    HEIGHT,
    INTRINSICS,
    RENDERED,
    WIDTH,
    X_WC,
    Q,
    build,
)

SIDE = "left"
PLACE = np.array([-0.3, 0.1, -0.2])
# It looks at the place from another side than at the arm.
LATER = se3.looking_at(PLACE + np.array([-0.2, 0.1, 0.6]), PLACE)
CAMERA_SPREAD = np.diag(np.repeat([np.deg2rad(0.3), 0.003], 3) ** 2)
BASE_SPREAD = np.diag(np.repeat([np.deg2rad(0.3), 0.003], 3) ** 2)
JOINTS = 1e-4


def view_from(X: Array, moved: RigidTransform | None = None, reduction: int = 2) -> RobotView:
    chain = ArmChain(f"{SIDE}_arm", ["first", "second"], f"{SIDE}_hand", "tip")
    own = {} if moved is None else {SIDE: moved}
    return RobotView(build(own), RENDERED, RigidTransform(X), {ARM: chain}, reduction)


@pytest.fixture
def seen_arm() -> SeenArm:
    return SeenArm(
        3,
        LookedAt(p_W=PLACE, X_WC=LATER),
        DepthCamera(
            intrinsics=INTRINSICS,
            X_WC=np.eye(4),
            pose_covariance=CAMERA_SPREAD,
            depth_scale_std=0.005,
            focal_length_std=1e-6,
        ),
        CalibratedArm(
            X_WBase=RigidTransform(BASES[SIDE]).GetAsMatrix4(),
            base_covariance=BASE_SPREAD,
            joint_offset_std=np.full(2, 1e-6),
        ),
        JOINTS,
        view_from,
        ArmRegistrationConfig(correlation=1, bend=2e-3),
        0.1,
    )


def look(system: SeenArm, depth: Array, looked: int = 3) -> ArmOffset:
    context = system.CreateDefaultContext()
    image = ImageDepth32F(WIDTH, HEIGHT)
    image.mutable_data[:, :, 0] = depth
    stamped = StampedImage(time=0.0, image=image, X_WC=X_WC.GetAsMatrix4())
    system.GetInputPort("depth_measured").FixValue(context, AbstractValue.Make(stamped))
    system.GetInputPort("joint_state_measured").FixValue(context, [*Q[SIDE], 0.0, 0.0])
    system.GetInputPort("looked").FixValue(context, [float(looked)])
    system.ExecuteForcedEvents(context)
    found: ArmOffset = system.GetOutputPort("arm_offset").Eval(context)
    return found


def seen_depth(arm: RigidTransform, mounting: Array, scale: float) -> Array:
    depth = view_from(X_WC.GetAsMatrix4() @ mounting, arm, 1).Render({ARM: Q[SIDE]}).depth
    return np.where(np.isfinite(depth), scale * depth, 0.0)


def true_offset(arm: RigidTransform, mounting: Array, scale: float) -> Array:
    """What is seen at p is truly at X p; the arm, displaced in W, believes to meet it elsewhere."""
    X_WBase = RigidTransform(BASES[SIDE])
    displaced = (X_WBase @ arm @ X_WBase.inverse()).GetAsMatrix4()
    p_C = np.linalg.inv(LATER) @ np.append(PLACE, 1.0)
    p_C[:3] /= scale
    met = np.linalg.inv(displaced) @ LATER @ mounting @ p_C
    return np.asarray(met[:3] - PLACE)


def test_errors_by_lot_are_found_within_what_is_claimed(seen_arm: SeenArm) -> None:
    rng, misses, distances = np.random.default_rng(1), [], []
    before = seen_arm.GetOutputPort("arm_offset").Eval(seen_arm.CreateDefaultContext())
    for _ in range(20):
        arm, mounting = (
            se3.exp(np.sqrt(np.diag(spread)) * rng.standard_normal(6))
            for spread in (BASE_SPREAD, CAMERA_SPREAD)
        )
        scale = 1.0 + 0.005 * rng.standard_normal()
        depth = seen_depth(RigidTransform(arm), mounting, scale)
        noisy = np.where(depth > 0.0, depth + 1e-3 * rng.standard_normal(depth.shape), 0.0)
        found = look(seen_arm, noisy)
        assert found.view == 3
        error = true_offset(RigidTransform(arm), mounting, scale) - found.mean
        misses.append(error)
        distances.append(error @ np.linalg.solve(found.covariance, error))
    assert chi2.ppf(0.001, 60) < np.sum(distances) < chi2.ppf(0.999, 60)
    assert np.square(misses).sum(axis=1).mean() < 0.4 * np.trace(before.covariance)


def test_before_the_look_it_is_what_the_calibrations_make_of_it(seen_arm: SeenArm) -> None:
    rng = np.random.default_rng(2)
    offsets = [
        true_offset(
            RigidTransform(se3.exp(np.sqrt(np.diag(BASE_SPREAD)) * rng.standard_normal(6))),
            se3.exp(np.sqrt(np.diag(CAMERA_SPREAD)) * rng.standard_normal(6)),
            1.0 + 0.005 * rng.standard_normal(),
        )
        for _ in range(2000)
    ]
    before = look(seen_arm, np.zeros((HEIGHT, WIDTH)), looked=2)
    assert before.view == 0
    assert_allclose(before.mean, 0.0)
    assert_allclose(before.covariance, np.cov(np.transpose(offsets)), rtol=0.15, atol=2e-6)


def test_where_the_arm_is_not_seen_nothing_is_learned(seen_arm: SeenArm) -> None:
    before = seen_arm.GetOutputPort("arm_offset").Eval(seen_arm.CreateDefaultContext())
    found = look(seen_arm, np.full((HEIGHT, WIDTH), 3.0))
    assert found.view == 3
    assert_allclose(found.mean, 0.0)
    assert_allclose(found.covariance, before.covariance)


def test_documented_ports_are_the_declared_ones(seen_arm: SeenArm) -> None:
    inputs = [
        seen_arm.get_input_port(InputPortIndex(k)).get_name()
        for k in range(seen_arm.num_input_ports())
    ]
    outputs = [seen_arm.get_output_port(OutputPortIndex(0)).get_name()]
    assert documented_ports(SeenArm.__doc__, "input") == inputs
    assert documented_ports(SeenArm.__doc__, "output") == outputs


def test_impossible_configurations_are_refused(seen_arm: SeenArm) -> None:
    with pytest.raises(ValueError, match="interval = -1"):
        SeenArm(
            1,
            LookedAt(p_W=PLACE, X_WC=LATER),
            DepthCamera(intrinsics=INTRINSICS, X_WC=np.eye(4), pose_covariance=CAMERA_SPREAD),
            CalibratedArm(
                X_WBase=np.eye(4), base_covariance=BASE_SPREAD, joint_offset_std=np.zeros(2)
            ),
            JOINTS,
            view_from,
            ArmRegistrationConfig(interval=-1.0),
            0.1,
        )
