"""How port values become ROS 2 messages, and messages port values again.

A codec is chosen by the type of the port's value. Values survive exactly. Messages are stamped with
the instants at which their values were measured.
"""

import dataclasses
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform
from pydrake.systems.sensors import ImageDepth32F, ImageGrey8U, ImageRgba8U

from crossmodal.maths.arrays import Array
from crossmodal.systems.port_values import SampleWindow, StampedImage
from crossmodal.systems.recordings.ros_messages import header, pose, vector

Stamped = tuple[int, Any]  # Instant [ns] and message.


def nanoseconds(time: float) -> int:
    return round(time * 1e9)


@dataclass(frozen=True, kw_only=True)
class Codec:
    """How the values of a port become messages of one type, and back.

    Attributes:
        message_type: Of ROS 2, as in `sensor_msgs/msg/Image`.
        encode: Messages of a value at an instant [ns].
        decode: The value of the messages since the last tick; the last counts unless all do. A
            ValueError says that a message does not hold a value like the port's.
        is_window: Whether all do: whether a tick's value is of that tick's messages alone.
    """

    message_type: str
    encode: Callable[[Any, int], list[Stamped]]
    decode: Callable[[Sequence[Stamped]], Any]
    is_window: bool = False


@dataclass(frozen=True, kw_only=True)
class Topic:
    """The topic of a port's messages and, unless its type's usual one will do, their codec.

    Attributes:
        name: Of the topic.
        window: For a `SampleWindow`: how one sample becomes a message.
    """

    name: str
    window: "WindowFields | None" = None


@dataclass(frozen=True, kw_only=True)
class WindowFields:
    """How one sample (n,) of a window becomes the fields of a message, and back."""

    message_type: str
    to_fields: Callable[[Array], dict[str, Any]]
    to_values: Callable[[Any], list[float]]
    header: bool = True


def _joint_fields(row: Array) -> dict[str, Any]:
    half = len(row) // 2
    position, velocity = row[:half].tolist(), row[half:].tolist()
    return {"name": [], "position": position, "velocity": velocity, "effort": []}


def _wrench_fields(row: Array) -> dict[str, Any]:
    return {"wrench": {"force": vector(row[3:]), "torque": vector(row[:3])}}


def _wrench_values(message: Any) -> list[float]:
    torque, force = message.wrench.torque, message.wrench.force
    return [torque.x, torque.y, torque.z, force.x, force.y, force.z]


JOINT_STATES = WindowFields(
    message_type="sensor_msgs/msg/JointState",
    to_fields=_joint_fields,
    to_values=lambda message: [*message.position, *message.velocity],
)
WRENCHES = WindowFields(
    message_type="geometry_msgs/msg/WrenchStamped",
    to_fields=_wrench_fields,
    to_values=_wrench_values,
)
NUMBERS = WindowFields(
    message_type="std_msgs/msg/Float64MultiArray",
    to_fields=lambda row: {"layout": {"dim": [], "data_offset": 0}, "data": row.tolist()},
    to_values=lambda message: list(message.data),
    header=False,
)
_IMAGES = {
    ImageRgba8U: ("rgba8", np.uint8),
    ImageDepth32F: ("32FC1", np.float32),
    ImageGrey8U: ("mono8", np.uint8),
}


def codec_for(model: Any, topic: Topic | None = None) -> Codec:
    """The codec of ports whose values are like `model`; an array stands for a vector port.

    Raises:
        TypeError: for a type of value that no message holds.
    """
    kind = type(model)
    if isinstance(model, StampedImage):
        return _stamped_image(model)
    if kind in _IMAGES:
        return _image(model, *_IMAGES[kind])
    if isinstance(model, SampleWindow):
        return _window((topic and topic.window) or NUMBERS, model.values.shape[1])
    if isinstance(model, np.ndarray):
        return _number() if len(model) == 1 else _vector(len(model))
    if isinstance(model, RigidTransform):
        return _pose()
    if dataclasses.is_dataclass(model):
        return _fields(kind)
    raise TypeError(f"values of the type {kind.__name__} cannot be recorded")


def _require(condition: bool, is_: object, expected: object) -> None:
    if not condition:
        raise ValueError(f"{is_}, but {expected} is expected")


def _image(model: Any, encoding: str, dtype: type) -> Codec:
    """Of images like `model`; one without pixels stands for images of any size."""
    kind, size = type(model), (model.width(), model.height())

    def encode(value: Any, now: int) -> list[Stamped]:
        data = np.asarray(value.data)
        message = {
            "header": header(now),
            "height": data.shape[0],
            "width": data.shape[1],
            "encoding": encoding,
            "is_bigendian": 0,
            "step": data.strides[0],
            "data": data.tobytes(),
        }
        return [(now, message)]

    def decode(messages: Sequence[Stamped]) -> Any:
        message = messages[-1][1]
        found = (message.width, message.height)
        _require(message.encoding == encoding, f"images of {message.encoding}", encoding)
        _require(
            0 in size or found == size,
            f"images of {found[0]} x {found[1]} pixels",
            f"{size[0]} x {size[1]} as the scenario's camera has them",
        )
        data: Array = np.frombuffer(message.data, dtype=dtype)
        image = kind(*found)
        shape = image.mutable_data.shape
        _require(data.size == np.prod(shape), f"images of {data.size} numbers", np.prod(shape))
        image.mutable_data[:] = data.reshape(shape)
        return image

    return Codec(message_type="sensor_msgs/msg/Image", encode=encode, decode=decode)


