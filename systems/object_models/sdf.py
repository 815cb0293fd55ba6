"""An articulated object as SDF."""

import xml.etree.ElementTree as ET

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.systems.object_models.articulated_object import ArticulatedObject
from crossmodal.systems.object_models.model_text import (
    INERTIA,
    MASS,
    MOMENTS,
    Link,
    add_comments,
    angles,
    dynamics,
    links,
    number,
    text,
    words,
)
from crossmodal.systems.port_values import JointType


def sdf(found: ArticulatedObject, name: str) -> str:
    """The object as SDF: a link for each body, with a frame where its frame B is.

    Raises:
        ValueError: for an object without a joint, and for a name that is none.
    """
    parts = links(found, name)
    root = ET.Element("sdf", version="1.9")
    model = ET.SubElement(root, "model", name=name)
    add_comments(model, found)
    _add_link(model, found.root, None)
    for part in parts:
        _add_link(model, part.body.name, part)
        frame = ET.SubElement(model, "frame", name=part.body.frame, attached_to=part.body.name)
        _add_pose(frame, part.X_JB, part.body.name)
        _add_joint(model, part)
    return text(root)


def _add_link(model: ET.Element, name: str, part: Link | None) -> None:
    link = ET.SubElement(model, "link", name=name)
    if part is not None:
        _add_pose(link, part.X_LJ, part.joint.parent)
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "mass").text = MASS
    inertia = ET.SubElement(inertial, "inertia")
    for moment in MOMENTS:
        ET.SubElement(inertia, moment).text = INERTIA
    box = None if part is None else part.box
    if box is None:
        return
    X_JC, size = box
    for kind in ("visual", "collision"):
        shape = ET.SubElement(link, kind, name=f"{name}_{kind}")
        _add_pose(shape, X_JC)
        geometry = ET.SubElement(ET.SubElement(shape, "geometry"), "box")
        ET.SubElement(geometry, "size").text = words(size)


def _add_joint(model: ET.Element, part: Link) -> None:
    found = part.joint
    kind = found.type if found.moves else "fixed"
    joint = ET.SubElement(model, "joint", name=found.name, type=kind)
    ET.SubElement(joint, "parent").text = found.parent
    ET.SubElement(joint, "child").text = found.child
    if not found.moves:
        return
    if found.type == JointType.SCREW:
        ET.SubElement(joint, "screw_thread_pitch").text = number(2.0 * np.pi * found.pitch)
    axis = ET.SubElement(joint, "axis")
    # Axes are in the joint's frame, which has the axes of the parent's B.
    ET.SubElement(axis, "xyz").text = words(found.axis_P)
    limit = ET.SubElement(axis, "limit")
    for bound, value in (("lower", found.lower), ("upper", found.upper)):
        ET.SubElement(limit, bound).text = number(value)
    if resistance := dynamics(found):
        element = ET.SubElement(axis, "dynamics")
        for key, said in resistance.items():
            ET.SubElement(element, key).text = said


def _add_pose(element: ET.Element, X: Array, frame: str = "") -> None:
    pose = ET.SubElement(element, "pose", {"relative_to": frame} if frame else {})
    pose.text = f"{words(X[:3, 3])} {angles(X)}"
