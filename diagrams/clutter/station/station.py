"""The station of the clutter application: robots on a table, or a rig in their place."""

from collections.abc import Mapping

from pydrake.systems.framework import DiagramBuilder, System

from crossmodal.diagrams.clutter.scenario import Scenario
from crossmodal.diagrams.clutter.station.rig_station import make_rig_station
from crossmodal.diagrams.clutter.station.robot_station import make_robot_station
from crossmodal.diagrams.run.application import Station
from crossmodal.diagrams.run.calibration import Calibration


def make_station(scenario: Scenario, calibration: Calibration) -> Station:
    """The one that the scenario names."""
    make = make_robot_station if scenario.station == "robots" else make_rig_station
    return make(scenario, calibration)


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
