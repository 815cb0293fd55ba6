from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from crossmodal.diagrams.command_line import app
from crossmodal.diagrams.crossmodal.studies import ablation_study


def test_each_finished_run_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    joint = {"type_estimated": "prismatic", "type_true": "prismatic"}
    joint |= dict.fromkeys(("configuration_error", "axis_angle_error"), 1e-3)
    results: dict[str, Any] = dict.fromkeys(ablation_study.WIRINGS, joint)
    monkeypatch.setattr(ablation_study, "run_ablation", lambda *_: results)
    result = CliRunner().invoke(app, ["ablate", "body-in-the-hand", "--seeds", "3:5"])
    assert result.exit_code == 0, result.output
    for seed in (3, 4):
        assert f"body-in-the-hand, seed {seed}: done" in result.stderr
    assert "| whole | 2/2 |" in Path("runs/ablations/ablations.md").read_text()
