import json
import shutil
import sys
import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure
from synthetic_episode import synthetic_episode

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.crossmodal.application import APPLICATION
from crossmodal.diagrams.evaluation.campaign import (
    Campaign,
    DamageWarning,
    Workers,
    connect,
    episode_folder,
    held_campaign,
    open_campaign_folder,
    prepare,
    run,
)
from crossmodal.diagrams.evaluation.campaign_report import write_campaign
from crossmodal.diagrams.evaluation.folder_checksums import write_checksums
from crossmodal.diagrams.run import process
from crossmodal.diagrams.run.folder.run_folder import (
    finished_summary,
    write_run,
    write_scenario,
    write_text,
)
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError

# Stands for an episode's process: odd seeds die, others take over a run that was prepared.
WORKER = """
import os, pathlib, shutil, signal, sys
folder = pathlib.Path(sys.argv[1])
seed = int(folder.name[-4:])
prepared = folder.parent / f"prepared-{seed}"
with (folder.parent / "runs.txt").open("a") as log: log.write(f"{seed}\\n")
if seed == 3: os.kill(os.getpid(), signal.SIGKILL)
if seed == 5: (folder / "error.txt").write_text("RuntimeError: gave up\\n\\nTraceback"); sys.exit(1)
if seed == 7: sys.exit(3)
if seed == 9: (folder / "summary.json").write_text("{}"); sys.exit()
shutil.copytree(prepared, folder, dirs_exist_ok=True)
"""


_FAILED = {"scenario": "drawer", "seed": 1, "success": False, "failure": "no", "modalities": {}}


def campaign(folder: Path, seeds: list[int], *, force: bool = False) -> Campaign:
    return prepare("drawer", *_drawer(), seeds, folder, force=force)


@cache
def _drawer() -> tuple[Any, Any]:
    return load_scenario("drawer")


@pytest.fixture
def fake_worker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that holds the runs of even seeds, and what was run in `runs.txt`."""
    monkeypatch.setattr(process, "_COMMAND", (sys.executable, "-c", WORKER))
    for scenario in campaign(tmp_path, [2, 4, 6]).scenarios:
        record = synthetic_episode(seed=scenario.seed)
        record.scenario = scenario
        results = replace(APPLICATION.evaluate(record), plots={})
        write_run(tmp_path / f"prepared-{scenario.seed}", APPLICATION, record, results)
    return tmp_path


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


DAMAGES: dict[str, Callable[[Path], object]] = {
    "missing": Path.unlink,
    "truncated": lambda path: path.write_bytes(path.read_bytes()[:-20]),
    "flipped": lambda path: path.write_bytes(
        path.read_bytes()[:50] + bytes([path.read_bytes()[50] ^ 1]) + path.read_bytes()[51:]
    ),
    "other": lambda path: path.write_text('{"other": 1}'),
    "empty": lambda path: path.write_bytes(b""),
}
FILES = ("summary.json", "estimates.parquet", "scenario.yaml", "figures/errors.png", "SHA256SUMS")


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of an evaluation whose two episodes have ended."""
    folder = tmp_path_factory.mktemp("finished")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(process, "run_apart", _write_episode)
        assert run(campaign(folder, [2, 4]), Workers())
    return folder


def _write_episode(application: Any, scenario: Any, place: Path, _: object) -> dict[str, Any]:
    record = synthetic_episode(seed=scenario.seed)
    record.scenario = scenario
    results = replace(application.evaluate(record), plots={"errors.png": Figure})
    write_run(place, application, record, results)
    return finished_summary(place, application, scenario) or {}


