"""An estimated joint as a model that simulators read."""

import re
import xml.etree.ElementTree as ET

import numpy as np
from scipy.spatial.transform import Rotation

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.systems.port_values import JointType
from crossmodal.systems.pose_tracks.joint_estimate import JointEstimate

_MASS, _INERTIA = 1.0, 0.01  # [kg], [kg m^2]; nothing is known of them.
_EFFORT, _VELOCITY = 1000.0, 10.0  # URDF asks for limits; nothing is known of them.


def joint_frame(found: JointEstimate) -> Array:
    """X_PJ (4, 4): the parent's axes, on the axis next to the body, or at the body."""
    X_PJ = np.eye(4)
    turns = found.type in (JointType.REVOLUTE, JointType.SCREW)
    X_PJ[:3, 3] = found.model.p_PA if turns else found.X_PB_zero[:3, 3]
    return X_PJ


def uncertainty(found: JointEstimate) -> list[str]:
    """What a model cannot say, a line each."""
    belief, model = found.belief, found.model
    lines = [f"{found.type}, probability {found.probability:.3f}, from {belief.updates} poses"]
    if found.type == JointType.REVOLUTE:
        lines.append(f"a hinge with probability {belief.hinge_probability():.3f}")
    if found.moves:
        unit = "m" if found.type == JointType.PRISMATIC else "rad"
        low, high = found.limits
        lines.append(f"axis known to {np.rad2deg(found.axis_deviation):.3g} deg")
        lines.append(f"limits are what was seen, {low:.4g} to {high:.4g} {unit}")
    if found.type in (JointType.REVOLUTE, JointType.SCREW):
        position = np.sqrt(np.trace(model.p_PA_covariance))
        lines.append(f"position of the axis known to {1e3 * position:.3g} mm")
    if found.type == JointType.SCREW:
        lines.append(f"pitch {model.pitch:.4g} +- {np.sqrt(model.pitch_variance):.2g} m/rad")
    return [*lines, "masses and inertias are placeholders"]


def to_urdf(found: JointEstimate, name: str = "object") -> str:
    """The joint as URDF: links `parent` and `child`, and `tracked` where B is.

    Raises:
        ValueError: for a disconnected body, a name that is none, and a screw, which URDF lacks.
    """
    _check(found, name)
    if found.type == JointType.SCREW:
        raise ValueError("URDF has no screw joints; write an SDF")
    X_PJ = joint_frame(found)
    robot = _commented(ET.Element("robot", name=name), found)
    for link in ("parent", "child"):
        inertial = ET.SubElement(ET.SubElement(robot, "link", name=link), "inertial")
        ET.SubElement(inertial, "mass", value=str(_MASS))
        moments = dict.fromkeys(("ixx", "iyy", "izz"), str(_INERTIA))
        ET.SubElement(inertial, "inertia", moments, ixy="0", ixz="0", iyz="0")
    ET.SubElement(robot, "link", name="tracked")
    joint = _urdf_joint(robot, "joint", "parent", "child", X_PJ)
    joint.set("type", str(found.type) if found.moves else "fixed")
    if found.moves:
        low, high = map(_number, found.limits)
        ET.SubElement(joint, "axis", xyz=_words(found.axis_P))
        known = {"lower": low, "upper": high}
        ET.SubElement(joint, "limit", known, effort=str(_EFFORT), velocity=str(_VELOCITY))
    X_JB = se3.inverse(X_PJ) @ found.X_PB_zero
    _urdf_joint(robot, "tracked_on_child", "child", "tracked", X_JB).set("type", "fixed")
    return _text(robot)


def to_sdf(found: JointEstimate, name: str = "object") -> str:
    """The joint as SDF: links `parent` and `child`, and the frame `tracked` where B is.

    Raises:
        ValueError: for a disconnected body, and a name that is none.
    """
    _check(found, name)
    X_PJ = joint_frame(found)
    sdf = ET.Element("sdf", version="1.9")
    model = _commented(ET.SubElement(sdf, "model", name=name), found)
    for link in ("parent", "child"):
        body = ET.SubElement(model, "link", name=link)
        if link == "child":
            _sdf_pose(body, "parent", X_PJ)
        inertial = ET.SubElement(body, "inertial")
        ET.SubElement(inertial, "mass").text = str(_MASS)
        inertia = ET.SubElement(inertial, "inertia")
        for moment in ("ixx", "iyy", "izz"):
            ET.SubElement(inertia, moment).text = str(_INERTIA)
    frame = ET.SubElement(model, "frame", name="tracked", attached_to="child")
    _sdf_pose(frame, "child", se3.inverse(X_PJ) @ found.X_PB_zero)
    kind = str(found.type) if found.moves else "fixed"
    joint = ET.SubElement(model, "joint", name="joint", type=kind)
    ET.SubElement(joint, "parent").text = "parent"
    ET.SubElement(joint, "child").text = "child"
    if found.type == JointType.SCREW:
        thread = 2.0 * np.pi * found.model.pitch
        ET.SubElement(joint, "screw_thread_pitch").text = _number(thread)
    if found.moves:
        axis = ET.SubElement(joint, "axis")
        ET.SubElement(axis, "xyz", expressed_in="parent").text = _words(found.axis_P)
        limit = ET.SubElement(axis, "limit")
        for bound, value in zip(("lower", "upper"), found.limits, strict=True):
            ET.SubElement(limit, bound).text = _number(value)
    return _text(sdf)


def _check(found: JointEstimate, name: str) -> None:
    if found.type == JointType.DISCONNECTED:
        raise ValueError("the body is disconnected, so that there is no joint to write")
    if not re.fullmatch(r"[A-Za-z_][\w-]*", name):
        raise ValueError(f"'{name}' is no name of a model; need letters, digits, - and _")


def _commented(element: ET.Element, found: JointEstimate) -> ET.Element:
    for line in uncertainty(found):
        element.append(ET.Comment(f" {line} "))
    return element


def _urdf_joint(robot: ET.Element, name: str, parent: str, child: str, X_PC: Array) -> ET.Element:
    joint = ET.SubElement(robot, "joint", name=name)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    ET.SubElement(joint, "origin", xyz=_words(X_PC[:3, 3]), rpy=_angles(X_PC))
    return joint


def _sdf_pose(element: ET.Element, frame: str, X: Array) -> None:
    pose = ET.SubElement(element, "pose", relative_to=frame)
    pose.text = f"{_words(X[:3, 3])} {_angles(X)}"


def _number(value: float) -> str:
    return f"{value:.9g}"


def _words(vector: Array) -> str:
    return " ".join(map(_number, vector))


def _angles(X: Array) -> str:
    """Roll, pitch and yaw."""
    return _words(Rotation.from_matrix(X[:3, :3]).as_euler("xyz"))


def _text(root: ET.Element) -> str:
    ET.indent(root)
    return f'<?xml version="1.0"?>\n{ET.tostring(root, encoding="unicode")}\n'
