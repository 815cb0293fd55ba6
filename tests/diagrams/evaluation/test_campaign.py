import json
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from synthetic_episode import synthetic_episode

from diagrams.crossmodal.scenario import load_scenario
from diagrams.crossmodal.studies.experiments import EXPERIMENTS
from diagrams.evaluation.campaign import (
    Evaluation,
    Workers,
    connect,
    episode_folder,
    open_evaluation_folder,
    prepare,
    run,
)
from diagrams.run import process
from diagrams.run.process import run_apart, run_here, thread_limits
from diagrams.run.run_folder import finished_summary, write_run, write_scenario, write_text
from diagrams.run.yaml_schema import ScenarioError

# Stands for an episode's process: odd seeds die, others take over a summary that was prepared.
WORKER = """
import os, pathlib, shutil, signal, sys
folder = pathlib.Path(sys.argv[1])
seed = int(folder.name[-4:])
prepared = folder.parent / f"prepared-{seed}.json"
with (folder.parent / "runs.txt").open("a") as log: log.write(f"{seed}\\n")
if seed == 3: os.kill(os.getpid(), signal.SIGKILL)
if seed == 5: (folder / "error.txt").write_text("RuntimeError: gave up\\n\\nTraceback"); sys.exit(1)
if seed == 7: sys.exit(3)
if seed == 9: (folder / "summary.json").write_text("{}"); sys.exit()
shutil.copy(prepared, folder / "summary.json")
"""


def evaluation(folder: Path, seeds: list[int], *, force: bool = False) -> Evaluation:
    return prepare("drawer", EXPERIMENTS["drawer"], seeds, folder, force=force)


