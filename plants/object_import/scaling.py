"""Makes a model larger or smaller, for files that are not in metres."""

from collections.abc import Collection, Iterable
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

# What holds nothing but lengths: attributes of URDF's shapes and elements of SDF's.
LENGTHS = {
    "box": ("size",),
    "cylinder": ("radius", "length"),
    "sphere": ("radius",),
    "capsule": ("radius", "length"),
    "ellipsoid": ("a", "b", "c", "radii"),
}
_MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


def scale_lengths(root: Element, scale: float) -> None:
    """Scales all lengths of an SDF or URDF model in place.

    Places, sizes, meshes and pitches of threads are lengths; so are limits of sliding joints, where
    their springs rest, and how they follow others. Masses stay, so moments of inertia go with the
    square. What is no number stays for the parser to complain of.
    """
    slides = {j.get("name") for j in root.iter("joint") if j.get("type") == "prismatic"}
    for node in root.iter():
        if node.tag == "pose":
            node.text = _scaled(node.text, [scale] * 3 + [1.0] * 4)
        elif node.tag == "origin":
            _scale(node, ("xyz",), scale)
        elif node.tag in LENGTHS:
            _scale(node, LENGTHS[node.tag], scale)
        elif node.tag == "mesh":
            if node.get("filename") is not None:
                node.set("scale", node.get("scale") or "1 1 1")
            elif node.find("scale") is None:
                ElementTree.SubElement(node, "scale").text = "1 1 1"
            _scale(node, ("scale",), scale)
        elif node.tag == "inertia":
            _scale(node, _MOMENTS, scale**2)
        elif node.tag == "joint":
            _scale_joint(node, slides, scale)


def _scale_joint(joint: Element, slides: Collection[str | None], scale: float) -> None:
    own = scale if joint.get("name") in slides else 1.0
    for limit in joint.iter("limit"):
        _scale(limit, ("lower", "upper"), own)
    for dynamics in joint.iter("dynamics"):
        _scale(dynamics, ("spring_reference",), own)
    for mimic in joint.iter("mimic"):
        leader = scale if mimic.get("joint") in slides else 1.0
        _scale(mimic, ("offset",), own)
        _scale(mimic, ("reference",), leader)
        if own != leader:
            if mimic.get("multiplier") is None and mimic.find("multiplier") is None:
                mimic.set("multiplier", "1")
            _scale(mimic, ("multiplier",), own / leader)
    _scale(joint, ("screw_thread_pitch",), scale)
    _scale(joint, ("thread_pitch",), 1.0 / scale)  # Turns per length.
    for pitch in joint.findall("{drake.mit.edu}screw_thread_pitch"):
        _scale(pitch, ("value",), scale)


def _scale(node: Element, keys: Iterable[str], scale: float) -> None:
    """Scales attributes and elements of these names."""
    for key in keys:
        text = node.get(key)
        if text is not None:
            node.set(key, _scaled(text, [scale] * 6) or "")
        for child in node.findall(key):
            child.text = _scaled(child.text, [scale] * 6)


def _scaled(text: str | None, scales: list[float]) -> str | None:
    """Numbers in a text, each by its scale."""
    try:
        values = [float(part) for part in (text or "").split()]
    except ValueError:
        return text
    if len(values) > len(scales):
        return text
    return " ".join(repr(scale * value) for scale, value in zip(scales, values, strict=False))
