"""A recorded run drives the network again; other wirings on the very same measurements."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from numpy.testing import assert_allclose

from crossmodal.diagrams.applications import load_recorded
from crossmodal.diagrams.crossmodal.application import APPLICATION
from crossmodal.diagrams.crossmodal.episode_parts import TOPICS
from crossmodal.diagrams.crossmodal.estimators import CROSSMODAL_CONNECTIONS, make_network
from crossmodal.diagrams.crossmodal.scenario import Scenario
from crossmodal.diagrams.evaluation.run_writer import summarise, write_run
from crossmodal.diagrams.joints.joint_metrics import JointEpisode, joint_episode
from crossmodal.diagrams.run.build import build_estimators
from crossmodal.diagrams.run.folder.run_folder import ESTIMATES_FILE, SENSORS_FILE, SUMMARY_FILE
from crossmodal.diagrams.run.record import Tick
from crossmodal.diagrams.run.replay import check_recorded, replay
from crossmodal.diagrams.run.sensor_streams.log import (
    SensorLog,
    SensorLogWriter,
    SensorReplay,
    Stream,
    make_streams,
)
from crossmodal.diagrams.run.wiring import stream_models
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
from crossmodal.systems.port_values import HELD_BODY, BodyMotion

WIRINGS: dict[str, tuple[str, list[str]]] = {
    "crossmodal": ("crossmodal", []),
    "proprioception": ("proprioception", []),
    "unguided": ("crossmodal", ["held_body_to_vision"]),
    "separate": ("crossmodal", list(CROSSMODAL_CONNECTIONS)),
}


def scenario_of(folder: Path, *changes: str) -> Scenario:
    return load_recorded(folder, changes)[1]


def streams(scenario: Scenario) -> list[Stream]:
    """Those that a recording of the scenario holds but for the pictures'."""
    estimators = build_estimators(APPLICATION, scenario)
    return make_streams(stream_models(estimators, APPLICATION.station_quantities(scenario)), TOPICS)


@pytest.fixture(scope="module")
def replayed(recorded_run: Path) -> JointEpisode:
    scenario = scenario_of(recorded_run)
    calibration = APPLICATION.make_calibration(scenario)
    networks = {
        name: make_network(
            modality,
            replace(scenario.perception, cut=cut),
            calibration,
            scenario.network_period,
        )
        for name, (modality, cut) in WIRINGS.items()
    }
    return joint_episode(replay(APPLICATION, recorded_run, scenario, networks))


@pytest.mark.parametrize("modality", ["proprioception", "crossmodal"])
def test_a_replay_believes_what_the_episode_believed(
    recorded_run: Path, replayed: JointEpisode, modality: str
) -> None:
    then = pd.read_parquet(recorded_run / ESTIMATES_FILE)
    now = APPLICATION.evaluate(replayed.record).estimates
    keys = ["time", "quantity", "component"]
    tables = [
        table[(table.modality == modality) & (table.quantity == "configuration")].round({"time": 6})
        for table in (then, now)
    ]
    both = tables[0].merge(tables[1], on=keys, how="outer", indicator=True)
    assert (both._merge == "both").all()
    assert len(both) > 20
    assert_allclose(both.estimate_x, both.estimate_y, atol=5e-6)
    assert_allclose(both.truth_x, both.truth_y, atol=1e-12)


def test_a_replay_reports_what_the_run_came_to(recorded_run: Path, replayed: JointEpisode) -> None:
    record = replayed.record
    then = json.loads((recorded_run / SUMMARY_FILE).read_text())
    now = summarise(APPLICATION, record, APPLICATION.evaluate(record))
    for key in ("success", "failure", "phases"):
        assert now[key] == then[key]
    for key in ("events", "duration"):  # To the last bit.
        assert now[key] == then[key]
    run = pd.read_parquet(recorded_run / ESTIMATES_FILE)
    ticks = run[run.modality == "crossmodal"].time.unique().tolist()
    assert [tick.time for tick in record.estimators["crossmodal"].ticks] == ticks


def last_ticks(replayed: JointEpisode) -> dict[str, Tick]:
    return {name: record.ticks[-1] for name, record in replayed.record.estimators.items()}


def held_body(tick: Tick) -> BodyMotion | None:
    bodies = tick.values["body_motions_latest"].bodies
    return next((body for body in bodies if body.body_id == HELD_BODY), None)


def held_features(replayed: JointEpisode, name: str) -> int:
    """Most features that ever belonged to the body in the hand."""
    bodies = map(held_body, replayed.record.estimators[name].ticks)
    return max(len(body.feature_ids) for body in bodies if body is not None)


def test_features_join_the_body_in_the_hand_only_through_its_prior(
    replayed: JointEpisode,
) -> None:
    assert held_features(replayed, "crossmodal") >= 4
    assert held_features(replayed, "unguided") == 0


def test_without_that_prior_less_is_known_in_the_dark(replayed: JointEpisode) -> None:
    """What vision has seen of the axis stays; where the body has gone is less certain."""
    angle = {name: replayed.series[name].axis_error[-1] for name in WIRINGS}
    std = {name: replayed.series[name].configuration_std[-1] for name in WIRINGS}
    assert max(angle["crossmodal"], angle["unguided"]) < np.deg2rad(1.0) < angle["separate"]
    assert std["unguided"] > 2.0 * std["crossmodal"]


