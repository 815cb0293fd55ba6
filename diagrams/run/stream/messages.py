"""ROS 2 messages of images, cameras, frames, bodies and joints."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from pydrake.math import RigidTransform
from rosbags.typesys import Stores, get_typestore

from crossmodal.diagrams.run.calibration import CameraCalibration
from crossmodal.maths.arrays import Array
from crossmodal.maths.vectors import normal_basis
from crossmodal.systems.object_models.articulated_object import (
    ArticulatedObject,
    ObjectBody,
    ObjectJoint,
)
from crossmodal.systems.port_values import ObjectPose

STORE = get_typestore(Stores.ROS2_HUMBLE)
WORLD = "world"
_AXIS_LENGTH, _AXIS_WIDTH = 0.3, 0.01  # Of a drawn axis, [m].
_CUBE, _ARROW, _TEXT = 1, 0, 9  # Kinds of `visualization_msgs/Marker`.
_ENCODINGS = {np.dtype(np.uint8): "rgb8", np.dtype(np.float32): "32FC1"}


def definition(message_type: str) -> str:
    """The text of a message's definition with those that it contains."""
    text: str = STORE.generate_msgdef(message_type, ros_version=2)[0]
    return text


def encoded(message: Any) -> bytes:
    """A message in CDR."""
    return bytes(STORE.serialize_cdr(message, message.__msgtype__))


def _make(name: str, **fields: Any) -> Any:
    return STORE.types[name](**fields)


def stamp(now: int) -> Any:
    """An instant [ns]."""
    seconds, rest = divmod(now, 1_000_000_000)
    return _make("builtin_interfaces/msg/Time", sec=seconds, nanosec=rest)


def header(now: int, frame: str) -> Any:
    return _make("std_msgs/msg/Header", stamp=stamp(now), frame_id=frame)


def image(data: Array, now: int, frame: str) -> Any:
    """A colour image (H, W, 3 or 4) of bytes, or a depth image (H, W, 1), [m]."""
    pixels = np.ascontiguousarray(data[:, :, :3])
    return _make(
        "sensor_msgs/msg/Image",
        header=header(now, frame),
        height=pixels.shape[0],
        width=pixels.shape[1],
        encoding=_ENCODINGS[pixels.dtype],
        is_bigendian=0,
        step=pixels.strides[0],
        data=pixels.view(np.uint8).reshape(-1),
    )


def camera_info(camera: CameraCalibration, now: int, frame: str) -> Any:
    """What is believed of a camera, which has no distortion."""
    lens = camera.intrinsics
    fx, fy, cx, cy = lens.vector().tolist()
    region = _make(
        "sensor_msgs/msg/RegionOfInterest",
        x_offset=0, y_offset=0, height=0, width=0, do_rectify=False,
    )  # fmt: skip
    return _make(
        "sensor_msgs/msg/CameraInfo",
        header=header(now, frame),
        height=lens.height,
        width=lens.width,
        distortion_model="plumb_bob",
        d=np.zeros(5),
        k=np.array([fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]),
        r=np.eye(3).ravel(),
        p=np.array([fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]),
        binning_x=0,
        binning_y=0,
        roi=region,
    )


def transforms(poses: Mapping[str, Array], now: int, world: str = WORLD) -> Any:
    """Frames by name, with their poses (4, 4) in the world, whose frame is called `world`."""
    each = [
        _make(
            "geometry_msgs/msg/TransformStamped",
            header=header(now, world),
            child_frame_id=frame,
            transform=_make(
                "geometry_msgs/msg/Transform",
                translation=_vector(X[:3, 3]),
                rotation=_quaternion(X),
            ),
        )
        for frame, X in poses.items()
    ]
    return _make("tf2_msgs/msg/TFMessage", transforms=each)


def _pose(X: Array) -> Any:
    x, y, z = map(float, X[:3, 3])
    return _make(
        "geometry_msgs/msg/Pose",
        position=_make("geometry_msgs/msg/Point", x=x, y=y, z=z),
        orientation=_quaternion(X),
    )


def _vector(v: Array) -> Any:
    x, y, z = map(float, v)
    return _make("geometry_msgs/msg/Vector3", x=x, y=y, z=z)


def _quaternion(X: Array) -> Any:
    q = RigidTransform(np.asarray(X)).rotation().ToQuaternion()
    return _make("geometry_msgs/msg/Quaternion", x=q.x(), y=q.y(), z=q.z(), w=q.w())


