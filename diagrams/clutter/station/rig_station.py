"""A station without robots: the measuring rig, and the planners that direct it."""

from pydrake.systems.framework import DiagramBuilder

from crossmodal.diagrams.clutter.estimators import believed_table, load_model
from crossmodal.diagrams.clutter.scenario import Scenario
from crossmodal.diagrams.clutter.station.rig import MeasuringRig, finger_displacements
from crossmodal.diagrams.run.application import Station
from crossmodal.diagrams.run.calibration import Calibration
from crossmodal.diagrams.stations.connections import export_input
from crossmodal.systems.active.touch_planner import TouchPlanner
from crossmodal.systems.active.view_planner import ViewPlanner


def make_rig_station(scenario: Scenario, calibration: Calibration) -> Station:
    """The rig, and the planners that say where to look and to touch next."""
    model, table = load_model(scenario), believed_table(scenario)
    builder = DiagramBuilder()
    rig = builder.AddNamedSystem("rig", MeasuringRig(scenario, calibration, model))
    height = None if table is None else table.height
    config = scenario.touches
    planner = builder.AddNamedSystem(
        "planner",
        TouchPlanner(
            model,
            config,
            height,
            scenario.network_period,
            scenario.seed,
            displaced=finger_displacements(scenario),
        ),
    )
    builder.Connect(planner.GetOutputPort("touch_latest"), rig.GetInputPort("touch"))
    views = builder.AddNamedSystem(
        "views", ViewPlanner(model, scenario.views, scenario.network_period, scenario.seed)
    )
    for name in ("pose_guess", "pose_measurement"):
        builder.Connect(rig.GetOutputPort(name), views.GetInputPort(name))
    builder.Connect(views.GetOutputPort("view_latest"), rig.GetInputPort("view"))
    for port in ("view_latest", "grid_latest"):
        builder.ExportOutput(views.GetOutputPort(port), port)
    builder.Connect(views.GetOutputPort("view_latest"), planner.GetInputPort("view_latest"))
    export_input(builder, "object_pose", planner, views)
    for name in ("pose_measurement", "pose_guess", "task_status", "cheat_object_pose"):
        builder.ExportOutput(rig.GetOutputPort(name), name)
    builder.ExportOutput(planner.GetOutputPort("touch_latest"), "touch_latest")
    return Station(diagram=builder.Build())
