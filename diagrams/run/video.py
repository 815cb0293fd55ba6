"""An episode as a video: what the robot's cameras see, and the scene from outside."""

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from pydrake.common.value import AbstractValue
from pydrake.geometry import QueryObject
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, LeafSystem
from pydrake.systems.sensors import ImageRgba8U

from crossmodal.diagrams.drawing.layers import Viewpoint
from crossmodal.diagrams.drawing.outside_view import OutsideView
from crossmodal.diagrams.run.application import SCENE_PORT
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, one_line
from crossmodal.systems.port_values import StampedImage

WIDTH, HEIGHT = 640, 480  # Of the view from outside, and the height of all, [px].

Image = npt.NDArray[np.uint8]


def need_encoder() -> Any:
    """PyAV, which encodes videos.

    Raises:
        ScenarioError: where it is not installed.
    """
    try:
        import av
    except ImportError:
        raise ScenarioError(
            "--video: PyAV is not installed; .venv/bin/pip install --editable '.[video]'"
        ) from None
    return av


def side_by_side(images: Sequence[Image]) -> Image:
    """Images (H, W, 3) beside each other, all of one height; an odd width loses a column."""
    scaled = [
        cv2.resize(image, (round(image.shape[1] * HEIGHT / image.shape[0]), HEIGHT))
        if image.shape[0] != HEIGHT
        else image
        for image in images
    ]
    joined = np.hstack(scaled)
    return np.ascontiguousarray(joined[:, : joined.shape[1] // 2 * 2])


class VideoWriter:
    """Encodes images as H.264 in an MP4 file.

    Attributes:
        path: Of the file.
        failure: Why there will be none, in one line; empty while there is no reason.
    """

    def __init__(self, path: Path, period: float) -> None:
        self._av = need_encoder()
        self.path, self.failure = path, ""
        self._rate = Fraction(1.0 / period).limit_denominator(1000)
        self._container: Any = None
        self._stream: Any = None

    def write(self, image: Image) -> None:
        """Adds an image (H, W, 3); all have the size of the first one."""
        if self.failure:
            return
        try:
            if self._container is None:
                self._open(image)
            frame = self._av.VideoFrame.from_ndarray(image, format="rgb24")
            self._container.mux(self._stream.encode(frame))
        except (OSError, self._av.FFmpegError) as error:
            self._give_up(error)

    def _open(self, image: Image) -> None:
        self._container = self._av.open(str(self.path), "w")
        self._stream = self._container.add_stream("h264", rate=self._rate)
        self._stream.height, self._stream.width = image.shape[:2]
        self._stream.pix_fmt = "yuv420p"

    def close(self) -> None:
        """Makes the file whole."""
        if self._container is None:
            self.failure = self.failure or f"{self.path}: there was nothing to be seen"
            return
        try:
            if not self.failure:
                self._container.mux(self._stream.encode())
            self._container.close()
        except (OSError, self._av.FFmpegError) as error:
            self._give_up(error)
        if self.failure:
            self.path.unlink(missing_ok=True)

    def _give_up(self, error: Exception) -> None:
        reason = getattr(error, "strerror", "") or error
        self.failure = self.failure or f"{self.path}: cannot be written: {one_line(reason)}"


class EpisodeVideo(LeafSystem):
    """Writes a frame at every tick: the cameras' images, then the view from outside.

    What was written is kept outside the Context, so one video serves one simulation.

    Input ports:
    - `<camera>`: `StampedImage` in colour, of each camera.
    - `query_object`: `QueryObject` of the scene; may stay unconnected.

    Args:
        writer: Of the file.
        period: Between two frames, [s].
        cameras: Ports of the station that give colour images.
        outside: Renders the scene; None where there is none.
    """

    def __init__(
        self,
        writer: VideoWriter,
        period: float,
        cameras: Sequence[str],
        outside: OutsideView | None,
    ) -> None:
        super().__init__()
        self._writer, self._outside = writer, outside
        model = AbstractValue.Make(StampedImage(time=0.0, image=ImageRgba8U()))
        self._cameras = [self.DeclareAbstractInputPort(name, model) for name in cameras]
        self._query = self.DeclareAbstractInputPort(
            "query_object", AbstractValue.Make(QueryObject())
        )
        self.DeclarePeriodicPublishEvent(period, 0.0, self._write)

    def _write(self, context: Context) -> None:
        images = [np.asarray(port.Eval(context).image.data)[:, :, :3] for port in self._cameras]
        if self._outside is not None:
            images.append(self._outside.image(self._query.Eval(context)))
        if any(image.size == 0 for image in images):  # A camera has not seen anything yet.
            return
        self._writer.write(side_by_side(images))


def add_video(
    builder: DiagramBuilder,
    station: Diagram,
    cameras: Sequence[str],
    view: Viewpoint,
    path: Path,
    period: float,
) -> VideoWriter:
    """Adds the video of a station.

    Args:
        cameras: Its ports that give colour images.
        view: From where its scene is seen, if it has one.
        path: Of the file.
        period: Between two frames, [s].

    Raises:
        ScenarioError: where there is nothing to be seen, or no encoder.
    """
    has_scene = station.HasOutputPort(SCENE_PORT) and station.HasSubsystemNamed("scene_graph")
    if not cameras and not has_scene:
        raise ScenarioError("--video: the scenario has neither a camera nor a scene to be seen")
    writer, outside = VideoWriter(path, period), None
    if has_scene:
        outside = OutsideView(station.GetSubsystemByName("scene_graph"), view, WIDTH, HEIGHT)
    video = builder.AddNamedSystem("video", EpisodeVideo(writer, period, cameras, outside))
    for name in cameras:
        builder.Connect(station.GetOutputPort(name), video.GetInputPort(name))
    if has_scene:
        builder.Connect(station.GetOutputPort(SCENE_PORT), video.GetInputPort("query_object"))
    return writer
