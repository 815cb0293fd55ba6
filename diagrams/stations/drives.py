"""How models with servo drives are moved: joint positions that their drives follow."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem, OutputPort, System
from pydrake.systems.primitives import ConstantVectorSource, MatrixGain

from crossmodal.diagrams.stations.connections import connect_alike
from crossmodal.diagrams.stations.naming import prefixed
from crossmodal.diagrams.stations.wiring import StationWiring
from crossmodal.maths.arrays import Array
from crossmodal.systems.sensors.joint_encoders import JointEncoders


class Drives(LeafSystem):
    """Where an arm's drives move its joints: they follow what the encoders say of them.

    An arm that is commanded where its encoders say that it is stays where it is.

    Input ports:
    - `joint_position_commanded`: (n,), [rad].

    Output ports:
    - `desired_state`: (2 n,) of the plant, the velocities zero, [rad], [rad/s].

    Args:
        encoders: Of the arm.
        joints: Their number n.
    """

    def __init__(self, encoders: JointEncoders, joints: int) -> None:
        super().__init__()
        self._encoders, self._joints = encoders, joints
        self._command = self.DeclareVectorInputPort("joint_position_commanded", joints)
        self.DeclareVectorOutputPort("desired_state", 2 * joints, self._desired_state)

    def _desired_state(self, context: Context, output: BasicVector) -> None:
        q = self._encoders.where_read(np.asarray(self._command.Eval(context)))
        output.SetFromVector(np.append(q, np.zeros(self._joints)))


def add_drives(
    wiring: StationWiring,
    owner: str,
    arm: str,
    encoders: JointEncoders,
    control: System,
    *readers: System,
) -> None:
    """Lets controls read an arm's joints, and the arm's drives follow one of them.

    Args:
        owner: Name of the arm where there are several; it begins the system's name.
        arm: Name of the arm's model in the scene.
        encoders: Of the arm.
        control: With the output `joint_position_commanded`.
        readers: With the input `joint_state_measured`; without any, `control` has it.
    """
    builder, plant = wiring.builder, wiring.plant
    target = plant.get_desired_state_input_port(wiring.scene.model(arm))
    drives = builder.AddNamedSystem(prefixed(owner, "drives"), Drives(encoders, target.size() // 2))
    connect_alike(builder, encoders, "joint_state_measured", *(readers or [control]))
    command = control.GetOutputPort("joint_position_commanded")
    builder.Connect(command, drives.get_input_port())
    builder.Connect(drives.get_output_port(), target)


def follow(wiring: StationWiring, model: str, command: OutputPort) -> None:
    """Lets a model's drives follow the positions (n,) that are commanded.

    They push no harder than the model's efforts allow.
    """
    port = wiring.plant.get_desired_state_input_port(wiring.scene.model(model))
    gain = MatrixGain(np.eye(port.size(), command.size()))
    drives = wiring.builder.AddNamedSystem(f"{model}_drives", gain)
    wiring.builder.Connect(command, drives.get_input_port())
    wiring.builder.Connect(drives.get_output_port(), port)


def hold_still(wiring: StationWiring, model: str, q: Array) -> None:
    """Commands a model's drives, if it has any, to stay at the positions `q` (n,)."""
    port = wiring.plant.get_desired_state_input_port(wiring.scene.model(model))
    if port.size() > 0:
        source = ConstantVectorSource(np.append(q, np.zeros(len(q))))
        held = wiring.builder.AddNamedSystem(f"{model}_posture", source)
        wiring.builder.Connect(held.get_output_port(), port)
