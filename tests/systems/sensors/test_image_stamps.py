"""Images get the instant of their tick and the camera's pose, and stay as they were."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame, RevoluteJoint, SpatialInertia
from pydrake.systems.framework import Context
from pydrake.systems.sensors import ImageDepth32F, ImageRgba8U

from crossmodal.maths import se3
from crossmodal.systems.arm_pose import ArmPose
from crossmodal.systems.port_values import StampedImage
from crossmodal.systems.sensors.image_stamps import ImageStamps, Mounting, carried_pose
from tests.documented_ports import documented_ports

X_PC = RigidTransform(RollPitchYaw(0.3, -0.5, 1.9), [0.05, -0.02, 0.1])
COVARIANCE = np.diag([1e-4, 2e-4, 3e-4, 1e-6, 2e-6, 3e-6])
BASE_COVARIANCE = np.diag([3e-5, 1e-5, 2e-5, 4e-6, 5e-6, 6e-6])
X_WBASE = RigidTransform(RollPitchYaw(0.1, 0.2, 0.3), [0.4, 0.5, 0.6])


def model(X_WBase: RigidTransform = X_WBASE) -> MultibodyPlant:
    """An arm of two joints."""
    plant = MultibodyPlant(0.0)
    inertia = SpatialInertia.SolidBoxWithMass(1.0, 0.1, 0.1, 0.1)
    base, first, second = (plant.AddRigidBody(name, inertia) for name in ("base", "first", "last"))
    plant.WeldFrames(plant.world_frame(), base.body_frame(), X_WBase)
    for name, parent, child, axis in (
        ("q1", base, first, [0.0, 0.0, 1.0]),
        ("q2", first, second, [0.0, 1.0, 0.0]),
    ):
        on_parent = plant.AddFrame(
            FixedOffsetFrame(f"{name}_at", parent.body_frame(), RigidTransform([0.1, 0.0, 0.3]))
        )
        plant.AddJoint(RevoluteJoint(name, on_parent, child.body_frame(), axis))
    plant.Finalize()
    return plant


def arm(offset: float = 0.0) -> ArmPose:
    return ArmPose(model(), BASE_COVARIANCE, np.full(2, offset), frame="last")


def stamped(system: ImageStamps, context: Context) -> list[StampedImage]:
    for name, image in (("color", ImageRgba8U(3, 2, 7)), ("depth", ImageDepth32F(3, 2, 1.5))):
        system.GetInputPort(f"{name}_image").FixValue(context, AbstractValue.Make(image))
    return [system.GetOutputPort(f"{name}_measured").Eval(context) for name in ("color", "depth")]


def test_an_image_is_stamped_with_the_tick_and_keeps_its_pixels_for_good() -> None:
    system = ImageStamps()
    context = system.CreateDefaultContext()
    color, depth = ImageRgba8U(3, 2, 7), ImageDepth32F(3, 2, 1.5)
    fixed = [
        system.GetInputPort(f"{name}_image").FixValue(context, AbstractValue.Make(image))
        for name, image in (("color", color), ("depth", depth))
    ]
    context.SetTime(0.4)
    stamped = [
        system.GetOutputPort(f"{name}_measured").Eval(context) for name in ("color", "depth")
    ]
    fixed[1].GetMutableData().get_mutable_value().mutable_data[:] = 2.5
    assert [image.time for image in stamped] == [0.4, 0.4]
    assert_array_equal(stamped[0].image.data, color.data)
    assert np.all(stamped[1].image.data == 1.5)


def test_where_a_camera_is_that_is_mounted_nowhere_is_not_known() -> None:
    system = ImageStamps()
    for image in stamped(system, system.CreateDefaultContext()):
        assert np.isnan(image.X_WC).all()
        assert np.isnan(image.covariance).all()


def test_a_camera_that_is_fixed_in_the_world_is_where_it_was_calibrated() -> None:
    system = ImageStamps(Mounting(X_PC=X_PC, covariance=COVARIANCE))
    for image in stamped(system, system.CreateDefaultContext()):
        assert_array_equal(image.X_WC, X_PC.GetAsMatrix4())
        assert_array_equal(image.covariance, COVARIANCE)


def test_a_camera_on_an_arm_goes_with_its_measured_joints() -> None:
    system = ImageStamps(Mounting(X_PC=X_PC, covariance=COVARIANCE, arm=arm()))
    context = system.CreateDefaultContext()
    plant = model()
    of_plant = plant.CreateDefaultContext()
    for q in (np.array([0.3, -0.8]), np.array([-1.0, 0.4])):
        state = np.append(q, [9.0, 9.0])  # The rates do not count.
        system.GetInputPort("joint_state_measured").FixValue(context, state)
        plant.SetPositions(of_plant, q)
        X_WP = plant.GetFrameByName("last").CalcPoseInWorld(of_plant)
        for image in stamped(system, context):
            assert_allclose(image.X_WC, (X_WP @ X_PC).GetAsMatrix4(), atol=1e-12)
            assert_array_equal(image.covariance, carried_pose(system._mounting, arm(), q)[1])


def test_the_errors_of_base_joints_and_mounting_add_up_at_the_camera() -> None:
    """Against cameras of which base, zeros and mounting were drawn."""
    rng, q, offset = np.random.default_rng(0), np.array([0.3, -0.8]), 0.004
    mounting = Mounting(X_PC=X_PC, covariance=COVARIANCE)
    X_WC, covariance = carried_pose(mounting, arm(offset), q)
    errors = []
    for _ in range(400):
        xi_base = rng.multivariate_normal(np.zeros(6), BASE_COVARIANCE)
        plant = model(X_WBASE @ RigidTransform(se3.exp(xi_base)))
        context = plant.CreateDefaultContext()
        plant.SetPositions(context, q + offset * rng.standard_normal(2))
        X_WP = plant.GetFrameByName("last").CalcPoseInWorld(context).GetAsMatrix4()
        xi = rng.multivariate_normal(np.zeros(6), COVARIANCE)
        true = X_WP @ X_PC.GetAsMatrix4() @ se3.exp(xi)
        errors.append(se3.log(se3.inverse(X_WC) @ true))
    whitened = np.linalg.solve(np.linalg.cholesky(covariance), np.transpose(errors))
    assert_allclose(np.cov(whitened), np.eye(6), atol=0.25)


@pytest.mark.parametrize("carrier", [None, arm()])
def test_documented_ports_are_the_declared_ones(carrier: ArmPose | None) -> None:
    system = ImageStamps(Mounting(arm=carrier))
    inputs = {system.get_input_port(i).get_name() for i in range(system.num_input_ports())}
    documented = set(documented_ports(ImageStamps.__doc__, "input"))
    assert documented - inputs == (set() if carrier else {"joint_state_measured"})
    assert inputs <= documented