def test_with_every_wire_cut_the_hand_learns_nothing_from_the_eye(replayed: JointEpisode) -> None:
    poses = {}
    for name, tick in last_ticks(replayed).items():
        body = held_body(tick)
        assert body is not None
        poses[name] = body.motion.X
    assert_allclose(poses["separate"], poses["proprioception"], atol=1e-12)
    assert np.abs(poses["crossmodal"] - poses["proprioception"]).max() > 1e-5


@pytest.fixture(scope="module")
def real_recording(recorded_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same streams as a real robot would have recorded them: no truth, no task's status."""
    folder = tmp_path_factory.mktemp("real")
    shutil.copy(recorded_run / "scenario.yaml", folder)
    scenario = scenario_of(recorded_run, "modalities=[proprioception]")
    known = [
        stream
        for stream in streams(scenario)
        if not stream.port.startswith("cheat_") and stream.port != "task_status"
    ]
    log = SensorLog(recorded_run / SENSORS_FILE, known)
    writer = SensorLogWriter(folder / SENSORS_FILE)
    period = scenario.network_period
    for tick in range(int(log.end / period + 1e-6) + 1):
        values = log.read(tick * period, period)
        for stream in log.streams:
            writer.write(stream, values[stream.port], tick * period)
    writer.close()
    return folder


def test_a_recording_without_truth_is_perceived_and_no_errors_are_claimed(
    recorded_run: Path, real_recording: Path, tmp_path: Path
) -> None:
    scenario = scenario_of(real_recording, "modalities=[proprioception]")
    record = replay(APPLICATION, real_recording, scenario)
    assert record.events == []
    ports = {port for tick in record.station for port in tick.values}
    assert ports == {"interaction_active"}
    results = APPLICATION.evaluate(record)
    assert results.success is None
    now, then = (
        table[(table.modality == "proprioception") & (table.quantity == "configuration_rate")]
        for table in (results.estimates, pd.read_parquet(recorded_run / ESTIMATES_FILE))
    )
    assert len(now) > 20
    assert_allclose(np.abs(now.estimate), np.abs(then.estimate), atol=1e-5)
    assert results.estimates.truth.isna().all()
    write_run(tmp_path, APPLICATION, record, results)
    summary = json.loads((tmp_path / SUMMARY_FILE).read_text())
    assert summary["success"] is None
    (joint,) = summary["modalities"]["proprioception"]["joints"]
    assert joint["type_estimated"] == "prismatic"
    assert joint["configuration_estimated"] is not None
    for key, value in joint.items():
        if key.endswith("_true") or "_error" in key:
            assert value in (None, [None] * 3), key
    assert summary["phases"]["exploration"]["error"] is None
    report = "\n".join(results.report(summary))
    assert "prismatic" in report
    assert "Against the truth" not in report
    assert not (tmp_path / "figures" / "errors.png").exists()


def test_a_stream_that_an_estimator_needs_is_missed_by_its_name(real_recording: Path) -> None:
    scenario = scenario_of(real_recording, "modalities=[vision]")
    missing = r"holds no stream '\w+', which the estimator 'vision' reads: record it again"
    with pytest.raises(ScenarioError, match=missing):
        replay(APPLICATION, real_recording, scenario)


@pytest.mark.parametrize(
    "change",
    ["network_period: 0.1", "cameras: {camera: {width: 320}}", "sensors: {wrench: {period: 0.02}}"],
)
def test_a_scenario_that_was_changed_since_is_refused_with_the_key(
    recorded_run: Path, tmp_path: Path, change: str
) -> None:
    document = yaml.safe_load((recorded_run / "scenario.yaml").read_text())
    for part in ("perception", "sensors"):  # Their ticks follow the network's.
        document.pop(part)
    ((key, value),) = yaml.safe_load(change).items()
    if isinstance(value, dict) and key in document:
        document[key]["camera"] |= value["camera"]
    else:
        document[key] = value
    (tmp_path / "scenario.yaml").write_text(yaml.safe_dump(document))
    (tmp_path / SENSORS_FILE).symlink_to(recorded_run / SENSORS_FILE)
    with pytest.raises(ScenarioError, match=r"scenario\.yaml: [\w.]+ = .* recorded with") as caught:
        replay(APPLICATION, tmp_path, scenario_of(tmp_path))
    assert f": {key}" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_replay_cannot_change_what_was_measured(recorded_run: Path) -> None:
    with pytest.raises(ScenarioError, match=r"objects\.drawer\.friction.*only perception"):
        load_recorded(recorded_run, ["objects.drawer.friction=3"])
    for change in ("perception.cut=[]", "modalities=[vision]", "calibration.believed.latency=1"):
        load_recorded(recorded_run, [change])


def test_a_folder_without_a_recording_says_how_to_make_one(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"scenario\.yaml; name the folder"):
        check_recorded(tmp_path)
    (tmp_path / "scenario.yaml").write_text("name: a\n")
    with pytest.raises(ScenarioError, match="--record-sensors"):
        check_recorded(tmp_path)


def test_between_ticks_the_last_ticks_values_stay(recorded_run: Path) -> None:
    known = streams(scenario_of(recorded_run))
    source = SensorReplay(SensorLog(recorded_run / SENSORS_FILE, known), 1 / 15)
    context = source.CreateDefaultContext()
    port = source.GetOutputPort("joint_state_window")
    context.SetTime(2.0)
    at_tick = port.Eval(context).times
    assert_allclose(at_tick[-1], 2.0)
    assert 13 <= len(at_tick) <= 14
    context.SetTime(2.05)
    assert_allclose(port.Eval(context).times, at_tick)
    context.SetTime(2.0 + 1 / 15)
    assert_allclose(port.Eval(context).times[0], at_tick[-1] + 0.005)
