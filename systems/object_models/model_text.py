"""What URDF and SDF have in common: placeholders, names, numbers, poses, boxes, comments."""

import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.systems.object_models.articulated_object import (
    ArticulatedObject,
    ObjectBody,
    ObjectJoint,
    uncertainty,
)

MASS, INERTIA = "1.0", "0.01"  # [kg], [kg m^2]; nothing is known of them.
MOMENTS = ("ixx", "iyy", "izz")
THINNEST = 0.005  # Of a box: what is seen of a face has no thickness, [m].


@dataclass(frozen=True, kw_only=True)
class Link:
    """A body with its joint, and the frame J of its link, which lies on the joint's axis.

    Attributes:
        body: With the frame B that its poses are of.
        joint: To its parent.
        X_LJ: Pose (4, 4) of J in the frame of the parent's link when the joint is at zero.
        X_JB: (4, 4)
    """

    body: ObjectBody
    joint: ObjectJoint
    X_LJ: Array
    X_JB: Array

    @property
    def box(self) -> tuple[Array, Array] | None:
        """Centre as a pose X_JC (4, 4), and size (3,), of what was perceived of its shape."""
        low, high = self.body.low, self.body.high
        if not np.isfinite([low, high]).all():
            return None
        X_BC = np.eye(4)
        X_BC[:3, 3] = 0.5 * (low + high)
        return self.X_JB @ X_BC, np.maximum(high - low, THINNEST)


def links(found: ArticulatedObject, name: str) -> list[Link]:
    """The object's bodies as links, parents first.

    Raises:
        ValueError: for an object without a joint, a joint without its parent, and a name that is
            none.
    """
    if not found.joints:
        raise ValueError("no joint was perceived, so that there is none to write")
    if not re.fullmatch(r"[A-Za-z_][\w-]*", name):
        raise ValueError(f"'{name}' is no name of a model; need letters, digits, - and _")
    in_link, made = {found.root: np.eye(4)}, []  # Poses of each B in its link.
    for body, joint in zip(found.bodies, found.joints, strict=True):
        if joint.parent not in in_link:
            raise ValueError(f"'{joint.name}' has the parent '{joint.parent}', which is no body")
        X_JB = se3.inverse(joint.X_PJ) @ joint.X_PB_zero
        X_LJ = in_link[joint.parent] @ joint.X_PJ
        made.append(Link(body=body, joint=joint, X_LJ=X_LJ, X_JB=X_JB))
        in_link[body.name] = X_JB
    return made


def add_comments(element: ET.Element, found: ArticulatedObject) -> None:
    """What the model cannot say, as comments."""
    lines = [line for joint in found.joints for line in uncertainty(joint)]
    for line in [*lines, "masses and inertias are placeholders"]:
        element.append(ET.Comment(f" {line} "))


def as_name(title: str) -> str:
    """A name of a model that resembles a text."""
    name = "".join(c if c.isascii() and (c.isalnum() or c in "_-") else "_" for c in title)
    return name if re.match(r"[A-Za-z_]", name) else f"object_{name}"


def number(value: float) -> str:
    return f"{value:.9g}"


def words(vector: Array) -> str:
    return " ".join(map(number, vector))


def angles(X: Array) -> str:
    """Roll, pitch and yaw."""
    return words(Rotation.from_matrix(X[:3, :3]).as_euler("xyz"))


def dynamics(joint: ObjectJoint) -> dict[str, str]:
    """Friction and damping, where they are known; simulators take none below zero."""
    known = {"damping": joint.damping, "friction": joint.friction}
    return {key: number(max(v, 0.0)) for key, v in known.items() if np.isfinite(v)}


def text(root: ET.Element) -> str:
    ET.indent(root)
    return f'<?xml version="1.0"?>\n{ET.tostring(root, encoding="unicode")}\n'
