"""What an episode leaves in its folder."""

import json
import os
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest
from matplotlib.figure import Figure
from numpy.testing import assert_allclose
from synthetic_episode import empty_episode, synthetic_episode

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.crossmodal.application import APPLICATION
from crossmodal.diagrams.evaluation.run_writer import RunWriter, summarise, write_run
from crossmodal.diagrams.run.folder.run_folder import PLOT_FOLDER, SENSORS_FILE, finished_summary
from crossmodal.diagrams.run.folder.written_files import write_text
from crossmodal.diagrams.run.record import EpisodeRecord
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError

FILES = {
    "scenario.yaml",
    "estimates.parquet",
    "perceived.yaml",
    "figures/errors.png",
    "figures/frames.png",
    "figures/configuration.png",
    "meshcat.html",
    "sensors.mcap",
    "report.html",
    "summary.json",
}


def write(folder: Path, record: EpisodeRecord) -> list[Path]:
    return write_run(folder, APPLICATION, record, APPLICATION.evaluate(record))


def test_a_run_writes_all_its_files_and_can_be_run_again(tmp_path: Path) -> None:
    record = synthetic_episode()
    record.scenario = load_scenario("drawer", ["seed=3"])[1]
    record.meshcat_html = "<html></html>"
    folder = tmp_path / "a" / "run"
    record.sensors_file = write_text(folder / SENSORS_FILE, "streams")
    written = write(folder, record)
    assert {path.relative_to(folder).as_posix() for path in written} == FILES
    files = {p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()}
    assert files == FILES
    summary = json.loads((folder / "summary.json").read_text())
    assert {*summary["files"], "summary.json"} == FILES
    page = (folder / "report.html").read_text()
    assert "drawer, seed 3" in page
    for path in (folder / PLOT_FOLDER).iterdir():
        assert path.read_bytes().startswith(b"\x89PNG")
        assert f'src="figures/{path.name}"' in page
    _, again = load_scenario(str(folder / "scenario.yaml"))
    assert again.seed == 3
    assert "drake" in again.versions
    assert len(pd.read_parquet(folder / "estimates.parquet")) > 1000
    assert json.loads((folder / "summary.json").read_text())["seed"] == 3


def test_a_run_replaces_an_earlier_ones_files_only(tmp_path: Path) -> None:
    record = synthetic_episode()
    record.meshcat_html = "<html></html>"
    write(tmp_path, record)
    foreign = write_text(tmp_path / "figures" / "mine.png", "mine")
    record.meshcat_html = None
    write(tmp_path, record)
    assert foreign.read_text() == "mine"
    assert not (tmp_path / "meshcat.html").exists()


def full_disk(monkeypatch: pytest.MonkeyPatch, *refused: str) -> None:
    """Lets no file of these names be written to its end."""
    replace_file = os.replace

    def replaced(partial: Path, path: Path) -> None:
        if path.name in refused:
            raise OSError(28, "No space left on device")
        replace_file(partial, path)

    monkeypatch.setattr(os, "replace", replaced)


