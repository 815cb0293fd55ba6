"""ROS messages by the names of their fields, with the definitions of `rosbags`."""

from collections.abc import Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from pydrake.math import RigidTransform

from crossmodal.maths.arrays import Array

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore


@cache
def ros2_types() -> "Typestore":
    """The types of messages of ROS 2."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_HUMBLE)


def definition(kind: str) -> str:
    """The text of a ROS 2 message's definition with those that it contains."""
    text: str = ros2_types().generate_msgdef(kind, ros_version=2)[0]
    return text


def encoded(message: Any) -> bytes:
    """A ROS 2 message in CDR."""
    return bytes(ros2_types().serialize_cdr(message, message.__msgtype__))


def made(kind: str, fields: Mapping[str, Any], types: "Typestore | None" = None) -> Any:
    """A message with these fields, of which those that are messages are mappings, too.

    Fields that are not given are zero or empty. A name that ROS 1 writes in capitals is found in
    either form.

    Args:
        kind: Its type, as in `sensor_msgs/msg/Image`.
        types: Of ROS 2 by default.
    """
    types = types or ros2_types()
    given = {**fields, **{name.upper(): value for name, value in fields.items()}}
    values = {
        name: _value(types, int(node), detail, given.get(name))
        for name, (node, detail) in types.fielddefs[kind][1]
    }
    return types.types[kind](**values)


def _value(types: "Typestore", node: int, detail: Any, value: Any) -> Any:
    from rosbags.interfaces import Nodetype

    if node == Nodetype.NAME:
        return made(detail, value or {}, types)
    if node == Nodetype.BASE:
        return ("" if detail[0] == "string" else 0) if value is None else value
    (inner, part), size = detail
    if inner == Nodetype.NAME:
        return [made(part, item, types) for item in value or ()]
    if part[0] == "string":
        return list(value or ())
    return _numbers(value, part[0], size if node == Nodetype.ARRAY else 0)


def _numbers(value: bytes | Sequence[Any] | None, kind: str, size: int) -> Array:
    dtype = np.dtype({"bool": "bool", "byte": "u1", "octet": "u1", "char": "u1"}.get(kind, kind))
    if value is None:
        return np.zeros(size, dtype=dtype)
    if isinstance(value, bytes | bytearray):
        return np.frombuffer(value, dtype=dtype)
    return np.asarray(value, dtype=dtype).ravel()


def header(now: int, frame: str = "") -> dict[str, Any]:
    """The header of what was measured at an instant [ns] in a frame."""
    seconds, rest = divmod(now, 1_000_000_000)
    return {"stamp": {"sec": seconds, "nanosec": rest}, "frame_id": frame}


def vector(v: Array) -> dict[str, float]:
    """A `Vector3` or `Point`."""
    return dict(zip("xyz", map(float, v), strict=True))


def quaternion(X: RigidTransform) -> dict[str, float]:
    q = X.rotation().ToQuaternion()
    return {"x": q.x(), "y": q.y(), "z": q.z(), "w": q.w()}


def pose(X: RigidTransform) -> dict[str, Any]:
    return {"position": vector(X.translation()), "orientation": quaternion(X)}
