"""Videos: what is written can be read again, and shows cameras and scene."""

import sys
from pathlib import Path

import numpy as np
import pytest
from pydrake.geometry import SceneGraph
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from crossmodal.diagrams.drawing.layers import Viewpoint
from crossmodal.diagrams.drawing.outside_view import OutsideView
from crossmodal.diagrams.run.video import VideoWriter, add_video, need_encoder, side_by_side
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError

BALL = """<robot name='ball'><link name='ball'>
<inertial><mass value='1'/><inertia ixx='1' iyy='1' izz='1'/></inertial>
<visual><geometry><sphere radius='0.2'/></geometry>
<material name='red'><color rgba='1 0 0 1'/></material></visual></link></robot>"""


def image(value: int, height: int = 48, width: int = 64) -> np.ndarray:
    return np.full((height, width, 3), value, dtype=np.uint8)


def test_frames_come_back_at_their_rate(tmp_path: Path) -> None:
    av = pytest.importorskip("av")
    writer = VideoWriter(tmp_path / "a.mp4", 1.0 / 15.0)
    for k in range(10):
        writer.write(image(20 * k))
    writer.close()
    assert writer.failure == ""
    with av.open(str(writer.path)) as container:
        stream = container.streams.video[0]
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
        assert stream.average_rate == 15
    assert len(frames) == 10
    assert abs(frames[-1].mean() - 180.0) < 10.0


def test_what_cannot_be_written_is_said_in_one_line(tmp_path: Path) -> None:
    pytest.importorskip("av")
    writer = VideoWriter(tmp_path / "nowhere" / "a.mp4", 0.1)
    writer.write(image(0))
    writer.write(image(0))
    writer.close()
    assert "a.mp4: cannot be written" in writer.failure
    assert "\n" not in writer.failure


def test_without_an_encoder_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(ScenarioError, match=r"pip install --editable '.\[video\]'"):
        need_encoder()


def test_images_stand_side_by_side_at_one_height() -> None:
    joined = side_by_side([image(10, 240, 320), image(200, 480, 641)])
    assert joined.shape == (480, 1280, 3)
    assert (joined[0, 0, 0], joined[0, -1, 0]) == (10, 200)


def test_nothing_to_be_seen_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("av")
    inner = DiagramBuilder()
    inner.AddSystem(SceneGraph())
    builder = DiagramBuilder()
    view = Viewpoint(p_WV=np.ones(3), p_WT=np.zeros(3))
    with pytest.raises(ScenarioError, match="neither a camera nor a scene"):
        add_video(builder, inner.Build(), [], view, tmp_path / "a.mp4", 0.1)


def test_the_view_from_outside_follows_the_bodies() -> None:
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.01)
    Parser(plant).AddModelsFromString(BALL, "urdf")
    plant.Finalize()
    diagram = builder.Build()
    view = OutsideView(
        scene_graph, Viewpoint(p_WV=np.array([0.0, -3.0, 0.0]), p_WT=np.zeros(3)), 80, 60
    )
    context = diagram.CreateDefaultContext()

    def red_column(x: float) -> float:
        q = np.array([1.0, 0.0, 0.0, 0.0, x, 0.0, 0.0])
        plant.SetPositions(plant.GetMyContextFromRoot(context), q)
        query = scene_graph.get_query_output_port().Eval(scene_graph.GetMyContextFromRoot(context))
        seen = view.image(query).astype(int)
        red = seen[:, :, 0] - seen[:, :, 2] > 50
        assert red.any()
        return float(np.nonzero(red)[1].mean())

    middle, right = red_column(0.0), red_column(0.5)
    assert abs(middle - 39.5) < 1.5
    assert right > middle + 10.0
