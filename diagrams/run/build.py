"""What a scenario names, built: the station and the estimators."""

import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from pydrake.systems.framework import System

from crossmodal.diagrams.run.application import Application, Station
from crossmodal.diagrams.run.calibration import Calibration
from crossmodal.diagrams.run.own_code import place_of
from crossmodal.diagrams.run.scenario import Scenario
from crossmodal.diagrams.run.variants import check_variants, with_variants
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, one_line, suggestion


class StationWarning(UserWarning):
    """What a user should know of a station before it runs."""


@contextmanager
def building(source: str) -> Iterator[None]:
    """Turns what systems and models refuse while a Diagram is built into a ScenarioError.

    Args:
        source: The scenario's name or file.
    """
    try:
        yield
    except (ValueError, RuntimeError, OSError, SystemExit) as error:
        # By a SystemExit with words Drake's demands fail, which values from files should not meet.
        if isinstance(error, SystemExit) and not isinstance(error.code, str):
            raise
        place = f"{place_of(error)}: " if place_of(error) else ""
        raise ScenarioError(f"{source}: {place}{one_line(error)}") from error


def build_estimators(
    application: Application, scenario: Scenario, calibration: Calibration | None = None
) -> Mapping[str, System]:
    """The estimators of a scenario, by name.

    Raises:
        ScenarioError: where a value of the scenario is impossible.
    """
    with building(scenario.name):
        calibration = calibration or application.make_calibration(scenario)
        estimators = application.make_estimators(scenario, calibration)
    originals = [name for name in estimators if name not in scenario.variants]
    check_variants(scenario.variants, originals, scenario.name)
    names = with_variants(scenario.modalities or list(estimators), scenario.variants)
    for name in names:
        if name in scenario.variants and name not in estimators:
            raise ScenarioError(
                f"{scenario.name}: variants.{name}: the application '{application.name}' has no"
                " filters that can be replaced: its make_estimators makes no such estimator"
            )
        if name not in estimators:
            raise ScenarioError(
                f"{scenario.name}: modalities: unknown modality '{name}';"
                f" {suggestion(name, estimators)}"
            )
    return {name: estimators[name] for name in names}


def build_station(
    application: Application, scenario: Scenario, calibration: Calibration | None = None
) -> Station:
    """The plant, sensors and controllers of one episode.

    Raises:
        ScenarioError: where a value of the scenario is impossible.
    """
    with building(scenario.name):
        calibration = calibration or application.make_calibration(scenario)
        station = application.make_station(scenario, calibration)
    for line in station.warnings:
        warnings.warn(f"{scenario.name}: {line}", StationWarning, stacklevel=2)
    return station
