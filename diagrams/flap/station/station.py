"""The station of the flap application: plant, sensors and what moves the arms, as one Diagram.

Its outputs are what the robots have (measured and commanded quantities); the truth leaves it only
through ports named `cheat_...`, for evaluation.
"""

from dataclasses import dataclass, replace

import numpy as np
from pydrake.multibody.plant import ExternallyAppliedSpatialForceMultiplexer
from pydrake.systems.framework import Context, DiagramBuilder, System

from crossmodal.diagrams.flap.robot_config import FINGER, HOLDER, HOLDER_HAND, ROBOTS, TOOL
from crossmodal.diagrams.flap.scenario import Scenario
from crossmodal.diagrams.flap.station.flap_truth import add_flap_truth
from crossmodal.diagrams.flap.station.settling import Start, add_scene, settled_start
from crossmodal.diagrams.flap.station.station_control import (
    add_flip_control,
    add_line_control,
)
from crossmodal.diagrams.flap.station.station_sensors import (
    add_joint_sensors,
    add_taxels,
    add_vision,
)
from crossmodal.diagrams.flap.station.tool_placement import draw_tool
from crossmodal.diagrams.flap.station.wiring import StationWiring
from crossmodal.diagrams.run.application import Station
from crossmodal.diagrams.run.calibration import Calibration, draw_base
from crossmodal.diagrams.stations.drives import hold_still
from crossmodal.diagrams.stations.true_pose import add_true_pose
from crossmodal.plants.external_forces import ExternalForces
from crossmodal.plants.robots.arm_with_hand import make_arm_with_load
from crossmodal.plants.scene import ManipulationScene
from crossmodal.plants.tools.flap_jerk import FlapJerks
from crossmodal.plants.tools.wiper import EDGE_FRAME
from crossmodal.systems.tactile.taxel_layout import SEMI_AXES

_VIEWS = 9  # Angles of the flap at which a camera is asked whether it sees it.


@dataclass(kw_only=True)
class FlapStation(Station):
    """The station and what of it others than the estimators may know.

    Attributes:
        scene: The simulated plant and its names.
        start: The true state at first.
    """

    scene: ManipulationScene
    start: Start


def make_flap_station(scenario: Scenario, calibration: Calibration) -> FlapStation:
    """Builds the station.

    Output ports of its Diagram: `color_measured`, `depth_measured`, `robot_mask`,
    `holder_joint_state_window`, `finger_joint_state_window`, `taxel_window`, `taxel_measured`,
    `tip_estimated`, `task_status`, `cheat_flap`, `cheat_edge_pose` (of the tool's frame `edge`),
    `cheat_end_effector_pose` (of the holder), `cheat_fingertip_pose`, `cheat_query_object`.
    Input ports, which may stay unconnected: `flap_angle_latest`, `hinge_latest`,
    `flap_plane_latest`, `tool_latest`, `force_desired`, `feed_speed`, and those of `add_cameras`.

    Args:
        scenario: With its seed, by which the tool and how it is held, the noise of all sensors,
            the true camera and where the arms truly stand are drawn.
        calibration: What the robots believe of themselves.

    Raises:
        ValueError: for impossible values, and for a tool out of reach or out of a camera's sight.
    """
    seed = scenario.seed
    errors = scenario.calibration.drawn_errors(seed)
    bases = {
        name: draw_base(name, arm.X_WBase, errors, seed) for name, arm in calibration.arms.items()
    }
    arms = {name: make_arm_with_load(ROBOTS[name], X) for name, X in bases.items()}
    tool = draw_tool(scenario, reach=float(SEMI_AXES[1]))
    builder = DiagramBuilder()
    wiring = StationWiring(
        builder=builder,
        scene=add_scene(builder, scenario, tool, bases),
        scenario=replace(scenario, cameras=scenario.drawn_cameras()),
        calibration=calibration,
        start=settled_start(scenario, tool, bases, arms),
    )
    _check_sight(wiring)
    hold_still(wiring, HOLDER_HAND, wiring.start.hand)
    encoders = add_joint_sensors(wiring, arms)
    taxels = add_taxels(wiring, scenario.finger.layout())
    flip = add_flip_control(wiring, encoders[FINGER], taxels)
    add_line_control(wiring, encoders[HOLDER], flip)
    add_vision(wiring, encoders)
    _add_outside(wiring)
    plant, start = wiring.plant, wiring.start

    def initialise(root: Context) -> None:
        plant.SetPositions(plant.GetMyMutableContextFromRoot(root), start.positions)

    return FlapStation(
        diagram=builder.Build(), initialise=initialise, scene=wiring.scene, start=start
    )