def _stamped_image(model: StampedImage) -> Codec:
    """As a plain image is written, but that its own stamp is in the header.

    A message whose header has no stamp was taken when it was logged. Where the camera was is not
    in the message (`CAMERA_POSE`).
    """
    plain = _image(model.image, *_IMAGES[type(model.image)])

    def encode(value: Any, now: int) -> list[Stamped]:
        ((_, message),) = plain.encode(value.image, now)
        return [(now, message | {"header": header(nanoseconds(value.time))})]

    def decode(messages: Sequence[Stamped]) -> StampedImage:
        logged, message = messages[-1]
        stamp = message.header.stamp
        taken = stamp.sec * 1_000_000_000 + stamp.nanosec
        return StampedImage(time=1e-9 * (taken or logged), image=plain.decode(messages))

    return Codec(message_type=plain.message_type, encode=encode, decode=decode)


def _window(fields: WindowFields, size: int) -> Codec:
    def encode(window: Any, now: int) -> list[Stamped]:
        stamps = [nanoseconds(time) for time in window.times]
        return [
            (stamp, ({"header": header(stamp)} if fields.header else {}) | fields.to_fields(row))
            for stamp, row in zip(stamps, window.values, strict=True)
        ]

    def decode(messages: Sequence[Stamped]) -> Any:
        rows = [fields.to_values(message) for _, message in messages]
        for row in rows:
            _require(len(row) == size, f"samples of {len(row)} numbers", size)
        return SampleWindow(
            times=np.array([stamp * 1e-9 for stamp, _ in messages]),
            values=np.array(rows).reshape(-1, size),
        )

    return Codec(message_type=fields.message_type, encode=encode, decode=decode, is_window=True)


def _number() -> Codec:
    return Codec(
        message_type="std_msgs/msg/Float64",
        encode=lambda value, now: [(now, {"data": float(value[0])})],
        decode=lambda messages: [messages[-1][1].data],
    )


def _vector(size: int) -> Codec:
    def decode(messages: Sequence[Stamped]) -> list[float]:
        values = NUMBERS.to_values(messages[-1][1])
        _require(len(values) == size, f"vectors of {len(values)} numbers", size)
        return values

    return Codec(
        message_type=NUMBERS.message_type,
        encode=lambda value, now: [(now, NUMBERS.to_fields(np.asarray(value)))],
        decode=decode,
    )


def _pose_of(pose: Any) -> RigidTransform:
    q, p = pose.orientation, pose.position
    wxyz = np.array([q.w, q.x, q.y, q.z])
    _require(bool(np.linalg.norm(wxyz) > 0.0), f"a pose with quaternion {wxyz}", "a unit one")
    return RigidTransform(Quaternion(wxyz / np.linalg.norm(wxyz)), [p.x, p.y, p.z])


def _pose() -> Codec:
    def encode(X: RigidTransform, now: int) -> list[Stamped]:
        return [(now, {"header": header(now), "pose": pose(X)})]

    return Codec(
        message_type="geometry_msgs/msg/PoseStamped",
        encode=encode,
        decode=lambda messages: _pose_of(messages[-1][1].pose),
    )


def _in_world(X_WC: RigidTransform) -> Array:
    """J (6, 6) from xi in X_WC exp(xi), rotation first, to a ROS pose's error.

    That is the translation in W and then the rotation about W's axes.
    """
    R, J = X_WC.rotation().matrix(), np.zeros((6, 6))
    J[:3, 3:] = J[3:, :3] = R
    return J


def _encode_camera_pose(value: StampedImage, now: int) -> list[Stamped]:
    if not np.all(np.isfinite(value.X_WC)):
        return []
    X_WC = RigidTransform(value.X_WC)
    J = _in_world(X_WC)
    covariance = J @ value.covariance @ J.T
    found = {"pose": pose(X_WC), "covariance": covariance.ravel().tolist()}
    return [(now, {"header": header(nanoseconds(value.time), "world"), "pose": found})]


def _decode_camera_pose(messages: Sequence[Stamped]) -> tuple[Array, Array]:
    found = messages[-1][1].pose
    X_WC = _pose_of(found.pose)
    J = _in_world(X_WC)
    covariance = np.array(found.covariance, dtype=float).reshape(6, 6)
    return X_WC.GetAsMatrix4(), J.T @ covariance @ J


# Where the camera was at a `StampedImage`: decoded, its `X_WC` and `covariance`.
CAMERA_POSE = Codec(
    message_type="geometry_msgs/msg/PoseWithCovarianceStamped",
    encode=_encode_camera_pose,
    decode=_decode_camera_pose,
)


def _fields(kind: type) -> Codec:
    """A dataclass of numbers, texts and arrays as JSON, in which a number keeps all its digits.

    A field that has a default may be missing: it is younger than the recording.
    """

    def encode(value: Any, now: int) -> list[Stamped]:
        fields = {key: _plain(item) for key, item in vars(value).items()}
        return [(now, {"data": json.dumps(fields)})]

    def decode(messages: Sequence[Stamped]) -> Any:
        fields = json.loads(messages[-1][1].data)
        return kind(**{key: _unplain(item) for key, item in fields.items()})

    return Codec(message_type="std_msgs/msg/String", encode=encode, decode=decode)


def _plain(item: Any) -> Any:
    """What JSON takes: of an array its lists, of an empty one its shape, of a tuple its items."""
    if isinstance(item, np.ndarray):
        return item.tolist() if item.size else {"shape": list(item.shape)}
    if isinstance(item, tuple):
        return {"items": [_plain(one) for one in item]}
    return item


def _unplain(item: Any) -> Any:
    if isinstance(item, list):
        return np.array(item, dtype=float)
    if isinstance(item, dict):
        items = item.get("items")
        return np.zeros(item["shape"]) if items is None else tuple(map(_unplain, items))
    return item