@pytest.fixture
def ended(finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of it, in which an episode that runs again is taken over and noted in `runs.txt`."""

    def take_over(application: Any, scenario: Any, place: Path, _: object) -> dict[str, Any]:
        shutil.copytree(finished / place.name, place, dirs_exist_ok=True)
        with (place.parent / "runs.txt").open("a") as log:
            log.write(f"{scenario.seed}\n")
        return finished_summary(place, application, scenario) or {}

    monkeypatch.setattr(process, "run_apart", take_over)
    return Path(shutil.copytree(finished, tmp_path / "ended"))


@pytest.mark.parametrize("how", DAMAGES)
@pytest.mark.parametrize("name", FILES)
def test_an_episode_with_a_damaged_file_is_said_in_a_line_and_runs_again(
    ended: Path, name: str, how: str
) -> None:
    DAMAGES[how](episode_folder(ended, 2) / name)
    word = "missing" if how == "missing" else "(damaged|missing)"
    with pytest.warns(DamageWarning, match=rf"seed-0002: \S+ is {word}; that seed runs") as found:
        again = campaign(ended, [2, 4])
    assert len(found) == 1
    assert [summary["seed"] for summary in again.summaries] == [4]
    assert run(again, Workers())
    assert runs(ended) == [2]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(campaign(ended, [2, 4]).summaries) == 2


@pytest.mark.parametrize("how", DAMAGES)
@pytest.mark.parametrize("name", ["evaluation.json", "SHA256SUMS"])
def test_an_evaluation_goes_on_past_its_own_damaged_file(ended: Path, name: str, how: str) -> None:
    DAMAGES[how](ended / name)
    with pytest.warns(DamageWarning, match="it is written anew, and whole episodes stay") as found:
        again = campaign(ended, [2, 4])
    assert len(found) == 1
    assert len(again.summaries) == 2
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        campaign(ended, [2, 4])


def test_another_scenario_does_not_go_on_in_a_damaged_folder(ended: Path) -> None:
    (ended / "evaluation.json").unlink()
    with pytest.raises(ScenarioError, match="no whole episode there is of this scenario"):
        prepare("drawer", *load_scenario("drawer", ["duration=6"]), [2], ended)
    assert episode_folder(ended, 2).is_dir()


def test_the_log_of_an_episode_may_change(ended: Path) -> None:
    (episode_folder(ended, 2) / "log.txt").write_text("gone")
    assert len(campaign(ended, [2, 4]).summaries) == 2


def test_force_starts_afresh(fake_worker: Path) -> None:
    run(campaign(fake_worker, [2, 4]), Workers())
    afresh = campaign(fake_worker, [2], force=True)
    assert not episode_folder(fake_worker, 4).exists()
    run(afresh, Workers())
    assert runs(fake_worker) == [2, 2, 4]


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


def test_results_of_another_drake_are_not_mixed_in(tmp_path: Path) -> None:
    _, scenario = load_scenario("drawer")
    open_campaign_folder(tmp_path, "drawer", APPLICATION, scenario)
    marker = tmp_path / "evaluation.json"
    found = json.loads(marker.read_text())
    found["versions"]["drake"] = "1.0.0"
    marker.write_text(json.dumps(found))
    write_checksums(tmp_path, [marker])
    with pytest.raises(ScenarioError, match=r"results of drake 1\.0\.0, not .*--force"):
        open_campaign_folder(tmp_path, "drawer", APPLICATION, scenario)


def test_a_written_scenario_is_the_same_when_an_episode_s_process_reads_it(tmp_path: Path) -> None:
    _, scenario = load_scenario("drawer-lights-off", ["seed=4", "plant.time_step=0.003"])
    record = synthetic_episode(seed=4)
    _, record.scenario = load_scenario(str(write_scenario(tmp_path, APPLICATION, scenario)))
    write_run(tmp_path, APPLICATION, record, APPLICATION.evaluate(record))
    assert finished_summary(tmp_path, APPLICATION, scenario) is not None


def test_a_folder_of_other_results_is_refused_unless_forced(tmp_path: Path) -> None:
    folder, scenario = tmp_path / "new", load_scenario("drawer")[1]
    open_campaign_folder(folder, "drawer", APPLICATION, scenario)
    scenario.seed = 9
    open_campaign_folder(folder, "drawer", APPLICATION, scenario)
    with pytest.raises(ScenarioError, match="holds the experiment 'drawer', not 'door'"):
        open_campaign_folder(folder, "door", APPLICATION, scenario)
    _, other = load_scenario("drawer", ["duration=6"])
    with pytest.raises(ScenarioError, match=r"the scenario with hash.*--force"):
        open_campaign_folder(folder, "drawer", APPLICATION, other)
    open_campaign_folder(folder, "drawer", APPLICATION, other, force=True)
    open_campaign_folder(folder, "drawer", APPLICATION, other)


def test_results_of_another_program_are_refused(tmp_path: Path) -> None:
    _, scenario = load_scenario("drawer")
    open_campaign_folder(tmp_path, "drawer", APPLICATION, scenario)
    marker = tmp_path / "evaluation.json"
    found = json.loads(marker.read_text())
    marker.write_text(json.dumps(found | {"source_hash": "older"}))
    write_checksums(tmp_path, [marker])
    with pytest.raises(ScenarioError, match="program with source hash 'older'") as caught:
        open_campaign_folder(tmp_path, "drawer", APPLICATION, scenario)
    assert "\n" not in str(caught.value)
    marker.write_text("{")
    with pytest.raises(ScenarioError, match=r"evaluation\.json is damaged, and no whole episode"):
        open_campaign_folder(tmp_path, "drawer", APPLICATION, scenario)


def test_a_folder_of_something_else_is_not_taken_for_an_experiment(tmp_path: Path) -> None:
    write_text(tmp_path / "notes.txt", "mine")
    with pytest.raises(ScenarioError, match="already holds files"), held_campaign(tmp_path):
        pass
    with (
        pytest.raises(ScenarioError, match="no run that --force could replace"),
        held_campaign(tmp_path, force=True),
    ):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


def test_two_evaluations_never_write_into_one_folder(tmp_path: Path) -> None:
    with held_campaign(tmp_path):
        campaign(tmp_path, [1])
        for force in (False, True):
            with (
                pytest.raises(ScenarioError, match="another run is writing there"),
                held_campaign(tmp_path, force=force),
            ):
                pass
    with held_campaign(tmp_path):
        campaign(tmp_path, [1])


def test_a_file_that_no_evaluation_has_written_is_not_replaced(tmp_path: Path) -> None:
    with held_campaign(tmp_path):
        campaign(tmp_path, [1])
    mine = write_text(tmp_path / "report.html", "mine")
    with held_campaign(tmp_path), pytest.raises(ScenarioError, match=r"report\.html: is no file"):
        write_campaign(replace(campaign(tmp_path, [1]), summaries=[_FAILED]), "")
    assert mine.read_text() == "mine"


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
    with pytest.raises(ScenarioError, match=r"pip install 'crossmodal\[cluster\]'"):
        connect(Workers(backend="ray"))
