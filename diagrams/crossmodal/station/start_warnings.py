"""What a user should know before the hand moves: what overlaps, what falls, what is not claimed."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from pydrake.multibody.tree import Joint
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from crossmodal.diagrams.crossmodal.robot_config import ARM, HAND
from crossmodal.diagrams.crossmodal.scenario import Scenario
from crossmodal.diagrams.crossmodal.station.station import ManipulationStation
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
from crossmodal.maths.arrays import Array
from crossmodal.plants.hands.soft_hand import SOFT_HAND_RANGE
from crossmodal.plants.scene import ManipulationScene, ObjectPlacement, add_manipulation_scene

_DEEPEST_OVERLAP = 0.005  # [m]
_MOST = 0.02  # Way of a handle that the hand still closes around, [m].


def overlaps(station: ManipulationStation) -> list[str]:
    """What of an object is inside something else at the start, by more than 5 mm, a line each."""
    scene, context = station.scene, station.diagram.CreateDefaultContext()
    station.initialise(context)
    query = scene.scene_graph.get_query_output_port().Eval(
        scene.scene_graph.GetMyContextFromRoot(context)
    )
    objects = list(scene.objects.values())
    inspector, deepest = query.inspector(), dict[tuple[str, str], float]()
    for pair in query.ComputePointPairPenetration():
        bodies = [
            scene.plant.GetBodyFromFrameId(inspector.GetFrameId(geometry))
            for geometry in (pair.id_A, pair.id_B)
        ]
        bodies.sort(key=lambda body: body.model_instance() not in objects)
        if bodies[0].model_instance() in objects and pair.depth > _DEEPEST_OVERLAP:
            names = bodies[0].name(), bodies[1].name()
            deepest[names] = max(deepest.get(names, 0.0), pair.depth)
    return [
        f"link '{link}' starts {100 * depth:.0f} cm inside '{other}'; place the object elsewhere"
        " (objects.NAME.position)"
        for (link, other), depth in deepest.items()
    ]


def unclaimed_errors(scenario: Scenario) -> list[str]:
    """Errors of the calibration that no reported covariance contains, a line."""
    errors, believed = vars(scenario.calibration.errors), vars(scenario.calibration.believed)
    names = [name for name, std in errors.items() if std > 0.0 and believed[name] == 0.0]
    if not names:
        return []
    return [
        "calibration.errors are unknown to the robot, so that reported deviations do not contain"
        f" them: {', '.join(names)}; say how large it takes them to be (calibration.believed)"
    ]


def settling(
    scenario: Scenario, placements: Mapping[str, ObjectPlacement], q_start: Array
) -> list[str]:
    """What a user should know of a handle that falls, slides or swings away by itself, a line.

    The scene is simulated with the robot held still, for as long as the hand takes to arrive and
    to close. Objects that come with the program stay where they are.

    Args:
        placements: Of its objects.
        q_start: Posture of the arm (n,) at the start, [rad].

    Raises:
        ScenarioError: if the handle goes farther than the hand reaches.
    """
    thing = scenario.object
    if not Path(thing.model).is_absolute():
        return []
    name = scenario.task.object or next(iter(scenario.objects))
    builder = DiagramBuilder()
    scene = add_manipulation_scene(builder, scenario.plant, placements, [(ARM, HAND)])
    plant = scene.plant
    plant.GetJointByName(thing.joint, scene.objects[name]).set_default_positions(
        [thing.initial_position]
    )
    simulator = Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    plant.SetPositions(context, scene.model(ARM), q_start)
    for joint in _joints(scene, (ARM, HAND)):
        joint.Lock(context)
    handle = plant.GetFrameByName(thing.handle_frame, scene.objects[name])
    start = handle.CalcPoseInWorld(context).translation()
    sequence = scenario.control.sequence
    time = sequence.approach_time + sequence.close_time
    simulator.AdvanceTo(time)
    way = handle.CalcPoseInWorld(context).translation() - start
    if np.linalg.norm(way) < _MOST:
        return []
    down = "falls" if -way[2] > 0.5 * np.linalg.norm(way) else "moves"
    place = "--object-pose" if thing.free else f"objects.{name}.initial_position"
    line = (
        f"the handle '{thing.handle_frame}' {down} by {100 * np.linalg.norm(way):.0f} cm in the"
        f" {time:g} s before the hand closes; begin where it rests ({place})"
    )
    if np.linalg.norm(way) > SOFT_HAND_RANGE.reach:
        raise ScenarioError(f"{name}: {line}")
    return [line]


def _joints(scene: ManipulationScene, models: tuple[str, ...]) -> list[Joint]:
    plant = scene.plant
    return [
        plant.get_joint(index)
        for model in models
        for index in plant.GetJointIndices(scene.model(model))
    ]
