"""What directs and moves both arms: planners of views and touches, looking, touching."""

from dataclasses import dataclass

import numpy as np
from pydrake.math import RigidTransform
from pydrake.systems.framework import OutputPort

from crossmodal.controllers.primitives.arm_task import believed_obstacles
from crossmodal.controllers.primitives.guarded_touch import GuardedTouch, touch_lines
from crossmodal.controllers.primitives.look import Look
from crossmodal.diagrams.clutter.robot_config import (
    CAMERA_ARM,
    LOOKER,
    TOUCH_ARM,
    TOUCHER,
)
from crossmodal.diagrams.clutter.station.believed_arms import BelievedArms
from crossmodal.diagrams.clutter.station.declutter_control import (
    DeclutterControl,
    connect_declutter,
)
from crossmodal.diagrams.clutter.station.robot_sensors import RobotSensors
from crossmodal.diagrams.clutter.station.wiring import StationWiring
from crossmodal.diagrams.run.record import TaskStatus
from crossmodal.diagrams.stations.connections import connect_alike, export_input
from crossmodal.diagrams.stations.drives import add_drives
from crossmodal.diagrams.stations.task_status import add_task_status
from crossmodal.maths.arrays import Array
from crossmodal.models.gripper_taxels import tip_taxels
from crossmodal.systems.active.touch_planner import TouchPlanner
from crossmodal.systems.active.view_planner import ViewPlanner
from crossmodal.systems.port_values import (
    NO_PROGRESS,
    DeclutterProgress,
    TouchRequest,
    ViewRequest,
)
from crossmodal.systems.pose.evidence import Table
from crossmodal.systems.pose.target_model import TargetModel

# Inputs of the station by which a person changes what the arms do: see `ArmTask`, `GuardedTouch`.
CAMERA_PACE, TOUCH_PACE, MOVE_PACE = "camera_pace", "touch_pace", "move_pace"
APPROACH_SPEED, CONTACT_THRESHOLD = "approach_speed", "contact_threshold"


@dataclass(frozen=True, kw_only=True)
class RobotControl:
    """What directs and moves the arms.

    Attributes:
        views: Chooses views.
        touches: Chooses touches.
        look: Moves the arm with the camera.
        touch: Moves the arm with the taxels.
    """

    views: ViewPlanner
    touches: TouchPlanner
    look: Look
    touch: GuardedTouch