def _check_sight(wiring: StationWiring) -> None:
    """Refuses a camera that never sees the flap, or only edge-on, on all of its way."""
    plant, tool = wiring.scene.plant, wiring.scene.model(TOOL)
    hinge, context = wiring.hinge, plant.CreateDefaultContext()
    edge = plant.GetFrameByName(EDGE_FRAME, tool)
    last = min(hinge.position_upper_limit(), wiring.scenario.control.sequence.angle)
    grazing = np.cos(wiring.scenario.perception.tracker.largest_incidence)
    poses = []
    for angle in np.linspace(0.0, last, _VIEWS):
        hinge.set_angle(context, angle)
        p_WJ = hinge.frame_on_child().CalcPoseInWorld(context).translation()
        X_WEdge = edge.CalcPoseInWorld(context).GetAsMatrix4()
        poses.append((0.5 * (p_WJ + X_WEdge[:3, 3]), X_WEdge[:3, 0]))
    for name, camera in wiring.calibration.cameras.items():
        why = f"the flap at {poses[0][0].round(2).tolist()} m is not in its image"
        for p_WF, n_W in poses:
            ((u, v),) = camera.project(p_WF)
            if not (0.0 <= u < camera.intrinsics.width and 0.0 <= v < camera.intrinsics.height):
                continue  # Behind the camera, u and v are NaN.
            ray = p_WF - camera.X_PC.translation()
            if abs(n_W @ ray) > grazing * np.linalg.norm(ray):
                break
            why = "it sees the flap edge-on only, however far that is turned"
        else:
            raise ValueError(f"cameras.{name}: {why}")


def _add_outside(wiring: StationWiring) -> None:
    """Adds what disturbs the tool, and the truth for the evaluation."""
    builder, scene = wiring.builder, wiring.scene
    plant, tool = scene.plant, scene.model(TOOL)
    disturbances = wiring.scenario.disturbances
    hands: list[System] = []
    if disturbances.jerks:
        edge = plant.GetFrameByName(EDGE_FRAME, tool)
        jerks = FlapJerks(plant, wiring.hinge, edge, disturbances.jerks)
        hands.append(builder.AddNamedSystem("flap_jerks", jerks))
        builder.Connect(plant.get_state_output_port(tool), jerks.GetInputPort("tool_state"))
    if disturbances.forces:
        forces = ExternalForces(plant, disturbances.forces)
        hands.append(builder.AddNamedSystem("external_forces", forces))
    if hands:
        total = ExternallyAppliedSpatialForceMultiplexer(len(hands))
        builder.AddNamedSystem("outside_forces", total)
        for index, hand in enumerate(hands):
            builder.Connect(plant.get_body_poses_output_port(), hand.GetInputPort("body_poses"))
            builder.Connect(hand.get_output_port(), total.get_input_port(index))
        builder.Connect(total.get_output_port(), plant.get_applied_spatial_force_input_port())
    add_flap_truth(wiring)
    end_effector = plant.GetFrameByName("end_effector", scene.model(HOLDER_HAND))
    add_true_pose(builder, plant, end_effector, "end_effector")
    add_true_pose(builder, plant, wiring.fingertip, "fingertip")
    add_true_pose(builder, plant, plant.GetFrameByName(EDGE_FRAME, scene.model(TOOL)), "edge")
    builder.ExportOutput(scene.scene_graph.get_query_output_port(), "cheat_query_object")