@pytest.fixture
def fake_worker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that holds the summaries of even seeds, and what was run in `runs.txt`."""
    monkeypatch.setattr(process, "_COMMAND", (sys.executable, "-c", WORKER))
    for scenario in evaluation(tmp_path, [2, 4, 6]).scenarios:
        episode = synthetic_episode(seed=scenario.seed)
        episode.scenario = scenario
        write_run(tmp_path / "made", episode)
        (tmp_path / "made" / "summary.json").rename(tmp_path / f"prepared-{scenario.seed}.json")
    return tmp_path


def runs(folder: Path) -> list[int]:
    return sorted(map(int, (folder / "runs.txt").read_text().split()))


def test_a_dead_worker_is_a_row_and_takes_no_other_along(fake_worker: Path) -> None:
    one = evaluation(fake_worker, [2, 3, 4, 5, 6, 7, 9])
    assert run(one, Workers(jobs=2))
    assert [summary["seed"] for summary in one.summaries] == [2, 3, 4, 5, 6, 7, 9]
    reasons = {summary["seed"]: summary["failure"] for summary in one.summaries}
    assert reasons[3] == "worker died (SIGKILL), see log.txt"
    assert reasons[5] == "RuntimeError: gave up"
    assert reasons[7] == "worker died (exit status 3), see log.txt"
    assert reasons[9] == "the program's files have changed since the evaluation began"
    assert [seed for seed, reason in reasons.items() if reason is None] == [2, 4, 6]


def test_finished_episodes_are_read_back_and_the_others_run_again(fake_worker: Path) -> None:
    assert run(evaluation(fake_worker, [2, 3]), Workers())
    again = evaluation(fake_worker, [2, 3, 4])
    assert run(again, Workers())
    assert runs(fake_worker) == [2, 3, 3, 4]
    assert len(again.summaries) == 3


def test_force_starts_afresh(fake_worker: Path) -> None:
    run(evaluation(fake_worker, [2, 4]), Workers())
    afresh = evaluation(fake_worker, [2], force=True)
    assert not episode_folder(fake_worker, 4).exists()
    run(afresh, Workers())
    assert runs(fake_worker) == [2, 2, 4]


def test_an_interrupt_keeps_what_has_finished(fake_worker: Path) -> None:
    one = evaluation(fake_worker, [2, 4, 6])

    def interrupt(_: object) -> None:
        if len(one.summaries) == 2:
            raise KeyboardInterrupt

    assert not run(one, Workers(), interrupt)
    assert len(one.summaries) == 2
    assert len(runs(fake_worker)) == 2


def test_what_has_finished_is_known_before_anything_is_run(fake_worker: Path) -> None:
    """So that an overview is whole, however early the next run is interrupted."""
    run(evaluation(fake_worker, [2, 3]), Workers())
    assert [one["seed"] for one in evaluation(fake_worker, [2, 3, 4]).summaries] == [2]


def test_an_episode_whose_folder_cannot_be_made_is_a_row(tmp_path: Path) -> None:
    (tmp_path / "seed-0000").write_text("a file")
    summary = run_apart(load_scenario("drawer"), tmp_path / "seed-0000", {})
    assert not summary["success"]
    assert "seed-0000: cannot be written" in summary["failure"]


def test_results_of_another_drake_are_not_mixed_in(tmp_path: Path) -> None:
    scenario = load_scenario("drawer")
    open_evaluation_folder(tmp_path, "drawer", scenario)
    marker = tmp_path / "evaluation.json"
    found = json.loads(marker.read_text())
    found["versions"]["drake"] = "1.0.0"
    marker.write_text(json.dumps(found))
    with pytest.raises(ScenarioError, match=r"results of drake 1\.0\.0, not .*--force"):
        open_evaluation_folder(tmp_path, "drawer", scenario)


def test_a_process_that_is_killed_while_it_runs_is_reported(tmp_path: Path) -> None:
    scenario = load_scenario("drawer")

    def kill() -> None:
        while not process._RUNNING:
            time.sleep(0.01)
        process.stop_running()

    threading.Thread(target=kill).start()
    summary = run_apart(scenario, tmp_path / "seed-0000", {})
    assert summary["failure"] == "worker died (SIGKILL), see log.txt"
    assert not process._RUNNING


def test_an_episode_s_process_ends_with_the_one_that_started_it(tmp_path: Path) -> None:
    write_scenario(tmp_path, load_scenario("drawer"))
    command = [*process._COMMAND, str(tmp_path)]
    root = Path(process.__file__).parents[2]
    with subprocess.Popen(command, stdin=subprocess.PIPE, cwd=root) as child:
        pass  # Closes its input.
    assert child.returncode == 1
    assert not (tmp_path / "summary.json").exists()


def test_what_an_episode_raises_is_kept_with_its_reason_first(tmp_path: Path) -> None:
    write_text(tmp_path / "scenario.yaml", "duratoin: 3\n")
    assert run_here(tmp_path) == 1
    lines = (tmp_path / "error.txt").read_text().splitlines()
    assert "duratoin" in lines[0]
    assert lines[2].startswith("Traceback")


def test_a_written_scenario_is_the_same_when_an_episode_s_process_reads_it(tmp_path: Path) -> None:
    scenario = load_scenario("drawer-lights-off", ["seed=4", "plant.time_step=0.003"])
    episode = synthetic_episode(seed=4)
    episode.scenario = load_scenario(str(write_scenario(tmp_path, scenario)))
    write_run(tmp_path, episode)
    assert finished_summary(tmp_path, scenario) is not None


def test_a_folder_of_other_results_is_refused_unless_forced(tmp_path: Path) -> None:
    folder, scenario = tmp_path / "new", load_scenario("drawer")
    open_evaluation_folder(folder, "drawer", scenario)
    scenario.seed = 9
    open_evaluation_folder(folder, "drawer", scenario)
    with pytest.raises(ScenarioError, match="holds the experiment 'drawer', not 'door'"):
        open_evaluation_folder(folder, "door", scenario)
    other = load_scenario("drawer", ["duration=6"])
    with pytest.raises(ScenarioError, match=r"the scenario with hash.*--force"):
        open_evaluation_folder(folder, "drawer", other)
    open_evaluation_folder(folder, "drawer", other, force=True)
    open_evaluation_folder(folder, "drawer", other)


def test_results_of_another_program_are_refused(tmp_path: Path) -> None:
    scenario = load_scenario("drawer")
    open_evaluation_folder(tmp_path, "drawer", scenario)
    marker = tmp_path / "evaluation.json"
    found = json.loads(marker.read_text())
    marker.write_text(json.dumps(found | {"source_hash": "older"}))
    with pytest.raises(ScenarioError, match="program with source hash 'older'") as caught:
        open_evaluation_folder(tmp_path, "drawer", scenario)
    assert "\n" not in str(caught.value)
    marker.write_text("{")
    with pytest.raises(ScenarioError, match="holds the experiment 'None'"):
        open_evaluation_folder(tmp_path, "drawer", scenario)


def test_a_folder_of_something_else_is_not_taken_for_an_experiment(tmp_path: Path) -> None:
    write_text(tmp_path / "notes.txt", "mine")
    with pytest.raises(ScenarioError, match="already holds files"):
        open_evaluation_folder(tmp_path, "drawer", load_scenario("drawer"))


def test_an_unknown_backend_lists_the_known_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ScenarioError, match="allowed: processes, ray"):
        connect(Workers(backend="rey"))
    with pytest.raises(ScenarioError, match="--address is for --backend ray only"):
        connect(Workers(address="here:1"))
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(ScenarioError, match=r"pip install 'crossmodal\[cluster\]'"):
        connect(Workers(backend="ray"))


def test_an_episode_with_one_core_draws_in_the_thread_that_asks_for_it() -> None:
    assert thread_limits(4)["LP_NUM_THREADS"] == "4"
    assert thread_limits(1)["LP_NUM_THREADS"] == "0"
    assert thread_limits(1)["OPENCV_FOR_THREADS_NUM"] == "1"
