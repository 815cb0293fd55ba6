import json
import sys
from pathlib import Path

import pytest
from synthetic_episode import synthetic_episode

from diagrams.applications import load_scenario
from diagrams.crossmodal.application import APPLICATION
from diagrams.evaluation.campaign import (
    Campaign,
    Workers,
    connect,
    episode_folder,
    open_campaign_folder,
    prepare,
    run,
)
from diagrams.run import process
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


def campaign(folder: Path, seeds: list[int], *, force: bool = False) -> Campaign:
    return prepare("drawer", *load_scenario("drawer"), seeds, folder, force=force)


@pytest.fixture
def fake_worker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that holds the summaries of even seeds, and what was run in `runs.txt`."""
    monkeypatch.setattr(process, "_COMMAND", (sys.executable, "-c", WORKER))
    for scenario in campaign(tmp_path, [2, 4, 6]).scenarios:
        record = synthetic_episode(seed=scenario.seed)
        record.scenario = scenario
        write_run(tmp_path / "made", APPLICATION, record, APPLICATION.evaluate(record))
        made = json.loads((tmp_path / "made" / "summary.json").read_text())
        prepared = tmp_path / f"prepared-{scenario.seed}.json"
        prepared.write_text(json.dumps(made | {"files": ["scenario.yaml"]}))
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
    with pytest.raises(ScenarioError, match="program with source hash 'older'") as caught:
        open_campaign_folder(tmp_path, "drawer", APPLICATION, scenario)
    assert "\n" not in str(caught.value)
    marker.write_text("{")
    with pytest.raises(ScenarioError, match="holds the experiment 'None'"):
        open_campaign_folder(tmp_path, "drawer", APPLICATION, scenario)


def test_a_folder_of_something_else_is_not_taken_for_an_experiment(tmp_path: Path) -> None:
    write_text(tmp_path / "notes.txt", "mine")
    with pytest.raises(ScenarioError, match="already holds files"):
        open_campaign_folder(tmp_path, "drawer", *load_scenario("drawer"))


def test_an_unknown_backend_lists_the_known_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ScenarioError, match="allowed: processes, ray"):
        connect(Workers(backend="rey"))
    with pytest.raises(ScenarioError, match="--address is for --backend ray only"):
        connect(Workers(address="here:1"))
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(ScenarioError, match=r"pip install 'crossmodal\[cluster\]'"):
        connect(Workers(backend="ray"))
