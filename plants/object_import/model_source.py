"""Reads SDF or URDF as found in the wild and repairs what Drake's parser does not take."""

import copy
import re
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.plants.object_import.meshes import (
    LARGEST,
    MANY_FACES,
    Surface,
    Warn,
    extent,
    merged,
    read_surfaces,
    write_contact_obj,
    write_obj,
)
from crossmodal.plants.object_import.model_files import MeshFiles, ModelFiles, is_image
from crossmodal.plants.object_import.scaling import scale_lengths

_MODEL_TYPES = {"robot": "URDF", "sdf": "SDF"}
_SHAPES = ("box", "cylinder", "sphere", "capsule", "ellipsoid")  # Those that are bounded.
_SCENERY = ("sun", "ground_plane")  # Gazebo's own, in most of its worlds.
_EXPRESSION = re.compile(r"\$\{|\$\((find|arg|env|optenv|eval|dirname)\b")  # Of xacro.
_IMPORTED = "crossmodal_imported"
ElementTree.register_namespace("drake", "drake.mit.edu")
_DRAKE = "{drake.mit.edu}"


@dataclass(kw_only=True)
class Mimic:
    """q = multiplier * q(leader) + offset."""

    leader: str
    multiplier: float
    offset: float


@dataclass(kw_only=True)
class ModelSource:
    """A repaired model, ready for Drake's parser.

    Attributes:
        root: Its XML; meshes are OBJ files with absolute names.
        suffix: `.sdf` or `.urdf`.
        masses: Links whose inertia the file does not give, with their mass [kg] where it does.
        mimics: By the name of the following joint.
        is_imported: Whether the file is a copy that an import has written.
    """

    root: Element
    suffix: str
    masses: dict[str, float | None] = field(default_factory=dict)
    mimics: dict[str, Mimic] = field(default_factory=dict)
    is_imported: bool = False


def read_model(path: Path) -> ModelSource:
    """The model in a file, as it stands.

    Raises:
        ValueError: in one line, if the file is neither SDF nor URDF.
    """
    try:
        text = _decoded(path.read_bytes())
        root = ElementTree.fromstring(_with_known_prefixes(text))
    except FileNotFoundError:
        raise ValueError(f"{path}: there is no such file") from None
    except OSError as error:
        raise ValueError(f"{path}: cannot be read as SDF or URDF: {error}") from None
    except ElementTree.ParseError as error:
        raise ValueError(f"{path}: is not valid XML: {error}") from None
    if _is_xacro(root):
        raise ValueError(
            f"{path}: is a xacro file; expand it first: xacro {path.name} > model.urdf"
        )
    if root.tag not in _MODEL_TYPES:
        raise ValueError(f"{path}: <{root.tag}> is neither SDF (<sdf>) nor URDF (<robot>)")
    suffix = f".{_MODEL_TYPES[root.tag].lower()}"
    return ModelSource(root=root, suffix=suffix, is_imported=f"<!-- {_IMPORTED} " in text)


def _is_xacro(root: Element) -> bool:
    """Whether something is left for xacro to expand; many files only declare its namespace."""
    for element in root.iter():
        if "xacro}" in str(element.tag) or any("xacro}" in key for key in element.attrib):
            return True
        if any(_EXPRESSION.search(text or "") for text in (element.text, *element.attrib.values())):
            return True
    return False


def _decoded(content: bytes) -> str:
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def _with_known_prefixes(text: str) -> str:
    """Declares the namespace prefixes that are used without a declaration, as many files do.

    Drake knows its own elements by their prefix, whatever it is declared as.
    """
    text = re.sub(r"xmlns:drake\s*=\s*(\"[^\"]*\"|'[^']*')", 'xmlns:drake="drake.mit.edu"', text)
    used = set(re.findall(r"</?([A-Za-z_]\w*):\w", text)) | set(
        re.findall(r"\s([A-Za-z_]\w*):\w+\s*=\s*[\"']", text)
    )
    missing = [
        prefix for prefix in sorted(used - {"xmlns", "xml"}) if f"xmlns:{prefix}=" not in text
    ]
    uris = {prefix: "drake.mit.edu" if prefix == "drake" else prefix for prefix in missing}
    declared = "".join(f' xmlns:{prefix}="{uri}"' for prefix, uri in uris.items())
    return re.sub(r"<(sdf|robot)\b", rf"<\1{declared}", text, count=1)


