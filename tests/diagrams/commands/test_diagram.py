from pathlib import Path

import pytest
from typer.testing import CliRunner

from crossmodal.diagrams.command_line import app
from crossmodal.diagrams.drawing import diagram_drawing


def test_a_drawing_without_a_place_goes_to_the_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(diagram_drawing, "render_svg", lambda dot: dot)
    result = CliRunner().invoke(app, ["diagram", "drawer", "--modality", "proprioception"])
    assert result.exit_code == 0, result.output
    assert "digraph" in Path("runs/drawer-proprioception.svg").read_text()
    assert [path.name for path in Path().iterdir()] == ["runs"]
