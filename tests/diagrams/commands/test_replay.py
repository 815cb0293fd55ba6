from typer.testing import CliRunner

from diagrams.command_line import app

RUNNER = CliRunner()


def test_a_replay_needs_a_recorded_run() -> None:
    result = RUNNER.invoke(app, ["replay", "runs/none"])
    assert result.exit_code == 2
    assert "runs/none: holds no scenario.yaml" in result.stderr