class Repair:
    """Changes a model in place until Drake's parser takes it; says what it changes.

    Args:
        folder: Where converted meshes are written.
        warn: Takes one line for each change that a user should know of.
        scale: Of all lengths in the file.
    """

    def __init__(self, source: Path, folder: Path, warn: Warn, scale: float = 1.0) -> None:
        if not 0 < scale < np.inf:
            raise ValueError(f"{source}: a scale of {scale:g}, but it must be > 0")
        self._scale = scale
        self._source, self._folder, self._warn = source, folder, warn
        self._files = ModelFiles(source)
        self._links: dict[str, list[str]] = {}  # Links by the note about them.
        self._surfaces: dict[tuple[Path, tuple[float, ...]], list[Surface]] = {}
        self._written: dict[object, list[Path]] = {}

    def run(self, model: ModelSource) -> None:
        """Repairs the model.

        Raises:
            ValueError: in one line that names file, element and fix, for what cannot be repaired.
        """
        root = model.root
        self._expand_includes(root, (self._source,))
        if self._scale != 1.0:
            scale_lengths(root, self._scale)
        for element in list(root.iter()):
            for name in ("transmission", "plugin", "sensor", "gazebo", "actor", "state", "light"):
                for child in element.findall(name):
                    element.remove(child)
        for link in root.iter("link"):
            self._repair_geometry(link)
        self._read_meshes(root)
        for link in root.iter("link"):
            for shape in link.findall("visual") + link.findall("collision"):
                self._convert_mesh(link, shape)
            self._repair_friction(link)
            self._repair_inertia(link, model)
        for joint in root.iter("joint"):
            self._repair_limits(joint)
            self._note_mimic(joint, model)
        for what, links in self._links.items():
            self._warn(f"{what}: {', '.join(links)}")

    def _note(self, what: str, link: Element) -> None:
        """Notes something about a link, once for all links of which it is true."""
        self._links.setdefault(what, []).append(link.get("name", ""))

    def _expand_includes(self, element: Element, within: tuple[Path, ...]) -> None:
        """Puts included models into the file, and makes the names of all files absolute.

        Args:
            within: The files that include each other down to this element, the last its own.
        """
        base = within[-1].parent
        for node in element.iter():
            self._make_absolute(node, base)
        for parent in list(element.iter()):
            for include in parent.findall("include"):
                uri = include.findtext("uri") or ""
                if uri.strip().rpartition("/")[2] in _SCENERY:
                    parent.remove(include)
                    continue
                parent[list(parent).index(include)] = self._included(include, within)

    def _included(self, include: Element, within: tuple[Path, ...]) -> Element:
        uri = (include.findtext("uri") or "").strip()
        path = self._files.find(uri, within[-1].parent, "<include><uri>")
        if path.is_dir():
            path = path / "model.sdf"
        if path.resolve() in [file.resolve() for file in within]:
            raise ValueError(
                f"{self._source}: <include><uri> '{uri}' in {within[-1].name} includes a file that"
                " includes it again; remove one of the two"
            )
        if include.get("merge") == "true":
            raise ValueError(
                f"{self._source}: <include merge='true'> of '{uri}' is not supported;"
                " write the model's links into the file"
            )
        root = read_model(path).root
        model = root.find("model")
        if model is None:
            raise ValueError(f"{path}: holds no <model> to include")
        model = copy.deepcopy(model)
        self._expand_includes(model, (*within, path))
        model.set("name", (include.findtext("name") or model.get("name") or "").strip())
        for key in ("pose", "static"):
            replacement = include.find(key)
            if replacement is not None:
                for old in model.findall(key):
                    model.remove(old)
                model.insert(0, replacement)
        placed = include.find("placement_frame")
        if placed is not None and placed.text:
            model.set("placement_frame", placed.text.strip())
        return model

    def _make_absolute(self, node: Element, base: Path) -> None:
        if node.tag == "mesh" and node.get("filename") is not None:  # URDF
            node.set("filename", str(self._files.find(node.get("filename", ""), base, "<mesh>")))
        elif node.tag == "mesh" and node.find("uri") is not None:  # SDF
            uri = node.find("uri")
            assert uri is not None
            uri.text = str(self._files.find((uri.text or "").strip(), base, "<mesh><uri>"))
        elif node.tag == "material":
            self._find_texture(node, base)

    def _find_texture(self, material: Element, base: Path) -> None:
        """Leaves a material the texture that is an image of the model's, or none."""
        for given in material.findall("texture"):  # URDF
            if given.get("filename") is not None:
                path = self._image(given.get("filename", ""), base, "<texture>")
                given.set("filename", str(path))
                if path is None:
                    material.remove(given)
                    if material.find("color") is None:
                        ElementTree.SubElement(material, "color", {"rgba": "0.6 0.6 0.6 1"})
        maps = [material.find(f"{_DRAKE}diffuse_map"), material.find("./pbr/metal/albedo_map")]
        for old in material.findall(f"{_DRAKE}diffuse_map") + material.findall("pbr"):
            material.remove(old)
        for texture in maps:
            if texture is not None and texture.text:
                path = self._image(texture.text.strip(), base, "<material>")
                if path is not None:
                    ElementTree.SubElement(material, f"{_DRAKE}diffuse_map").text = str(path)
                return

    def _image(self, uri: str, base: Path, element: str) -> Path | None:
        """The image that a URI names; None, and a word about it, where there is none to be had."""
        try:
            path = self._files.find(uri, base, element)
        except ValueError as error:
            self._warn(f"{str(error).removeprefix(f'{self._source}: ')}; left out")
            return None
        if not is_image(path):
            self._warn(f"{element} '{uri}': is not an image; left out")
            return None
        return path

    def _repair_geometry(self, link: Element) -> None:
        for kind in ("visual", "collision"):
            for shape in link.findall(kind):
                geometry = shape.find("geometry")
                if geometry is None or not len(geometry):
                    link.remove(shape)
                elif geometry[0].tag not in _SHAPES and geometry.find("mesh") is None:
                    self._note(f"<{geometry[0].tag}> left out", link)
                    link.remove(shape)
        if not link.findall("collision") and link.findall("visual"):
            self._note("no collision geometry, so what is seen is touched", link)
            for visual in link.findall("visual"):
                shape = copy.deepcopy(visual)
                shape.tag = "collision"
                if shape.get("name"):
                    shape.set("name", f"collision_{shape.get('name')}")
                for material in shape.findall("material"):
                    shape.remove(material)
                link.append(shape)

    def _convert_mesh(self, link: Element, shape: Element) -> None:
        mesh = shape.find("geometry/mesh")
        if mesh is None:
            return
        files = self._converted(self._mesh_key(mesh), shape.tag == "visual")
        place = list(link).index(shape)
        link.remove(shape)
        for number, file in enumerate(files):
            part = copy.deepcopy(shape)
            if part.get("name") and number:
                part.set("name", f"{part.get('name')}_{number}")
            element = part.find("geometry/mesh")
            assert element is not None
            element.clear()
            if mesh.get("filename") is not None:
                element.set("filename", str(file))
            else:
                ElementTree.SubElement(element, "uri").text = str(file)
            link.insert(place + number, part)

    def _mesh_key(self, mesh: Element) -> tuple[Path, tuple[float, ...]]:
        """File and scale of a <mesh>."""
        path = Path(mesh.get("filename") or mesh.findtext("uri") or "")
        text = mesh.get("scale") or mesh.findtext("scale") or "1 1 1"
        scale = self._numbers(text, (1, 3), f"<mesh> {path.name}: scale")
        return path, tuple(np.broadcast_to(scale, 3).tolist())

    def _read_meshes(self, root: Element) -> None:
        """Reads all meshes; those of a scale at which one is huge were meant in millimetres."""
        for geometry in root.iter("geometry"):
            mesh = geometry.find("mesh")
            if mesh is not None:
                path, scale = self._mesh_key(mesh)
                if (path, scale) not in self._surfaces:
                    self._surfaces[path, scale] = read_surfaces(
                        path, np.array(scale), MeshFiles(self._files, path.parent)
                    )
        sizes = {key: extent(surfaces) for key, surfaces in self._surfaces.items()}
        for scale in {scale for (_, scale), size in sizes.items() if size > LARGEST}:
            alike = {path: size for (path, other), size in sizes.items() if other == scale}
            path = max(alike, key=lambda path: alike[path])
            self._warn(
                f"{path.name}: {alike[path]:.0f} m large, so meshes of its scale are read as"
                " millimetres; say so by a <scale> of 0.001"
            )
            for path in alike:
                for surface in self._surfaces[path, scale]:
                    surface.mesh.apply_scale(0.001)

    def _converted(self, mesh: tuple[Path, tuple[float, ...]], is_visual: bool) -> list[Path]:
        path, key = mesh[0], (mesh, is_visual)
        if key not in self._written:
            surfaces = self._surfaces[mesh]
            faces = sum(len(surface.mesh.faces) for surface in surfaces)
            if not is_visual and faces > MANY_FACES:
                self._warn(
                    f"{path.name}: contact with {faces} triangles is slow;"
                    " give the link a simpler <collision>"
                )
            self._folder.mkdir(parents=True, exist_ok=True)
            stem = re.sub(r"\W", "_", path.stem)
            stem += f"_{len(self._written)}_{'visual' if is_visual else 'contact'}"
            files = self._written[key] = []
            for number, surface in enumerate(surfaces if is_visual else [merged(surfaces)]):
                files.append(self._folder / f"{stem}_{number}.obj")
                (write_obj if is_visual else write_contact_obj)(surface, files[-1])
        return self._written[key]

    def _repair_friction(self, link: Element) -> None:
        """SDF's default mu2 is 1, and Drake refuses a dynamic friction above the static one."""
        for ode in link.iter("ode"):
            mu = ode.findtext("mu")
            if mu is None:
                continue
            for old in ode.findall("mu2"):
                mu = str(min(float(mu), float(old.text or mu)))
                ode.remove(old)
            for name in ("mu", "mu2"):
                for old in ode.findall(name):
                    ode.remove(old)
                ElementTree.SubElement(ode, name).text = mu

    def _repair_inertia(self, link: Element, model: ModelSource) -> None:
        name, inertial = link.get("name", ""), link.find("inertial")
        if inertial is None:
            model.masses[name] = None
            if link.findall("visual") or link.findall("collision"):
                self._note("no inertia, so that of the geometry", link)
            return
        mass, inertia = _inertia(inertial)
        if inertia is not None and mass is not None and _is_physical(mass, inertia):
            return
        link.remove(inertial)
        usable = mass is not None and np.isfinite(mass) and mass > 0
        model.masses[name] = mass if usable else None
        what = "inertia" if usable else "mass"
        self._note(f"{what} that no body can have, so that of the geometry", link)

    def _note_mimic(self, joint: Element, model: ModelSource) -> None:
        for parent in (joint, *joint.findall("axis")):
            for mimic in parent.findall("mimic"):
                parent.remove(mimic)
                values = {
                    key: self._number(mimic.get(key) or mimic.findtext(key), joint, usual)
                    for key, usual in (("multiplier", 1.0), ("offset", 0.0))
                }
                leader = mimic.get("joint", "")
                model.mimics[joint.get("name", "")] = Mimic(leader=leader, **values)

    def _repair_limits(self, joint: Element) -> None:
        """URDF knows no infinite limits, so none is given instead."""
        for limit in joint.findall("limit"):
            for key in ("lower", "upper"):
                value = self._number(limit.get(key), joint, np.inf)
                if key in limit.attrib and not np.isfinite(value):
                    del limit.attrib[key]

    def _number(self, text: str | None, joint: Element, usual: float) -> float:
        try:
            return usual if text is None else float(text)
        except ValueError:
            raise ValueError(
                f"{self._source}: joint '{joint.get('name')}': '{text}' must be a number"
            ) from None

    def _numbers(self, text: str, counts: tuple[int, ...], what: str) -> Array:
        try:
            values = np.array(text.split(), dtype=float)
        except ValueError:
            values = np.zeros(0)
        if len(values) not in counts or not np.all(np.isfinite(values)) or np.any(values == 0):
            raise ValueError(f"{self._source}: {what} = '{text}', but it must be numbers, not zero")
        return values


def _inertia(inertial: Element) -> tuple[float | None, Array | None]:
    """Mass and inertia matrix (3, 3) of an <inertial>, each None where it is not given."""

    def number(element: Element | None, key: str) -> float | None:
        text = None
        if element is not None:
            text = element.get("value") if key == "value" else element.get(key)
            text = text or (element.text if key == "value" else element.findtext(key))
        try:
            return None if text is None else float(text)
        except ValueError:
            return None

    mass = number(inertial.find("mass"), "value")
    inertia = inertial.find("inertia")
    diagonal = [number(inertia, key) for key in ("ixx", "iyy", "izz")]
    if inertia is None or any(value is None for value in diagonal):
        return mass, None
    xy, xz, yz = (number(inertia, key) or 0.0 for key in ("ixy", "ixz", "iyz"))
    xx, yy, zz = diagonal
    return mass, np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], dtype=float)


def _is_physical(mass: float, inertia: Array) -> bool:
    if not (np.isfinite(mass) and mass > 0 and np.all(np.isfinite(inertia))):
        return False
    moments = np.linalg.eigvalsh(inertia)
    return bool(moments[0] > 0 and moments[0] + moments[1] >= (1 - 1e-6) * moments[2])
