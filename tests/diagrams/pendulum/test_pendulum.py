"""An application of a user's own, from one file: all commands know it, and none of its nouns."""

from pathlib import Path

import pandas as pd
import pytest
from numpy.testing import assert_allclose
from typer.testing import CliRunner

from diagrams.applications import OWN, load_scenario, read_run
from diagrams.command_line import app
from diagrams.evaluation.metric_table import tidy_metrics
from diagrams.run.episode import run_episode
from diagrams.run.run_folder import summarise

RUNNER = CliRunner()
FILE = Path(__file__).with_name("pendulum.py")


@pytest.fixture(autouse=True)
def in_an_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(OWN, str(FILE))


def test_it_is_listed_with_its_scenario_and_its_experiment() -> None:
    result = RUNNER.invoke(app, ["list"])
    assert result.exit_code == 0, result.output
    assert "pendulum: a pendulum swings" in result.output
    assert result.output.count("swing  ") == 2


def test_it_is_run_and_what_was_recorded_is_perceived_again() -> None:
    command = ["run", "swing", "--out", "a", "--record-sensors", "--no-recording", "--seed", "3"]
    result = RUNNER.invoke(app, [*command, "--duration", "2"])
    assert result.exit_code == 0, result.output
    for name in ("scenario.yaml", "estimates.parquet", "summary.json", "sensors.mcap"):
        assert Path("a", name).is_file()
    assert Path("a/figures/angle.png").read_bytes().startswith(b"\x89PNG")
    assert "stubborn: angle" in result.output
    again = RUNNER.invoke(app, ["replay", "a"])
    assert again.exit_code == 0, again.output
    then, now = (pd.read_parquet(Path(folder, "estimates.parquet")) for folder in ("a", "a/replay"))
    assert_allclose(now.estimate, then.estimate, atol=1e-12)
    assert_allclose(now.truth, then.truth, atol=1e-12)
    assert read_run(Path("a")).scenario.noise == 0.02


def test_its_own_keys_can_be_set_and_bad_ones_are_refused() -> None:
    _, scenario = load_scenario("swing", ["noise=0.1"])
    assert scenario.noise == 0.1
    result = RUNNER.invoke(app, ["run", "swing", "--set", "nois=0.1"])
    assert result.exit_code == 2
    assert "unknown key 'nois'; did you mean 'noise'?" in result.stderr


def test_an_object_of_a_users_own_has_no_place_in_it() -> None:
    Path("thing.urdf").write_text("<robot name='thing'/>")
    result = RUNNER.invoke(app, ["run", "swing", "--object", "thing.urdf"])
    assert result.exit_code == 2
    assert "'swing' has no object to be replaced" in result.stderr
    assert result.stderr.count("\n") == 1


def test_its_experiment_is_repeated_over_seeds_with_its_own_metrics() -> None:
    command = ["evaluate", "swing", "--seeds", "3:5", "--out", "e", "--set", "duration=2"]
    result = RUNNER.invoke(app, command)
    assert result.exit_code == 0, result.output
    assert "| angle, rms error |" in result.output
    assert "# swing: 2 episodes, seeds 3, 4" in result.output
    table = pd.read_csv("e/results.csv")
    assert set(table.modality.dropna()) == {"stubborn", "open"}
    page = Path("e/report.html").read_text()
    assert "data:image/png;base64" in page


def test_its_metrics_are_computed_for_each_of_its_estimators() -> None:
    application, scenario = load_scenario("swing", ["duration=5", "seed=1"])
    record = run_episode(application, scenario)
    summary = summarise(application, record, application.evaluate(record))
    figures = tidy_metrics(application, "swing", [summary])
    error = figures[figures.metric == "angle_rms_error"].set_index("modality").value
    assert set(error.index) == {"stubborn", "open"}
    # The encoder alone has 0.02 rad.
    assert 0.0 < error["open"] < 0.02
    assert error["stubborn"] != error["open"]


def test_a_meshcat_is_no_use_without_a_scene() -> None:
    result = RUNNER.invoke(app, ["run", "swing", "--out", "a", "--duration", "1"])
    assert result.exit_code == 0, result.output
    assert not Path("a/meshcat.html").exists()
