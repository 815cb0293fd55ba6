"""A scene as somebody sees it who stands beside it, as images."""

import numpy as np
import numpy.typing as npt
from pydrake.common.value import Value
from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    DepthRange,
    DepthRenderCamera,
    FramePoseVector,
    LightParameter,
    MakeRenderEngineVtk,
    QueryObject,
    RenderCameraCore,
    RenderEngineVtkParams,
    SceneGraph,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import CameraInfo, RgbdSensor

from crossmodal.diagrams.drawing.layers import Viewpoint
from crossmodal.maths import se3

_RENDERER = "colour"  # A visual that accepts this renderer only is transparent.
_FIELD_OF_VIEW = np.deg2rad(50.0)  # From top to bottom.
_LIGHTS = [
    LightParameter(type="directional", direction=[0.5, -0.5, -1.0], intensity=0.9, frame="world"),
    LightParameter(type="directional", direction=[0.0, 0.0, 1.0], intensity=0.8, frame="camera"),
]


class OutsideView:
    """Renders a scene from one place. It has a copy of the scene, so that the simulation of the
    other one does not get slower.

    Args:
        scene_graph: Of the scene, with its geometry complete.
        view: From where.
        width: Of the images, [px].
        height: Likewise.
    """

    def __init__(self, scene_graph: SceneGraph, view: Viewpoint, width: int, height: int) -> None:
        builder = DiagramBuilder()
        self._scene = builder.AddSystem(scene_graph.Clone())
        params = RenderEngineVtkParams(default_clear_color=[0.9, 0.92, 0.95], lights=_LIGHTS)
        self._scene.AddRenderer(_RENDERER, MakeRenderEngineVtk(params))
        info = CameraInfo(width, height, _FIELD_OF_VIEW)
        core = RenderCameraCore(_RENDERER, info, ClippingRange(0.05, 20.0), RigidTransform())
        X_WC = se3.looking_at(view.p_WV, view.p_WT)
        camera = RgbdSensor(
            self._scene.world_frame_id(),
            RigidTransform(RotationMatrix.ProjectToRotationMatrix(X_WC[:3, :3]), X_WC[:3, 3]),
            ColorRenderCamera(core),
            DepthRenderCamera(core, DepthRange(0.1, 10.0)),
        )
        camera = builder.AddSystem(camera)
        builder.Connect(self._scene.get_query_output_port(), camera.query_object_input_port())
        builder.ExportOutput(camera.color_image_output_port(), "image")
        self._diagram = builder.Build()
        self._context = self._diagram.CreateDefaultContext()

    def image(self, query: QueryObject) -> npt.NDArray[np.uint8]:
        """The scene (H, W, 3) where its bodies are now."""
        inspector = self._scene.model_inspector()
        context = self._scene.GetMyContextFromRoot(self._context)
        world = inspector.world_frame_id()
        for source in inspector.GetAllSourceIds():
            frames = [frame for frame in inspector.FramesForSource(source) if frame != world]
            poses = FramePoseVector()
            for frame in frames:
                poses.set_value(frame, query.GetPoseInWorld(frame))
            if frames:
                self._scene.get_source_pose_port(source).FixValue(context, Value(poses))
        image = self._diagram.GetOutputPort("image").Eval(self._context)
        return np.array(image.data[:, :, :3])
