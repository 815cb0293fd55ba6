import json
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from synthetic_episode import synthetic_episode

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.crossmodal.application import APPLICATION
from crossmodal.diagrams.evaluation.campaign import (
    Campaign,
    Workers,
    connect,
    episode_folder,
    prepare,
    run,
)
from crossmodal.diagrams.evaluation.run_writer import write_run
from crossmodal.diagrams.run import process
from crossmodal.diagrams.run.folder.run_folder import finished_summary, write_scenario
from crossmodal.diagrams.run.folder.written_files import write_text
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError

# Stands for an episode's process: odd seeds die, others take over a run that was prepared.
WORKER = """
import os, pathlib, shutil, signal, sys
folder = pathlib.Path(sys.argv[1])
seed = int(folder.name[-4:])
prepared = folder.parent.parent / f"prepared-{seed}"
with (folder.parent / "runs.txt").open("a") as log: log.write(f"{seed}\\n")
if seed == 3: os.kill(os.getpid(), signal.SIGKILL)
if seed == 5: (folder / "error.txt").write_text("RuntimeError: gave up\\n\\nTraceback"); sys.exit(1)
if seed == 7: sys.exit(3)
if seed == 9: (folder / "summary.json").write_text("{}"); sys.exit()
shutil.copytree(prepared, folder, dirs_exist_ok=True)
"""


def campaign(folder: Path, seeds: list[int], *, force: bool = False) -> Campaign:
    return prepare("drawer", *_drawer(), seeds, folder, force=force)


@cache
def _drawer() -> tuple[Any, Any]:
    return load_scenario("drawer")


