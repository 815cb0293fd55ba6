import numpy as np
import pytest
from pydrake.geometry import (
    Box,
    ClippingRange,
    ColorRenderCamera,
    GeometryInstance,
    MakeRenderEngineVtk,
    PerceptionProperties,
    RenderCameraCore,
    RenderEngineVtkParams,
    RenderLabel,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder

from crossmodal.maths.pinhole import Intrinsics
from crossmodal.plants.camera_view import renderer_intrinsics


@pytest.mark.parametrize("center", [(319.0, 239.0), (300.0, 250.0)])
def test_a_renderer_is_told_where_the_camera_sees_a_point(center: tuple[float, float]) -> None:
    """The mean pixel of small plates is where their centres are projected."""
    u0, v0 = center
    intrinsics = Intrinsics(
        width=640, height=480, focal_x=577.3, focal_y=577.3, center_x=u0, center_y=v0
    )
    rng = np.random.default_rng(2)
    scene_graph = SceneGraph()
    scene_graph.AddRenderer("vtk", MakeRenderEngineVtk(RenderEngineVtkParams()))
    source = scene_graph.RegisterSource("scene")
    points = []
    for i, (x, y) in enumerate(np.mgrid[-0.3:0.31:0.12, -0.2:0.21:0.1].reshape(2, -1).T):
        p_CP = np.array([x, y, 1.0]) + rng.uniform(-0.01, 0.01, 3)
        size = 0.05, 0.05, 1e-4
        plate = GeometryInstance(RigidTransform(p_CP), Box(*size), f"plate{i}")
        properties = PerceptionProperties()
        properties.AddProperty("label", "id", RenderLabel(i + 1))
        plate.set_perception_properties(properties)
        scene_graph.RegisterAnchoredGeometry(source, plate)
        points.append(p_CP)
    builder = DiagramBuilder()
    builder.AddSystem(scene_graph)
    builder.ExportOutput(scene_graph.get_query_output_port(), "query")
    diagram = builder.Build()
    core = RenderCameraCore(
        "vtk", renderer_intrinsics(intrinsics), ClippingRange(0.05, 10.0), RigidTransform()
    )
    query = diagram.GetOutputPort("query").Eval(diagram.CreateDefaultContext())
    world = scene_graph.world_frame_id()
    label = query.RenderLabelImage(ColorRenderCamera(core), world, RigidTransform()).data[:, :, 0]
    expected = intrinsics.project(np.array(points))
    found = []
    for i in range(len(points)):
        v, u = np.nonzero(label == i + 1)
        found.append([u.mean(), v.mean()])
    assert np.abs(np.mean(np.array(found) - expected, axis=0)).max() < 0.1
