import json
import os
import signal
import subprocess
import sys
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from synthetic_episode import synthetic_episode
from typer.testing import CliRunner

from diagrams import command_line, episode_process
from diagrams.command_line import GentleInterrupt, app
from diagrams.episode_process import failed_summary
from diagrams.experiments import EXPERIMENTS
from diagrams.run_folder import finished_summary, write_scenario
from diagrams.scenario import Scenario
from models import MODELS_DIR

RUNNER = CliRunner()
EXAMPLE = MODELS_DIR / "examples" / "two_drawers.urdf"
Progress = Callable[[float], None] | None


@pytest.fixture(autouse=True)
def work_in_an_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def fake_episode(monkeypatch: pytest.MonkeyPatch) -> types.SimpleNamespace:
    """Replaces the simulation by a synthetic episode; its attributes say how that ends."""
    fake = types.SimpleNamespace(
        failure=None, interrupt=False, error=None, stops_early=False, runs=[]
    )

    def run_episode(
        scenario: Scenario,
        seed: int,
        *,
        meshcat: Any = None,
        progress: Progress = None,
        sensors_file: Path | None = None,
    ) -> Any:
        fake.runs.append((scenario.name, seed, meshcat is not None))
        result = synthetic_episode(seed=seed)
        result.scenario, result.failure = scenario, fake.failure
        result.interrupted = fake.stops_early
        if fake.error is not None:
            raise fake.error
        if progress is not None:
            progress(1.0)
            if fake.interrupt:
                os.kill(os.getpid(), signal.SIGINT)
                try:
                    progress(2.0)
                except KeyboardInterrupt:
                    result.interrupted = True
        return result

    module = types.ModuleType("diagrams.episode")
    module.run_episode = run_episode  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "diagrams.episode", module)
    return fake


def test_help_teaches_by_example_and_needs_no_heavy_import() -> None:
    code = (
        "import sys; from diagrams import command_line;"
        "heavy = {'pydrake', 'numpy', 'torch', 'cv2', 'matplotlib', 'pandas'} & set(sys.modules);"
        "assert not heavy, heavy"
    )
    subprocess.run(
        [sys.executable, "-c", code], check=True, cwd=Path(command_line.__file__).parents[1]
    )
    for command in ([], ["run"], ["replay"], ["evaluate"], ["train", "hand-bending"], ["diagram"]):
        result = RUNNER.invoke(app, [*command, "--help"])
        assert result.exit_code == 0
        assert "crossmodal" in result.output


def test_list_names_the_scenarios() -> None:
    result = RUNNER.invoke(app, ["list"])
    assert result.exit_code == 0
    assert "drawer" in result.output


def test_a_run_writes_its_folder_and_reports_every_modality(
    fake_episode: types.SimpleNamespace,
) -> None:
    result = RUNNER.invoke(app, ["run", "drawer", "--seed", "7", "--no-recording"])
    assert result.exit_code == 0, result.output
    assert fake_episode.runs == [("drawer", 7, False)]
    folder = Path("runs/drawer-seed7")
    assert json.loads((folder / "summary.json").read_text())["seed"] == 7
    for word in ("vision:", "proprioception:", "cross-modal:", "opening error", "real-time factor",
                 str(folder / "summary.json")):  # fmt: skip
        assert word in result.output


def test_a_replay_needs_a_recorded_run() -> None:
    result = RUNNER.invoke(app, ["replay", "runs/none"])
    assert result.exit_code == 2
    assert "runs/none: holds no scenario.yaml" in result.stderr


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
    fake_episode.failure = "the drawer was opened by 12.0 cm of 20.0 cm"
    result = RUNNER.invoke(app, ["run", "drawer", "--out", "here", "--no-recording"])
    assert result.exit_code == 1
    assert "12.0 cm of 20.0 cm" in result.output
    assert json.loads(Path("here/summary.json").read_text())["success"] is False


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


