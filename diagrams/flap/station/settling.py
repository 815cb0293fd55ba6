"""How an episode begins: the hand has closed around the tool, the finger waits at its flap."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RevoluteJoint
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder

from crossmodal.controllers.arm.inverse_kinematics import inverse_kinematics
from crossmodal.diagrams.flap.robot_config import (
    FINGER_ARM,
    FINGERTIP,
    HOLDER_ARM,
    HOLDER_HAND,
    TOOL,
)
from crossmodal.diagrams.flap.scenario import Scenario
from crossmodal.diagrams.flap.station.tool_placement import ToolPlacement
from crossmodal.maths.arrays import Array
from crossmodal.plants.hands.three_finger_hand import closed_posture, grip_torques
from crossmodal.plants.scene import ManipulationScene, ObjectPlacement, add_manipulation_scene
from crossmodal.plants.tools.held_tool import make_touchable
from crossmodal.plants.tools.wiper import EDGE_FRAME, HANDLE_FRAME, HINGE

# Elbows up and outward, all joints far from their limits.
_HOLDER_GUESS = np.array([-0.2, -0.43, 0.97, 1.19, 1.12, -0.89, 0.16])
_FINGER_GUESS = np.array([-0.22, -0.63, -0.39, 1.6, 1.4, 1.01, -0.83])
# The hand's grip grows to its full force and what moves comes to rest, [s].
_GRIP_TIME, _REST_TIME, _STEP = 0.3, 0.6, 0.02
_MOST_SLIP = 0.005  # Of a tool that counts as held, [m].


@dataclass(frozen=True, kw_only=True)
class Start:
    """The true state in which an episode begins; all is at rest.

    Attributes:
        positions: Of the whole plant (nq,).
        holder: Joint positions of the holding arm (7,), [rad].
        finger: Of the arm with the fingertip (7,), [rad].
        hand: What the hand's drives are commanded for the episode (6,), [rad].
        fingers: Where its joints are (6,), [rad].
    """

    positions: Array
    holder: Array
    finger: Array
    hand: Array
    fingers: Array


def add_scene(
    builder: DiagramBuilder,
    scenario: Scenario,
    tool: ToolPlacement,
    bases: Mapping[str, RigidTransform],
) -> ManipulationScene:
    """Adds plant and scene graph: both robots, the tool as a free body, the table.

    Args:
        scenario: With the plant's configuration.
        bases: Where the arms truly stand, by their names.
    """
    robots = [(HOLDER_ARM, HOLDER_HAND), (FINGER_ARM, FINGERTIP)]
    placement = ObjectPlacement(model=tool.model, X_WO=tool.X_WM, free=True, texture=tool.texture)
    scene = add_manipulation_scene(
        builder,
        scenario.plant,
        {TOOL: placement},
        robots,
        bases,
        weightless=[name for robot in robots for name in robot],
    )
    make_touchable(scene.plant, scene.scene_graph, scene.model(TOOL))
    return scene


def settled_start(
    scenario: Scenario,
    tool: ToolPlacement,
    bases: Mapping[str, RigidTransform],
    arms: Mapping[str, MultibodyPlant],
) -> Start:
    """Closes the hand around the tool in a simulation of its own and puts the finger to the flap.

    The fingers close by torque; once the tool is at rest, their self-locking drives keep what they
    are commanded then.

    Args:
        bases: Where the arms truly stand, by their names.
        arms: The arms alone, as they are, by their names.

    Raises:
        ValueError: for a tool that is out of reach of one of the arms, or that the hand cannot
            hold, in one line.
    """
    builder = DiagramBuilder()
    scene = add_scene(builder, scenario, tool, bases)
    plant = scene.plant
    hand = scene.model(HOLDER_HAND)
    simulator = Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    holder = _reach(
        HOLDER_ARM, arms, scene.pose(HANDLE_FRAME, TOOL) @ tool.X_HandleE, _HOLDER_GUESS
    )
    plant.SetPositions(context, scene.model(HOLDER_ARM), holder)
    plant.SetPositions(context, hand, closed_posture(tool.thickness))
    for name in (HOLDER_ARM, FINGER_ARM, TOOL):
        _hold(plant, context, scene, name)
    handle = plant.GetFrameByName(HANDLE_FRAME, scene.model(TOOL))
    p_start = handle.CalcPoseInWorld(context).translation()
    torques = grip_torques(tool.thickness, scenario.tool.grip_force)
    stiffness = _stiffness(plant, scene)
    command = plant.get_desired_state_input_port(hand)
    commanded = closed_posture(tool.thickness)
    for time in np.arange(0.0, _REST_TIME, _STEP):
        share = min(1.0, (time + _STEP) / _GRIP_TIME)
        commanded = plant.GetPositions(context, hand) + share * torques / stiffness
        command.FixValue(context, np.append(commanded, np.zeros(len(commanded))))
        simulator.AdvanceTo(time + _STEP)
    slip = np.linalg.norm(handle.CalcPoseInWorld(context).translation() - p_start)
    if not slip < _MOST_SLIP:
        raise ValueError(f"{HOLDER_HAND}: the tool slips by {1e3 * slip:.0f} mm as the hand closes")
    finger = _finger_posture(scenario, tool, arms, scene, context)
    plant.SetPositions(context, scene.model(FINGER_ARM), finger)
    return Start(
        positions=plant.GetPositions(context).copy(),
        holder=holder,
        finger=finger,
        hand=commanded,
        fingers=plant.GetPositions(context, hand),
    )


def _hold(plant: MultibodyPlant, context: Context, scene: ManipulationScene, model: str) -> None:
    """Commands a model to stay where it is."""
    port = plant.get_desired_state_input_port(scene.model(model))
    q = plant.GetPositions(context, scene.model(model))[-port.size() // 2 :]
    port.FixValue(context, np.append(q, np.zeros(port.size() - len(q))))


def _stiffness(plant: MultibodyPlant, scene: ManipulationScene) -> Array:
    """Proportional gains (6,) of the hand's drives, [N m/rad]."""
    drives = plant.GetJointActuatorIndices(scene.model(HOLDER_HAND))
    return np.array([plant.get_joint_actuator(i).get_controller_gains().p for i in drives])


