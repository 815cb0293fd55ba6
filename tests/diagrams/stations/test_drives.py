"""Drives follow what the encoders say of the joints, and fingers what is commanded."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from crossmodal.diagrams.stations.drives import Drives, follow
from crossmodal.diagrams.stations.wiring import StationWiring
from crossmodal.plants.hands.taxel_gripper import GRIPPER_FILE
from crossmodal.plants.parsing import add_model, make_parser
from crossmodal.systems.sensors.joint_encoders import JointEncoders, joint_side_encoders

_Q = np.array([0.3, -1.2, 0.8])


def test_an_arm_that_is_commanded_where_it_is_read_stays_where_it_is() -> None:
    encoders = JointEncoders(joint_side_encoders(), np.eye(6)[:, :3], seed=4)
    read = encoders.as_read(_Q)
    assert np.abs(read - _Q).max() > 3e-4
    drives = Drives(encoders, 3)
    context = drives.CreateDefaultContext()
    drives.get_input_port().FixValue(context, read)
    desired = drives.get_output_port().Eval(context)
    # As exactly as the encoders' noise allows.
    np.testing.assert_allclose(desired[:3], _Q, atol=1e-4)
    np.testing.assert_array_equal(desired[3:], 0.0)


def test_fingers_follow_what_is_commanded_of_each() -> None:
    command = [0.03, 0.01]
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(MultibodyPlantConfig(time_step=0.0025), builder)
    gripper = add_model(make_parser(plant), GRIPPER_FILE, "gripper")
    plant.Finalize()
    scene = cast(Any, SimpleNamespace(plant=plant, model=lambda name: gripper))
    unused = cast(Any, None)
    wiring = StationWiring(builder=builder, scene=scene, scenario=unused, calibration=unused)
    source = builder.AddSystem(ConstantVectorSource(command))
    follow(wiring, "gripper", source.get_output_port())
    diagram = builder.Build()
    context = plant.GetMyContextFromRoot(diagram.CreateDefaultContext())
    desired = plant.get_desired_state_input_port(gripper).Eval(context)
    np.testing.assert_array_equal(desired, [*command, 0.0, 0.0])