def add_control(
    wiring: StationWiring,
    model: TargetModel,
    table: Table | None,
    sensors: RobotSensors,
    believed: BelievedArms,
    guess: OutputPort,
    displaced: Array,
    declutter: DeclutterControl | None,
) -> RobotControl:
    """Adds planners and controllers; exports what is planned, the grid and `touch_end`.

    The station's input `object_pose` is what is believed of the object; further ones, which may
    stay unconnected, are a person's.

    Args:
        model: Of the object.
        table: As believed.
        sensors: Of the robots.
        believed: What the robots know of their arms.
        guess: `pose_guess`.
        displaced: (6, m) by which twist in W contacts are displaced per error of the calibration.
        declutter: What clears the way before; None where there is nothing to be cleared.
    """
    builder, scenario = wiring.builder, wiring.scenario
    config, period, seed = scenario.control, scenario.network_period, scenario.seed
    arms, planners, q_home = believed.arms, believed.planners, believed.q_home

    def can_look(request: ViewRequest) -> bool:
        planner = planners[CAMERA_ARM]
        planner.look_at({TOUCH_ARM: q_home[TOUCH_ARM]}, believed_obstacles(request))
        guesses = [q_home[CAMERA_ARM]]
        return planner.posture(RigidTransform(request.X_WC), guesses) is not None

    def can_touch(request: TouchRequest) -> bool:
        others = {CAMERA_ARM: q_home[CAMERA_ARM]}
        planner, guesses = planners[TOUCH_ARM], [q_home[TOUCH_ARM]]
        return any(True for _ in touch_lines(planner, request, guesses, others, config.touch))

    add = builder.AddNamedSystem
    views = add("views", ViewPlanner(model, scenario.views, period, seed, can_look))
    height = None if table is None else table.height
    touches = add(
        "planner",
        TouchPlanner(model, scenario.touches, height, period, seed, can_touch, displaced),
    )
    joints = {name: arm.num_joints for name, arm in arms.items()}
    look = add(
        "look",
        Look(
            config.look,
            arms[CAMERA_ARM],
            planners[CAMERA_ARM],
            q_home[CAMERA_ARM],
            {TOUCH_ARM: joints[TOUCH_ARM]},
        ),
    )
    touch = add(
        "guarded_touch",
        GuardedTouch(
            config.touch,
            arms[TOUCH_ARM],
            planners[TOUCH_ARM],
            q_home[TOUCH_ARM],
            {CAMERA_ARM: joints[CAMERA_ARM]},
            sensors.taxels.size() // 3,
            tip_taxels(),
        ),
    )
    add_drives(wiring, LOOKER, CAMERA_ARM, sensors.encoders[CAMERA_ARM], look)
    view = views.GetOutputPort("view_latest")
    if declutter is None:
        add_drives(wiring, TOUCHER, TOUCH_ARM, sensors.encoders[TOUCH_ARM], touch)
    else:
        connect_declutter(wiring, declutter, sensors, look, touch, view, q_home[TOUCH_ARM])
        view = declutter.sequence.GetOutputPort("view_latest")
        for planner in (views, touches):
            connect_alike(builder, declutter.sequence, "obstacles", planner)
    measured = {
        name: encoders.GetOutputPort("joint_state_measured")
        for name, encoders in sensors.encoders.items()
    }
    connections = [
        (guess, views, "pose_guess"),
        (view, look, "view_latest"),
        (sensors.depth, look, "depth_measured"),
        (views.GetOutputPort("view_latest"), touches, "view_latest"),
        (touches.GetOutputPort("touch_latest"), look, "touch_latest"),
        (touches.GetOutputPort("touch_latest"), touch, "touch_latest"),
        (measured[TOUCH_ARM], look, f"{TOUCH_ARM}_joint_state_measured"),
        (measured[CAMERA_ARM], touch, f"{CAMERA_ARM}_joint_state_measured"),
        (sensors.taxels, touch, "taxel_measured"),
        (look.GetOutputPort("is_away"), touch, "is_clear"),
    ]
    for source, system, port in connections:
        builder.Connect(source, system.GetInputPort(port))
    export_input(builder, "object_pose", touches, views)
    movers = [] if declutter is None else [declutter.move]
    for name, system, port in (
        (CAMERA_PACE, look, "pace"),
        (TOUCH_PACE, touch, "pace"),
        *((MOVE_PACE, move, "pace") for move in movers),
        (APPROACH_SPEED, touch, "approach_speed"),
        (CONTACT_THRESHOLD, touch, "contact_threshold"),
    ):
        builder.ExportInput(system.GetInputPort(port), name)
    builder.ExportOutput(view, "view_latest")
    builder.ExportOutput(views.GetOutputPort("grid_latest"), "grid_latest")
    builder.ExportOutput(touches.GetOutputPort("touch_latest"), "touch_latest")
    builder.ExportOutput(touch.GetOutputPort("touch_end"), "touch_end")
    clearing = {}
    if declutter is not None:
        clearing = {
            "move": declutter.move.GetOutputPort("phase"),
            "stuck": declutter.move.GetOutputPort("failure"),
            "progress": declutter.sequence.GetOutputPort("declutter_progress"),
        }
    add_task_status(
        builder,
        _status,
        {
            **clearing,
            "look": look.GetOutputPort("phase"),
            "touch": touch.GetOutputPort("phase"),
            "wanted": touches.GetOutputPort("touch_latest"),
            "is_done": touch.GetOutputPort("is_done"),
            "failure": touch.GetOutputPort("failure"),
            "in_the_way": look.GetOutputPort("failure"),
        },
    )
    return RobotControl(views=views, touches=touches, look=look, touch=touch)


def _status(
    look: str,
    touch: str,
    wanted: TouchRequest,
    is_done: Array,
    failure: str,
    in_the_way: str,
    move: str = "",
    stuck: str = "",
    progress: DeclutterProgress = NO_PROGRESS,
) -> TaskStatus:
    unseen = progress.why if progress.done and not progress.found else ""
    stops = in_the_way or stuck or unseen
    done = bool(np.asarray(is_done)[0] > 0.5 or stops)
    return TaskStatus(phase=move or touch or look, done=done, note=failure or stops or wanted.why)
