import re
import shutil
from xml.etree import ElementTree

import numpy as np
import pytest
from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.drawing import diagram_drawing
from crossmodal.diagrams.drawing.diagram_drawing import diagram_dot, render_svg, wires, words
from crossmodal.diagrams.run.build import build_estimators
from crossmodal.maths.arrays import Array


def fake_filter(name: str, package: str, inputs: list[str], outputs: list[str]) -> LeafSystem:
    """A system of a class `name` from `package` with vector ports of these names."""

    def initialise(self: LeafSystem) -> None:
        LeafSystem.__init__(self)
        for port in inputs:
            self.DeclareVectorInputPort(port, 1)
        for port in outputs:
            self.DeclareVectorOutputPort(
                port, 1, lambda context, output: None, {self.nothing_ticket()}
            )

    kind = type(name, (LeafSystem,), {"__init__": initialise, "__module__": package})
    return kind()


def network() -> Diagram:
    """A body filter with a joint filter above it; the body filter in a Diagram of its own."""
    inner = DiagramBuilder()
    bodies = inner.AddNamedSystem(
        "bodies",
        fake_filter(
            "RigidBodyMotion",
            "crossmodal.systems.vision.bodies.rigid_body_motion",
            ["features_estimated", "joint_predictions"],
            ["body_motions_estimated"],
        ),
    )
    inner.ExportInput(bodies.GetInputPort("features_estimated"), "features_estimated")
    inner.ExportInput(bodies.GetInputPort("joint_predictions"), "joint_predictions")
    inner.ExportOutput(bodies.get_output_port(), "body_motions_estimated")
    builder = DiagramBuilder()
    vision = builder.AddNamedSystem("vision", inner.Build())
    joints = builder.AddNamedSystem(
        "joints",
        fake_filter(
            "KinematicModel",
            "crossmodal.systems.kinematics.kinematic_model",
            ["body_motions"],
            ["bodies_predicted"],
        ),
    )
    builder.Connect(vision.get_output_port(), joints.get_input_port())
    builder.Connect(joints.get_output_port(), vision.GetInputPort("joint_predictions"))
    builder.ExportInput(vision.GetInputPort("features_estimated"), "features_estimated")
    return builder.Build()


def test_every_wire_between_leaf_systems_is_found_through_nested_diagrams() -> None:
    found = {
        (
            "" if wire.source is None else wire.source.get_name(),
            wire.source_port,
            wire.target.get_name(),
            wire.target_port,
        )
        for wire in wires(network())
    }
    assert found == {
        ("", "features_estimated", "bodies", "features_estimated"),
        ("bodies", "body_motions_estimated", "joints", "body_motions"),
        ("joints", "bodies_predicted", "bodies", "joint_predictions"),
    }


def test_measurements_are_solid_and_predictions_dashed() -> None:
    lines = diagram_dot(network(), "drawer").splitlines()
    (up,) = (line for line in lines if "body_motions_estimated to body_motions" in line)
    (down,) = (line for line in lines if "bodies_predicted to joint_predictions" in line)
    assert "dashed" not in up
    assert 'label="body motions"' in up
    assert "style=dashed" in down
    assert "constraint=false" in down


def test_one_of_several_of_a_kind_is_called_by_its_own_name() -> None:
    builder = DiagramBuilder()
    for name in ("left_camera_noise", "right_eye", None):
        system = fake_filter("CameraNoise", "crossmodal.systems.sensors.rgbd_camera", [], ["x"])
        builder.AddNamedSystem(name, system) if name else builder.AddSystem(system)
    dot = diagram_dot(builder.Build(), "two cameras")
    for label in ("left camera noise", "camera noise\\nright eye", "camera noise"):
        assert f'[label="{label}"' in dot


def test_systems_are_grouped_by_what_they_perceive_with() -> None:
    dot = diagram_dot(network(), "drawer")
    assert 'label="rigid body motion' in dot
    assert 'label="kinematic model' in dot
    assert dot.index("cluster_Vision") < dot.index("rigid body motion")
    assert "cluster_Kinematics" in dot


@pytest.mark.skipif(shutil.which("dot") is None, reason="Graphviz is not installed")
def test_the_svg_holds_a_node_per_system_and_an_edge_per_wire() -> None:
    svg = render_svg(diagram_dot(network(), "drawer & <door>"))
    assert svg.lstrip().startswith("<?xml")
    assert svg.count('class="edge"') == 3
    assert "rigid body motion" in svg
    assert "drawer &amp; &lt;door&gt;" in svg


def test_a_missing_graphviz_names_the_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(diagram_drawing.shutil, "which", lambda name: None)
    with pytest.raises(RuntimeError, match="install the system package 'graphviz'"):
        render_svg(diagram_dot(network(), "drawer"))


def test_names_are_read_as_words() -> None:
    assert words("EndEffectorMotion") == "end effector motion"
    assert words("drake/systems/ZeroOrderHold@1") == "zero order hold@1"
    assert words("body_motions") == "body motions"


def title_boxes(svg: str) -> dict[str, tuple[float, float, float, float]]:
    """Left, top, right and bottom of the titles of the rooms, by their words."""
    found = {}
    for text in ElementTree.fromstring(svg).findall(".//{*}text"):
        if text.get("font-size") == "15.00" and text.text:
            x, y, half = float(text.get("x", 0)), float(text.get("y", 0)), 3.6 * len(text.text)
            found[text.text] = (x - half, y - 10.0, x + half, y)
    return found


def wire_points(svg: str) -> Array:
    """Points (n, 2) on all wires, close together."""
    share = np.linspace(0.0, 1.0, 50)[:, None]
    weights = [(1 - share) ** 3, 3 * share * (1 - share) ** 2, 3 * share**2 * (1 - share), share**3]
    points = []
    for group in ElementTree.fromstring(svg).findall(".//{*}g"):
        for path in group.findall(".//{*}path") if group.get("class") == "edge" else []:
            numbers = re.findall(r"-?[\d.]+", path.get("d", ""))
            control = np.array(numbers, dtype=float).reshape(-1, 2)
            for first in range(0, len(control) - 1, 3):
                piece = control[first : first + 4]
                points.append(sum(w * p for w, p in zip(weights, piece, strict=True)))
    return np.concatenate(points)


@pytest.mark.skipif(shutil.which("dot") is None, reason="Graphviz is not installed")
def test_no_wire_crosses_the_title_of_a_room() -> None:
    application, scenario = load_scenario("drawer", ["modalities=[crossmodal]"])
    (estimator,) = build_estimators(application, scenario).values()
    svg = render_svg(diagram_dot(estimator, "drawer"))
    boxes = title_boxes(svg)
    assert {"Proprioception", "Vision", "Kinematics"} <= boxes.keys()
    x, y = wire_points(svg).T
    for title, (left, top, right, bottom) in boxes.items():
        assert not np.any((left < x) & (x < right) & (top < y) & (y < bottom)), title
