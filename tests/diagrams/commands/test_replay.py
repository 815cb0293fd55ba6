from pathlib import Path

from typer.testing import CliRunner

from diagrams.applications import load_scenario
from diagrams.command_line import app
from diagrams.run.run_folder import write_scenario

RUNNER = CliRunner()


def test_a_replay_needs_a_recorded_run() -> None:
    result = RUNNER.invoke(app, ["replay", "runs/none"])
    assert result.exit_code == 2
    assert "runs/none: holds no scenario.yaml" in result.stderr


def test_a_replay_does_not_replace_the_run_itself() -> None:
    write_scenario(Path("run"), *load_scenario("drawer"))
    Path("run/sensors.mcap").touch()
    result = RUNNER.invoke(app, ["replay", "run", "--out", "run", "--force"])
    assert result.exit_code == 2
    assert "--out run: holds the recorded run itself" in result.stderr
    assert Path("run/sensors.mcap").exists()


def test_a_recording_that_is_cut_off_is_refused_and_leaves_no_folder() -> None:
    write_scenario(Path("run"), *load_scenario("drawer"))
    Path("run/sensors.mcap").write_bytes(b"\x89MCAP0\r\n" + 64 * b"\x00")
    result = RUNNER.invoke(app, ["replay", "run"])
    assert result.exit_code == 2
    assert result.stderr.startswith("crossmodal: run/sensors.mcap: cannot be read")
    assert result.stderr.count("\n") == 1
    assert not Path("run/replay").exists()
