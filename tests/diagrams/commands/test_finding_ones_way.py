"""Completion, listings, help of one application, and the log of a run."""

from pathlib import Path
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

from crossmodal.diagrams.applications import OWN, applications, load_scenario, scenarios_of
from crossmodal.diagrams.command_line import app
from crossmodal.diagrams.commands.completion import (
    complete_connection,
    complete_experiment,
    complete_scenario,
)
from crossmodal.diagrams.commands.listings import listings
from crossmodal.diagrams.run.listing import description_of

RUNNER = CliRunner()


def test_the_listings_are_those_of_the_applications() -> None:
    known = {one.name: one for one in listings()}
    assert list(known) == list(applications())
    files = {name: path for one in listings() for name, path in one.files().items()}
    for name, application in applications().items():
        assert known[name].description == application.description
        assert known[name].experiments == application.experiments
        assert known[name].files() == scenarios_of(application)
        assert (known[name].object_options is None) == (application.own_object is None)
    for name, path in files.items():
        assert description_of(path, files) == load_scenario(name)[1].description


def test_one_bad_scenario_ends_no_list(tmp_path: Path) -> None:
    (tmp_path / "bad.yaml").write_text("a: [")
    assert "cannot be read" in description_of(tmp_path / "bad.yaml", {})
    (tmp_path / "circle.yaml").write_text("base: circle")
    assert description_of(tmp_path / "circle.yaml", {}) == ""


def test_names_are_completed_with_what_they_are() -> None:
    found = dict(complete_scenario("drawer-"))
    assert {"drawer-lights-off", "drawer-return"} <= set(found)
    assert all(found.values())
    assert "flap-jerked" in dict(complete_experiment("flap"))
    assert "all" in dict(complete_experiment("al"))
    assert complete_connection("no such connection") == []


def completed(words: str) -> list[str]:
    """What bash offers for the last of the words."""
    environment = {
        "_CROSSMODAL_COMPLETE": "complete_bash",
        "COMP_WORDS": words,
        "COMP_CWORD": str(words.count(" ")),
    }
    result = RUNNER.invoke(app, [], env=environment, prog_name="crossmodal")
    assert (result.exit_code, result.stderr) == (0, ""), result.output
    return result.stdout.split()


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("show drawer perception.hand_bending.cr", "perception.hand_bending.creep"),
        ("run drawer --set control.sequence.stop", "control.sequence.stop_time"),
        ("run --seed 3 drawer --set task.go", "task.goal"),
        ("evaluate flap --set control.sequence.an", "control.sequence.angle"),
        ("replay run --set perception.hand_bending.cr", "perception.hand_bending.creep"),
        ("run drawer --modalities vision,cr", "vision,crossmodal"),
        ("diagram drawer --modality cr", "crossmodal"),
        ("diagram cupboard-door-m", "cupboard-door-miscalibrated"),
        ("inspect x.sdf --scenario cupboard-door-m", "cupboard-door-miscalibrated"),
        ("export run --to u", "urdf"),
        ("joints x.csv --to s", "sdf"),
        ("stream run --to f", "foxglove"),
    ],
)
def test_what_there_is_is_completed(words: str, expected: str) -> None:
    Path("run").mkdir()
    Path("run/scenario.yaml").write_text("base: drawer\nsystem: crossmodal\n")
    assert completed(f"crossmodal {words}") == [expected]


def test_a_completion_prints_nothing_where_something_is_broken(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    Path("broken_here.py").write_text("print('hello')\nimport no_such_module\n")
    Path("bad.yaml").write_text("system: crossmodal\nduratoin: 3\n")
    monkeypatch.setenv(OWN, "broken_here.py")
    assert completed("crossmodal run cupboard-door-m") == ["cupboard-door-miscalibrated"]
    for words in (
        "show bad.yaml dur",
        "show nothing dur",
        "run --set dur",
        "evaluate none --set d",
    ):
        assert completed(f"crossmodal {words}") == []


def test_files_are_completed_where_no_scenario_begins_so() -> None:
    Path("mine").mkdir()
    Path("mine.yaml").touch()
    assert [name for name, _ in complete_scenario("min")] == ["mine/", "mine.yaml"]


@pytest.mark.parametrize(
    ("scenario", "shown", "hidden"),
    [
        ([], ["--object", "--grasp-frame", "--scale"], []),
        (["drawer"], ["--object", "--grasp-frame", "--scale"], []),
        (["pose"], ["--object", "--scale"], ["--grasp-frame", "--pull-direction"]),
        (["flap"], ["--object"], ["--grasp-frame", "--scale"]),
        (["--seed", "3", "flap"], ["--object"], ["--grasp-frame", "--scale"]),
        (["--modalities", "vision", "drawer"], ["--object", "--grasp-frame", "--scale"], []),
        (["my_flap.yaml"], ["--object"], ["--grasp-frame", "--scale"]),
        (["mine.yaml", "--out", "drawer"], ["--object"], ["--grasp-frame", "--scale"]),
        (["none.yaml"], ["--object", "--grasp-frame", "--scale"], []),
    ],
)
def test_help_after_a_scenario_leaves_out_what_its_application_has_no_use_for(
    scenario: list[str], shown: list[str], hidden: list[str]
) -> None:
    Path("my_flap.yaml").write_text("base: flap-jerked\n")
    Path("mine.yaml").write_text("system: flap\n")
    options = RUNNER.invoke(app, ["run", *scenario, "--help"]).output.partition("Examples:")[0]
    assert all(f"{name} " in options for name in shown)
    assert not any(f"{name} " in options for name in hidden)


def test_a_run_leaves_a_log_of_what_happened(fake_episode: SimpleNamespace) -> None:
    fake_episode.warning = "the light is dim"
    result = RUNNER.invoke(app, ["run", "drawer", "--no-recording", "--out", "run", "-v"])
    assert result.exit_code == 0, result.output
    log = Path("run/log.txt").read_text()
    for text in ("warning: the light is dim", "Versions: ", "Events, in simulated time", "ended;"):
        assert text in log
    assert "Building the simulation of drawer, seed 0" in result.stderr
    again = ["run", "drawer", "--no-recording", "--out", "run", "--force", "-q"]
    result = RUNNER.invoke(app, again)
    assert result.exit_code == 0
    assert result.stdout == ""
    assert "the light is dim" in result.stderr


def test_a_folder_is_shown_and_a_scenarios_options_are_refused_for_it() -> None:
    Path("run").mkdir()
    for arguments, expected in (
        (["run"], "holds nothing of a run"),
        (["run", "control"], "KEY and --set are for scenarios"),
        (["drawer", "--port", "8000"], "is no folder of a run"),
    ):
        result = RUNNER.invoke(app, ["show", *arguments])
        assert result.exit_code == 2
        assert expected in result.stderr
        assert result.stderr.count("\n") == 1
