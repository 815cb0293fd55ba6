"""Makes a model larger or smaller, for files that are not in metres."""

from xml.etree import ElementTree
from xml.etree.ElementTree import Element

# What holds nothing but lengths: attributes of URDF's shapes, elements of SDF's.
_URDF = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",),
         "capsule": ("radius", "length"), "ellipsoid": ("a", "b", "c")}  # fmt: skip
_SDF = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",),
        "capsule": ("radius", "length"), "ellipsoid": ("radii",)}  # fmt: skip
_MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


def scale_lengths(root: Element, scale: float) -> None:
    """Scales all lengths of an SDF or URDF model in place.

    Places, sizes, meshes and the limits of sliding joints are lengths. Masses stay, so moments of
    inertia go with the square. What is no number stays for the parser to complain of.
    """
    for node in root.iter():
        if node.tag == "pose":
            node.text = _scaled(node.text, [scale] * 3 + [1.0] * 4)
        elif node.tag == "origin":
            _scale_attribute(node, "xyz", scale)
        elif node.tag in _URDF:
            for key in _URDF[node.tag]:
                _scale_attribute(node, key, scale)
            for key in _SDF[node.tag]:
                _scale_child(node, key, scale)
        elif node.tag == "mesh":
            _scale_mesh(node, scale)
        elif node.tag == "inertia":
            for key in _MOMENTS:
                _scale_attribute(node, key, scale**2)
                _scale_child(node, key, scale**2)
        elif node.tag == "joint" and node.get("type") == "prismatic":
            for limit in node.iter("limit"):
                for key in ("lower", "upper"):
                    _scale_attribute(limit, key, scale)
                    _scale_child(limit, key, scale)


def _scale_mesh(mesh: Element, scale: float) -> None:
    if mesh.get("filename") is not None:
        mesh.set("scale", mesh.get("scale") or "1 1 1")
        _scale_attribute(mesh, "scale", scale)
        return
    if mesh.find("scale") is None:
        ElementTree.SubElement(mesh, "scale").text = "1 1 1"
    _scale_child(mesh, "scale", scale)


def _scale_attribute(node: Element, key: str, scale: float) -> None:
    text = node.get(key)
    if text is not None:
        node.set(key, _scaled(text, [scale] * 6) or "")


def _scale_child(node: Element, key: str, scale: float) -> None:
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
