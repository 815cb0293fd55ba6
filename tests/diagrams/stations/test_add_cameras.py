"""The cameras' scene is a copy that follows the simulated one."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pytest
from pydrake.common.eigen_geometry import Quaternion
from pydrake.geometry import (
    Box,
    ClippingRange,
    ColorRenderCamera,
    DepthRange,
    DepthRenderCamera,
    MakeRenderEngineVtk,
    RenderCameraCore,
    RenderEngineVtkParams,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from pydrake.systems.sensors import CameraInfo, RgbdSensor

from crossmodal.diagrams.stations.add_cameras import add_camera_scene


@dataclass(kw_only=True)
class Scene:
    """A red box that falls before a camera."""

    diagram: Diagram
    plant: MultibodyPlant
    scene_graph: SceneGraph
    camera_scene: SceneGraph
    sensor: RgbdSensor

    def image(self, root: Context) -> npt.NDArray[np.uint8]:
        port = self.sensor.color_image_output_port()
        return np.array(port.Eval(self.sensor.GetMyContextFromRoot(root)).data)

    def drop(self, root: Context, height: float) -> None:
        context = self.plant.GetMyMutableContextFromRoot(root)
        self.plant.SetPositions(context, [*Quaternion.Identity().wxyz(), 0.0, -height, 1.0])


@pytest.fixture(scope="module")
def scene() -> Scene:
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.01)
    box = plant.AddRigidBody("box", SpatialInertia.SolidBoxWithMass(1.0, 0.2, 0.2, 0.2))
    shape = Box(0.2, 0.2, 0.2)
    plant.RegisterVisualGeometry(box, RigidTransform(), shape, "box", [1.0, 0.0, 0.0, 1.0])
    plant.Finalize()
    camera_scene = add_camera_scene(builder, plant, scene_graph)
    core = RenderCameraCore(
        "colour", CameraInfo(64, 48, 1.0), ClippingRange(0.05, 10.0), RigidTransform()
    )
    sensor = builder.AddSystem(
        RgbdSensor(
            camera_scene.world_frame_id(),
            RigidTransform(),
            ColorRenderCamera(core),
            DepthRenderCamera(core, DepthRange(0.1, 8.0)),
        )
    )
    builder.Connect(camera_scene.get_query_output_port(), sensor.query_object_input_port())
    return Scene(
        diagram=builder.Build(),
        plant=plant,
        scene_graph=scene_graph,
        camera_scene=camera_scene,
        sensor=sensor,
    )


def test_what_the_plant_asks_holds_no_renderer(scene: Scene) -> None:
    assert scene.scene_graph.RendererCount() == 0
    assert scene.camera_scene.RendererCount() > 0


def test_the_image_shows_the_plant_as_it_is_now(scene: Scene) -> None:
    root = scene.diagram.CreateDefaultContext()
    places = []
    for height in (0.1, -0.1):
        scene.drop(root, height)
        red = scene.image(root)[:, :, 1] == 0
        places.append(np.argwhere(red).mean(axis=0))
    assert places[0][0] < 20.0 < 27.0 < places[1][0]


def test_the_light_can_be_switched_while_it_runs(scene: Scene) -> None:
    root = scene.diagram.CreateDefaultContext()
    scene.drop(root, 0.0)
    lit = scene.image(root)
    context = scene.camera_scene.GetMyMutableContextFromRoot(root)
    night = RenderEngineVtkParams(default_clear_color=[0.0, 0.0, 0.0])
    scene.camera_scene.RemoveRenderer(context, "colour")
    scene.camera_scene.AddRenderer(context, "colour", MakeRenderEngineVtk(night))
    scene.drop(root, 0.01)
    assert lit[0, 0, :3].min() > 100
    assert scene.image(root)[0, 0, :3].max() == 0
