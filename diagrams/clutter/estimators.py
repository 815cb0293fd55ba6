"""The estimators of the clutter application, and the planner of touches."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path

from pydrake.systems.framework import DiagramBuilder, System

from crossmodal.diagrams.clutter.rig import MeasuringRig
from crossmodal.diagrams.clutter.scenario import Scenario, generator, target_mesh
from crossmodal.diagrams.run.application import Station
from crossmodal.diagrams.run.calibration import (
    Calibration,
    calibrated,
)
from crossmodal.diagrams.run.scenario import CameraConfig
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
from crossmodal.systems.active.touch_planner import TouchPlanner
from crossmodal.systems.active.view_planner import ViewPlanner
from crossmodal.systems.pose.evidence import Table
from crossmodal.systems.pose.pose_belief import SolverConfig
from crossmodal.systems.pose.pose_estimators import (
    PoseEstimator,
    quaternion_filter,
    sampled_density,
)
from crossmodal.systems.pose.quaternion_filter import QuaternionFilterConfig
from crossmodal.systems.pose.target_model import TargetModel, TargetModelError, load_target


@cache
def _loaded(path: Path, scale: float) -> TargetModel:
    return load_target(path, scale)


def load_model(scenario: Scenario) -> TargetModel:
    """The object's model, which estimators know.

    Raises:
        ScenarioError: for a mesh that cannot be a target.
    """
    try:
        return _loaded(target_mesh(scenario), scenario.target.scale)
    except TargetModelError as error:
        raise ScenarioError(str(error)) from None


def believed_table(scenario: Scenario) -> Table | None:
    """The table as it is believed to be; its true height is zero."""
    if not scenario.table.known:
        return None
    error = scenario.table.height_error * generator(scenario, "table").normal()
    return Table(height=float(error), height_sigma=max(scenario.table.height_error, 1e-4))


def make_calibration(scenario: Scenario) -> Calibration:
    """The camera, whose pose on the flange is known up to the believed errors."""
    config = scenario.cameras.get("camera", CameraConfig())
    camera = calibrated(config.camera(), scenario.calibration.believed)
    return Calibration(cameras={"camera": camera}, noise=scenario.calibration.noise)


def make_estimators(scenario: Scenario, calibration: Calibration) -> Mapping[str, System]:
    """One for each of the scenario's modalities."""
    model, table = load_model(scenario), believed_table(scenario)
    inferences = {
        "density": sampled_density(SolverConfig()),
        "quaternion": quaternion_filter(QuaternionFilterConfig()),
    }
    return {
        name: PoseEstimator(model, inferences[name], table, scenario.network_period)
        for name in scenario.modalities
    }


def make_station(scenario: Scenario, calibration: Calibration) -> Station:
    """The rig, and the planners that say where to look and to touch next."""
    model, table = load_model(scenario), believed_table(scenario)
    builder = DiagramBuilder()
    rig = builder.AddNamedSystem("rig", MeasuringRig(scenario, calibration, model))
    height = None if table is None else table.height
    config = scenario.touches
    planner = builder.AddNamedSystem(
        "planner", TouchPlanner(model, config, height, scenario.network_period, scenario.seed)
    )
    builder.Connect(planner.GetOutputPort("touch_latest"), rig.GetInputPort("touch"))
    views = builder.AddNamedSystem(
        "views", ViewPlanner(model, scenario.views, scenario.network_period, scenario.seed)
    )
    for name in ("pose_guess", "pose_measurement"):
        builder.Connect(rig.GetOutputPort(name), views.GetInputPort(name))
    builder.Connect(views.GetOutputPort("view_latest"), rig.GetInputPort("view"))
    builder.ExportOutput(views.GetOutputPort("view_latest"), "view_latest")
    builder.ExportInput(planner.GetInputPort("object_pose"), "object_pose")
    for name in ("pose_measurement", "pose_guess", "task_status", "cheat_object_pose"):
        builder.ExportOutput(rig.GetOutputPort(name), name)
    builder.ExportOutput(planner.GetOutputPort("touch_latest"), "touch_latest")
    return Station(diagram=builder.Build())


def close_loop(
    builder: DiagramBuilder,
    scenario: Scenario,
    station: System,
    estimators: Mapping[str, System],
) -> None:
    """Touches are planned by what the first estimator believes."""
    first = estimators[scenario.modalities[0]]
    pose = first.GetOutputPort("object_pose_latest")
    builder.Connect(pose, station.GetInputPort("object_pose"))
