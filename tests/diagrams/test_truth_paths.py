"""Nothing true reaches an estimator or controller, by wires or by references, in any scenario."""

from collections.abc import Callable
from functools import partial
from typing import Any

import pytest
from pydrake.systems.framework import Diagram, System
from truth_paths import truth_paths, truth_references

from crossmodal.diagrams.applications import load_scenario, scenario_files
from crossmodal.diagrams.run.episode import Episode

# How many things lie around changes no wire, but a heap takes more than a minute to come to rest.
SMALLER = {name: ["clutter.count=1", "clutter.tries=1"] for name in ("clutter", "declutter")}


def built(name: str) -> Episode:
    application, scenario = load_scenario(name, SMALLER.get(name, []))
    return Episode(application, scenario)


@pytest.fixture(scope="module")
def episode() -> Episode:
    return built("drawer")


@pytest.mark.parametrize("name", sorted(scenario_files()))
def test_nothing_true_reaches_the_robot(name: str) -> None:
    diagram = built(name).diagram
    assert truth_paths(diagram) == []
    assert truth_references(diagram) == []


def a_filter(episode: Episode) -> System:
    network = episode.estimators["crossmodal"]
    assert isinstance(network, Diagram)
    return network.GetSubsystemByName("kinematic_model")


@pytest.mark.parametrize(
    ("hold", "found"),
    [
        (lambda plant, scene_graph, camera_scene: plant, "the simulation's MultibodyPlant"),
        (
            lambda plant, scene_graph, camera_scene: {"scene": [scene_graph]},
            "the simulation's SceneGraph",
        ),
        (lambda plant, scene_graph, camera_scene: camera_scene, "the simulation's SceneGraph"),
        (
            lambda plant, scene_graph, camera_scene: plant.GetBodyByName("wrist"),
            "of the simulated plant",
        ),
        (
            lambda plant, scene_graph, camera_scene: partial(print, plant.CreateDefaultContext()),
            "a context of the simulation's MultibodyPlant",
        ),
        (
            lambda plant, scene_graph, camera_scene: plant.CalcTotalMass,
            "the simulation's MultibodyPlant",
        ),
    ],
)
def test_a_reference_to_the_simulated_world_is_found(
    episode: Episode, hold: Callable[[Any, Any, Any], Any], found: str
) -> None:
    station = episode.station.diagram
    world = [station.GetSubsystemByName(name) for name in ("plant", "scene_graph", "camera_scene")]
    guilty: Any = a_filter(episode)
    guilty.kept = hold(*world)
    try:
        (line,) = [line for line in truth_references(episode.diagram) if found in line]
        assert line.startswith("KinematicModel.kept")
    finally:
        del guilty.kept
    assert truth_references(episode.diagram) == []
