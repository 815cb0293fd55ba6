"""A network whose streams fail says so in time, and claims no more than what is left can tell."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.crossmodal.application import APPLICATION
from crossmodal.diagrams.run.application import Results
from crossmodal.diagrams.run.replay import replay
from crossmodal.systems.sensors.stream_fault import StreamFault

FAULTS = {
    "joint_state": StreamFault(stream="joint_state_window", kind="silent", start=4.5, end=5.2),
    "wrench": StreamFault(stream="wrench_window", kind="nan", start=5.0, end=5.6),
    "pressure": StreamFault(stream="pressure_window", kind="stuck", start=5.4, end=6.0),
    "depth": StreamFault(stream="depth_measured", kind="biased", start=5.8, end=6.4, size=[0.02]),
    "color": StreamFault(stream="color_measured", kind="delayed", start=6.5, end=6.9, size=[0.3]),
}
# Sensors that jump, and stay where they are.
JUMPS = {
    "joint_state": StreamFault(
        stream="joint_state_window", kind="biased", start=4.6, size=[0.05] * 7 + [0.0] * 7
    ),
    "wrench": StreamFault(
        stream="wrench_window", kind="biased", start=5.2, size=[0.5] * 3 + [5.0] * 3
    ),
    "pressure": StreamFault(stream="pressure_window", kind="biased", start=5.6, size=[5e3]),
    "color": StreamFault(stream="color_measured", kind="biased", start=6.0, size=[40.0]),
}


@pytest.fixture(scope="module")
def failing(recorded_run: Path) -> Results:
    """The recorded drawer, perceived while one stream after another fails."""
    return perceived(recorded_run, FAULTS)


@pytest.fixture(scope="module")
def jumped(recorded_run: Path) -> Results:
    """The recorded drawer, perceived while one stream after another jumps for good."""
    return perceived(recorded_run, JUMPS)


def perceived(recorded_run: Path, faults: dict[str, StreamFault]) -> Results:
    _, scenario = load_scenario(str(recorded_run / "scenario.yaml"), ["modalities=[crossmodal]"])
    disturbances = replace(scenario.disturbances, faults=list(faults.values()))
    record = replay(APPLICATION, recorded_run, replace(scenario, disturbances=disturbances))
    return APPLICATION.evaluate(record)


def test_every_fault_is_told_within_a_fifth_of_a_second_and_ends_in_time(failing: Results) -> None:
    told = {fault["stream"]: fault for fault in failing.summary["stream_faults"]}
    assert set(told) == set(FAULTS)
    for stream, fault in FAULTS.items():
        assert 0.0 <= told[stream]["start"] - fault.start <= 0.21, stream
        assert 0.0 <= told[stream]["end"] - fault.end <= 0.11, stream


@pytest.mark.parametrize("results", ["failing", "jumped"])
def test_the_truth_stays_inside_what_is_claimed(
    results: str, request: pytest.FixtureRequest
) -> None:
    table: pd.DataFrame = request.getfixturevalue(results).estimates
    chosen = table[table.quantity == "configuration"]
    deviations = ((chosen.estimate - chosen.truth).abs() / chosen["std"]).dropna()
    assert len(deviations) > 50
    assert np.mean(deviations < 3.0) > 0.95


def test_what_jumps_for_good_is_told_at_once_and_stays_in_use(jumped: Results) -> None:
    told = {fault["stream"]: fault for fault in jumped.summary["stream_faults"]}
    assert set(told) == set(JUMPS)
    for stream, fault in JUMPS.items():
        assert 0.0 <= told[stream]["start"] - fault.start <= 0.21, stream
    table = jumped.estimates
    ages = table[(table.quantity == "stream_age") & table.component.isin(list(JUMPS))]
    assert ages.estimate.max() < 0.1  # [s]


def test_faults_are_events_rows_and_lines(failing: Results) -> None:
    assert any(event.name.startswith("wrench: ") for event in failing.events)
    table = failing.estimates
    ages = table[(table.quantity == "stream_age") & (table.component == "joint_state")]
    assert ages.estimate.max() > 0.5
    summary = {**failing.summary, "modalities": {}}
    assert any("depth: the depth of what stands still" in line for line in failing.report(summary))
