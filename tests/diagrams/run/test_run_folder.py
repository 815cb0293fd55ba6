import json
from pathlib import Path

import pandas as pd
import pytest
from synthetic_episode import empty_episode, synthetic_episode

from diagrams.crossmodal.scenario import load_scenario
from diagrams.run.run_folder import (
    FIGURE_FILES,
    OWN_FILES,
    SENSORS_FILE,
    default_folder,
    finished_summary,
    open_run_folder,
    write_atomically,
    write_run,
    write_text,
)
from diagrams.run.yaml_schema import ScenarioError


def test_a_run_writes_all_its_files_and_can_be_run_again(tmp_path: Path) -> None:
    result = synthetic_episode()
    result.scenario = load_scenario("drawer", ["seed=3"])
    result.meshcat_html = "<html></html>"
    folder = open_run_folder(tmp_path / "a" / "run")
    result.sensors_file = write_text(folder / SENSORS_FILE, "streams")
    written = write_run(folder, result)
    assert {path.relative_to(folder).as_posix() for path in written} == set(OWN_FILES)
    assert {p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()} == set(
        OWN_FILES
    )
    for name in FIGURE_FILES:
        assert (folder / name).read_bytes().startswith(b"\x89PNG")
    again = load_scenario(str(folder / "scenario.yaml"))
    assert again.seed == 3
    assert "drake" in again.versions
    assert len(pd.read_parquet(folder / "estimates.parquet")) > 1000
    assert json.loads((folder / "summary.json").read_text())["seed"] == 3


def test_a_folder_that_holds_something_is_refused_without_force(tmp_path: Path) -> None:
    foreign = write_text(tmp_path / "notes.txt", "mine")
    with pytest.raises(ScenarioError, match=r"already holds files.*--force"):
        open_run_folder(tmp_path)
    open_run_folder(tmp_path, force=True)
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]
    assert foreign.read_text() == "mine"


def test_force_replaces_the_own_files_only(tmp_path: Path) -> None:
    foreign = write_text(tmp_path / "figures" / "mine.png", "mine")
    stale = write_text(tmp_path / "meshcat.html", "of an earlier run")
    result = synthetic_episode()
    write_run(open_run_folder(tmp_path, force=True), result)
    assert foreign.read_text() == "mine"
    assert not stale.exists()


@pytest.mark.parametrize("place", ["file", "file/below", "/proc/nowhere/run"])
def test_a_folder_that_cannot_be_written_is_refused_in_one_line(tmp_path: Path, place: str) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ScenarioError, match="cannot be written") as caught:
        open_run_folder(tmp_path / place)
    assert "\n" not in str(caught.value)


def test_a_write_that_fails_leaves_the_old_file_and_no_rest(tmp_path: Path) -> None:
    path = write_text(tmp_path / "a.txt", "old")

    def fail(partial: Path) -> None:
        partial.write_text("half")
        raise OSError(28, "No space left on device")

    with pytest.raises(ScenarioError, match=r"a\.txt: cannot be written: .*No space left"):
        write_atomically(path, fail)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_an_interrupted_run_keeps_what_there_is(tmp_path: Path) -> None:
    written = write_run(open_run_folder(tmp_path / "run"), empty_episode())
    names = {path.name for path in written}
    assert {"scenario.yaml", "estimates.parquet", "summary.json"} <= names
    assert "frames.png" not in names


def test_only_a_complete_run_of_the_same_scenario_counts_as_finished(tmp_path: Path) -> None:
    result = synthetic_episode()
    write_run(open_run_folder(tmp_path), result)
    summary = finished_summary(tmp_path, result.scenario)
    assert summary is not None
    assert summary["seed"] == result.scenario.seed
    result.scenario.task.opening = 0.3
    assert finished_summary(tmp_path, result.scenario) is None
    result.interrupted = True
    write_run(open_run_folder(tmp_path, force=True), result)
    assert finished_summary(tmp_path, result.scenario) is None
    assert finished_summary(tmp_path / "none", result.scenario) is None


def test_the_usual_folder_names_scenario_and_seed() -> None:
    assert default_folder(load_scenario("drawer", ["seed=4"])) == Path("runs/drawer-seed4")
