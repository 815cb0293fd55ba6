"""Faults of a scenario reach the estimators, in an episode as in its replay, and nobody else."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from crossmodal.diagrams.applications import OWN, load_scenario
from crossmodal.diagrams.evaluation.run_writer import write_run
from crossmodal.diagrams.run.episode import run_episode
from crossmodal.diagrams.run.folder.run_folder import SENSORS_FILE
from crossmodal.diagrams.run.recorded_scenario import check_replaced
from crossmodal.diagrams.run.replay import replay
from crossmodal.diagrams.run.scenario import Disturbances
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
from crossmodal.systems.sensors.stream_fault import StreamFault

PENDULUM = Path(__file__).parents[2] / "pendulum" / "pendulum.py"
SHORT = ["duration=2.0"]
BIASED = StreamFault(stream="state_window", kind="biased", start=1.0, size=[0.5])


@pytest.fixture(scope="module", autouse=True)
def _pendulum() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(OWN, str(PENDULUM))
        yield


def angles(table: pd.DataFrame) -> np.ndarray:
    return table[table.modality == "open"].sort_values("time").estimate.to_numpy()


def test_a_fault_changes_what_is_perceived_from_its_start_on(tmp_path: Path) -> None:
    application, scenario = load_scenario("swing", SHORT)
    failing = replace(scenario, disturbances=Disturbances(faults=[BIASED]))
    healthy = application.evaluate(run_episode(application, scenario)).estimates
    record = run_episode(application, failing, sensors_file=tmp_path / SENSORS_FILE)
    results = application.evaluate(record)
    write_run(tmp_path, application, record, results)
    before = int(1.0 / scenario.network_period - 1e-9) + 1
    perceived, usual = angles(results.estimates), angles(healthy)
    np.testing.assert_array_equal(perceived[:before], usual[:before])
    assert np.min(perceived[before + 5 :] - usual[before + 5 :]) > 0.1

    # What the sensors measured is recorded, and fails again on its way when it is replayed.
    again = application.evaluate(replay(application, tmp_path, failing)).estimates
    mended = application.evaluate(replay(application, tmp_path, scenario)).estimates
    shared = len(perceived) - 2
    np.testing.assert_allclose(angles(again)[:shared], perceived[:shared], atol=1e-9)
    np.testing.assert_allclose(angles(mended)[:shared], usual[:shared], atol=1e-9)
    check_replaced(application, ["disturbances.faults=[]"])
    with pytest.raises(ScenarioError, match="only perception"):
        check_replaced(application, ["disturbances.lights_off=[]"])


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        (StreamFault(stream="state_widow", kind="silent"), "did you mean 'state_window'"),
        (StreamFault(stream="cheat_state", kind="silent"), "no stream 'cheat_state'"),
        (StreamFault(stream="state_window", kind="silen"), "there are silent"),
    ],
)
def test_faults_that_cannot_be_are_refused_in_one_line(fault: StreamFault, message: str) -> None:
    application, scenario = load_scenario("swing", SHORT)
    with pytest.raises(ScenarioError, match=message):
        run_episode(application, replace(scenario, disturbances=Disturbances(faults=[fault])))
