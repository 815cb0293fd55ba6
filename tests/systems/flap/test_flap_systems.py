"""The flap's systems through their ports, together in one diagram."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder, InputPort, LeafSystem
from pydrake.systems.sensors import ImageDepth32F, ImageGrey8U
from synthetic_flap import PERIOD, Errors, Laboratory, ideal_depth, measured_depth

from crossmodal.systems.depth_camera import DepthCamera
from crossmodal.systems.flap.flap_angle import FlapAngleConfig, FlapAngleFilter
from crossmodal.systems.flap.hinge.hinge_estimator import HingeEstimator, HingeEstimatorConfig
from crossmodal.systems.flap.joint.flap_joint import FlapJoint
from crossmodal.systems.flap.joint.flap_joint_model import FlapJointConfig
from crossmodal.systems.flap.tool_kinematics import ToolKinematics, ToolKinematicsConfig
from crossmodal.systems.flap.tracking.flap_tracking import FlapTracker
from crossmodal.systems.flap.tracking.flap_tracking_config import FlapTrackingConfig
from crossmodal.systems.port_values import (
    UNKNOWN_FINGERTIP,
    FlapAngleBelief,
    FlapPlane,
    HingeBelief,
    StampedImage,
    ToolBelief,
)
from tests.documented_ports import documented_ports

EXACT = Errors(
    camera_rotation=1e-6, camera_translation=1e-6, depth_scale=1e-6, focal_length=1e-6,
    arm_rotation=1e-6, arm_translation=1e-6, taxels=1e-6,
)  # fmt: skip


class Chain:
    """Tracker, estimator and tool in a diagram whose inputs are set by hand."""

    def __init__(
        self, lab: Laboratory, filtered: bool, tracked_by: DepthCamera | None = None
    ) -> None:
        self.lab = lab
        builder = DiagramBuilder()
        self._inputs: dict[str, list[InputPort]] = {}
        tracker = builder.AddSystem(FlapTracker(FlapTrackingConfig(), tracked_by or lab.camera))
        tool = builder.AddSystem(ToolKinematics(ToolKinematicsConfig()))
        systems: list[LeafSystem] = [tracker]
        if filtered:
            joint = builder.AddSystem(FlapJoint(FlapJointConfig(), lab.camera))
            hinge = angle = joint
            systems.append(joint)
        else:
            hinge = builder.AddSystem(HingeEstimator(HingeEstimatorConfig(), lab.camera))
            angle = builder.AddSystem(FlapAngleFilter(FlapAngleConfig(), lab.camera))
            builder.Connect(
                hinge.GetOutputPort("hinge_estimated"), angle.GetInputPort("hinge_estimated")
            )
            systems += [hinge, angle]
        for system in systems[1:]:
            builder.Connect(
                tracker.GetOutputPort("flap_plane_estimated"),
                system.GetInputPort("flap_plane_estimated"),
            )
        for name, source in (("hinge_estimated", hinge), ("flap_angle_estimated", angle)):
            builder.Connect(source.GetOutputPort(name), tool.GetInputPort(name))
        for system in [*systems, tool]:
            for i in range(system.num_input_ports()):
                port = system.get_input_port(i)
                if not builder.IsConnectedOrExported(port):
                    name = port.get_name()
                    if name not in self._inputs:
                        builder.ExportInput(port, name)
                        self._inputs[name] = [port]
                    else:
                        builder.ConnectInput(name, port)
        self.tracker, self.hinge, self.angle, self.tool = tracker, hinge, angle, tool
        self.diagram: Diagram = builder.Build()
        self.simulator = Simulator(self.diagram)
        self.context = self.simulator.get_mutable_context()
        self.rng = np.random.default_rng(5)
        self._fix("end_effector_estimated", lab.end_effector())
        self._fix("displacements_estimated", lab.displacements())
        self._fix("robot_mask", ImageGrey8U(640, 480))

    def _fix(self, name: str, value: object) -> None:
        self.diagram.GetInputPort(name).FixValue(self.context, AbstractValue.Make(value))

    def tick(self, theta: float, rate: float, touching: bool = True) -> None:
        """Sets what camera and finger say at theta, then lets one tick pass."""
        image = ImageDepth32F(640, 480)
        ideal = ideal_depth(self.lab.tool, theta, self.lab.X_WC_true)
        image.mutable_data[:, :, 0] = measured_depth(ideal, self.rng)
        camera = self.lab.camera
        self._fix(
            "depth_measured",
            StampedImage(
                time=0.0, image=image, X_WC=camera.X_WC, covariance=camera.pose_covariance
            ),
        )
        contact = self.lab.contact(theta, rate) if touching else UNKNOWN_FINGERTIP
        self._fix("fingertip_contact_estimated", contact)
        self.simulator.AdvanceTo(self.context.get_time() + PERIOD)

    def read(self, system: LeafSystem, port: str) -> object:
        context = system.GetMyContextFromRoot(self.context)
        return system.GetOutputPort(port).Eval(context)


@pytest.mark.parametrize(("filtered", "direction"), [(False, 0.02), (True, 0.05)])
def test_a_turned_flap_becomes_a_tool_with_hinge_angle_and_links(
    filtered: bool, direction: float
) -> None:
    lab = Laboratory(3, EXACT)
    chain = Chain(lab, filtered)
    chain.tick(0.0, 0.0, touching=False)
    tool = chain.read(chain.tool, "tool_latest")
    assert isinstance(tool, ToolBelief)
    assert not tool.hinge.known
    steps = 60
    for i in range(steps):
        rate = 0.6 / (steps * PERIOD) * (i >= 15)
        theta = max(0.0, 0.6 * (i - 15) / (steps - 15))
        chain.tick(theta, rate)
    tool = chain.read(chain.tool, "tool_latest")
    assert isinstance(tool, ToolBelief)
    assert tool.hinge.known
    assert tool.hinge.k_W @ lab.tool.k_W > np.cos(direction)
    assert tool.angle.theta == pytest.approx(theta, abs=0.03)
    k = lab.tool.k_W
    to_contact = lab.true_contact - lab.tool.p_WK
    np.testing.assert_allclose(-tool.L2_W, to_contact - k * (k @ to_contact), atol=0.006)
    np.testing.assert_allclose(
        chain.lab.end_effector().X @ tool.X_EK @ tool.X_KT @ [0.0, 0.0, 0.0, 1.0],
        [*lab.true_contact, 1.0],
        atol=0.004,
    )


def test_estimated_ports_react_at_their_tick_and_latest_ones_after_it() -> None:
    lab = Laboratory(3, EXACT)
    chain = Chain(lab, filtered=False)
    chain.tick(0.0, 0.0)
    before = chain.read(chain.angle, "flap_angle_latest")
    chain.tick(0.0, 0.0)
    after = chain.read(chain.angle, "flap_angle_latest")
    assert isinstance(before, FlapAngleBelief)
    assert isinstance(after, FlapAngleBelief)
    assert before.known
    assert not np.array_equal(after.n_W, before.n_W)
    hinge = chain.read(chain.hinge, "hinge_latest")
    assert isinstance(hinge, HingeBelief)
    assert not hinge.known


def test_a_flap_is_where_the_image_says_that_the_camera_was() -> None:
    planes = []
    for moved in (False, True):
        lab = Laboratory(3, EXACT)
        elsewhere = replace(lab.camera, X_WC=np.eye(4), pose_covariance=np.zeros((6, 6)))
        chain = Chain(lab, filtered=False, tracked_by=elsewhere if moved else lab.camera)
        chain.tick(0.0, 0.0)
        chain.tick(0.0, 0.0)
        planes.append(chain.read(chain.tracker, "flap_plane_latest"))
    for plane in planes:
        assert isinstance(plane, FlapPlane)
        assert plane.seen
        assert np.array_equal(plane.n_W, planes[0].n_W)
        assert np.array_equal(plane.common_covariance, planes[0].common_covariance)


def test_nothing_is_seen_by_a_camera_of_which_nobody_knows_where_it_is() -> None:
    lab = Laboratory(3, EXACT)
    system = FlapTracker(FlapTrackingConfig(), lab.camera)
    context = system.CreateDefaultContext()
    image = ImageDepth32F(640, 480, 0.9)
    for name, value in (
        ("depth_measured", StampedImage(time=0.0, image=image)),
        ("fingertip_contact_estimated", lab.contact(0.0, 0.0)),
    ):
        system.GetInputPort(name).FixValue(context, AbstractValue.Make(value))
    plane = system.GetOutputPort("flap_plane_estimated").Eval(context)
    assert plane.why == "the camera does not look there"


def _systems() -> list[LeafSystem]:
    camera = Laboratory(0).camera
    return [
        FlapTracker(FlapTrackingConfig(), camera),
        HingeEstimator(HingeEstimatorConfig(), camera),
        FlapAngleFilter(FlapAngleConfig(), camera),
        FlapJoint(FlapJointConfig(), camera),
        ToolKinematics(ToolKinematicsConfig()),
    ]


@pytest.mark.parametrize("system", _systems(), ids=lambda system: type(system).__name__)
def test_documented_ports_are_the_declared_ones(system: LeafSystem) -> None:
    inputs = [system.get_input_port(i).get_name() for i in range(system.num_input_ports())]
    outputs = [system.get_output_port(i).get_name() for i in range(system.num_output_ports())]
    assert documented_ports(type(system).__doc__, "input") == inputs
    assert documented_ports(type(system).__doc__, "output") == outputs
