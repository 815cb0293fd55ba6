"""A rendered drawer and what a depth camera makes of it, and a way to tick systems by hand."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from pydrake.geometry import (
    Box,
    ClippingRange,
    ColorRenderCamera,
    DepthRange,
    DepthRenderCamera,
    FramePoseVector,
    GeometryFrame,
    GeometryInstance,
    MakeRenderEngineVtk,
    PerceptionProperties,
    RenderCameraCore,
    RenderEngineVtkParams,
    RenderLabel,
    SceneGraph,
)
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, System
from pydrake.systems.sensors import ImageDepth32F, ImageGrey8U, ImageRgba8U

from crossmodal.maths.pinhole import Intrinsics
from crossmodal.plants.camera_view import renderer_intrinsics
from crossmodal.systems.port_values import StampedImage

PERIOD = 1.0 / 15.0
FOCAL = 320.0 / np.tan(np.deg2rad(29.0))
CAMERA = Intrinsics(
    width=640, height=480, focal_x=FOCAL, focal_y=FOCAL, center_x=319.0, center_y=239.0
)
ROBOT = RenderLabel(3)


@pytest.fixture(scope="session")
def camera() -> Intrinsics:
    return CAMERA


@pytest.fixture(scope="session")
def tick() -> Callable[..., Iterator[tuple[int, Any]]]:
    """Runs a system tick by tick: fix inputs, let the periodic events happen, look at outputs."""

    def run(
        system: System, inputs: Callable[[int], dict[str, Any]], count: int
    ) -> Iterator[tuple[int, Any]]:
        simulator = Simulator(system)
        context = simulator.get_mutable_context()
        for k in range(count):
            for name, value in inputs(k).items():
                system.GetInputPort(name).FixValue(context, value)
            if k == 0:
                simulator.Initialize()
            simulator.AdvanceTo((k + 0.5) * PERIOD)
            yield k, context

    return run


def texture(rng: np.random.Generator, path: Path, grey: float) -> Path:
    """A wood-like PNG: noise of several scales and a few lines."""
    size = 512
    image = np.full((size, size), grey, np.float32)
    for cells in (8, 16, 32, 64, 128):
        noise = rng.normal(0.0, 1.0, (cells, cells)).astype(np.float32)
        image += 8.0 * cv2.resize(noise, (size, size), interpolation=cv2.INTER_CUBIC)
    for x0, y0, x1, y1 in rng.integers(0, size, (15, 4)):
        shade = float(rng.integers(40, 200))
        cv2.line(image, (int(x0), int(y0)), (int(x1), int(y1)), shade, 2, cv2.LINE_AA)
    cv2.imwrite(str(path), np.dstack([np.clip(image, 0, 255).astype(np.uint8)] * 3))
    return path


@dataclass(kw_only=True)
class Sequence:
    """Ideal images of a drawer that stands, then moves by 22 cm towards camera and robot.

    Attributes:
        grey: (T, H, W).
        depth: (T, H, W), [m].
        robot: Whether a pixel shows the robot (T, H, W).
        X_WD: Pose of the drawer (T, 4, 4).
        X_WC: Pose of the camera (4, 4).
    """

    grey: np.ndarray
    depth: np.ndarray
    robot: np.ndarray
    X_WD: np.ndarray
    X_WC: np.ndarray

    def measured(
        self, k: int, seed: int, *, gain: float = 1.0, read_noise: float = 2.0
    ) -> dict[str, Any]:
        """Images with noise and quantisation of the sequence's k-th frame, by port name."""
        rng = np.random.default_rng([seed, k])
        noise = rng.normal(0.0, read_noise, self.grey[k].shape)
        grey = np.clip(np.round(self.grey[k] * gain + noise), 0, 255).astype(np.uint8)
        z = self.depth[k].astype(float)
        # Neighbours share what their matched patches share; 9 px, as in the simulated camera.
        white = rng.normal(0.0, 1.0, z.shape).astype(np.float32)
        noisy = z + (1.2e-3 + 1.9e-3 * (z - 0.4) ** 2) * 9.0 * cv2.blur(white, (9, 9))
        disparity = np.round(8 * FOCAL * 0.075 / noisy) / 8
        color, depth, mask = ImageRgba8U(640, 480), ImageDepth32F(640, 480), ImageGrey8U(640, 480)
        color.mutable_data[:, :, :3] = grey[:, :, None]
        color.mutable_data[:, :, 3] = 255
        depth.mutable_data[:, :, 0] = FOCAL * 0.075 / disparity
        grown = cv2.dilate(255 * self.robot[k].astype(np.uint8), np.ones((5, 5), np.uint8))
        mask.mutable_data[:, :, 0] = grown
        return {
            "color_measured": StampedImage(time=0.0, image=color, X_WC=self.X_WC),
            "depth_measured": StampedImage(time=0.0, image=depth, X_WC=self.X_WC),
            "robot_mask": mask,
        }