@pytest.fixture
def fake_worker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that holds the runs of even seeds, and what was run in `runs.txt`."""
    monkeypatch.setattr(process, "_COMMAND", (sys.executable, "-c", WORKER))
    folder = tmp_path / "here"
    for scenario in campaign(folder, [2, 4, 6]).scenarios:
        record = synthetic_episode(seed=scenario.seed)
        record.scenario = scenario
        results = replace(APPLICATION.evaluate(record), plots={})
        write_run(tmp_path / f"prepared-{scenario.seed}", APPLICATION, record, results)
    return folder


def runs(folder: Path) -> list[int]:
    return sorted(map(int, (folder / "runs.txt").read_text().split()))


def test_a_dead_worker_is_a_row_and_takes_no_other_along(fake_worker: Path) -> None:
    one = campaign(fake_worker, [2, 3, 4, 5, 6, 7, 9])
    assert run(one, Workers(jobs=2))
    assert [summary["seed"] for summary in one.summaries] == [2, 3, 4, 5, 6, 7, 9]
    reasons = {summary["seed"]: summary["failure"] for summary in one.summaries}
    assert reasons[3] == "worker died (SIGKILL), see log.txt"
    assert reasons[5] == "RuntimeError: gave up"
    assert reasons[7] == "worker died (exit status 3), see log.txt"
    assert reasons[9] == "the program's files have changed since the evaluation began"
    assert [seed for seed, reason in reasons.items() if reason is None] == [2, 4, 6]


def test_finished_episodes_are_read_back_and_the_others_run_again(fake_worker: Path) -> None:
    assert run(campaign(fake_worker, [2, 3]), Workers())
    again = campaign(fake_worker, [2, 3, 4])
    assert run(again, Workers())
    assert runs(fake_worker) == [2, 3, 3, 4]
    assert len(again.summaries) == 3


def _garbled(data: bytes) -> bytes:
    third = len(data) // 3
    return (
        data[:third] + bytes(255 - byte for byte in data[third : third + 40]) + data[third + 40 :]
    )


@pytest.mark.parametrize("name", ["summary.json", "estimates.parquet", "scenario.yaml", "log.txt"])
@pytest.mark.parametrize(
    "damage",
    [
        pytest.param(None, id="lost"),
        pytest.param(lambda data: b"", id="empty"),
        pytest.param(lambda data: data[: len(data) // 2], id="cut"),
        pytest.param(lambda data: bytes(len(data)), id="zeros"),
        pytest.param(_garbled, id="garbled"),
    ],
)
def test_an_episode_that_is_not_whole_runs_again_wherever_the_folder_is(
    fake_worker: Path, tmp_path: Path, name: str, damage: Callable[[bytes], bytes] | None
) -> None:
    assert run(campaign(fake_worker, [2, 4]), Workers())
    moved = tmp_path / "elsewhere"
    fake_worker.rename(moved)
    path = episode_folder(moved, 2) / name
    if damage is None:
        path.unlink()
    else:
        path.write_bytes(damage(path.read_bytes()))
    again = campaign(moved, [2, 4])
    whole = name == "log.txt"
    assert [summary["seed"] for summary in again.summaries] == ([2, 4] if whole else [4])
    assert run(again, Workers())
    assert runs(moved) == ([2, 4] if whole else [2, 2, 4])
    assert len(campaign(moved, [2, 4]).summaries) == 2


def test_force_starts_afresh(fake_worker: Path) -> None:
    run(campaign(fake_worker, [2, 4]), Workers())
    afresh = campaign(fake_worker, [2], force=True)
    assert not episode_folder(fake_worker, 4).exists()
    run(afresh, Workers())
    assert runs(fake_worker) == [2, 2, 4]


def test_force_removes_nothing_behind_a_link(fake_worker: Path, tmp_path: Path) -> None:
    run(campaign(fake_worker, [2]), Workers())
    mine = tmp_path / "mine"
    episode_folder(fake_worker, 2).rename(mine)
    episode_folder(fake_worker, 2).symlink_to(mine)
    campaign(fake_worker, [2], force=True)
    assert not episode_folder(fake_worker, 2).is_symlink()
    assert (mine / "summary.json").is_file()


def test_an_interrupt_keeps_what_has_finished(fake_worker: Path) -> None:
    one = campaign(fake_worker, [2, 4, 6])

    def interrupt(_: object) -> None:
        if len(one.summaries) == 2:
            raise KeyboardInterrupt

    assert not run(one, Workers(), interrupt)
    assert len(one.summaries) == 2
    assert len(runs(fake_worker)) == 2


def test_what_has_finished_is_known_before_anything_is_run(fake_worker: Path) -> None:
    """So that an overview is whole, however early the next run is interrupted."""
    run(campaign(fake_worker, [2, 3]), Workers())
    assert [one["seed"] for one in campaign(fake_worker, [2, 3, 4]).summaries] == [2]


def test_a_written_scenario_is_the_same_when_an_episode_s_process_reads_it(tmp_path: Path) -> None:
    _, scenario = load_scenario("drawer-lights-off", ["seed=4", "plant.time_step=0.003"])
    record = synthetic_episode(seed=4)
    _, record.scenario = load_scenario(str(write_scenario(tmp_path, APPLICATION, scenario)))
    write_run(tmp_path, APPLICATION, record, APPLICATION.evaluate(record))
    assert finished_summary(tmp_path, APPLICATION, scenario) is not None


def test_results_of_another_scenario_are_refused_unless_forced(fake_worker: Path) -> None:
    run(campaign(fake_worker, [2]), Workers())
    other = load_scenario("drawer", ["duration=6"])
    with pytest.raises(ScenarioError, match=r"another scenario or program: scenario_hash.*--force"):
        prepare("drawer", *other, [2], fake_worker)
    assert len(campaign(fake_worker, [2]).summaries) == 1
    assert prepare("drawer", *other, [2], fake_worker, force=True).summaries == []
    assert not episode_folder(fake_worker, 2).exists()


@pytest.mark.parametrize(
    ("key", "value"), [("source_hash", "older"), ("computed_with", {"drake": "1.0.0"})]
)
def test_results_of_another_program_are_refused(fake_worker: Path, key: str, value: object) -> None:
    run(campaign(fake_worker, [2]), Workers())
    path = episode_folder(fake_worker, 2) / "summary.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {key: value}))
    with pytest.raises(ScenarioError, match=f"another scenario or program: {key} is") as caught:
        campaign(fake_worker, [2])
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("force", [False, True])
def test_a_folder_of_something_else_is_not_taken_for_an_experiment(
    tmp_path: Path, force: bool
) -> None:
    write_text(tmp_path / "notes.txt", "mine")
    with pytest.raises(ScenarioError, match="already holds files, but no evaluation"):
        campaign(tmp_path, [1], force=force)
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


def test_starting_afresh_leaves_what_no_episode_has_written(fake_worker: Path) -> None:
    run(campaign(fake_worker, [2, 4]), Workers())
    mine = write_text(episode_folder(fake_worker, 4) / "notes.txt", "mine")
    campaign(fake_worker, [2], force=True)
    assert [path.name for path in episode_folder(fake_worker, 4).iterdir()] == ["notes.txt"]
    assert mine.read_text() == "mine"
    assert not episode_folder(fake_worker, 2).exists()


def test_an_unknown_backend_lists_the_known_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ScenarioError, match="allowed: processes, ray"):
        connect(Workers(backend="rey"))
    with pytest.raises(ScenarioError, match="--address is for --backend ray only"):
        connect(Workers(address="here:1"))
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(ScenarioError, match=r"pip install --editable '.\[cluster\]'"):
        connect(Workers(backend="ray"))
