"""The ports in each docstring are the ports that the system declares."""

import re
from pathlib import Path

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import LeafSystem

from systems.proprioception.bending_network import BendingNetwork
from systems.proprioception.end_effector_motion import EndEffectorMotion, EndEffectorMotionConfig
from systems.proprioception.grasp_filters import GraspModelConfig
from systems.proprioception.grasp_model import GraspModel
from systems.proprioception.hand_bending import HandBending, HandBendingConfig
from systems.proprioception.interacted_body_filter import InteractedBodyMotionConfig
from systems.proprioception.interacted_body_motion import InteractedBodyMotion


def end_effector_motion() -> LeafSystem:
    plant = MultibodyPlant(0.0)
    plant.Finalize()
    return EndEffectorMotion(EndEffectorMotionConfig(), plant, "world")


def hand_bending() -> LeafSystem:
    vector, layers = np.ones(6), [(np.zeros((6, 10)), np.zeros(6))]
    network = BendingNetwork(
        input_mean=np.zeros(10),
        input_scale=np.ones(10),
        input_low=-np.ones(10),
        input_high=np.ones(10),
        pose_layers=layers,
        pose_scale=vector,
        deviation_layers=layers,
        deviation_scale=vector,
        deviation_factor=vector,
    )
    return HandBending(HandBendingConfig(), network)


SYSTEMS = [
    end_effector_motion,
    hand_bending,
    lambda: GraspModel(GraspModelConfig()),
    lambda: InteractedBodyMotion(InteractedBodyMotionConfig(), corrected_by_vision=True),
]


@pytest.mark.parametrize("make", SYSTEMS)
def test_documented_ports_are_the_declared_ones(make: object) -> None:
    system = make()  # type: ignore[operator]
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
        assert f"`{port}`: " in text


def test_filters_of_this_folder_do_not_import_torch() -> None:
    folder = Path(__file__).parents[3] / "systems" / "proprioception"
    assert all("torch" not in path.read_text() for path in folder.glob("*.py"))
