"""What clears the way to the object: segmentation, grasps, graph, sequence and actions."""

from dataclasses import dataclass

import numpy as np
import shapely
from pydrake.math import RigidTransform
from pydrake.systems.framework import OutputPort

from crossmodal.controllers.arm.command_switch import CommandSwitch
from crossmodal.controllers.arm.motion_planner import box_vertices
from crossmodal.controllers.primitives.guarded_touch import GuardedTouch
from crossmodal.controllers.primitives.look import Look
from crossmodal.controllers.primitives.move_object import MoveObject
from crossmodal.diagrams.clutter.robot_config import CAMERA_ARM, GRIPPER, TOUCH_ARM, TOUCHER
from crossmodal.diagrams.clutter.scenario import target_name
from crossmodal.diagrams.clutter.station.believed_arms import BelievedArms
from crossmodal.diagrams.clutter.station.robot_sensors import RobotSensors
from crossmodal.diagrams.clutter.station.wiring import StationWiring
from crossmodal.diagrams.run.calibration import Calibration
from crossmodal.diagrams.stations.drives import add_drives, follow
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.plants.goods.dense_clutter import mesh_vertices
from crossmodal.systems.declutter.arm_offset import ArmOffsetFilter
from crossmodal.systems.declutter.declutter_planner import DeclutterPlanner
from crossmodal.systems.declutter.declutter_sequence import DeclutterSequence
from crossmodal.systems.grasping.grasp_planner import GraspPlanner
from crossmodal.systems.port_values import ViewRequest
from crossmodal.systems.pose.target_model import TargetModel
from crossmodal.systems.segmentation.network_input import CLASSES, OTHER
from crossmodal.systems.segmentation.objects import load_network
from crossmodal.systems.segmentation.segmenter import Segmenter

_HIGHEST = 0.35  # Of what lies on the table, [m].
_DISTANCE = 0.7  # From which all of the table is looked at, [m].
# Sides and heights of it, tried in this order, [deg].
_ELEVATIONS, _AZIMUTHS = (80.0, 65.0, 50.0), (180.0, 150.0, -150.0, 120.0, -120.0, 90.0, -90.0)
_PLACES = 3
_JOINTS = 5e-4  # By which the zeros of an arm's joints displace its hand, [m].


@dataclass(frozen=True, kw_only=True)
class DeclutterControl:
    """What clears the way.

    Attributes:
        segmenter: Says what is on the table.
        sequence: Says what is done.
        move: Moves objects.
    """

    segmenter: Segmenter
    sequence: DeclutterSequence
    move: MoveObject


def add_declutter_control(
    wiring: StationWiring,
    model: TargetModel,
    height: float,
    sensors: RobotSensors,
    arms: BelievedArms,
) -> DeclutterControl:
    """Adds all of it, connected to each other and to the sensors; exports what it says.

    Args:
        model: Of the object.
        height: z of the table in W as believed, [m].
        sensors: Of the robots.
        arms: As believed.
    """
    builder, scenario = wiring.builder, wiring.scenario
    period, perception = scenario.network_period, scenario.perception
    (camera,) = wiring.calibration.cameras.values()
    low, high = scenario.sequence.around.corners
    region = shapely.box(*low, *high)
    table = _table_box(region, height)
    add = builder.AddNamedSystem
    segmenter = add(
        "segmenter",
        Segmenter(
            load_network(),
            camera.intrinsics,
            height,
            region.buffer(scenario.sequence.around.beyond, join_style="mitre"),
            {name: np.ptp(mesh_vertices(name), axis=0) for name in CLASSES[1:] if name != OTHER},
            perception.segmenter,
            period,
        ),
    )
    grasps = add("grasp_planner", GraspPlanner(height, perception.grasps, period))
    name = target_name(scenario)
    graph = add("declutter_planner", DeclutterPlanner(name, scenario.declutter, period))
    places = _places(arms, table)
    prior = offset_covariance(wiring.calibration, places[0], table.X_WB[:3, 3])
    offset = add("arm_offset", ArmOffsetFilter(prior, perception.arm_offset, period))
    sequence = add(
        "declutter_sequence",
        DeclutterSequence(
            name,
            model.middle,
            np.ptp(model.hull, axis=0),
            height,
            places,
            table,
            scenario.sequence,
            period,
        ),
    )
    move = add(
        "move_object",
        MoveObject(
            scenario.control.move,
            arms.arms[TOUCH_ARM],
            arms.planners[TOUCH_ARM],
            GRIPPER,
            arms.q_home[TOUCH_ARM],
            {CAMERA_ARM: arms.q_home[CAMERA_ARM]},
        ),
    )
    looker = sensors.encoders[CAMERA_ARM].GetOutputPort("joint_state_measured")
    segments, masks = (segmenter.GetOutputPort(port) for port in ("segments", "object_masks"))
    connections = [
        (sensors.colour, segmenter, "color_measured"),
        (sensors.depth, segmenter, "depth_measured"),
        (sensors.mask, segmenter, "robot_mask"),
        (masks, grasps, "object_masks"),
        (segments, graph, "segments"),
        (grasps.GetOutputPort("grasps"), graph, "grasps"),
        (sequence.GetOutputPort("tries"), graph, "tries"),
        (segments, sequence, "segments"),
        (grasps.GetOutputPort("grasps"), sequence, "grasps"),
        (graph.GetOutputPort("declutter_graph"), sequence, "declutter_graph"),
        (segments, offset, "segments"),
        (move.GetOutputPort("action_end"), offset, "action_end"),
        (offset.GetOutputPort("arm_offset"), sequence, "arm_offset"),
        (move.GetOutputPort("action_end"), sequence, "action_end"),
        (sequence.GetOutputPort("action_request"), move, "action_request"),
        (looker, move, f"{CAMERA_ARM}_joint_state_measured"),
        (sensors.taxels, move, "taxel_measured"),
        (sensors.fingers, move, "finger_position_measured"),
    ]
    for source, system, port in connections:
        builder.Connect(source, system.GetInputPort(port))
    for system, port in (
        (segmenter, "object_masks"),
        (graph, "declutter_graph"),
        (sequence, "action_request"),
        (sequence, "declutter_progress"),
        (offset, "arm_offset"),
    ):
        builder.ExportOutput(system.GetOutputPort(port), port)
    return DeclutterControl(segmenter=segmenter, sequence=sequence, move=move)


