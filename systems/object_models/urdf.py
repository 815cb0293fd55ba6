"""An articulated object as URDF."""

import xml.etree.ElementTree as ET

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

_EFFORT, _VELOCITY = "1000.0", "10.0"  # URDF asks for limits; nothing is known of them.


def urdf(found: ArticulatedObject, name: str) -> str:
    """The object as URDF: a link for each body, and one without mass where its frame B is.

    Raises:
        ValueError: for an object without a joint, a name that is none, and a screw, which URDF
            lacks.
    """
    parts = links(found, name)
    if any(part.joint.type == JointType.SCREW for part in parts):
        raise ValueError("URDF has no screw joints; write an SDF")
    robot = ET.Element("robot", name=name)
    add_comments(robot, found)
    _add_link(robot, found.root, None)
    for part in parts:
        _add_link(robot, part.body.name, part)
        ET.SubElement(robot, "link", name=part.body.frame)
        _add_joint(robot, part)
        fixed = f"{part.body.frame}_on_{part.body.name}"
        _connect(robot, fixed, "fixed", (part.body.name, part.body.frame), part.X_JB)
    return text(robot)


def _add_link(robot: ET.Element, name: str, part: Link | None) -> None:
    link = ET.SubElement(robot, "link", name=name)
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "mass", value=MASS)
    ET.SubElement(inertial, "inertia", dict.fromkeys(MOMENTS, INERTIA), ixy="0", ixz="0", iyz="0")
    box = None if part is None else part.box
    if box is None:
        return
    X_JC, size = box
    for kind in ("visual", "collision"):
        shape = ET.SubElement(link, kind, name=f"{name}_{kind}")
        _origin(shape, X_JC)
        ET.SubElement(ET.SubElement(shape, "geometry"), "box", size=words(size))


def _add_joint(robot: ET.Element, part: Link) -> None:
    found = part.joint
    kind = found.type if found.moves else "fixed"
    joint = _connect(robot, found.name, kind, (found.parent, found.child), part.X_LJ)
    if not found.moves:
        return
    # Axes are in the joint's frame, which has the axes of the parent's B.
    ET.SubElement(joint, "axis", xyz=words(found.axis_P))
    known = {"lower": number(found.lower), "upper": number(found.upper)}
    ET.SubElement(joint, "limit", known, effort=_EFFORT, velocity=_VELOCITY)
    if resistance := dynamics(found):
        ET.SubElement(joint, "dynamics", resistance)


def _connect(
    robot: ET.Element, name: str, kind: str, ends: tuple[str, str], X: Array
) -> ET.Element:
    joint = ET.SubElement(robot, "joint", name=name, type=kind)
    for role, link in zip(("parent", "child"), ends, strict=True):
        ET.SubElement(joint, role, link=link)
    _origin(joint, X)
    return joint


def _origin(element: ET.Element, X: Array) -> None:
    ET.SubElement(element, "origin", xyz=words(X[:3, 3]), rpy=angles(X))
