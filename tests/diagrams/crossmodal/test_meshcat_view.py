import re
from base64 import b64decode

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.geometry import Mesh, Meshcat
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from synthetic_episode import ReplayedBeliefs, connect_all, nudged, synthetic_episode

from crossmodal.diagrams.crossmodal import meshcat_view
from crossmodal.diagrams.crossmodal.meshcat_view import (
    MeshcatView,
)
from crossmodal.diagrams.drawing.meshcat import start_meshcat
from crossmodal.diagrams.drawing.text_board import text_board
from crossmodal.diagrams.joints.joint_metrics import joint_episode
from crossmodal.diagrams.joints.joint_palette import JOINT, body_color, body_label
from crossmodal.diagrams.run.episode import recorded_page
from crossmodal.systems.port_values import HELD_BODY, STATIC_BODY, JointType


@pytest.fixture(scope="module")
def meshcat() -> Meshcat:
    return start_meshcat()


def show(meshcat: Meshcat, joint_type: JointType, duration: float) -> None:
    builder = DiagramBuilder()
    source = builder.AddSystem(ReplayedBeliefs(synthetic_episode(joint_type)))
    view = builder.AddSystem(MeshcatView(meshcat, ["crossmodal", "proprioception"]))
    connect_all(builder, source, view)
    Simulator(builder.Build()).AdvanceTo(duration)


@pytest.mark.parametrize(
    ("joint_type", "other"),
    [(JointType.PRISMATIC, JointType.REVOLUTE), (JointType.REVOLUTE, JointType.PRISMATIC)],
)
def test_features_joint_and_text_are_drawn(
    meshcat: Meshcat, joint_type: JointType, other: JointType
) -> None:
    show(meshcat, joint_type, 6.05)
    layer = "/perception/crossmodal"
    for path in ("bar", "direction_ahead/cone", "direction_behind/cone"):
        assert meshcat.HasPath(f"{layer}/joint/{joint_type}/{path}")
    assert not meshcat.HasPath(f"{layer}/joint/{other}")
    assert meshcat.HasPath(f"{layer}/features/set_7/body_0")
    assert meshcat.HasPath(f"{layer}/features/set_7/body_1")
    assert meshcat.HasPath(f"{layer}/text")


def test_the_text_counts_from_the_grasp_as_the_estimates_do(
    meshcat: Meshcat, monkeypatch: pytest.MonkeyPatch
) -> None:
    written: list[str] = []

    def keep(text: str, height: float, color: tuple[int, int, int]) -> Mesh:
        written.append(text)
        return text_board(text, height, color)

    monkeypatch.setattr(meshcat_view, "text_board", keep)
    record = nudged(synthetic_episode(), 0.05)
    builder = DiagramBuilder()
    source = builder.AddSystem(ReplayedBeliefs(record))
    view = builder.AddSystem(MeshcatView(meshcat, ["vision"]))
    connect_all(builder, source, view)
    Simulator(builder.Build()).AdvanceTo(9.0)
    series = joint_episode(record).series["vision"]
    last = 100.0 * series.configuration[series.times <= 9.0][-1]
    text = float(written[-1].removeprefix("prismatic ").partition(" ")[0])
    assert abs(text - last) < 1.5  # As far as it goes between two texts.


def test_features_are_dots_with_an_outline(meshcat: Meshcat) -> None:
    show(meshcat, JointType.PRISMATIC, 1.0)
    for part in ("dots", "outline"):
        assert meshcat.HasPath(f"/perception/crossmodal/features/set_1/body_0/{part}")


def test_a_legend_says_which_modality_is_drawn_and_names_what_can_be_seen(
    meshcat: Meshcat, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: dict[str, str] = {}
    titles: list[str] = []

    def keep(meshcat: Meshcat, title: str, entries: list[tuple[str, str, str]]) -> None:
        titles.append(title)
        shown.update({color: text for _, color, text in entries})

    monkeypatch.setattr(meshcat_view, "show_legend", keep)
    MeshcatView(meshcat, ["vision", "crossmodal"])
    assert "cross-modal" in titles[0]
    for body in (STATIC_BODY, HELD_BODY, 2):
        assert shown[body_color(body)] == body_label(body)
    for kind in (JointType.PRISMATIC, JointType.REVOLUTE):
        assert str(kind) in shown[JOINT[kind]]


def test_textured_meshes_take_the_place_of_what_the_scene_shows(meshcat: Meshcat) -> None:
    path = "/drake/visualizer/chest/front"
    mesh = text_board("as wood", 0.1, (0, 0, 0))
    view = MeshcatView(meshcat, [], {path: mesh})
    simulator = Simulator(view)
    simulator.AdvanceTo(0.05)
    assert not meshcat.HasPath(path)
    simulator.AdvanceTo(0.15)
    assert meshcat.HasPath(path)


def test_the_planned_path_is_drawn_anew_while_there_is_a_plan(meshcat: Meshcat) -> None:
    view = MeshcatView(meshcat, [])
    simulator = Simulator(view)
    port = view.GetInputPort("path_planned")
    path = "/perception/planned_path"
    value = port.FixValue(simulator.get_mutable_context(), Value[object](np.zeros((0, 4, 4))))
    simulator.AdvanceTo(0.5)
    assert not meshcat.HasPath(path)
    value.GetMutableData().set_value(np.array([np.eye(4), np.eye(4)]))
    simulator.AdvanceTo(2.0)
    assert meshcat.HasPath(f"{path}/line_1")
    assert meshcat.HasPath(f"{path}/line_2")
    assert not meshcat.HasPath(f"{path}/line_3")


def test_nothing_is_drawn_of_a_joint_before_it_is_believed_in(meshcat: Meshcat) -> None:
    show(meshcat, JointType.PRISMATIC, 4.5)
    assert not meshcat.HasPath("/perception/crossmodal/joint")
    assert not meshcat.HasPath("/perception/crossmodal/text")


def animated(page: str) -> dict[str, str]:
    """By path, the names of the properties that the animation in a page changes."""
    messages = map(b64decode, re.findall(r'"data:application/octet-binary;base64,([^"]+)"', page))
    (animation,) = (message for message in messages if b"set_animation" in message)
    parts = animation.decode("latin-1").split("/perception/")[1:]
    found = {}
    for part in parts:
        path = re.match(r"[\w/]+", part)
        assert path is not None
        found[path.group()] = " ".join(re.findall(r"\.(?:visible|scale|position|quaternion)", part))
    return found


def test_the_recording_animates_visibility_scale_and_pose(meshcat: Meshcat) -> None:
    meshcat.StartRecording(frames_per_second=30.0)
    show(meshcat, JointType.PRISMATIC, 6.05)
    changes = animated(recorded_page(meshcat))
    meshcat.DeleteRecording()
    joint = "crossmodal/joint/prismatic"
    assert ".visible" in changes[joint]
    assert ".position" in changes[joint]
    assert ".scale" in changes[f"{joint}/direction_ahead/cone"]
    assert ".position" in changes["crossmodal/features/set_7/body_1"]
    assert ".visible" in changes["crossmodal/features/set_1/body_0"]
