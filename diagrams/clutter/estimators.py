"""The estimators of the clutter application, and what robots believe of themselves."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.systems.framework import System

from crossmodal.diagrams.clutter.own_mesh import target_mass
from crossmodal.diagrams.clutter.robot_config import CAMERA_ARM, ROBOTS
from crossmodal.diagrams.clutter.scenario import Scenario, generator, target_mesh
from crossmodal.diagrams.run.calibration import (
    Calibration,
    calibrated,
)
from crossmodal.diagrams.run.scenario import CameraConfig
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
from crossmodal.diagrams.stations.believed_robots import believed_robots
from crossmodal.diagrams.stations.filters import Filters, MakeFilter
from crossmodal.systems.pose.evidence import Table
from crossmodal.systems.pose.pose_belief import SolverConfig
from crossmodal.systems.pose.pose_estimators import (
    PoseEstimator,
    quaternion_filter,
    sampled_density,
)
from crossmodal.systems.pose.quaternion_filter import QuaternionFilterConfig
from crossmodal.systems.pose.target_model import TargetModel, TargetModelError, load_target

# What is left of an encoder's offset behind the gears, once the joints are mastered so well that
# the end-effector is off by half a millimetre and 0.05 deg, [rad].
_JOINT_OFFSET = float(np.deg2rad(0.1))


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
    """Camera and arms, as the scene places them, and how well that is taken to be known."""
    cameras = scenario.cameras or {"camera": CameraConfig()}
    if scenario.station == "robots":
        scene = scenario.plant.scene
        found = believed_robots(scenario, scene, ROBOTS, cameras, _JOINT_OFFSET)
        # W is where the camera's arm stands.
        looker = replace(found.arms[CAMERA_ARM], covariance=np.zeros((6, 6)))
        return replace(found, arms={**found.arms, CAMERA_ARM: looker})
    believed = scenario.calibration.believed
    return Calibration(
        cameras={name: calibrated(config.camera(), believed) for name, config in cameras.items()},
        noise=scenario.calibration.noise,
    )


def make_estimators(scenario: Scenario, calibration: Calibration) -> Mapping[str, System]:
    """One for each of the scenario's modalities."""
    model, table = load_model(scenario), believed_table(scenario)
    inferences = {
        "density": sampled_density(SolverConfig()),
        "quaternion": quaternion_filter(QuaternionFilterConfig()),
    }
    # What the rig touches does not move.
    moved = 0.0
    if scenario.station == "robots":
        moved = scenario.perception.moved / target_mass(scenario)
    return {
        name: _make_estimator(
            name,
            scenario.replacements(name),
            model,
            inferences[scenario.original(name)],
            table,
            scenario.network_period,
            moved,
        )
        for name in scenario.modalities
    }


def _make_estimator(name: str, replacements: Mapping[str, MakeFilter], *arguments: Any) -> System:
    """A pose estimator, or what takes its place as `pose_estimator`."""
    filters = Filters(replacements)
    estimator = filters.make("pose_estimator", PoseEstimator, *arguments)
    filters.check(name)
    return estimator
