"""The robots' station with clutter: its objects rest at no cost, and the truth about them."""

import numpy as np
import pytest
from pydrake.math import RigidTransform

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.clutter.scenario import Scenario, object_names
from crossmodal.diagrams.clutter.station import robot_station
from crossmodal.diagrams.run.application import Results
from crossmodal.diagrams.run.episode import run_episode
from crossmodal.diagrams.run.record import EpisodeRecord
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
from crossmodal.maths.arrays import Array

CHANGES = [
    "seed=3",
    "target.object=oil",
    "modalities=[density]",
    "clutter.count=2",
    "duration=0.4",
    "guess.translation=[0.0, 0.001]",
]


def _apart(scenario: Scenario) -> dict[str, RigidTransform]:
    """The target and the others upright in a row."""
    names = ["oil", *object_names(scenario)]
    return {name: RigidTransform([0.5, 0.2 * k, 0.0]) for k, name in enumerate(names)}


@pytest.fixture(scope="module")
def ran() -> tuple[EpisodeRecord, Results]:
    """Somebody pushes the first of the others."""
    application, scenario = load_scenario("clutter", CHANGES)
    pushed = object_names(scenario)[0]
    frame = f"{pushed}::{pushed}"
    force = f"disturbances.forces=[{{frame: '{frame}', force: [0, 0, 20], start: 0.1}}]"
    application, scenario = load_scenario("clutter", [*CHANGES, force])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(robot_station, "clutter_poses", _apart)
        record = run_episode(application, scenario)
    return record, application.evaluate(record)


def _places(record: EpisodeRecord, name: str) -> Array:
    return np.array([X.translation() for X in record.station_values(f"cheat_{name}_pose")])


def test_the_truth_about_each_object_is_recorded(ran: tuple[EpisodeRecord, Results]) -> None:
    record, _ = ran
    for k, name in enumerate(["object", *object_names(record.scenario)]):
        np.testing.assert_allclose(_places(record, name)[0], [0.5, 0.2 * k, 0.0], atol=1e-9)


def test_what_nobody_touches_stays_where_it_is(ran: tuple[EpisodeRecord, Results]) -> None:
    record, _ = ran
    for name in ("object", object_names(record.scenario)[1]):
        assert np.ptp(_places(record, name), axis=0).max() < 1e-5


def test_what_somebody_pushes_from_outside_moves(ran: tuple[EpisodeRecord, Results]) -> None:
    record, _ = ran
    assert np.ptp(_places(record, object_names(record.scenario)[0])[:, 2]) > 0.05


def test_the_summary_says_how_dense_the_clutter_is(ran: tuple[EpisodeRecord, Results]) -> None:
    record, results = ran
    clutter = results.summary["clutter"]
    assert clutter["objects"] == object_names(record.scenario)
    assert clutter["density"]["hidden_above"] == 0.0
    assert clutter["density"]["touching"] == 0


@pytest.mark.parametrize(
    "changes",
    [["station=rig"], ["table.known=false"], ["target.mesh=any.obj"]],
)
def test_clutter_lies_on_a_table_before_robots_around_goods(changes: list[str]) -> None:
    with pytest.raises(ScenarioError, match=r"clutter\.count = 8"):
        load_scenario("clutter", changes)
