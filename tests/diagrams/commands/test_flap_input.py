"""What the flap application cannot run ends in one line and status 2."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from crossmodal.diagrams.command_line import app

EXAMPLE = Path(__file__).parents[3] / "models" / "examples" / "squeegee.sdf"
# What is changed in the file of a tool, and a part of the answer.
TOOLS = {
    "without a hinge": ('name="hinge"', 'name="pivot"', "need a revolute joint named 'hinge'"),
    "without a handle": ('name="handle"', 'name="grab"', "need a frame named 'handle', found none"),
    "without an edge": ('name="edge"', 'name="rim"', "need a frame named 'edge', found none"),
    "that slides": ('type="revolute"', 'type="prismatic"', "'hinge' is prismatic"),
    "that turns the other way": ("0 -1 0", "0 1 0", "against its x"),
    "that is no model": ("<sdf", "<stf", "tool.model: "),
}
# Assignments, and a part of the answer.
SCENARIOS = {
    "tool.position=[0.9, 0.0, 0.55]": "flap: holder_arm: the arm does not reach",
    "tool.position=[0.48, -0.4, 0.55]": "flap: finger_arm: the arm does not reach",
    "tool.position=[0.48, 3.0, 0.55]": "flap: holder_arm: the arm does not reach",
    "finger.taxels=[[0, 0], [0.003, 0], [0, 0.003]]": "finger.taxels: TaxelLayout: 3 taxels, need",
    "finger.taxels=[]": "finger.taxels = []",
    "cameras.camera.looking_at=[3.0, 0.0, 0.12]": "cameras.camera: the flap at",
    "cameras.camera.position=[0.48, 2.5, 0.55]": "cameras.camera: it sees the flap edge-on only",
    "disturbances.taxels=[{taxel: 12}]": "TaxelSensor: taxel = 12, need < 12, their number",
    "disturbances.faults=[{stream: taxel_windows}]": "did you mean 'taxel_window'?",
    "disturbances.jerks=[{start: 3, end: 1}]": "disturbances.jerks.0 = 3 to 1 s",
}


@pytest.fixture(autouse=True)
def nothing_is_simulated(monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*_: object, **__: object) -> None:
        raise AssertionError("nothing is simulated")

    monkeypatch.setattr("crossmodal.diagrams.run.episode.Episode.Run", never)


def check(arguments: list[str], expected: str) -> None:
    result = CliRunner().invoke(app, ["run", "flap", "--no-recording", *arguments])
    assert result.exit_code == 2, result.output
    assert result.stderr.startswith("crossmodal: ")
    assert result.stderr.count("\n") == 1
    assert expected in result.stderr


@pytest.mark.parametrize("about", TOOLS)
def test_a_tool_is_refused(about: str) -> None:
    old, new, expected = TOOLS[about]
    Path("mine.sdf").write_text(EXAMPLE.read_text().replace(old, new))
    check(["--object", "mine.sdf"], expected)
    assert [path.name for path in Path().iterdir()] == ["mine.sdf"]


@pytest.mark.parametrize("assignment", SCENARIOS)
def test_a_scenario_is_refused(assignment: str) -> None:
    check(["--set", assignment], SCENARIOS[assignment])
    assert list(Path().iterdir()) == []
