"""A run's folder: what is written, replaced, removed and read again."""

import json
import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from damaged_files import DAMAGES, Damage
from matplotlib.figure import Figure
from synthetic_episode import synthetic_episode

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.crossmodal.application import APPLICATION
from crossmodal.diagrams.evaluation.run_writer import write_run
from crossmodal.diagrams.run.application import Results
from crossmodal.diagrams.run.folder.run_folder import (
    default_folder,
    files_of_run,
    finished_summary,
    opened,
    remove_run,
    without_nan,
)
from crossmodal.diagrams.run.folder.written_files import write_atomically, write_text
from crossmodal.diagrams.run.record import EpisodeRecord
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError


def write(folder: Path, record: EpisodeRecord) -> list[Path]:
    return write_run(folder, APPLICATION, record, APPLICATION.evaluate(record))


def test_a_write_that_fails_leaves_the_old_file_and_no_rest(tmp_path: Path) -> None:
    path = write_text(tmp_path / "a.txt", "old")

    def fail(partial: Path) -> None:
        partial.write_text("half")
        raise OSError(28, "No space left on device")

    with pytest.raises(ScenarioError, match=r"a\.txt: cannot be written: .*No space left"):
        write_atomically(path, fail)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("value", [float("nan"), float("inf"), np.float64("nan")])
def test_what_json_cannot_hold_becomes_null(value: float) -> None:
    assert without_nan({"a": [value, 1.0], "b": (np.float64(2.0),)}) == {
        "a": [None, 1.0],
        "b": [2.0],
    }


def test_numbers_of_numpy_can_be_written_as_json() -> None:
    values = [np.bool_(True), np.int64(3), np.float32(0.5), np.float32("nan")]
    assert json.dumps(without_nan({"a": values}), allow_nan=False) == '{"a": [true, 3, 0.5, null]}'


def test_only_a_complete_run_of_the_same_scenario_counts_as_finished(tmp_path: Path) -> None:
    record = synthetic_episode()
    write(tmp_path, record)
    summary = finished_summary(tmp_path, APPLICATION, record.scenario)
    assert summary is not None
    assert summary["seed"] == record.scenario.seed
    record.scenario.task.opening = 0.3
    assert finished_summary(tmp_path, APPLICATION, record.scenario) is None
    record.interrupted = True
    write(tmp_path, record)
    assert finished_summary(tmp_path, APPLICATION, record.scenario) is None
    assert finished_summary(tmp_path / "none", APPLICATION, record.scenario) is None


def test_the_usual_folder_names_scenario_and_seed() -> None:
    assert default_folder(load_scenario("drawer", ["seed=4"])[1]) == Path("runs/drawer-seed4")


def test_a_folder_that_is_taken_gives_way_to_the_next_number(tmp_path: Path) -> None:
    usual = tmp_path / "drawer-seed4"
    for number in ("", "-2", "-3"):
        with opened(usual, numbered=True) as folder:
            assert folder == tmp_path / f"drawer-seed4{number}"
            (folder / "summary.json").touch()


def test_a_folder_that_nothing_is_written_into_is_removed_again(tmp_path: Path) -> None:
    with opened(tmp_path / "a" / "b"):
        pass
    assert list(tmp_path.iterdir()) == []


def test_only_a_run_is_replaced_and_only_if_asked(tmp_path: Path) -> None:
    write(tmp_path / "run", synthetic_episode())
    with (
        pytest.raises(ScenarioError, match=r"already holds files.*--force"),
        opened(tmp_path / "run"),
    ):
        pass
    with opened(tmp_path / "run", force=True):
        pass
    mine = write_text(tmp_path / "mine" / "summary.json", '{"mine": 1}')
    with (
        pytest.raises(ScenarioError, match="no run that --force could replace"),
        opened(tmp_path / "mine", force=True),
    ):
        pass
    assert mine.read_text() == '{"mine": 1}'


@pytest.fixture(scope="module")
def whole_run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, EpisodeRecord, Results]:
    folder, record = tmp_path_factory.mktemp("whole"), synthetic_episode()
    results = replace(APPLICATION.evaluate(record), plots={"b.png": Figure})
    write_run(folder, APPLICATION, record, results)
    return folder, record, results


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize(
    "name",
    [
        "scenario.yaml",
        "estimates.parquet",
        "summary.json",
        "perceived.yaml",
        "report.html",
        "figures/b.png",
    ],
)
def test_a_run_with_a_damaged_file_is_not_finished_and_is_written_again(
    tmp_path: Path, whole_run: tuple[Path, EpisodeRecord, Results], name: str, damage: Damage
) -> None:
    whole, record, results = whole_run
    folder, mine = tmp_path / "run", tmp_path / "mine"
    shutil.copytree(whole, folder)
    assert finished_summary(folder, APPLICATION, record.scenario) is not None
    damage(folder / name, mine)
    before = mine.read_bytes() if mine.exists() else b""
    assert finished_summary(folder, APPLICATION, record.scenario) is None
    write_run(folder, APPLICATION, record, results)
    assert finished_summary(folder, APPLICATION, record.scenario) is not None
    assert not (folder / name).is_symlink()
    assert (mine.read_bytes() if mine.exists() else b"") == before


@pytest.mark.parametrize("name", ["../mine", "/{}/mine", "link/mine"])
def test_nothing_outside_the_folder_is_removed_whatever_a_summary_says(
    tmp_path: Path, name: str
) -> None:
    mine, folder = write_text(tmp_path / "mine", "mine"), tmp_path / "run"
    write_text(folder / "a.txt", "of a run")
    (folder / "link").symlink_to(tmp_path)
    named = ["a.txt", name.format(tmp_path)]
    write_text(folder / "summary.json", json.dumps({"files": named}))
    remove_run(folder)
    assert mine.read_text() == "mine"
    assert [path.name for path in folder.iterdir()] == ["link"]


@pytest.mark.parametrize(
    "files", [[1], "a.txt", {"a": 1}, ["a\0b"], ["a" * 5000], [None], [f"{'a' * 300}/b"]]
)
def test_a_summary_that_names_no_files_is_of_no_run(tmp_path: Path, files: object) -> None:
    write_text(tmp_path / "summary.json", json.dumps({"files": files}))
    assert finished_summary(tmp_path, APPLICATION, load_scenario("drawer", [])[1]) is None
    with pytest.raises(ScenarioError, match="no run that --force"), opened(tmp_path, force=True):
        pass


@pytest.mark.parametrize("make", [os.mkfifo, lambda path: path.symlink_to("/dev/zero")])
def test_a_summary_that_is_no_file_of_the_folder_is_none(
    tmp_path: Path, make: Callable[[Path], None]
) -> None:
    make(tmp_path / "summary.json")
    assert files_of_run(tmp_path) == []


def test_a_summary_that_names_a_folder_removes_none(tmp_path: Path) -> None:
    write_text(tmp_path / "summary.json", json.dumps({"files": ["figures", "."]}))
    mine = write_text(tmp_path / "figures" / "mine", "mine")
    remove_run(tmp_path)
    assert mine.read_text() == "mine"


@pytest.mark.parametrize("place", ["file", "file/below", "/proc/nowhere/run", "a" * 300])
def test_a_folder_that_cannot_be_written_is_refused_in_one_line(tmp_path: Path, place: str) -> None:
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(ScenarioError, match="cannot be written") as caught,
        opened(tmp_path / place),
    ):
        pass
    assert "\n" not in str(caught.value)
