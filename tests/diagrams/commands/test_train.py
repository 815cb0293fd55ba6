import importlib.util

import pytest
from typer.testing import CliRunner

from crossmodal.diagrams.command_line import app


def test_without_pytorch_it_names_the_extra_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    result = CliRunner().invoke(app, ["train", "hand-bending", "--out", "weights"])
    assert result.exit_code == 2
    assert result.stderr.endswith("not installed; .venv/bin/pip install --editable '.[train]'\n")
