from pathlib import Path
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.command_line import app
from crossmodal.diagrams.run.folder.perceived_file import PERCEIVED_FILE
from crossmodal.diagrams.run.folder.run_folder import write_scenario


def export(*options: str, code: int = 0) -> str:
    result = CliRunner().invoke(app, ["export", *options])
    assert result.exit_code == code, result.output
    return result.output


def test_a_run_keeps_what_every_estimator_perceived(fake_episode: SimpleNamespace) -> None:
    options = ["run", "drawer", "--no-recording", "--out", "run"]
    assert CliRunner().invoke(app, options).exit_code == 0
    assert Path("run", PERCEIVED_FILE).exists()
    assert "as 'crossmodal' perceived it" in export("run", "--to", "sdf")
    assert "as 'vision' perceived it" in export(
        "run", "--to", "urdf", "--estimator", "vision", "--out", "seen.urdf"
    )
    text = Path("seen.urdf").read_text()
    assert '<robot name="drawer">' in text
    assert 'type="prismatic"' in text
    assert "allowed: crossmodal, proprioception, vision" in export(
        "run", "--to", "urdf", "--estimator", "touch", code=2
    )


@pytest.mark.parametrize(
    ("scenario", "options", "message"),
    [
        ("", ["--to", "sdf"], "run: holds no scenario.yaml; name the folder of a run"),
        ("drawer", ["--to", "mjcf"], "--to = 'mjcf', need one of urdf, sdf, bag, mcap, db3"),
        ("drawer", ["--to", "bag"], "run: holds no sensors.mcap; record one with"),
        ("drawer", ["--to", "bag", "--estimator", "vision"], "a bag (--to bag) holds no estimates"),
        ("drawer", ["--to", "sdf"], "run: holds no perceived.yaml or sensors.mcap; run it again"),
        ("pose", ["--to", "sdf"], "run: the application 'clutter' perceives no articulated object"),
    ],
)
def test_what_cannot_be_exported_is_told_in_one_line(
    scenario: str, options: list[str], message: str
) -> None:
    if scenario:
        write_scenario(Path("run"), *load_scenario(scenario))
    said = export("run", *options, code=2)
    assert message in said
    assert said.count("\n") == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("estimators: [1]", "estimators = [1], but it must be a mapping"),
        ("estimators: {crossmodal: {root: 3}}", "estimators.crossmodal.root = 3"),
        ("estimators: {}", "no joint was perceived"),
        ("{", "is not valid YAML"),
    ],
)
def test_a_damaged_file_is_told_in_one_line(text: str, message: str) -> None:
    write_scenario(Path("run"), *load_scenario("drawer"))
    Path("run", PERCEIVED_FILE).write_text(text)
    said = export("run", "--to", "sdf", code=2)
    assert message in said
    assert said.count("\n") == 1
