"""A scenario finds its application; applications of a user's own are found by a variable."""

import sys
from pathlib import Path

import pytest
from synthetic_episode import LIGHTS_OFF, synthetic_episode
from typer.testing import CliRunner

from crossmodal.diagrams.applications import (
    OWN,
    ApplicationWarning,
    applications,
    experiments,
    find_scenario,
    load_scenario,
    read_run,
    scenario_files,
)
from crossmodal.diagrams.command_line import app
from crossmodal.diagrams.evaluation.run_writer import write_run
from crossmodal.diagrams.run.own_code import GROUP
from crossmodal.diagrams.run.scenario import Scenario
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError

RUNNER = CliRunner()
TOY = """
from dataclasses import dataclass
from pathlib import Path

from crossmodal.diagrams.run.application import Application, Results
from crossmodal.diagrams.run.scenario import Scenario


@dataclass(kw_only=True)
class ToyScenario(Scenario):
    speed: float = 1.0  # [m/s]


APPLICATION = Application(
    name="{name}",
    description="a toy",
    scenario=ToyScenario,
    scenarios=Path(__file__).parent / "scenarios",
    make_station=lambda scenario, calibration: None,
    make_estimators=lambda scenario, calibration: {{}},
    quantities=lambda scenario: (),
    evaluate=lambda record: None,
)
"""


@pytest.fixture
def toy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file of an application of the user's own, with one scenario beside it."""
    path = tmp_path / "rolling_application.py"
    path.write_text(TOY.format(name="toy"))
    (tmp_path / "scenarios").mkdir()
    (tmp_path / "scenarios" / "rolling.yaml").write_text(
        "system: toy\ndescription: a ball rolls\nspeed: 3\n"
    )
    monkeypatch.setenv(OWN, f" {path} ,")
    return path


def test_the_one_that_comes_along_is_there() -> None:
    assert "crossmodal" in applications()
    assert set(experiments()) <= set(scenario_files())


def test_one_of_the_users_own_comes_after_those_that_come_along(toy: Path) -> None:
    *others, last = applications()
    assert "crossmodal" in others
    assert last == "toy"
    assert "rolling" in scenario_files()
    application, scenario = load_scenario("rolling", ["seed=4"])
    assert application.name == "toy"
    assert (scenario.speed, scenario.seed, scenario.name) == (3.0, 4, "rolling")


def test_a_list_shows_each_application_with_its_scenarios(toy: Path) -> None:
    result = RUNNER.invoke(app, ["list"])
    assert result.exit_code == 0, result.output
    assert "toy: a toy" in result.output
    assert "rolling a ball rolls" in " ".join(result.output.split())
    assert result.output.index("drawer") < result.output.index("rolling")


