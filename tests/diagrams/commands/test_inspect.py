import shlex
import types
from pathlib import Path

import pytest
from PIL import Image
from typer.testing import CliRunner

from crossmodal.diagrams.command_line import app
from crossmodal.models import MODELS_DIR

RUNNER = CliRunner()
EXAMPLE = MODELS_DIR / "examples" / "two_drawers.urdf"


def test_a_model_is_shown_with_a_picture_and_a_command_that_runs_it(
    fake_episode: types.SimpleNamespace,
) -> None:
    result = RUNNER.invoke(app, ["inspect", str(EXAMPLE), "--object-pose", "0.9,0,0.9,0,0,3.1"])
    assert result.exit_code == 0, result.output
    for words in ("2 moving joints", "left_slide", "0 to 0.3 m", "61 mm free behind it"):
        assert words in result.stdout
    assert Image.open("runs/two_drawers.png").size[0] > 1000
    (line,) = [line for line in result.stdout.splitlines() if "crossmodal run" in line]
    words = shlex.split(line)[1:]
    assert RUNNER.invoke(app, [*words, "--out", "run"]).exit_code in (0, 1)
    assert [name for name, *_ in fake_episode.runs] == ["drawer"]
    assert "left_slide" in Path("run/scenario.yaml").read_text()


def test_a_picture_is_not_replaced_unasked() -> None:
    picture = Path("runs/two_drawers.png")
    picture.parent.mkdir()
    picture.write_text("mine")
    result = RUNNER.invoke(app, ["inspect", str(EXAMPLE)])
    assert result.exit_code == 2
    assert picture.read_text() == "mine"


def test_a_model_without_a_handle_is_said_to_have_none_and_what_was_left_out_of_it() -> None:
    gone = "<geometry><mesh filename='gone.obj'/></geometry>"
    Path("box.urdf").write_text(
        "<robot name='m'><link name='a'><visual><geometry><box size='1 1 1'/></geometry></visual>"
        f"<visual>{gone}</visual><collision>{gone}</collision></link></robot>"
    )
    result = RUNNER.invoke(app, ["inspect", "box.urdf"])
    assert result.exit_code == 0, result.output
    assert "none: the hand holds bars of 4 to 55 mm" in result.stdout
    assert "mesh 'gone.obj', which there is not, left out: a\n" in result.stdout
    assert not Path("runs").exists()


@pytest.mark.parametrize("arguments", [["none.sdf"], ["bad.urdf"], [str(EXAMPLE), "--scale", "-1"],
                                       [str(EXAMPLE), "--grasp-frame", "knob"],
                                       [str(EXAMPLE), "--scenario", "none"]])  # fmt: skip
def test_what_cannot_be_inspected_is_answered_in_one_line(arguments: list[str]) -> None:
    Path("bad.urdf").write_text("<robot>")
    result = RUNNER.invoke(app, ["inspect", *arguments])
    assert result.exit_code == 2, result.output
    lines = [line for line in result.stderr.splitlines() if "warning:" not in line]
    assert len(lines) == 1
    assert lines[0].startswith("crossmodal: ")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([str(EXAMPLE), "--drafts", "d"], "--drafts d: {} is no recording"),
        (["a.bag", "--scale", "2"], "--scale 2.0: a.bag is a recording"),
        (["a.bag", "--out", "a.png"], "--out a.png: a.bag is a recording"),
        (["a.bag", "--joint", "lid"], "--joint lid: a.bag is a recording"),
        (["a.bag", "--scenario", "press"], "--scenario press: a.bag is a recording"),
        ([str(EXAMPLE), "--scenario", "flap"], "crossmodal run flap --object FILE"),
    ],
)
def test_an_option_that_would_do_nothing_is_refused(arguments: list[str], message: str) -> None:
    Path("a.bag").touch()
    result = RUNNER.invoke(app, ["inspect", *arguments])
    assert result.exit_code == 2, result.output
    assert message.format(EXAMPLE) in result.stderr
    assert result.stderr.count("\n") == 1