def test_on_a_full_disk_only_the_large_files_are_missing_and_the_run_is_not_complete(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    record = synthetic_episode()
    record.meshcat_html = "<html></html>"
    full_disk(monkeypatch, "meshcat.html", "frames.png")
    writer = RunWriter(tmp_path, APPLICATION, record, APPLICATION.evaluate(record))
    writer.write_results()
    writer.write_pictures()
    there = {path.name for path in tmp_path.rglob("*") if path.is_file()}
    assert there == {"scenario.yaml", "estimates.parquet", "summary.json", "perceived.yaml",
                     "errors.png", "configuration.png", "report.html"}  # fmt: skip
    assert writer.missing == [
        f"{tmp_path / name}: cannot be written: No space left on device"
        for name in ("figures/frames.png", "meshcat.html")
    ]
    assert finished_summary(tmp_path, APPLICATION, record.scenario) is None
    monkeypatch.undo()
    write(tmp_path, record)
    assert finished_summary(tmp_path, APPLICATION, record.scenario) is not None


def test_without_estimates_there_is_no_summary_not_even_an_earlier_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    record = synthetic_episode()
    write(tmp_path, record)
    full_disk(monkeypatch, "estimates.parquet")
    with pytest.raises(ScenarioError, match=r"estimates\.parquet: cannot be written"):
        write(tmp_path, record)
    assert not (tmp_path / "summary.json").exists()
    assert (tmp_path / "figures" / "errors.png").exists()


def test_a_table_that_cannot_be_written_costs_no_other_file(tmp_path: Path) -> None:
    record = synthetic_episode()
    results = APPLICATION.evaluate(record)
    mixed = results.estimates.assign(mixed=[{1}, *["a"] * (len(results.estimates) - 1)])
    with pytest.raises(ScenarioError, match=r"estimates\.parquet: cannot be written: .*mixed"):
        write_run(tmp_path, APPLICATION, record, replace(results, estimates=mixed))
    assert (tmp_path / "scenario.yaml").exists()
    assert (tmp_path / "figures" / "errors.png").exists()


def test_the_results_are_written_before_the_pictures(tmp_path: Path) -> None:
    record = synthetic_episode()
    writer = RunWriter(tmp_path, APPLICATION, record, APPLICATION.evaluate(record))
    writer.write_results()
    assert json.loads((tmp_path / "summary.json").read_text()) == writer.summary
    assert not (tmp_path / "figures").exists()
    assert finished_summary(tmp_path, APPLICATION, record.scenario) is None


def test_an_interrupted_run_keeps_what_there_is(tmp_path: Path) -> None:
    names = {path.name for path in write(tmp_path / "run", empty_episode())}
    assert {"scenario.yaml", "estimates.parquet", "summary.json"} <= names
    assert "frames.png" not in names


def test_the_summary_has_what_every_episode_has_and_is_strict_json() -> None:
    record = synthetic_episode()
    summary = summarise(APPLICATION, record, APPLICATION.evaluate(record))
    json.dumps(summary, allow_nan=False)
    assert {"scenario", "seed", "success", "duration", "wall_time", "real_time_factor", "failure",
            "modalities", "peak_memory", "events", "interrupted"} <= set(summary)  # fmt: skip
    assert summary["success"] is True
    assert set(summary["modalities"]) == {"vision", "proprioception", "crossmodal"}
    for modality in summary["modalities"].values():
        assert set(modality["tick"]) == {"median", "p95"}
        assert modality["tick"]["median"] <= modality["tick"]["p95"]
    assert_allclose(summary["real_time_factor"], 16.0 / 11.0)


def test_an_episode_that_hardly_began_still_has_a_summary() -> None:
    record = empty_episode()
    summary = summarise(APPLICATION, record, APPLICATION.evaluate(record))
    json.dumps(summary, allow_nan=False)
    assert summary["success"] is False
    assert summary["failure"] == "interrupted"
    assert summary["modalities"]["vision"]["tick"] == {"median": None, "p95": None}


def test_a_picture_that_no_run_has_drawn_is_not_replaced(tmp_path: Path) -> None:
    record = synthetic_episode()
    results = APPLICATION.evaluate(record)
    write_run(tmp_path, APPLICATION, record, replace(results, plots={}))
    mine = write_text(tmp_path / "figures" / "errors.png", "mine")
    writer = RunWriter(tmp_path, APPLICATION, record, results)
    writer.write_results()
    writer.write_pictures()
    assert "errors.png: cannot be drawn: FileExistsError: a file is there" in writer.missing[0]
    assert mine.read_text() == "mine"


def test_nothing_is_written_through_a_link_out_of_the_folder(tmp_path: Path) -> None:
    folder, elsewhere = tmp_path / "run", tmp_path / "elsewhere"
    elsewhere.mkdir()
    folder.mkdir()
    (folder / "figures").symlink_to(elsewhere)
    with pytest.raises(ScenarioError, match=r"figures/errors\.png: a link leads out of"):
        write(folder, synthetic_episode())
    assert list(elsewhere.iterdir()) == []
    assert (folder / "summary.json").is_file()


def test_an_error_while_drawing_loses_nothing_but_that_picture(tmp_path: Path) -> None:
    def fail() -> Figure:
        raise ValueError("no such\ncolour")

    def fails_when_saved() -> Figure:
        return Figure(figsize=(1e9, 1e9))

    record = synthetic_episode()
    plots = {"a.png": fail, "b.png": fails_when_saved, "c.png": Figure}
    results = replace(APPLICATION.evaluate(record), plots=plots)
    writer = RunWriter(tmp_path, APPLICATION, record, results)
    writer.write_results()
    writer.write_pictures()
    names = {"scenario.yaml", "estimates.parquet", "summary.json", "perceived.yaml", "c.png"}
    names |= {"report.html"}
    assert {path.name for path in writer.written} == names
    assert len(writer.written) == len(names)
    first, second = writer.missing
    assert first == f"{tmp_path}/figures/a.png: cannot be drawn: ValueError: no such colour"
    assert second.startswith(f"{tmp_path}/figures/b.png: cannot be drawn: ")
    assert "\n" not in second
    summary = finished_summary(tmp_path, APPLICATION, record.scenario)
    assert summary is not None
    assert "figures/c.png" in summary["files"]
    assert not {"figures/a.png", "figures/b.png"} & {*summary["files"]}
