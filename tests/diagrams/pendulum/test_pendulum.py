"""An application in one short file goes through the same commands as those that come along."""

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from pydrake.geometry import Meshcat
from typer.testing import CliRunner

from crossmodal.diagrams.applications import OWN, load_scenario
from crossmodal.diagrams.command_line import app
from crossmodal.diagrams.commands.endings import GentleInterrupt
from crossmodal.diagrams.drawing.legend import EventBoard
from crossmodal.diagrams.run.episode import Episode
from crossmodal.diagrams.run.folder.fingerprint import fingerprint

FILE = Path(__file__).with_name("pendulum.py")
NOISE = 0.02  # Of the encoder, [rad].
RESULTS = ("results.csv", "table.md", "report.html")


def crossmodal(*arguments: object) -> Any:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def read_summary(folder: Path) -> dict:
    return json.loads((folder / "summary.json").read_text())


def read_estimates(folder: Path) -> pd.DataFrame:
    return pd.read_parquet(folder / "estimates.parquet")


@pytest.fixture(scope="module", autouse=True)
def pendulum() -> Iterator[None]:
    """The program knows the pendulum while this file is tested."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(OWN, str(FILE))
        yield


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a recorded run."""
    folder = tmp_path_factory.mktemp("pendulum") / "run"
    result = crossmodal("run", "swing", "--record-sensors", "--out", folder)
    assert result.exit_code == 0, result.output
    return folder


