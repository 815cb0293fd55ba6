"""What a tool with a flap needs."""

from pathlib import Path

import numpy as np
import pytest
from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from crossmodal.plants.parsing import add_model, make_parser
from crossmodal.plants.tools.held_tool import check_tool, make_touchable
from crossmodal.plants.tools.wiper import WiperConfig, draw_wiper, wiper_sdf

BODY = '<link name="body"/><link name="flap"/>'
JOINT = """<joint name="{name}" type="{type}"><parent>body</parent><child>flap</child>
<axis><xyz>0 -1 0</xyz></axis></joint>"""
FRAMES = (
    '<frame name="handle" attached_to="body"/><frame name="edge" attached_to="flap">'
    "<pose>0 0 -0.08 0 0 0</pose></frame>"
)


def model(content: str) -> str:
    return f'<sdf version="1.9"><model name="tool">{content}</model></sdf>'


def test_a_wiper_is_a_tool() -> None:
    check_tool(wiper_sdf(draw_wiper(WiperConfig(), np.random.default_rng(0))))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (BODY + FRAMES, "need a revolute joint named 'hinge', found none"),
        (BODY + JOINT.format(name="hinge", type="prismatic") + FRAMES, "'hinge' is prismatic"),
        (
            BODY + JOINT.format(name="hinge", type="revolute"),
            "need a frame named 'handle', found none",
        ),
        (
            BODY + JOINT.format(name="hinge", type="revolute") + FRAMES.partition("/>")[0] + "/>",
            "need a frame named 'edge', found none",
        ),
        (
            BODY + JOINT.format(name="hinge", type="revolute") + FRAMES.replace('"flap"', '"body"'),
            "the frame 'edge' is on 'body', need it on 'flap', which the hinge turns",
        ),
        (
            BODY + JOINT.format(name="hinge", type="revolute").replace("0 -1 0", "0 1 0") + FRAMES,
            "the hinge turns the frame 'edge' against its x",
        ),
    ],
)
def test_a_tool_that_lacks_something_is_refused_in_one_line(
    content: str, message: str, tmp_path: Path
) -> None:
    file = tmp_path / "tool.sdf"
    file.write_text(model(content), encoding="utf-8")
    with pytest.raises(ValueError, match=message) as error:
        check_tool(file)
    assert str(error.value).startswith(str(file))
    assert "\n" not in str(error.value)


def touchable(scene_graph: SceneGraph) -> dict[str, bool]:
    """By name, whether a shape has hydroelastic properties."""
    inspector = scene_graph.model_inspector()
    found = {}
    for geometry in inspector.GetAllGeometryIds():
        properties = inspector.GetProximityProperties(geometry)
        if properties is not None:
            name = inspector.GetName(geometry).split("::")[-1]
            found[name] = bool(properties.HasProperty("hydroelastic", "compliance_type"))
    return found


def test_shapes_of_which_the_file_says_nothing_can_be_touched_by_the_skin() -> None:
    box = "<geometry><box><size>0.1 0.1 0.1</size></box></geometry>"
    soft = (
        '<drake:proximity_properties xmlns:drake="drake"><drake:compliant_hydroelastic/>'
        "<drake:hydroelastic_modulus>1e6</drake:hydroelastic_modulus>"
        "</drake:proximity_properties>"
    )
    shapes = (
        f'<collision name="plain">{box}</collision><collision name="soft">{box}{soft}</collision>'
    )
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.01)
    tool = add_model(make_parser(plant), model(f'<link name="body">{shapes}</link>'), "tool")
    plant.Finalize()
    assert touchable(scene_graph) == {"plain": False, "soft": True}
    make_touchable(plant, scene_graph, tool)
    assert touchable(scene_graph) == {"plain": True, "soft": True}
