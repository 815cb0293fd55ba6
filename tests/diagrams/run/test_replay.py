"""A recorded run drives the network again; other wirings on the very same measurements."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose

from diagrams.crossmodal.estimators import CROSSMODAL_WIRES
from diagrams.joints.joint_metrics import joint_series
from diagrams.joints.joint_record import estimates_table, summarise
from diagrams.run.record import EpisodeResult
from diagrams.run.replay import SensorReplay, Wiring, load_recorded_scenario, replay
from diagrams.run.run_folder import ESTIMATES_FILE, SENSORS_FILE, SUMMARY_FILE
from diagrams.run.sensor_log import SensorLog
from diagrams.run.yaml_schema import ScenarioError
from systems.port_values import HELD_BODY

WIRINGS = {
    "crossmodal": Wiring(),
    "proprioception": Wiring(modality="proprioception"),
    "unguided": Wiring(cut=["held_body_to_vision"]),
    "separate": Wiring(cut=list(CROSSMODAL_WIRES)),
}


@pytest.fixture(scope="module")
def replayed(recorded_run: Path) -> EpisodeResult:
    return replay(recorded_run, load_recorded_scenario(recorded_run), WIRINGS)


@pytest.mark.parametrize("modality", ["proprioception", "crossmodal"])
def test_a_replay_believes_what_the_episode_believed(
    recorded_run: Path, replayed: EpisodeResult, modality: str
) -> None:
    then, now = pd.read_parquet(recorded_run / ESTIMATES_FILE), estimates_table(replayed)
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


def test_a_replay_reports_what_the_run_came_to(recorded_run: Path, replayed: EpisodeResult) -> None:
    then, now = json.loads((recorded_run / SUMMARY_FILE).read_text()), summarise(replayed)
    for key in ("success", "failure", "phases", "events"):
        assert now[key] == then[key]


def held_features(replayed: EpisodeResult, name: str) -> int:
    """Most features that ever belonged to the body in the hand."""
    return max(
        len(body.feature_ids)
        for tick in replayed.modalities[name].ticks
        for body in tick.bodies.bodies
        if body.body_id == HELD_BODY
    )


def test_features_join_the_body_in_the_hand_only_through_its_prior(
    replayed: EpisodeResult,
) -> None:
    assert held_features(replayed, "crossmodal") >= 4
    assert held_features(replayed, "unguided") == 0


def test_without_that_prior_the_axis_is_worse_in_the_dark(replayed: EpisodeResult) -> None:
    angle = {
        name: joint_series(replayed.modalities[name].ticks, replayed.truth).axis_error[-1]
        for name in ("crossmodal", "unguided")
    }
    assert angle["crossmodal"] < np.deg2rad(1.0)
    assert not angle["unguided"] < 2.0 * angle["crossmodal"]  # True, too, without any axis.


def test_with_every_wire_cut_the_hand_learns_nothing_from_the_eye(replayed: EpisodeResult) -> None:
    ticks = {name: record.ticks[-1] for name, record in replayed.modalities.items()}
    separate, alone = (
        next(body for body in ticks[name].bodies.bodies if body.body_id == HELD_BODY)
        for name in ("separate", "proprioception")
    )
    assert_allclose(separate.motion.X, alone.motion.X, atol=1e-12)
    crossmodal = ticks["crossmodal"].bodies.bodies[0]
    assert np.abs(crossmodal.motion.X - alone.motion.X).max() > 1e-5


def test_a_replay_cannot_change_what_was_measured(recorded_run: Path) -> None:
    with pytest.raises(ScenarioError, match=r"object\.friction.*only perception"):
        load_recorded_scenario(recorded_run, ["object.friction=3"])


def test_a_folder_without_a_recording_says_how_to_make_one(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"scenario\.yaml; name the folder"):
        load_recorded_scenario(tmp_path)
    (tmp_path / "scenario.yaml").write_text("name: a\n")
    with pytest.raises(ScenarioError, match="--record-sensors"):
        load_recorded_scenario(tmp_path)


def test_between_ticks_the_last_ticks_values_stay(recorded_run: Path) -> None:
    source = SensorReplay(SensorLog(recorded_run / SENSORS_FILE), 1 / 15)
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
