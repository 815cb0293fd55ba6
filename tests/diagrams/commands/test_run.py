import errno
import json
import types
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from crossmodal.diagrams.command_line import app
from crossmodal.models import MODELS_DIR

RUNNER = CliRunner()
EXAMPLE = MODELS_DIR / "examples" / "two_drawers.urdf"


def test_a_run_writes_its_folder_and_reports_every_modality(
    fake_episode: types.SimpleNamespace,
) -> None:
    result = RUNNER.invoke(app, ["run", "drawer", "--seed", "7", "--no-recording"])
    assert result.exit_code == 0, result.output
    assert fake_episode.runs == [("drawer", 7, False)]
    folder = Path("runs/drawer-seed7")
    assert json.loads((folder / "summary.json").read_text())["seed"] == 7
    for word in ("vision:", "proprioception:", "cross-modal:", "configuration error",
                 "real-time factor", str(folder / "summary.json")):  # fmt: skip
        assert word in result.output


def test_a_second_run_into_the_same_folder_needs_force(fake_episode: types.SimpleNamespace) -> None:
    command = ["run", "drawer", "--out", "here", "--no-recording"]
    assert RUNNER.invoke(app, command).exit_code == 0
    before = Path("here/summary.json").read_bytes()
    refused = RUNNER.invoke(app, command)
    assert refused.exit_code == 2
    assert refused.stderr.count("\n") == 1
    assert "--force" in refused.stderr
    assert Path("here/summary.json").read_bytes() == before
    assert len(fake_episode.runs) == 1
    assert RUNNER.invoke(app, [*command, "--force"]).exit_code == 0


def test_an_episode_that_misses_its_task_exits_with_one_and_keeps_its_files(
    fake_episode: types.SimpleNamespace,
) -> None:
    fake_episode.duration = 10.0
    result = RUNNER.invoke(app, ["run", "drawer", "--out", "here", "--no-recording"])
    assert result.exit_code == 1
    assert "The episode failed: opened 12.0 cm of the 20 cm asked for when" in result.output
    assert json.loads(Path("here/summary.json").read_text())["success"] is False


def test_an_episode_that_was_given_too_little_time_is_said_to_have_had_it(
    fake_episode: types.SimpleNamespace,
) -> None:
    fake_episode.duration = 10.0
    result = RUNNER.invoke(
        app, ["run", "drawer", "--out", "here", "--no-recording", "--duration", "10"]
    )
    assert result.exit_code == 1
    assert "The 10 s that the episode may take were over: opened" in result.output
    assert "failed" not in result.output


def test_an_interrupted_run_keeps_what_there_is_and_says_so(
    fake_episode: types.SimpleNamespace,
) -> None:
    fake_episode.interrupt = True
    result = RUNNER.invoke(app, ["run", "drawer", "--out", "here", "--no-recording"])
    assert result.exit_code == 130
    assert "interrupted at" in result.stderr
    assert json.loads(Path("here/summary.json").read_text())["interrupted"] is True


def test_an_interrupt_before_anything_was_recorded_leaves_no_folder(
    fake_episode: types.SimpleNamespace,
) -> None:
    fake_episode.error = KeyboardInterrupt()
    result = RUNNER.invoke(app, ["run", "drawer", "--out", "here", "--no-recording"])
    assert result.exit_code == 130
    assert result.stderr.count("\n") == 1
    assert not Path("here").exists()


def test_an_own_object_takes_the_place_of_the_scenarios_and_its_changes_are_told(
    fake_episode: types.SimpleNamespace,
) -> None:
    command = ["run", "drawer", "--object", str(EXAMPLE), "--no-recording", "--out", "here"]
    refused = RUNNER.invoke(app, command)
    assert refused.exit_code == 2
    assert refused.stderr.count("\n") == 1
    assert "left_handle" in refused.stderr
    result = RUNNER.invoke(app, [*command, "--grasp-frame", "right_handle"])
    assert result.exit_code == 0, result.output
    assert "crossmodal: warning: two_drawers.urdf: no inertia" in result.stderr
    assert "joint: right_slide" in Path("here/scenario.yaml").read_text()
    assert Path("here/model/object.sdf").is_file()


def test_options_about_an_object_need_one(fake_episode: types.SimpleNamespace) -> None:
    result = RUNNER.invoke(app, ["run", "drawer", "--joint", "hinge"])
    assert result.exit_code == 2
    assert "--object FILE" in result.stderr
    assert fake_episode.runs == []


def test_a_full_disk_is_said_in_one_line(fake_episode: types.SimpleNamespace) -> None:
    fake_episode.error = OSError(errno.ENOSPC, "No space left on device")
    result = RUNNER.invoke(app, ["run", "drawer", "--out", "full"])
    assert result.exit_code == 1
    assert "no space left" in result.stderr.splitlines()[-1]
    assert "Traceback" not in result.output


def test_what_a_station_warns_of_is_said_in_one_line(fake_episode: types.SimpleNamespace) -> None:
    fake_episode.warning = "drawer: link 'front' starts 3 cm inside 'palm'"
    result = RUNNER.invoke(app, ["run", "drawer", "--out", "here", "--no-recording"])
    assert result.exit_code == 0, result.output
    lines = [line for line in result.stderr.splitlines() if "palm" in line]
    assert lines == [f"crossmodal: warning: {fake_episode.warning}"]


def test_how_long_and_which_modalities_can_be_said_in_short(
    fake_episode: types.SimpleNamespace,
) -> None:
    command = ["run", "drawer", "--out", "here", "--no-recording", "--duration", "3"]
    assert RUNNER.invoke(app, [*command, "--modalities", "crossmodal, vision"]).exit_code == 0
    written = yaml.safe_load(Path("here/scenario.yaml").read_text())
    assert written["duration"] == 3.0
    assert written["modalities"] == ["vision", "crossmodal"]


def test_force_never_touches_what_no_run_has_written(fake_episode: types.SimpleNamespace) -> None:
    Path("model").mkdir()
    Path("model/mine.sdf").write_text("mine")
    result = RUNNER.invoke(app, ["run", "drawer", "--out", ".", "--force", "--no-recording"])
    assert result.exit_code == 2
    assert "no run that --force could replace" in result.stderr
    assert [path.as_posix() for path in Path().rglob("*")] == ["model", "model/mine.sdf"]


def test_what_was_perceived_is_said_and_kept_where_the_pictures_do_not_fit(
    fake_episode: types.SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("crossmodal.diagrams.drawing.plot_style.save", full)
    result = RUNNER.invoke(app, ["run", "drawer", "--out", "here", "--no-recording"])
    assert result.exit_code == 1
    assert "Perceived joint:" in result.output
    assert json.loads(Path("here/summary.json").read_text())["success"] is True
    lines = result.stderr.splitlines()
    assert (
        "crossmodal: here/figures/errors.png: cannot be written: No space left on device" in lines
    )


def test_an_error_while_drawing_is_said_in_one_line_after_the_results(
    fake_episode: types.SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise IndexError("list index out of range")

    monkeypatch.setattr("crossmodal.diagrams.crossmodal.results.plots.draw_errors", fail)
    result = RUNNER.invoke(app, ["run", "drawer", "--out", "here", "--no-recording"])
    assert result.exit_code == 1
    assert "Perceived joint:" in result.output
    assert result.stderr == (
        "crossmodal: here/figures/errors.png: cannot be drawn: IndexError: list index out of"
        " range\n"
    )
    assert Path("here/figures/frames.png").exists()
