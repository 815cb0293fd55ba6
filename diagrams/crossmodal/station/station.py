"""The station: plant, sensors and controllers of one episode, as one Diagram.

Its outputs are what a robot has (measured and commanded quantities); the truth leaves it only
through ports named `cheat_...`, for evaluation.
"""

from dataclasses import dataclass

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.tree import Joint
from pydrake.systems.framework import Context, DiagramBuilder

from crossmodal.diagrams.crossmodal.robot_config import ARM, HAND
from crossmodal.diagrams.crossmodal.scenario import ObjectConfig, Scenario, object_model_file
from crossmodal.diagrams.crossmodal.station.station_control import add_control, taught_postures
from crossmodal.diagrams.crossmodal.station.station_sensors import add_proprioception, add_vision
from crossmodal.diagrams.crossmodal.station.wiring import StationWiring
from crossmodal.diagrams.crossmodal.task import task_status
from crossmodal.diagrams.joints.joint_truth import ObjectTruth
from crossmodal.diagrams.run.application import Station
from crossmodal.diagrams.run.calibration import Calibration, draw_base
from crossmodal.diagrams.stations.connections import export_outputs
from crossmodal.diagrams.stations.task_status import add_task_status
from crossmodal.diagrams.stations.true_pose import add_true_pose
from crossmodal.maths.arrays import Array
from crossmodal.plants.external_forces import ExternalForces
from crossmodal.plants.joint_friction import Detents
from crossmodal.plants.robots.arm_with_hand import make_arm_with_load
from crossmodal.plants.robots.wam import WAM_WITH_SOFT_HAND
from crossmodal.plants.scene import (
    ManipulationScene,
    ObjectPlacement,
    add_manipulation_scene,
    facing,
)
from crossmodal.systems.sensors.randomness import make_generator


@dataclass(kw_only=True)
class ManipulationStation(Station):
    """The station and what of it others than the estimators may know.

    Attributes:
        scene: The simulated plant and its names.
        joint: The explored joint.
        q_start: Posture (7,) at the start of the approach, true, [rad].
    """

    scene: ManipulationScene
    joint: Joint
    q_start: Array


def draw_placements(scenario: Scenario) -> dict[str, ObjectPlacement]:
    """Where the objects of this seed stand, how stiff they move and how they look.

    What is drawn of one object does not depend on which others there are.
    """
    placements = {}
    for name, thing in scenario.objects.items():
        rng = (
            np.random.default_rng((scenario.seed, 0))
            if thing is scenario.object
            else make_generator(scenario.seed, f"placement {name}")
        )
        placements[name] = draw_placement(thing, rng)
    return placements


def draw_placement(thing: ObjectConfig, rng: np.random.Generator) -> ObjectPlacement:
    """One object, drawn around its nominal pose and friction."""
    variation = thing.variation
    position = thing.position + variation.position * rng.uniform(-1.0, 1.0, 3)
    turned = np.deg2rad(variation.yaw * rng.uniform(-1.0, 1.0))
    friction = thing.friction * (1.0 + variation.friction * rng.uniform(-1.0, 1.0))
    texture = str(rng.choice(variation.textures)) if variation.textures else ""
    return ObjectPlacement(
        model=object_model_file(thing),
        X_WO=RigidTransform(
            RotationMatrix.MakeZRotation(turned) @ thing.pose().rotation(), position
        ),
        free=thing.free,
        friction=friction,
        texture=texture,
    )


