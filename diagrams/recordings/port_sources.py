"""How messages of a foreign recording become the values of a station's ports.

A source takes the messages of its topics in the order in which they were logged, with the instants
at which they were measured, and gives a port's value at a tick from those until then.
"""

from abc import ABC, abstractmethod
from bisect import insort
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from pydrake.systems.sensors import ImageDepth32F, ImageGrey8U, ImageRgba8U

from crossmodal.diagrams.run.calibration import CameraCalibration
from crossmodal.diagrams.run.sensor_streams.codecs import Codec
from crossmodal.maths.arrays import Array
from crossmodal.systems.port_values import SampleWindow, StampedImage
from crossmodal.systems.recordings.camera_info import CameraFacts
from crossmodal.systems.recordings.images import color_of, depth_of
from crossmodal.systems.recordings.recording import RecordingError

Timed = tuple[int, Any]  # Instant [ns] since the replay's start, and message.


class Source(ABC):
    """The messages of some topics that wait for their tick.

    Attributes:
        topics: Whose messages it takes.
    """

    def __init__(self, topics: Sequence[str]) -> None:
        self.topics = topics
        self._waiting: list[Timed] = []
        self._until = -(2**62)  # Instant of the last tick.

    def add(self, topic: str, time: int, message: Any) -> None:
        """Takes a message; one of a tick that has passed comes too late and is left out."""
        if time > self._until:
            insort(self._waiting, (time, self.read(topic, message)), key=lambda timed: timed[0])

    def read(self, topic: str, message: Any) -> Any:
        """What is kept of a message."""
        return message

    def take(self, now: int) -> list[Timed]:
        """The messages until a tick [ns] that were not taken yet."""
        count = sum(time <= now for time, _ in self._waiting)
        taken, self._waiting = self._waiting[:count], self._waiting[count:]
        self._until = now
        return taken

    @abstractmethod
    def value(self, now: int) -> Any:
        """The port's value at a tick [ns]; None before there is one."""


class ImageSource(Source):
    """Images as `StampedImage`s; only those that a tick reads are converted.

    Args:
        topic: Of the images.
        convert: From a message to pixels (H, W, ...).
        make: From these to an image of Drake.
        camera: What is believed of the camera.
    """

    def __init__(
        self,
        topic: str,
        convert: Callable[[Any], npt.NDArray[Any]],
        make: Callable[[npt.NDArray[Any]], Any],
        camera: CameraCalibration | None,
    ) -> None:
        super().__init__([topic])
        self._convert, self._make, self._camera = convert, make, camera
        self._last: Any = None

    def value(self, now: int) -> Any:
        """The last image at or before a tick."""
        if not (taken := self.take(now)):
            return self._last
        time, message = taken[-1]
        try:
            image = self._make(self._convert(message))
        except RecordingError as error:
            raise RecordingError(f"'{self.topics[0]}': {error}") from None
        if self._camera is None:
            self._last = image
            return image
        self._last = StampedImage(
            time=1e-9 * time,
            image=image,
            X_WC=np.asarray(self._camera.X_PC.GetAsMatrix4()),
            covariance=self._camera.pose_covariance,
        )
        return self._last


class WindowSource(Source):
    """Samples since the last tick as a `SampleWindow`.

    Args:
        topics: Whose messages are samples.
        rows: From a topic, an instant [ns] and its message to a sample (n,); None where it is none.
        size: n.
    """

    def __init__(
        self, topics: Sequence[str], rows: Callable[[str, int, Any], Array | None], size: int
    ) -> None:
        super().__init__(topics)
        self._rows, self._size = rows, size

    def read(self, topic: str, message: Any) -> Any:
        """The message with its topic."""
        return topic, message

    def value(self, now: int) -> SampleWindow:
        """The samples since the last tick, one for each instant."""
        samples: dict[int, Array] = {}
        for time, (topic, message) in self.take(now):
            row = self._rows(topic, time, message)
            if row is None:
                continue
            if len(row) != self._size:
                raise RecordingError(
                    f"'{topic}' holds samples of {len(row)} numbers; need {self._size}"
                )
            samples[time] = row
        return SampleWindow(
            times=np.array([time * 1e-9 for time in samples]),
            values=np.array(list(samples.values())).reshape(-1, self._size),
        )


class CodecSource(Source):
    """A stream that has been written by this program itself."""

    def __init__(self, topic: str, codec: Codec) -> None:
        super().__init__([topic])
        self._codec = codec
        self._last: Any = None

    def value(self, now: int) -> Any:
        """The codec's value of the messages since the last tick, or the last one."""
        taken = self.take(now)
        if taken or self._codec.is_window:
            try:
                self._last = self._codec.decode(taken)
            except (ValueError, LookupError, TypeError, AttributeError) as error:
                raise RecordingError(f"'{self.topics[0]}': {error}") from None
        return self._last


