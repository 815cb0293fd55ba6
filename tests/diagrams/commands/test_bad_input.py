import shutil
import sys
import types
from pathlib import Path

import pytest
from typer.testing import CliRunner

from crossmodal.diagrams import command_line
from crossmodal.diagrams.command_line import app

RUNNER = CliRunner()
RECORDING = Path(__file__).parents[2] / "recordings/drawer"


@pytest.mark.parametrize(
    "arguments",
    [
        ["run", "drawr"],
        ["run", "none.yaml"],
        ["run", "malformed.yaml"],
        ["run", "drawer", "--set", "sensors.encoders.noise_positio=1"],
        ["run", "drawer", "--set", "plant.time_step=1e-9"],
        ["run", "drawer", "--set", "control.exploration.speed=.nan"],
        ["run", "drawer", "--set", "objects.drawer.model=none.sdf"],
        ["run", "drawer", "--set", "objects.drawer.handle_frame=none"],
        ["run", "drawer", "--modalities", "vision,smell"],
        ["run", "drawer", "--duration", "-3"],
        ["run", "drawer", "--out", "malformed.yaml/run"],
        ["run", "drawer", "--host", "203.0.113.7"],
        ["run", "drawer", "--host", "nope.invalid"],
        ["run", "drawer", "--set", "name=../../../evil"],
        ["run", "drawer", "--set", "name=.."],
        ["run", "drawer", "--out", ".", "--force"],
        ["train", "hand-bending"],
        ["evaluate", "cupboard"],
        ["evaluate", "drawer", "--seeds", "a:b"],
        ["evaluate", "drawer", "--seeds", "5:5"],
        ["evaluate", "drawer", "--backend", "rey"],
        ["evaluate", "drawer", "--set", "duratoin=3"],
        ["train", "hand-bending", "--out", "malformed.yaml/weights"],
        ["diagram", "drawer", "--modality", "touch"],
        ["diagram", "drawer", "--out", "malformed.yaml"],
    ],
)
def test_bad_input_is_answered_in_one_line_with_status_two(
    arguments: list[str], fake_episode: types.SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    Path("malformed.yaml").write_text("a: [1\n")
    monkeypatch.setattr(
        "crossmodal.diagrams.run.build.build_estimators",
        lambda application, scenario: dict.fromkeys(scenario.modalities),
    )
    result = RUNNER.invoke(app, arguments)
    assert result.exit_code == 2, result.output
    assert result.stderr.startswith("crossmodal: ")
    assert result.stderr.count("\n") == 1
    assert fake_episode.runs == []
    assert sorted(path.name for path in Path().iterdir()) == ["malformed.yaml"]


@pytest.mark.parametrize("arguments", [["run"], ["run", "drawer", "--sed", "3"], ["fly"],
                                       ["run", "drawer", "--seed", "x"]])  # fmt: skip
def test_bad_options_are_answered_in_one_line_with_status_two(
    arguments: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["crossmodal", *arguments])
    assert command_line.main() == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("crossmodal: ")
    assert captured.err.count("\n") == 1
    assert "; see 'crossmodal" in captured.err


@pytest.mark.parametrize("place", ["chunk", "schema"])
@pytest.mark.parametrize(
    "command",
    [
        ["replay", "run"],
        ["inspect", "run"],
        ["stream", "run", "--to", "seen.mcap"],
        ["export", "run", "--to", "sdf"],
        ["export", "run", "--to", "bag", "--out", "seen.bag", "--force"],
        ["export", "run", "--to", "db3", "--out", "new/seen"],
    ],
)
def test_a_recording_with_one_wrong_byte_is_refused_in_one_line_and_leaves_nothing(
    command: list[str], place: str
) -> None:
    shutil.copytree(RECORDING, "run")
    Path("seen.bag").write_text("mine")
    file = Path("run/sensors.mcap")
    data = bytearray(file.read_bytes())
    data[len(data) // 2 if place == "chunk" else data.rindex(b"MSG: std_msgs/Header") - 20] ^= 0x15
    file.write_bytes(data)
    before = sorted(Path().rglob("*"))
    result = RUNNER.invoke(app, command)
    assert result.exit_code == 2, result.output
    told = result.stderr.splitlines()[-1]
    assert told.startswith("crossmodal: run")
    assert "damaged" in told
    assert len(told) < 200
    assert "Traceback" not in result.output
    assert sorted(Path().rglob("*")) == before
    assert Path("seen.bag").read_text() == "mine"