def test_a_users_files_may_be_called_alike_or_as_a_module_of_pythons(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = sys.modules["json"]
    places = [tmp_path / name / "json.py" for name in ("first", "second")]
    for place in places:
        place.parent.mkdir()
        place.write_text(TOY.format(name=place.parent.name))
    monkeypatch.setenv(OWN, ",".join(map(str, places)))
    assert {"first", "second"} <= set(applications())
    assert sys.modules["json"] is before


def test_a_scenario_that_cannot_be_read_does_not_end_a_list(toy: Path) -> None:
    (toy.parent / "scenarios" / "broken.yaml").write_text("system: toy\nsped: 3\n")
    result = RUNNER.invoke(app, ["list"])
    assert result.exit_code == 0, result.output
    shown = " ".join(result.output.split())
    assert "rolling a ball rolls" in shown
    assert "broken cannot be used:" in shown
    assert "unknown key 'sped'; did you mean 'speed'?" in shown


def test_where_applications_of_ones_own_are_named_is_said_where_nothing_is_near(
    toy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mine = toy.parent / "mine.yaml"
    mine.write_text("system: toy\n")
    assert load_scenario(str(mine))[0].name == "toy"
    with pytest.raises(ScenarioError, match=rf"'xyzzy'.*named in {OWN}, which is .*{toy.name}"):
        find_scenario("xyzzy")
    monkeypatch.delenv(OWN)
    for source in ("rolling", str(mine)):
        with pytest.raises(ScenarioError, match=f"named in {OWN}, which is not set"):
            load_scenario(source)
    result = RUNNER.invoke(app, ["evaluate", "rolling"])
    assert f"named in {OWN}, which is not set" in result.stderr


@pytest.mark.parametrize(
    ("assignments", "named"),
    [
        (["seed=3", "task.openin=1"], "task.openin=1"),
        (["duration=-1", "seed=3"], "duration=-1"),
        (["perception={cut: [nothing]}"], "perception={cut: [nothing]}"),
        (["seed=3", "perception.hand_bending.creep=many"], "perception.hand_bending.creep=many"),
    ],
)
def test_a_message_names_the_assignment_that_it_is_about(
    assignments: list[str], named: str
) -> None:
    with pytest.raises(ScenarioError) as caught:
        load_scenario("drawer", assignments)
    assert str(caught.value).endswith(f" (set by {named})")


def test_a_message_about_a_file_names_no_assignment(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("base: drawer\nduration: -1\n")
    with pytest.raises(ScenarioError) as caught:
        load_scenario(str(path), ["seed=3"])
    assert "set by" not in str(caught.value)


def test_model_directives_beside_the_scenarios_are_no_scenario(toy: Path) -> None:
    (toy.parent / "scenarios" / "room.dmd.yaml").write_text("directives: []\n")
    assert not [name for name in scenario_files() if name.startswith("room")]
    result = RUNNER.invoke(app, ["list"])
    assert result.exit_code == 0, result.output


def test_an_application_may_be_a_module(toy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(toy.parent)
    monkeypatch.setenv(OWN, "rolling_application")
    assert "toy" in applications()


@pytest.mark.parametrize("system", ["", "system: crosmodal\n"])
def test_an_unknown_system_lists_the_known_ones(tmp_path: Path, system: str) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(f"{system}duration: 3\n")
    with pytest.raises(ScenarioError, match=r"mine\.yaml: .*system.*crossmodal"):
        load_scenario(str(path))
    result = RUNNER.invoke(app, ["run", str(path)])
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (None, "cannot be had: .*No such file"),
        ("x = 3\n", "holds no Application called APPLICATION"),
        ("APPLICATION = 3\n", "holds no Application called APPLICATION"),
        ("def f(:\n", "cannot be had: .*invalid syntax"),
        ("import no_such_module\n", "cannot be had: .*No module named 'no_such_module'"),
        (TOY.format(name="crossmodal"), "there are two applications 'crossmodal'"),
    ],
)
def test_what_is_no_application_is_left_out_with_a_warning_of_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str | None, expected: str
) -> None:
    path = tmp_path / "mine.py"
    if text is not None:
        path.write_text(text)
    monkeypatch.setenv(OWN, str(path))
    with pytest.warns(ApplicationWarning, match=f"{expected}.*left out"):
        assert list(applications()) == ["crossmodal", "flap", "clutter"]


def test_a_broken_application_ends_no_command_that_does_without_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mine.yaml").write_text("system: mine\n")
    monkeypatch.chdir(tmp_path)
    for number, (command, status) in enumerate(
        [(["list"], 0), (["show", "drawer", "seed"], 0), (["run", "mine.yaml"], 2)]
    ):
        (tmp_path / f"mine{number}.py").write_text("import no_such_module\n")
        monkeypatch.setenv(OWN, f"mine{number}.py")
        result = RUNNER.invoke(app, command)
        assert result.exit_code == status, result.output
        warning, *rest = result.stderr.splitlines()
        assert "warning: application" in warning
        assert "No module named 'no_such_module'; it is left out" in warning
        assert len(rest) == (status == 2)
        assert bool(result.stdout) == (status == 0)


def test_an_installed_package_names_its_applications_as_entry_points(
    toy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    installed = tmp_path / "rolling-1.0.dist-info"
    installed.mkdir()
    (installed / "METADATA").write_text("Metadata-Version: 2.1\nName: rolling\nVersion: 1.0\n")
    (installed / "entry_points.txt").write_text(f"[{GROUP}]\ntoy = rolling_application\n")
    monkeypatch.delenv(OWN)
    assert "toy" not in applications()
    monkeypatch.syspath_prepend(tmp_path)
    assert list(applications())[-1] == "toy"
    monkeypatch.setenv(OWN, "rolling_application")  # Named twice, it is still one.
    assert list(applications())[-1] == "toy"


def test_a_module_that_there_is_not_is_said_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(OWN, "no.such.module")
    with pytest.warns(ApplicationWarning, match=r"'no\.such\.module' cannot be had"):
        applications()


def test_a_scenario_is_found_by_name_or_by_path(tmp_path: Path) -> None:
    assert find_scenario("drawer").name == "drawer.yaml"
    assert find_scenario(str(tmp_path / "x.yaml")) == tmp_path / "x.yaml"
    with pytest.raises(ScenarioError, match="unknown scenario 'drawr'; did you mean 'drawer'"):
        find_scenario("drawr")


def test_a_scenario_is_of_its_applications_class() -> None:
    application, scenario = load_scenario("drawer")
    assert type(scenario) is application.scenario
    assert isinstance(scenario, Scenario)


def test_a_run_is_read_back_with_its_application(tmp_path: Path) -> None:
    record = synthetic_episode(seed=5)
    application = applications()["crossmodal"]
    write_run(tmp_path, application, record, application.evaluate(record))
    run = read_run(tmp_path)
    assert run.application is application
    assert run.scenario.seed == run.summary["seed"] == 5
    assert run.folder == tmp_path
    assert set(run.estimates.modality) == set(run.summary["modalities"])
    assert run.dark() == [(LIGHTS_OFF, float("inf"))]
    (tmp_path / "summary.json").unlink()
    with pytest.raises(ScenarioError, match=r"holds no summary\.json; name the folder"):
        read_run(tmp_path)
