"""The ports in each docstring are the ports that the system declares."""

import re

import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.sensors import CameraInfo

from systems.sensors.air_pressure import PressureSensor, PressureSensorConfig
from systems.sensors.joint_encoders import JointEncoders, JointEncodersConfig
from systems.sensors.rgbd_camera import CameraNoise, CameraNoiseConfig
from systems.sensors.robot_mask import (
    HandPostureModel,
    RobotMask,
    RobotMaskConfig,
    SilhouetteMask,
)
from systems.sensors.wrist_wrench import ReactionWrench, WristWrenchConfig, WristWrenchSensor

INTRINSICS = CameraInfo(64, 48, 57.6, 57.6, 31.5, 23.5)


def reaction_wrench():
    plant = MultibodyPlant(0.001)
    body = plant.AddRigidBody("body")
    joint = plant.WeldFrames(plant.world_frame(), body.body_frame())
    plant.Finalize()
    return ReactionWrench(plant, joint, RigidTransform())


SYSTEMS = [
    lambda: CameraNoise(CameraNoiseConfig(), INTRINSICS, 0),
    lambda: JointEncoders(JointEncodersConfig(), np.eye(6, 7), 0),
    lambda: WristWrenchSensor(WristWrenchConfig(), 0),
    lambda: PressureSensor(PressureSensorConfig(), 0),
    reaction_wrench,
    lambda: HandPostureModel(np.arange(7), np.zeros(9), np.ones(9)),
    lambda: SilhouetteMask(RobotMaskConfig(), INTRINSICS),
    lambda: RobotMask(RobotMaskConfig(), lambda _: None, INTRINSICS, RigidTransform(), [], {}),
]


@pytest.mark.parametrize("make", SYSTEMS)
def test_documented_ports_are_the_declared_ones(make):
    system = make()
    text = type(system).__doc__
    inputs, outputs = re.search(r"input_ports:\n(.*?)output_ports:\n(.*?)\n\n", text, re.S).groups()
    declared_inputs = [system.get_input_port(i).get_name() for i in range(system.num_input_ports())]
    declared_outputs = [
        system.get_output_port(i).get_name() for i in range(system.num_output_ports())
    ]
    assert re.findall(r"- (\w+)", inputs) == declared_inputs
    assert re.findall(r"- (\w+)", outputs) == declared_outputs
    assert f"name: {type(system).__name__}\n" in text
    for port in declared_inputs + declared_outputs:
        assert f"- `{port}`: " in text