@pytest.mark.parametrize(
    "arguments",
    [
        ["run", "drawr"],
        ["run", "none.yaml"],
        ["run", "malformed.yaml"],
        ["run", "drawer", "--set", "sensors.encoders.noise_positio=1"],
        ["run", "drawer", "--set", "plant.time_step=0"],
        ["run", "drawer", "--set", "object.model=none.sdf"],
        ["run", "drawer", "--set", "object.handle_frame=none"],
        ["run", "drawer", "--modalities", "vision,smell"],
        ["run", "drawer", "--duration", "-3"],
        ["run", "drawer", "--out", "malformed.yaml/run"],
        ["evaluate", "cupboard"],
        ["evaluate", "drawer", "--seeds", "a:b"],
        ["evaluate", "drawer", "--seeds", "5:5"],
        ["evaluate", "drawer", "--backend", "rey"],
        ["evaluate", "drawer", "--set", "duratoin=3"],
        ["diagram", "drawer", "--modality", "touch"],
        ["diagram", "drawer", "--out", "malformed.yaml"],
    ],
)
def test_bad_input_is_answered_in_one_line_with_status_two(
    arguments: list[str], fake_episode: types.SimpleNamespace
) -> None:
    Path("malformed.yaml").write_text("a: [1\n")
    sys.modules["diagrams.episode"].build_networks = None  # type: ignore[attr-defined]
    sys.modules["diagrams.episode"].build_station = None  # type: ignore[attr-defined]
    result = RUNNER.invoke(app, arguments)
    assert result.exit_code == 2, result.output
    assert result.stderr.startswith("crossmodal: ")
    assert result.stderr.count("\n") == 1
    assert fake_episode.runs == []
    assert sorted(path.name for path in Path().iterdir()) == ["malformed.yaml"]


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


@pytest.mark.parametrize("arguments", [["run"], ["run", "drawer", "--sed", "3"], ["fly"],
                                       ["run", "drawer", "--seed", "x"]])  # fmt: skip
def test_bad_options_are_answered_in_one_line_with_status_two(
    arguments: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["crossmodal", *arguments])
    assert command_line.main() == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("crossmodal: ")
    assert captured.err.count("\n") == 1


def test_an_interrupt_waits_for_the_step_to_end_and_a_second_one_does_not() -> None:
    before = signal.getsignal(signal.SIGINT)
    with GentleInterrupt() as interrupt:
        interrupt.check()
        os.kill(os.getpid(), signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            interrupt.check()
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before


@pytest.fixture
def in_this_process(monkeypatch: pytest.MonkeyPatch, fake_episode: types.SimpleNamespace) -> None:
    """Lets an evaluation's episodes run in the test's own process."""

    def run_apart(scenario: Scenario, folder: Path, environment: Any) -> dict[str, Any]:
        write_scenario(folder, scenario)
        episode_process.run_here(folder)
        if fake_episode.stops_early:
            raise KeyboardInterrupt
        summary = finished_summary(folder, scenario)
        return summary or failed_summary(scenario, episode_process._reason(folder, 1))

    monkeypatch.setattr(episode_process, "run_apart", run_apart)


@pytest.mark.usefixtures("in_this_process")
def test_evaluate_goes_on_where_it_was_and_reports_failures(
    fake_episode: types.SimpleNamespace,
) -> None:
    command = ["evaluate", "drawer", "--seeds", "3:5", "--out", "here"]
    first = RUNNER.invoke(app, command)
    assert first.exit_code == 0, first.output
    assert "| configuration error at the end |" in first.output
    assert len(fake_episode.runs) == 2
    fake_episode.error = RuntimeError("the solver\ngave up")
    second = RUNNER.invoke(app, [*command[:3], "3:6", *command[4:]])
    assert second.exit_code == 1
    assert len(fake_episode.runs) == 3
    assert "| 5 | RuntimeError: the solver gave up |" in second.output
    assert "2/3" in second.output
    assert "gave up" in Path("here/seed-0005/error.txt").read_text()


@pytest.mark.usefixtures("in_this_process")
def test_an_interrupted_evaluation_stops_and_its_table_has_what_was_finished(
    fake_episode: types.SimpleNamespace,
) -> None:
    command = ["evaluate", "drawer", "--out", "here", "--seeds"]
    assert RUNNER.invoke(app, [*command, "3:4"]).exit_code == 0
    fake_episode.stops_early = True
    stopped = RUNNER.invoke(app, [*command, "3:6"])
    assert stopped.exit_code == 130
    assert "interrupted after 1 episode(s)" in stopped.stderr
    assert "# drawer: 1 episode, seeds 3" in stopped.stdout
    assert len(fake_episode.runs) == 2


@pytest.mark.usefixtures("in_this_process")
def test_all_experiments_end_in_one_table_and_single_ones_are_taken_over(
    fake_episode: types.SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = {name: EXPERIMENTS[name] for name in ("drawer", "drawer-lights-off")}
    monkeypatch.setattr("diagrams.experiments.EXPERIMENTS", kept)
    assert RUNNER.invoke(app, ["evaluate", "drawer", "--seeds", "1"]).exit_code == 0
    result = RUNNER.invoke(app, ["evaluate", "all", "--seeds", "1"])
    assert result.exit_code == 0, result.output
    assert [name for name, *_ in fake_episode.runs] == ["drawer", "drawer-lights-off"]
    assert "| all | 2/2 (100 %) |" in result.output
    assert Path("runs/evaluate/report.html").is_file()
    assert Path("runs/evaluate/drawer/report.html").is_file()
