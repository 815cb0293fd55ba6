import base64
import io
import json
from pathlib import Path

import numpy as np
from PIL import Image
from pydrake.geometry import (
    Box,
    GeometryFrame,
    GeometryInstance,
    MakePhongIllustrationProperties,
    Mesh,
    MeshcatVisualizer,
    PerceptionProperties,
    Rgba,
    SceneGraph,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder

from crossmodal.diagrams.drawing.meshcat import start_meshcat
from crossmodal.diagrams.drawing.textures import textured_box, textured_boxes


def contents(mesh: Mesh) -> dict:
    memory = mesh.source().in_memory()
    return json.loads(memory.mesh_file.contents())


def picture(mesh: Mesh) -> Image.Image:
    (image,) = contents(mesh)["images"]
    uri = image.get("uri") or contents(mesh)["buffers"][image["bufferView"]]["uri"]
    return Image.open(io.BytesIO(base64.b64decode(uri.partition(",")[2])))


def write_texture(folder: Path) -> str:
    path = folder / "wood.png"
    Image.new("RGB", (8, 8), (200, 100, 50)).save(path)
    return str(path)


def test_boxes_that_cameras_see_with_a_texture_are_found_where_meshcat_shows_them(
    tmp_path: Path,
) -> None:
    builder = DiagramBuilder()
    scene_graph = builder.AddSystem(SceneGraph())
    source = scene_graph.RegisterSource("plant")
    frame = scene_graph.RegisterFrame(source, GeometryFrame("chest::drawer"))
    for name, shape, texture in (
        ("chest::front", Box(0.1, 0.2, 0.3), write_texture(tmp_path)),
        ("chest::plain", Box(0.1, 0.2, 0.3), ""),
        ("chest::knob", Sphere(0.1), write_texture(tmp_path)),
    ):
        geometry = GeometryInstance(RigidTransform(), shape, name)
        geometry.set_illustration_properties(MakePhongIllustrationProperties(np.ones(4)))
        seen = PerceptionProperties()
        seen.AddProperty("phong", "diffuse", Rgba(0.5, 1.0, 1.0))
        if texture:
            seen.AddProperty("phong", "diffuse_map", texture)
        geometry.set_perception_properties(seen)
        scene_graph.RegisterGeometry(source, frame, geometry)
    pose = scene_graph.get_source_pose_port(source)
    boxes = textured_boxes(scene_graph)
    assert len(boxes) == 1

    meshcat = start_meshcat()
    MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat)
    builder.ExportInput(pose, "poses")
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    poses = type(pose.Allocate().get_value())()
    poses.set_value(frame, RigidTransform())
    diagram.get_input_port().FixValue(context, poses)
    diagram.ForcedPublish(context)
    ((path, mesh),) = boxes.items()
    assert meshcat.HasPath(path)
    assert picture(mesh).getpixel((0, 0)) == (100, 100, 50)


def test_a_textured_box_has_its_size_with_gltfs_y_up(tmp_path: Path) -> None:
    mesh = textured_box((0.1, 0.2, 0.3), write_texture(tmp_path), (1.0, 1.0, 1.0))
    accessors = [one for one in contents(mesh)["accessors"] if one["type"] == "VEC3"]
    corners = next(one for one in accessors if one["count"] == 24)
    np.testing.assert_allclose(corners["max"], [0.05, 0.15, 0.1], atol=1e-6)
    np.testing.assert_allclose(corners["min"], [-0.05, -0.15, -0.1], atol=1e-6)