class FlagSource(Source):
    """A number above one half while something is so; zero before the first message."""

    def __init__(self, topic: str) -> None:
        super().__init__([topic])
        self._last = [0.0]

    def value(self, now: int) -> list[float]:
        """The last one at or before a tick."""
        if taken := self.take(now):
            self._last = [float(np.ravel(taken[-1][1].data)[0])]
        return self._last


class PositionSource(Source):
    """The position (1,) of one joint of joint states; NaN before the first message.

    Args:
        topic: Of the joint states.
        joint: Its name.
    """

    def __init__(self, topic: str, joint: str) -> None:
        super().__init__([topic])
        self._joint = joint
        self._last = [np.nan]

    def value(self, now: int) -> list[float]:
        """The last one at or before a tick."""
        for _, message in self.take(now):
            if self._joint in message.name:
                self._last = [float(message.position[list(message.name).index(self._joint)])]
        return self._last


class SpanSource(Source):
    """One within spans of time, zero elsewhere."""

    def __init__(self, holds: Callable[[float], bool]) -> None:
        super().__init__([])
        self._holds = holds

    def value(self, now: int) -> list[float]:
        """Whether the tick is in a span."""
        return [float(self._holds(1e-9 * now))]


class ConstantSource(Source):
    """Always the same."""

    def __init__(self, value: Any) -> None:
        super().__init__([])
        self._value = value

    def value(self, now: int) -> Any:
        """It."""
        return self._value


def color_image(pixels: npt.NDArray[np.uint8]) -> ImageRgba8U:
    """Of red, green and blue (H, W, 3)."""
    image = ImageRgba8U(pixels.shape[1], pixels.shape[0])
    image.mutable_data[:, :, :3], image.mutable_data[:, :, 3] = pixels, 255
    return image


def depth_image(pixels: npt.NDArray[np.float32]) -> ImageDepth32F:
    """Of depths (H, W), [m]."""
    image = ImageDepth32F(pixels.shape[1], pixels.shape[0])
    image.mutable_data[:, :, 0] = pixels
    return image


def grey_image(pixels: npt.NDArray[np.uint8]) -> ImageGrey8U:
    """Of a mask (H, W)."""
    image = ImageGrey8U(pixels.shape[1], pixels.shape[0])
    image.mutable_data[:, :, 0] = pixels
    return image


class Rectifier:
    """Takes a lens' distortion out of images, and brings depth to the size of the colour image.

    Args:
        camera: Of the colour images.
    """

    def __init__(self, camera: CameraFacts) -> None:
        self._size = camera.intrinsics.width, camera.intrinsics.height
        self._maps: Any = None
        if len(camera.distortion):
            self._maps = _undistortion(camera)

    def color(self, message: Any) -> npt.NDArray[np.uint8]:
        """Red, green and blue (H, W, 3)."""
        return np.asarray(self._mapped(self._sized(color_of(message), "colour"), linear=True))

    def depth(self, message: Any) -> npt.NDArray[np.float32]:
        """Depths (H, W), [m]."""
        return np.asarray(self._mapped(self._sized(depth_of(message), "depth"), linear=False))

    def mask(self, message: Any, robot_is_black: bool) -> npt.NDArray[np.uint8]:
        """255 where the robot is, zero elsewhere (H, W)."""
        grey = self._sized(color_of(message), "mask")[:, :, 0]
        robot = (grey < 128) if robot_is_black else (grey >= 128)
        return np.asarray(self._mapped(np.where(robot, np.uint8(255), np.uint8(0)), linear=False))

    def _sized(self, image: npt.NDArray[Any], what: str) -> npt.NDArray[Any]:
        import cv2

        width, height = self._size
        if image.shape[:2] == (height, width):
            return image
        if abs(image.shape[1] * height / (image.shape[0] * width) - 1.0) > 0.02:
            raise RecordingError(
                f"{what} images of {image.shape[1]} x {image.shape[0]} pixels beside"
                f" {width} x {height}; choose the topic that is registered to the colour image"
            )
        return np.asarray(cv2.resize(image, self._size, interpolation=cv2.INTER_NEAREST))

    def _mapped(self, image: npt.NDArray[Any], *, linear: bool) -> npt.NDArray[Any]:
        import cv2

        if self._maps is None:
            return image
        how = cv2.INTER_LINEAR if linear else cv2.INTER_NEAREST
        return np.asarray(cv2.remap(image, *self._maps, how))


def _undistortion(camera: CameraFacts) -> Any:
    import cv2

    fx, fy, cx, cy = camera.intrinsics.vector()
    K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    size = camera.intrinsics.width, camera.intrinsics.height
    D, eye = camera.distortion, np.eye(3)
    try:
        if camera.distortion_model in ("equidistant", "fisheye"):
            return cv2.fisheye.initUndistortRectifyMap(K, D[:4], eye, K, size, cv2.CV_32FC1)
        return cv2.initUndistortRectifyMap(K, D, eye, K, size, cv2.CV_32FC1)
    except cv2.error:
        raise RecordingError(
            f"a distortion of {len(D)} coefficients does not fit {camera.distortion_model};"
            " correct camera.distortion in the calibration"
        ) from None