def connect_declutter(
    wiring: StationWiring,
    declutter: DeclutterControl,
    sensors: RobotSensors,
    look: Look,
    touch: GuardedTouch,
    planned: OutputPort,
    q_home: Array,
) -> None:
    """Connects it with what looks and touches; the touching arm's drives follow one or the other.

    Args:
        declutter: What clears the way.
        sensors: Of the robots.
        look: Moves the arm with the camera.
        touch: Moves the arm with the taxels.
        planned: `view_latest` of the views for the object's pose.
        q_home: Where tasks of the touching arm begin and end (n,), [rad].
    """
    builder, sequence, move = wiring.builder, declutter.sequence, declutter.move
    tasks, command = {"touch": touch, "move": move}, "joint_position_commanded"
    switch = builder.AddNamedSystem(f"{TOUCHER}_switch", CommandSwitch([*tasks], q_home))
    connections = [
        (sensors.colour, look, "color_measured"),
        (look.GetOutputPort("looked"), declutter.segmenter, "looked"),
        (look.GetOutputPort("unreachable"), sequence, "unreachable"),
        (look.GetOutputPort("is_away"), move, "is_clear"),
        (planned, sequence, "view_planned"),
        *(
            (task.GetOutputPort(command), switch, f"{name}_{command}")
            for name, task in tasks.items()
        ),
    ]
    for source, system, port in connections:
        builder.Connect(source, system.GetInputPort(port))
    add_drives(wiring, TOUCHER, TOUCH_ARM, sensors.encoders[TOUCH_ARM], switch, touch, move)
    follow(wiring, GRIPPER, move.GetOutputPort("finger_position_commanded"))


def _table_box(region: shapely.Polygon, height: float) -> ViewRequest:
    """The box in which all objects are; the camera goes around it while it looks at all."""
    x, y, right, up = region.bounds
    X_WB = np.eye(4)
    X_WB[:3, 3] = [0.5 * (x + right), 0.5 * (y + up), height + 0.5 * _HIGHEST]
    return ViewRequest(box_edges=np.array([right - x, up - y, _HIGHEST]), X_WB=X_WB)


def offset_covariance(calibration: Calibration, X_WC: Array, p: Array) -> Array:
    """Of a place as the touching arm has it from where the camera sees it (2, 2), [m^2].

    Args:
        calibration: As believed.
        X_WC: Of the camera (4, 4).
        p: The place in W (3,), [m].
    """
    (camera,), arm = calibration.cameras.values(), calibration.arms[TOUCH_ARM]
    at = np.hstack([-se3.skew(p), np.eye(3)])  # How a twist in W displaces it.
    found = _JOINTS**2 * np.eye(3)
    for X, covariance in (
        (X_WC, camera.pose_covariance),
        (arm.X_WBase.GetAsMatrix4(), arm.covariance),
    ):
        J = at @ se3.adjoint(X)
        found = found + J @ covariance @ J.T
    return found[:2, :2]


def _places(arms: BelievedArms, table: ViewRequest) -> list[Array]:
    """Places X_WC (4, 4) from which the camera's arm can look at the table, the highest first."""
    centre = table.X_WB[:3, 3] * [1.0, 1.0, 0.0] + [0.0, 0.0, 0.05]
    found = []
    planner, home = arms.planners[CAMERA_ARM], arms.q_home[CAMERA_ARM]
    planner.look_at(
        {TOUCH_ARM: arms.q_home[TOUCH_ARM]},
        [box_vertices(table.box_edges, RigidTransform(table.X_WB))],
    )
    for elevation in np.deg2rad(_ELEVATIONS):
        for azimuth in np.deg2rad(_AZIMUTHS):
            level = np.cos(elevation)
            out = [level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)]
            X_WC = se3.looking_at(centre + _DISTANCE * np.array(out), centre)
            if planner.posture(RigidTransform(X_WC), [home]) is not None:
                found.append(X_WC)
                break
    if not found:
        raise ValueError("the camera's arm cannot look at the table from anywhere")
    return found[:_PLACES]