def make_manipulation_station(
    scenario: Scenario,
    calibration: Calibration,
    placements: dict[str, ObjectPlacement] | None = None,
) -> ManipulationStation:
    """Builds the station.

    Output ports of its Diagram: `color_measured`, `depth_measured`, `robot_mask`,
    `joint_state_window`, `wrench_window`, `pressure_window`, `interaction_active`, `task_status`,
    `path_planned`, `cheat_joint`, `cheat_joint_mechanics`, `cheat_configuration`,
    `cheat_body_pose`, `cheat_hand_pose`, `cheat_handle_pose`, `cheat_query_object`.
    Input ports, which may stay unconnected: `PERCEIVED_INPUTS`, `pull_speed`, and those of
    `add_cameras` and `add_soft_hand`.

    Args:
        scenario: With its seed, which the noise of all sensors, the true camera and arm, and how
            the hand is guided to the handle are drawn by.
        calibration: What the robot believes of itself.
        placements: Of the objects, by default drawn by the seed.

    Raises:
        ValueError: for impossible values, unknown names, a handle out of reach.
    """
    thing, seed = scenario.object, scenario.seed
    errors = scenario.calibration.drawn_errors(seed)
    name = scenario.task.object or next(iter(scenario.objects))
    believed = calibration.arms[ARM].X_WBase
    X_WBase = draw_base(ARM, believed, errors, seed)
    builder = DiagramBuilder()
    scene = add_manipulation_scene(
        builder,
        scenario.plant,
        placements or draw_placements(scenario),
        [(ARM, HAND)],
        {ARM: X_WBase} if X_WBase is not believed else {},
    )
    plant = scene.plant
    joint = plant.GetJointByName(thing.joint, scene.objects[name])
    if thing.initial_position != 0.0:
        joint.set_default_positions(np.array([thing.initial_position]))
    wiring = StationWiring(
        builder=builder,
        scene=scene,
        scenario=scenario,
        calibration=calibration,
        true_arm=make_arm_with_load(WAM_WITH_SOFT_HAND, X_WBase),
    )
    _add_object_mechanics(wiring, joint)
    add_true_pose(builder, plant, plant.GetFrameByName("sensor", scene.model(HAND)), "hand")
    handle = plant.GetFrameByName(thing.handle_frame, scene.objects[name])
    add_true_pose(builder, plant, handle, "handle")
    X_WHandle, X_WO = (
        plant.GetFrameByName(frame, scene.objects[name]).CalcPoseInWorld(
            plant.CreateDefaultContext()
        )
        for frame in (thing.handle_frame, "__model__")
    )
    q_grasp, q_start = taught_postures(wiring, X_WHandle, X_WHandle.inverse() @ X_WO)
    encoders = add_proprioception(wiring, q_grasp)
    # A person guided the hand along the approach, so the arm knows it as its encoders read it.
    taught = [encoders.as_read(q) for q in (q_grasp, q_start)]
    direction_E = facing(RigidTransform()).rotation().inverse() @ thing.pull_direction
    sequence = add_control(wiring, encoders, taught[0], taught[1], direction_E)
    add_vision(wiring, encoders, sequence)
    ports = {name: sequence.GetOutputPort(name) for name in ("phase", "grasp_lost", "stuck")}
    add_task_status(builder, task_status, ports)

    def initialise(root: Context) -> None:
        context = plant.GetMyMutableContextFromRoot(root)
        plant.SetPositions(context, scene.model(ARM), q_start)
        if scenario.control.excitation is not None:
            joint.Lock(context)  # The object is to stay.

    return ManipulationStation(
        diagram=builder.Build(), initialise=initialise, scene=scene, joint=joint, q_start=q_start
    )


def _add_object_mechanics(wiring: StationWiring, joint: Joint) -> None:
    builder, scene = wiring.builder, wiring.scene
    plant = scene.plant
    detents = [
        (plant.GetJointByName(thing.joint, scene.objects[name]), thing.detent)
        for name, thing in wiring.scenario.objects.items()
        if thing.detent > 0.0
    ]
    holding = builder.AddNamedSystem("detents", Detents(plant, detents))
    builder.Connect(plant.get_state_output_port(), holding.get_input_port())
    builder.Connect(holding.get_output_port(), plant.get_applied_generalized_force_input_port())
    friction = float(scene.friction[joint.velocity_start()])
    truth = ObjectTruth(plant, joint, friction, wiring.scenario.object.detent)
    builder.AddNamedSystem("object_truth", truth)
    if wiring.scenario.disturbances.forces:
        forces = ExternalForces(plant, wiring.scenario.disturbances.forces)
        builder.AddNamedSystem("external_forces", forces)
        builder.Connect(plant.get_body_poses_output_port(), forces.get_input_port())
        builder.Connect(forces.get_output_port(), plant.get_applied_spatial_force_input_port())
    builder.Connect(plant.get_state_output_port(), truth.get_input_port())
    export_outputs(
        builder,
        truth,
        "cheat_joint",
        "cheat_joint_mechanics",
        "cheat_configuration",
        "cheat_body_pose",
    )
    builder.ExportOutput(scene.scene_graph.get_query_output_port(), "cheat_query_object")
