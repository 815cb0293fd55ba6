import json
from pathlib import Path
from typing import Any

import pytest
from synthetic_episode import synthetic_episode
from typer.testing import CliRunner

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.command_line import app
from crossmodal.diagrams.run.folder.run_folder import write_scenario

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


@pytest.mark.parametrize(
    ("duration", "with_truth", "status", "said"),
    [
        (16.0, True, 0, ""),
        (10.0, True, 1, "The episode failed: opened 12.0 cm of the 20 cm"),
        (10.0, False, 0, "Whether the task was done is not known"),
    ],
)
def test_a_replay_gives_the_verdict_of_its_run_or_none(
    duration: float, with_truth: bool, status: int, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def replay(application: Any, folder: Path, scenario: Any, **_: Any) -> Any:
        record = synthetic_episode(duration=duration)
        record.scenario = scenario
        for tick in record.station:
            if not with_truth:
                tick.values = {k: v for k, v in tick.values.items() if "cheat_" not in k}
        return record

    monkeypatch.setattr("crossmodal.diagrams.run.replay.replay", replay)
    write_scenario(Path("run"), *load_scenario("drawer"))
    Path("run/sensors.mcap").touch()
    result = RUNNER.invoke(app, ["replay", "run"])
    assert result.exit_code == status, result.output
    assert said in result.output
    success = json.loads(Path("run/replay/summary.json").read_text())["success"]
    assert success is {"": True, "T": False, "W": None}[said[:1]]
