"""ROS 2 messages of images, cameras, frames, bodies and joints."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from pydrake.math import RigidTransform

from crossmodal.maths.arrays import Array
from crossmodal.maths.pinhole import Intrinsics
from crossmodal.maths.vectors import normal_basis
from crossmodal.systems.object_models.articulated_object import (
    ArticulatedObject,
    ObjectBody,
    ObjectJoint,
)
from crossmodal.systems.port_values import ObjectPose
from crossmodal.systems.recordings.camera_info import CAMERA_INFO, camera_info
from crossmodal.systems.recordings.images import IMAGE
from crossmodal.systems.recordings.ros_messages import header, made, pose, quaternion, vector

WORLD = "world"
_AXIS_LENGTH, _AXIS_WIDTH = 0.3, 0.01  # Of a drawn axis, [m].
_CUBE, _ARROW, _TEXT = 1, 0, 9  # Kinds of `visualization_msgs/Marker`.
_ENCODINGS = {np.dtype(np.uint8): "rgb8", np.dtype(np.float32): "32FC1"}


def image(data: Array, now: int, frame: str) -> Any:
    """A colour image (H, W, 3 or 4) of bytes, or a depth image (H, W, 1), [m]."""
    pixels = np.ascontiguousarray(data[:, :, :3])
    fields = {
        "header": header(now, frame),
        "height": pixels.shape[0],
        "width": pixels.shape[1],
        "encoding": _ENCODINGS[pixels.dtype],
        "step": pixels.strides[0],
        "data": pixels.tobytes(),
    }
    return made(IMAGE, fields)


def camera_message(lens: Intrinsics, now: int, frame: str) -> Any:
    """The intrinsics of a camera without distortion."""
    return made(CAMERA_INFO, {"header": header(now, frame), **camera_info(lens)})


def transforms(poses: Mapping[str, Array], now: int, world: str = WORLD) -> Any:
    """Frames by name, with their poses (4, 4) in the world, whose frame is called `world`."""
    each = [
        {
            "header": header(now, world),
            "child_frame_id": frame,
            "transform": {
                "translation": vector(X[:3, 3]),
                "rotation": quaternion(RigidTransform(X)),
            },
        }
        for frame, X in poses.items()
    ]
    return made("tf2_msgs/msg/TFMessage", {"transforms": each})


def pose_with_covariance(belief: ObjectPose, now: int, world: str = WORLD) -> Any:
    """Of the mesh's frame of an object whose pose is known; covariance by axes of the world."""
    R, p = belief.X[:3, :3], belief.X[:3, :3] @ belief.middle
    change = np.zeros((6, 6))  # From rotation in O and translation of the middle in W.
    change[:3] = np.hstack([np.cross(p, R, axisb=0, axisc=0), np.eye(3)])
    change[3:, :3] = R
    covariance = change @ belief.covariance @ change.T
    found = {"pose": pose(RigidTransform(belief.X_WO)), "covariance": covariance.ravel()}
    fields = {"header": header(now, world), "pose": found}
    return made("geometry_msgs/msg/PoseWithCovarianceStamped", fields)


def markers(found: ArticulatedObject, now: int, color: str, world: str = WORLD) -> Any:
    """Bodies as boxes and joints as arrows along their axes, with their names and configurations.

    Args:
        now: [ns]
        color: '#RRGGBB'.
        world: What the world's frame is called.
    """
    top = header(now, world)
    poses = {found.root: found.X_WR} | {body.name: body.X_WB for body in found.bodies}
    drawn: list[Any] = []
    for body, joint in zip(found.bodies, found.joints, strict=True):
        if np.isfinite([body.low, body.high]).all():
            drawn.append(_box(body, top, color, len(drawn)))
        if joint.moves:
            drawn += _axis(joint, poses[joint.parent], body.X_WB, top, color, len(drawn))
    return made("visualization_msgs/msg/MarkerArray", {"markers": drawn})


def _box(body: ObjectBody, top: Any, color: str, number: int) -> dict[str, Any]:
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
) -> dict[str, Any]:  # fmt: skip
    red, green, blue = (int(color[k : k + 2], 16) / 255.0 for k in (1, 3, 5))
    return {
        "header": top,
        "ns": "perceived",
        "id": number,
        "type": kind,
        "pose": pose(RigidTransform(X)),
        "scale": vector(size),
        "color": {"r": red, "g": green, "b": blue, "a": alpha},
        "text": text,
    }
