"""What clears the way to the object: segmentation, grasps, graph, sequence and actions."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial

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
from crossmodal.diagrams.clutter.station.robot_sensors import RobotSensors, touch_arm_view
from crossmodal.diagrams.clutter.station.wiring import StationWiring
from crossmodal.diagrams.run.believed import calibrated_arm, depth_camera
from crossmodal.diagrams.stations.drives import add_drives, follow
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.plants.goods.dense_clutter import mesh_vertices
from crossmodal.systems.declutter.arm_offset import ArmOffsetFilter
from crossmodal.systems.declutter.declutter_planner import DeclutterPlanner
from crossmodal.systems.declutter.declutter_sequence import ARM_VIEW, DeclutterSequence
from crossmodal.systems.grasping.grasp_planner import GraspPlanner
from crossmodal.systems.port_values import ViewRequest
from crossmodal.systems.pose.target_model import TargetModel
from crossmodal.systems.registration.seen_arm import LookedAt, SeenArm
from crossmodal.systems.segmentation.network_input import CLASSES, OTHER
from crossmodal.systems.segmentation.objects import load_network
from crossmodal.systems.segmentation.segmenter import Segmenter

_HIGHEST = 0.35  # Of what lies on the table, [m].
_DISTANCE = 0.7  # From which all of the table is looked at, [m].
# Sides and heights of it, tried in this order, [deg].
_ELEVATIONS, _AZIMUTHS = (80.0, 65.0, 50.0), (180.0, 150.0, -150.0, 120.0, -120.0, 90.0, -90.0)
_PLACES = 3
_JOINTS = 5e-4  # By which the zeros of an arm's joints displace its hand, [m].
# Sides and heights from which the other arm is looked at, tried in this order, [deg], and from how
# far: the camera measures nothing nearer than .4 m.
_ARM_ELEVATIONS, _ARM_DISTANCE = (40.0, 20.0, 0.0), 0.55


@dataclass(frozen=True, kw_only=True)
class DeclutterControl:
    """What clears the way.

    Attributes:
        segmenter: Says what is on the table.
        seen_arm: Says by how much the arm meets things beside where they are seen.
        sequence: Says what is done.
        move: Moves objects.
    """

    segmenter: Segmenter
    seen_arm: SeenArm
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
    seen = region.buffer(scenario.sequence.around.beyond, join_style="mitre")
    table = _table_box(region, height)
    places, X_WArmView = _places(arms, table), _arm_view(arms, table)
    arm_view = 0 if X_WArmView is None else ARM_VIEW
    add = builder.AddNamedSystem
    segmenter = add(
        "segmenter",
        Segmenter(
            load_network(),
            camera.intrinsics,
            height,
            seen,
            {name: np.ptp(mesh_vertices(name), axis=0) for name in CLASSES[1:] if name != OTHER},
            perception.segmenter,
            period,
            skipped=arm_view,
        ),
    )
    grasps = add("grasp_planner", GraspPlanner(perception.grasps, period))
    name = target_name(scenario)
    graph = add("declutter_planner", DeclutterPlanner(name, scenario.declutter, period, seen))
    offset = add("arm_offset", ArmOffsetFilter(perception.arm_offset, period))
    seen_arm = add(
        "seen_arm",
        SeenArm(
            arm_view,
            LookedAt(p_W=table.X_WB[:3, 3] * [1.0, 1.0, 0.0], X_WC=places[0]),
            depth_camera(wiring.calibration),
            calibrated_arm(wiring.calibration, TOUCH_ARM),
            _JOINTS,
            partial(touch_arm_view, wiring.calibration),
            perception.registration,
            period,
        ),
    )
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
            X_WArmView,
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
    touched = sensors.encoders[TOUCH_ARM].GetOutputPort("joint_state_measured")
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
        (seen_arm.GetOutputPort("arm_offset"), offset, "arm_offset_seen"),
        (sensors.depth, seen_arm, "depth_measured"),
        (touched, seen_arm, "joint_state_measured"),
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
    return DeclutterControl(segmenter=segmenter, seen_arm=seen_arm, sequence=sequence, move=move)


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
        (look.GetOutputPort("looked"), declutter.seen_arm, "looked"),
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


def _places(arms: BelievedArms, table: ViewRequest) -> list[Array]:
    """Places X_WC (4, 4) from which the camera's arm can look at the table, the highest first."""
    centre = table.X_WB[:3, 3] * [1.0, 1.0, 0.0] + [0.0, 0.0, 0.05]
    found = list(_views(arms, table, centre, _DISTANCE, _ELEVATIONS))
    if not found:
        raise ValueError("the camera's arm cannot look at the table from anywhere")
    return found[:_PLACES]


def _arm_view(arms: BelievedArms, table: ViewRequest) -> Array | None:
    """From where the camera's arm can look at the other one at home X_WC (4, 4), if it can."""
    q = arms.q_home[TOUCH_ARM]
    hand = arms.arms[TOUCH_ARM].Evaluate(np.append(q, np.zeros_like(q))).X_WE[:3, 3]
    return next(_views(arms, table, hand, _ARM_DISTANCE, _ARM_ELEVATIONS), None)


def _views(
    arms: BelievedArms, table: ViewRequest, p_W: Array, distance: float, elevations: Sequence[float]
) -> Iterator[Array]:
    """X_WC (4, 4) from which a place (3,) is seen, one for each elevation [deg] that has any."""
    planner, home = arms.planners[CAMERA_ARM], arms.q_home[CAMERA_ARM]
    planner.look_at(
        {TOUCH_ARM: arms.q_home[TOUCH_ARM]},
        [box_vertices(table.box_edges, RigidTransform(table.X_WB))],
    )
    for elevation in np.deg2rad(elevations):
        for azimuth in np.deg2rad(_AZIMUTHS):
            level = np.cos(elevation)
            out = [level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)]
            X_WC = se3.looking_at(p_W + distance * np.array(out), p_W)
            if planner.posture(RigidTransform(X_WC), [home]) is not None:
                yield X_WC
                break