@pytest.fixture(scope="module")
def evaluated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of an evaluation over three seeds."""
    folder = tmp_path_factory.mktemp("pendulum") / "swing"
    result = crossmodal("evaluate", "swing", "--seeds", 3, "--jobs", 2, "--out", folder)
    assert result.exit_code == 0, result.output
    return folder


def test_an_application_takes_at_most_eighty_lines() -> None:
    assert sum(bool(line.strip()) for line in FILE.read_text().splitlines()) <= 80


def test_it_is_listed_with_its_scenario_and_experiment() -> None:
    result = crossmodal("list")
    assert result.exit_code == 0, result.output
    assert "pendulum: a pendulum swings" in result.output
    lines = [" ".join(line.split()) for line in result.output.splitlines()]
    assert "swing a pendulum swings freely" in lines
    assert "swing it swings for 10 s" in lines


def test_an_object_of_a_users_own_has_no_place_in_it(tmp_path: Path) -> None:
    model = tmp_path / "thing.urdf"
    model.write_text("<robot name='thing'/>")
    result = crossmodal("run", "swing", "--object", model, "--out", tmp_path / "run")
    assert result.exit_code == 2
    assert "'swing' has no object to be replaced" in result.stderr


def test_a_run_leaves_its_files(recorded: Path) -> None:
    for name in ("summary.json", "estimates.parquet", "sensors.mcap", "figures/angle.png"):
        assert (recorded / name).stat().st_size > 0
    summary = read_summary(recorded)
    assert summary["success"]
    assert summary["duration"] == pytest.approx(10.0)
    table = read_estimates(recorded)
    assert set(table["modality"]) == {"stubborn", "open"}
    assert table.groupby("modality", observed=True).size().tolist() == [150, 150]


def test_a_live_run_obeys_its_page_and_shows_events_although_nothing_is_drawn(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    shown: list[str] = []
    monkeypatch.setattr(EventBoard, "show", lambda board, lines, time: shown.extend(lines))
    application, scenario = load_scenario("swing")
    episode = Episode(application, scenario, Meshcat(), is_live=True, begins_paused=True)
    assert episode.session is not None
    assert episode.session.is_paused
    episode.session.wants_next = True
    assert episode.Run().wants_next
    assert shown[0] == "swing, seed 0; nothing in it can be changed by hand"
    assert shown[-1].endswith("ended by hand")


@pytest.mark.parametrize("estimator", ["stubborn", "open"])
def test_a_filter_knows_more_than_its_encoder_and_how_much(recorded: Path, estimator: str) -> None:
    angle = read_summary(recorded)["modalities"][estimator]["quantities"]["angle"]
    assert 0.0 < angle["rms_error"] < 0.6 * NOISE
    assert 0.85 <= angle["inside_two_sigma"] <= 1.0


def test_a_filter_that_trusts_the_true_model_more_errs_less(recorded: Path) -> None:
    parts = read_summary(recorded)["modalities"]
    stubborn, open_ = (parts[name]["quantities"]["angle"] for name in ("stubborn", "open"))
    assert stubborn["rms_error"] < open_["rms_error"]


def test_a_replay_gives_the_very_same_estimates(recorded: Path, tmp_path: Path) -> None:
    result = crossmodal("replay", recorded, "--out", tmp_path / "again")
    assert result.exit_code == 0, result.output
    pd.testing.assert_frame_equal(
        read_estimates(tmp_path / "again"), read_estimates(recorded), check_exact=True
    )


def test_a_replay_of_a_run_that_was_interrupted_says_so_and_claims_no_success(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ticks = iter(range(20))

    def check(_: GentleInterrupt) -> None:
        if next(ticks, None) is None:
            raise KeyboardInterrupt

    run, again = tmp_path / "run", tmp_path / "again"
    monkeypatch.setattr(GentleInterrupt, "check", check)
    options = ("--record-sensors", "--no-recording", "--out", run)
    assert crossmodal("run", "swing", *options).exit_code == 130
    result = crossmodal("replay", run, "--out", again)
    assert result.exit_code == 1, result.output
    assert "interrupted at 1." in result.stderr
    for folder in (run, again):
        summary = read_summary(folder)
        said = (summary["success"], summary["failure"], summary["interrupted"])
        assert said == (False, "interrupted", True)


@pytest.mark.parametrize("duration", [2.0, 1.98, 2.02, 11 / 15])
def test_a_replay_has_the_runs_ticks_wherever_between_two_it_ended(
    tmp_path: Path, duration: float
) -> None:
    run, again = tmp_path / "run", tmp_path / "again"
    options = ("--record-sensors", "--no-recording", "--duration", duration, "--out", run)
    assert crossmodal("run", "swing", *options).exit_code == 0
    assert crossmodal("replay", run, "--out", again).exit_code == 0
    pd.testing.assert_frame_equal(read_estimates(again), read_estimates(run), check_exact=True)
    for key in ("duration", "success", "events"):
        assert read_summary(again)[key] == read_summary(run)[key]


def test_an_evaluations_files_hold_its_metric(evaluated: Path) -> None:
    assert "angle, RMS error" in (evaluated / "table.md").read_text()
    assert "angle, RMS error" in (evaluated / "report.html").read_text()
    figures = pd.read_csv(evaluated / "results.csv")
    errors = figures[(figures["metric"] == "angle_rms_error") & (figures["modality"] == "stubborn")]
    assert errors["seed"].tolist() == [0, 1, 2]
    assert errors["value"].nunique() == 3
    assert errors["value"].between(0.0, 0.6 * NOISE).all()


def test_an_evaluation_goes_on_where_it_was(evaluated: Path) -> None:
    summaries = sorted(evaluated.glob("seed-*/summary.json"))
    before = [path.stat().st_mtime_ns for path in summaries]
    for name in RESULTS:
        (evaluated / name).unlink()
    result = crossmodal("evaluate", "swing", "--seeds", 3, "--jobs", 2, "--out", evaluated)
    assert result.exit_code == 0, result.output
    assert len(before) == 3
    assert [path.stat().st_mtime_ns for path in summaries] == before
    assert all((evaluated / name).is_file() for name in RESULTS)


@pytest.mark.skipif(shutil.which("dot") is None, reason="Graphviz is not installed")
def test_its_filter_can_be_drawn(tmp_path: Path) -> None:
    path = tmp_path / "filter.svg"
    result = crossmodal("diagram", "swing", "--modality", "open", "--out", path)
    assert result.exit_code == 0, result.output
    assert "kalman filter" in path.read_text()


@pytest.mark.parametrize("command", ["run", "diagram"])
def test_an_unknown_key_is_refused_in_one_line(tmp_path: Path, command: str) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("system: pendulum\nnose: 0.1\n")
    result = crossmodal(command, path)
    assert result.exit_code == 2
    assert result.stderr.startswith(f"crossmodal: {path}: unknown key 'nose'; did you mean 'noise'")
    assert result.stderr.count("\n") == 1


@pytest.mark.parametrize("noise", ["-1", ".nan", ".inf", "1e300"])
def test_a_number_outside_its_declared_range_is_refused_in_one_line(
    tmp_path: Path, noise: str
) -> None:
    result = crossmodal("run", "swing", "--set", f"noise={noise}", "--out", tmp_path / "run")
    assert result.exit_code == 2
    said = f"noise = {float(noise.lstrip('.'))!r} rad or rad/s, need >= 0, <= 10 rad or rad/s"
    assert f"swing.yaml: {said}" in result.stderr
    assert result.stderr.count("\n") == 1


def test_only_the_estimators_that_are_asked_for_run(tmp_path: Path) -> None:
    options = ("run", "swing", "--duration", 1, "--modalities")
    result = crossmodal(*options, "open", "--out", tmp_path / "run")
    assert result.exit_code == 0, result.output
    assert list(read_summary(tmp_path / "run")["modalities"]) == ["open"]
    refused = crossmodal(*options, "opne", "--out", tmp_path / "none")
    assert refused.exit_code == 2
    assert "unknown modality 'opne'; did you mean 'open'?" in refused.stderr


def test_an_episode_is_not_valid_any_more_once_its_application_was_edited(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hashes = []
    for number, noise in enumerate(("0.02", "0.03")):
        copy = tmp_path / str(number) / "pendulum.py"
        copy.parent.mkdir()
        copy.write_text(FILE.read_text().replace("0.02", noise))
        shutil.copy(FILE.with_name("swing.yaml"), copy.parent)
        monkeypatch.setenv(OWN, str(copy))
        application, scenario = load_scenario("swing", ["noise=0.01"])
        hashes.append(fingerprint(application, scenario))
    assert hashes[0]["scenario_hash"] == hashes[1]["scenario_hash"]
    assert hashes[0]["source_hash"] != hashes[1]["source_hash"]


def test_an_estimator_that_reads_the_truth_is_refused_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    copy = tmp_path / "pendulum.py"
    honest = 'self._declare_value_input("state_window", window)'
    assert honest in FILE.read_text()
    copy.write_text(
        FILE.read_text().replace(honest, 'self.DeclareVectorInputPort("cheat_state", 2)')
    )
    shutil.copy(FILE.with_name("swing.yaml"), tmp_path)
    monkeypatch.setenv(OWN, str(copy))
    result = crossmodal("run", "swing", "--out", tmp_path / "run")
    assert result.exit_code == 2
    assert "reads 'cheat_state': the truth is not for it" in result.stderr
    assert result.stderr.count("\n") == 1


def test_a_port_that_is_not_from_the_state_alone_is_not_recorded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Read half a tick later, it would be off by the motion meanwhile."""
    text = FILE.read_text().replace(
        '_declare_latest("state_latest"', '_declare_estimated("state_latest"'
    )
    own = tmp_path / "feedthrough.py"
    own.write_text(text)
    shutil.copy(FILE.with_name("swing.yaml"), tmp_path)
    monkeypatch.setenv(OWN, str(own))
    result = crossmodal("run", "swing", "--out", tmp_path / "run")
    assert result.exit_code == 2
    assert "'stubborn': its port 'state_latest' depends on what the sensors give" in result.stderr