def _add_box(
    scene_graph: SceneGraph,
    source: Any,
    frame: Any,
    pose: RigidTransform,
    size: tuple[float, float, float],
    label: RenderLabel,
    diffuse_map: Path | None,
) -> None:
    geometry = GeometryInstance(
        pose, Box(*size), f"box{scene_graph.model_inspector().num_geometries()}"
    )
    properties = PerceptionProperties()
    properties.AddProperty("label", "id", label)
    if diffuse_map is not None:
        properties.AddProperty("phong", "diffuse_map", str(diffuse_map))
    geometry.set_perception_properties(properties)
    if frame is None:
        scene_graph.RegisterAnchoredGeometry(source, geometry)
    else:
        scene_graph.RegisterGeometry(source, frame, geometry)


@pytest.fixture(scope="session")
def drawer_sequence(tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    """Stands for 20 ticks, then moves at 4 cm/s, an arm with it that hides a part."""
    folder = tmp_path_factory.mktemp("textures")
    rng = np.random.default_rng(5)
    builder = DiagramBuilder()
    scene_graph = builder.AddSystem(SceneGraph())
    scene_graph.AddRenderer("vtk", MakeRenderEngineVtk(RenderEngineVtkParams()))
    source = scene_graph.RegisterSource("scene")
    X_WO = RigidTransform(RollPitchYaw(0, 0, 0.2), [1.0, 0.0, 0.55])
    drawer = scene_graph.RegisterFrame(source, GeometryFrame("drawer"))
    robot = scene_graph.RegisterFrame(source, GeometryFrame("robot"))
    still = [
        (RigidTransform([1.9, 0, 1]), (0.05, 4.0, 3.0)),
        (RigidTransform([1.0, 0, -0.02]), (3.0, 3.0, 0.04)),
        (X_WO @ RigidTransform([0.25, 0, 0.31]), (0.5, 0.5, 0.32)),
        (X_WO @ RigidTransform([0.25, 0, -0.35]), (0.5, 0.5, 0.4)),
    ]
    for i, (pose, size) in enumerate(still):
        image = texture(rng, folder / f"still{i}.png", 120.0)
        _add_box(scene_graph, source, None, pose, size, RenderLabel(1), image)
    front = texture(rng, folder / "front.png", 130.0)
    _add_box(
        scene_graph, source, drawer, RigidTransform(), (0.02, 0.44, 0.28), RenderLabel(2), front
    )
    arm = RigidTransform([-0.28, -0.05, 0.05])
    _add_box(scene_graph, source, robot, arm, (0.5, 0.08, 0.08), ROBOT, None)
    builder.ExportInput(scene_graph.get_source_pose_port(source), "poses")
    builder.ExportOutput(scene_graph.get_query_output_port(), "query")
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()

    level = RotationMatrix(np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]))
    X_WC = RigidTransform(RollPitchYaw(0, 0.32, 0).ToRotationMatrix() @ level, [-0.2, 0.15, 0.95])
    core = RenderCameraCore(
        "vtk", renderer_intrinsics(CAMERA), ClippingRange(0.05, 10.0), RigidTransform()
    )
    color_camera = ColorRenderCamera(core)
    depth_camera = DepthRenderCamera(core, DepthRange(0.1, 8.0))
    q = np.clip(0.04 * (np.arange(115) - 20) * PERIOD, 0.0, 0.22)
    grey, depth, mask, poses = [], [], [], []
    for opening in q:
        X_WD = X_WO @ RigidTransform([-opening, 0, 0])
        vector = FramePoseVector()
        vector.set_value(drawer, X_WD)
        vector.set_value(robot, X_WD)
        diagram.GetInputPort("poses").FixValue(context, vector)
        query = diagram.GetOutputPort("query").Eval(context)
        world = scene_graph.world_frame_id()
        color = query.RenderColorImage(color_camera, world, X_WC).data
        grey.append(cv2.cvtColor(np.ascontiguousarray(color), cv2.COLOR_RGBA2GRAY))
        depth.append(query.RenderDepthImage(depth_camera, world, X_WC).data[:, :, 0].copy())
        label = query.RenderLabelImage(color_camera, world, X_WC).data[:, :, 0]
        mask.append(label == int(ROBOT))
        poses.append(X_WD.GetAsMatrix4())
    return Sequence(
        grey=np.array(grey),
        depth=np.array(depth),
        robot=np.array(mask),
        X_WD=np.array(poses),
        X_WC=X_WC.GetAsMatrix4(),
    )
