import shutil
import types
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from damaged_files import Damage, link_out, make_a_folder
from matplotlib.figure import Figure
from typer.testing import CliRunner

from crossmodal.diagrams.command_line import app
from crossmodal.diagrams.commands.episode import run_here
from crossmodal.diagrams.crossmodal.application import APPLICATION
from crossmodal.diagrams.evaluation.campaign_report import OVERVIEW_FILES
from crossmodal.diagrams.run import process
from crossmodal.diagrams.run.application import Application
from crossmodal.diagrams.run.experiment import CampaignPlot
from crossmodal.diagrams.run.folder.run_folder import finished_summary, write_scenario
from crossmodal.diagrams.run.process import failed_summary
from crossmodal.diagrams.run.scenario import Scenario

RUNNER = CliRunner()


@pytest.fixture
def in_this_process(monkeypatch: pytest.MonkeyPatch, fake_episode: types.SimpleNamespace) -> None:
    """Lets an evaluation's episodes run in the test's own process."""

    def run_apart(
        application: Application, scenario: Scenario, folder: Path, environment: Any
    ) -> dict[str, Any]:
        write_scenario(folder, application, scenario)
        run_here(folder)
        if fake_episode.stops_early:
            raise KeyboardInterrupt
        summary = finished_summary(folder, application, scenario)
        return summary or failed_summary(scenario, process._reason(folder, 1))

    monkeypatch.setattr(process, "run_apart", run_apart)


@pytest.mark.usefixtures("in_this_process")
def test_evaluate_says_more_or_less_as_it_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    table = Path("table.md")
    table.write_text("| a table |")
    reports = "crossmodal.diagrams.evaluation.campaign_report.write_campaign"
    monkeypatch.setattr(reports, lambda campaign, origin: [table])
    command = ["evaluate", "drawer", "--seeds", "1", "--out", "here"]
    first = RUNNER.invoke(app, [*command, "-v"])
    assert first.exit_code == 0, first.output
    assert "s  drawer: 0 of 1 episodes are there" in first.stderr
    assert "s  drawer, seed 0: has ended" in first.stderr
    assert "| a table |" in first.stdout
    again = RUNNER.invoke(app, [*command, "-q"])
    assert (again.exit_code, again.output) == (0, "")


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
    assert "1 of 3, interrupted; the same command goes on" in stopped.stderr
    assert "# drawer: 1 of 3, interrupted: seeds 3 of 3 to 5" in stopped.stdout
    assert "--seeds 3:6 --jobs 1`, interrupted, crossmodal" in stopped.stdout
    assert len(fake_episode.runs) == 2


@pytest.mark.usefixtures("in_this_process")
def test_all_experiments_end_in_one_table_and_single_ones_are_taken_over(
    fake_episode: types.SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = ("drawer", "drawer-lights-off")
    monkeypatch.setattr(
        "crossmodal.diagrams.applications.experiments", lambda: {n: APPLICATION for n in names}
    )
    assert RUNNER.invoke(app, ["evaluate", "drawer", "--seeds", "1"]).exit_code == 0
    result = RUNNER.invoke(app, ["evaluate", "all", "--seeds", "1"])
    assert result.exit_code == 0, result.output
    assert [name for name, *_ in fake_episode.runs] == ["drawer", "drawer-lights-off"]
    assert "| all | 2/2 |" in result.output
    assert Path("runs/evaluate/report.html").is_file()
    assert Path("runs/evaluate/drawer/report.html").is_file()


CAMPAIGN = ("a.png", *OVERVIEW_FILES)


@pytest.fixture(scope="module")
def finished_evaluation(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Holds the folder of an evaluation as soon as one is there, for all tests of this module."""
    return [tmp_path_factory.mktemp("finished")]


@pytest.mark.usefixtures("in_this_process")
@pytest.mark.parametrize("name", [*CAMPAIGN, "seed-0003/summary.json", "seed-0003/figures/b.png"])
@pytest.mark.parametrize("damage", [make_a_folder, link_out])
def test_what_is_damaged_is_made_again_and_what_is_whole_is_used(
    damage: Damage,
    name: str,
    fake_episode: types.SimpleNamespace,
    finished_evaluation: list[Path],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    few = replace(
        APPLICATION,
        evaluate=lambda record: replace(APPLICATION.evaluate(record), plots={"b.png": Figure}),
        campaign_plots={"a.png": CampaignPlot(caption="", draw=lambda _: Figure())},
    )
    monkeypatch.setattr("crossmodal.diagrams.applications._load", lambda _: {"crossmodal": few})
    command = ["evaluate", "drawer", "--seeds", "3:5", "--out", "here"]
    (whole,) = finished_evaluation
    if not any(whole.iterdir()):
        assert RUNNER.invoke(app, command).exit_code == 0
        shutil.copytree("here", whole, dirs_exist_ok=True)
    else:
        shutil.copytree(whole, "here")
    fake_episode.runs.clear()
    damage(Path("here", name), Path("mine"))
    before = Path("mine").read_bytes() if Path("mine").exists() else b""
    result = RUNNER.invoke(app, command)
    assert result.exit_code == 0, result.output
    assert [seed for _, seed, _ in fake_episode.runs] == ([3] if "seed" in name else [])
    assert Path("here", name).is_file()
    assert not Path("here", name).is_symlink()
    assert Path("here", name).stat().st_size > 0.9 * (whole / name).stat().st_size
    assert (Path("mine").read_bytes() if Path("mine").exists() else b"") == before


def test_a_folder_whose_name_is_too_long_is_refused_in_one_line() -> None:
    training = [["train", "hand-bending"]] if find_spec("torch") else []
    for command in (["run", "drawer"], ["evaluate", "drawer"], *training):
        result = RUNNER.invoke(app, [*command, "--out", "a" * 300])
        assert result.exit_code == 2, result.output
        assert result.stderr.endswith("cannot be written: File name too long\n")
        assert result.stderr.count("\n") == 1


@pytest.mark.usefixtures("in_this_process", "fake_episode")
def test_an_error_while_drawing_leaves_tables_and_page(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: object) -> None:
        raise ValueError("no such colour")

    first = next(iter(APPLICATION.campaign_plots))
    plots = {first: CampaignPlot(caption="", draw=fail)}
    monkeypatch.setattr(
        "crossmodal.diagrams.applications._load",
        lambda _: {"crossmodal": replace(APPLICATION, campaign_plots=plots)},
    )
    result = RUNNER.invoke(app, ["evaluate", "drawer", "--seeds", "1", "--out", "here"])
    assert result.exit_code == 1
    said = [line for line in result.stderr.splitlines() if line.startswith("crossmodal")]
    assert said == [f"crossmodal: here/{first}: cannot be drawn: ValueError: no such colour"]
    assert all(Path("here", name).is_file() for name in OVERVIEW_FILES)
