import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from crossmodal.diagrams.command_line import app

RUNNER = CliRunner()


@pytest.fixture
def runs() -> None:
    for name, duration in (("a", 20.0), ("b", 22.0)):
        Path(name).mkdir()
        Path(name, "scenario.yaml").write_text(f"system: crossmodal\nduration: {duration}\n")
        summary = {"seed": 1, "success": True, "modalities": {}, "duration": duration}
        Path(name, "summary.json").write_text(json.dumps(summary))


@pytest.mark.usefixtures("runs")
def test_compare_prints_a_table_and_writes_a_page() -> None:
    result = RUNNER.invoke(app, ["compare", "a", "b", "--out", "page.html"])
    assert result.exit_code == 0, result.output
    assert "| duration |  | 20 s | 22 s | +2 s |" in result.output
    assert "| duration [s] | 20.0 | 22.0 |" in result.output
    assert "<td>+2 s</td>" in Path("page.html").read_text()
    again = ["compare", "a", "b", "--out", "page.html"]
    assert RUNNER.invoke(app, again).exit_code == 2
    assert RUNNER.invoke(app, [*again, "--force"]).exit_code == 0


@pytest.mark.usefixtures("runs")
@pytest.mark.parametrize(
    ("folders", "expected"),
    [
        (["a"], "Name two folders or more"),
        (["a", "none"], "none: holds neither a summary.json nor episodes"),
        (["a", "b/summary.json"], "holds neither"),
    ],
)
def test_what_cannot_be_compared_is_refused_in_one_line(folders: list[str], expected: str) -> None:
    result = RUNNER.invoke(app, ["compare", *folders])
    assert result.exit_code == 2
    assert expected in result.stderr
    assert result.stderr.count("\n") == 1