@pytest.mark.parametrize(
    ("line", "instead", "message", "ticks"),
    [
        (
            "return mean + gain",
            "assert context.get_time() < 1.0, 'lost'; return mean + gain",
            "AssertionError: lost",
            True,
        ),
        ('tick.values["state_latest"]', 'tick.values["state"]', "KeyError: 'state'", False),
    ],
)
def test_what_its_code_raises_is_told_and_the_run_is_kept(
    line: str,
    instead: str,
    message: str,
    ticks: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert line in FILE.read_text()
    text = FILE.read_text().replace(line, instead)
    own = tmp_path / "broken.py"
    own.write_text(text)
    shutil.copy(FILE.with_name("swing.yaml"), tmp_path)
    monkeypatch.setenv(OWN, str(own))
    result = crossmodal("run", "swing", "--record-sensors", "--out", tmp_path / "run")
    assert result.exit_code == 1
    place = 1 + text[: text.index(instead)].count("\n")
    assert f"The episode failed: broken.py:{place}: {message}" in result.output
    summary = read_summary(tmp_path / "run")
    assert (summary["success"], summary["interrupted"]) == (False, False)
    assert message in summary["failure"]
    assert "Traceback" in (tmp_path / "run/log.txt").read_text()
    assert (tmp_path / "run/sensors.mcap").is_file()
    assert bool(len(read_estimates(tmp_path / "run"))) == ticks