def pose_with_covariance(belief: ObjectPose, now: int, world: str = WORLD) -> Any:
    """Of the mesh's frame of an object whose pose is known; covariance by axes of the world."""
    R, p = belief.X[:3, :3], belief.X[:3, :3] @ belief.middle
    change = np.zeros((6, 6))  # From rotation in O and translation of the middle in W.
    change[:3] = np.hstack([np.cross(p, R, axisb=0, axisc=0), np.eye(3)])
    change[3:, :3] = R
    covariance = change @ belief.covariance @ change.T
    return _make(
        "geometry_msgs/msg/PoseWithCovarianceStamped",
        header=header(now, world),
        pose=_make(
            "geometry_msgs/msg/PoseWithCovariance",
            pose=_pose(belief.X_WO),
            covariance=covariance.ravel(),
        ),
    )


def markers(found: ArticulatedObject, now: int, color: str, world: str = WORLD) -> Any:
    """Bodies as boxes and joints as arrows along their axes, with their names and configurations.

    Args:
        now: [ns]
        color: '#RRGGBB'.
        world: What the world's frame is called.
    """
    top = header(now, world)
    poses = {found.root: found.X_WR} | {body.name: body.X_WB for body in found.bodies}
    made: list[Any] = []
    for body, joint in zip(found.bodies, found.joints, strict=True):
        if np.isfinite([body.low, body.high]).all():
            made.append(_box(body, top, color, len(made)))
        if joint.moves:
            made += _axis(joint, poses[joint.parent], body.X_WB, top, color, len(made))
    return _make("visualization_msgs/msg/MarkerArray", markers=made)


def _box(body: ObjectBody, top: Any, color: str, number: int) -> Any:
    X_WC = body.X_WB.copy()
    X_WC[:3, 3] += X_WC[:3, :3] @ (0.5 * (body.low + body.high))
    size = np.maximum(body.high - body.low, _AXIS_WIDTH)
    return _marker(_CUBE, X_WC, size, top, color, number, alpha=0.4)


def _axis(
    joint: ObjectJoint, X_WP: Array, X_WB: Array, top: Any, color: str, number: int
) -> list[Any]:
    """An arrow (x along it) from the joint's frame, and what is believed of the joint."""
    axis = X_WP[:3, :3] @ joint.axis_P
    v, w = normal_basis(axis)
    if np.cross(v, w) @ axis < 0.0:
        v, w = w, v
    X_WA = np.eye(4)
    X_WA[:3, :3] = np.column_stack([axis, v, w])
    p_WA = X_WP[:3, :3] @ joint.p_PA + X_WP[:3, 3] if joint.turns else X_WB[:3, 3]
    X_WA[:3, 3] = p_WA
    X_WT = np.eye(4)
    X_WT[:3, 3] = p_WA + 0.5 * _AXIS_LENGTH * axis
    told = f"{joint.type} {joint.q:.3f} {'rad' if joint.turns else 'm'}"
    size = np.array([_AXIS_LENGTH, _AXIS_WIDTH, _AXIS_WIDTH])
    arrow = _marker(_ARROW, X_WA, size, top, color, number)
    return [arrow, _marker(_TEXT, X_WT, np.full(3, 0.03), top, color, number + 1, text=told)]


def _marker(
    kind: int, X: Array, size: Array, top: Any, color: str, number: int, *,
    alpha: float = 1.0, text: str = "",
) -> Any:  # fmt: skip
    red, green, blue = (int(color[k : k + 2], 16) / 255.0 for k in (1, 3, 5))
    nothing = np.zeros(0, np.uint8)
    return _make(
        "visualization_msgs/msg/Marker",
        header=top,
        ns="perceived",
        id=number,
        type=kind,
        action=0,
        pose=_pose(X),
        scale=_vector(size),
        color=_make("std_msgs/msg/ColorRGBA", r=red, g=green, b=blue, a=alpha),
        lifetime=_make("builtin_interfaces/msg/Duration", sec=0, nanosec=0),
        frame_locked=False,
        points=[],
        colors=[],
        texture_resource="",
        texture=_make("sensor_msgs/msg/CompressedImage", header=top, format="", data=nothing),
        uv_coordinates=[],
        text=text,
        mesh_resource="",
        mesh_file=_make("visualization_msgs/msg/MeshFile", filename="", data=nothing),
        mesh_use_embedded_materials=False,
    )
