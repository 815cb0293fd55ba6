"""A tool of the user's own in place of the drawn wiper."""

from collections.abc import Callable
from pathlib import Path

import pytest

from crossmodal.diagrams.flap.application import APPLICATION
from crossmodal.diagrams.flap.own_tool import keep_files, own_tool_assignments, tool_files
from crossmodal.diagrams.flap.scenario import Scenario
from crossmodal.diagrams.run.folder.fingerprint import contents
from crossmodal.diagrams.run.own_object import OwnObject
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError

Load = Callable[..., Scenario]
EXAMPLE = Path(__file__).parents[3] / "models" / "examples" / "squeegee.sdf"


def test_an_own_tool_takes_the_wipers_place(load: Load) -> None:
    made = own_tool_assignments(load("flap"), "flap", OwnObject(model=EXAMPLE))
    scenario = load("flap", *made, "tool.thickness=0.02")
    assert scenario.tool.model == str(EXAMPLE)


@pytest.mark.parametrize(
    ("own", "message"),
    [
        (OwnObject(model=Path("none.sdf")), "--object none.sdf: there is no such file"),
        (OwnObject(model=EXAMPLE, joint="pivot"), "--joint pivot: 'flap' holds a tool by"),
        (OwnObject(model=EXAMPLE, grasp_frame="grip"), "--grasp-frame grip: 'flap' holds"),
        (OwnObject(model=EXAMPLE, scale=0.001), "--scale 0.001: 'flap' holds"),
    ],
)
def test_what_a_tool_does_not_have_is_refused(load: Load, own: OwnObject, message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        own_tool_assignments(load("flap"), "flap", own)


def test_a_tool_without_the_thickness_of_its_bar_is_refused(load: Load) -> None:
    with pytest.raises(ScenarioError, match=r"tool\.thickness: a tool of one's own needs it"):
        load("flap", f"tool.model={EXAMPLE}")


def test_a_run_takes_its_tool_along(load: Load, tmp_path: Path) -> None:
    """The copy is the same tool; a wiper that the seed draws needs no file."""
    scenario = load("flap", f"tool.model={EXAMPLE}", "tool.thickness=0.02")
    kept, files = keep_files(scenario)
    assert files == {"model/squeegee.sdf": EXAMPLE}
    assert kept.tool.model == "model/squeegee.sdf"
    copy = tmp_path / EXAMPLE.name
    copy.write_text(EXAMPLE.read_text())
    other = load("flap", f"tool.model={copy}", "tool.thickness=0.02")
    same = contents(APPLICATION, scenario)
    assert contents(APPLICATION, other) == same
    copy.write_text(EXAMPLE.read_text().replace("0.19", "0.18"))
    assert contents(APPLICATION, other) != same
    assert keep_files(load("flap"))[1] == {}


def test_files_that_a_tool_names_come_along_if_they_lie_beside_it(tmp_path: Path) -> None:
    mesh = "<sdf><mesh><uri>meshes/lip.obj</uri></mesh></sdf>"
    model = tmp_path / "tool.sdf"
    model.write_text(mesh)
    with pytest.raises(ScenarioError, match=r"names 'meshes/lip\.obj', which does not lie"):
        tool_files(model)
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "lip.obj").touch()
    assert tool_files(model) == [model, tmp_path / "meshes" / "lip.obj"]