def _finger_posture(
    scenario: Scenario,
    tool: ToolPlacement,
    arms: Mapping[str, MultibodyPlant],
    scene: ManipulationScene,
    context: Context,
) -> Array:
    """Where the finger waits (7,), [rad]; it must reach the edge all along its way, too."""
    plant = scene.plant
    instance = scene.model(TOOL)
    X_WEdge = plant.GetFrameByName(EDGE_FRAME, instance).CalcPoseInWorld(context)
    hinge = plant.GetJointByName(HINGE, instance)
    assert isinstance(hinge, RevoluteJoint)
    X_WJ = hinge.frame_on_parent().CalcPoseInWorld(context)
    start = _reach(FINGER_ARM, arms, X_WEdge @ tool.X_EdgeS, _FINGER_GUESS)
    X_WTouch = X_WEdge @ tool.X_EdgeTouch
    posture = start
    for angle in np.linspace(0.0, scenario.control.sequence.angle, 4):
        turned = RigidTransform(AngleAxis(angle, hinge.revolute_axis()), np.zeros(3))
        X_WS = X_WJ @ turned @ X_WJ.inverse() @ X_WTouch
        posture = _reach(FINGER_ARM, arms, X_WS, posture)
    return start


def _reach(
    name: str, arms: Mapping[str, MultibodyPlant], X_WE: RigidTransform, guess: Array
) -> Array:
    """Joint positions (7,) of an arm that put its end-effector there.

    Raises:
        ValueError: if it is out of reach.
    """
    try:
        return inverse_kinematics(arms[name], X_WE, guess)
    except ValueError as error:
        raise ValueError(f"{name}: {error}; place the tool elsewhere (tool.position)") from None
