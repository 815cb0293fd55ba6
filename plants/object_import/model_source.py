"""Reads SDF or URDF as found in the wild and repairs what Drake's parser does not take."""

import copy
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
from scipy import stats

from crossmodal.maths.arrays import Array
from crossmodal.maths.git_lfs import STANDS_FOR_ANOTHER, is_lfs_pointer
from crossmodal.plants.object_import.meshes import (
    MANY_FACES,
    EmptyMeshError,
    Surface,
    Warn,
    extent,
    merged,
    read_surfaces,
    write_contact_obj,
    write_obj,
)
from crossmodal.plants.object_import.model_files import (
    MeshFiles,
    MissingFileError,
    ModelFiles,
    is_image,
)
from crossmodal.plants.object_import.scaling import LENGTHS, scale_lengths
from crossmodal.plants.object_import.sides import with_sides_apart
from crossmodal.plants.object_import.text import decoded

_MODEL_TYPES = {"robot": "URDF", "sdf": "SDF"}
_DECLARATION = re.compile(r"<\?xml\s[^>]*\?>")
_ENCODING = re.compile(rb"<\?xml\s[^>]*?encoding\s*=\s*[\"']?([\w.-]+)")
_DEEPEST = 200  # Elements within each other.
_MOST_INCLUDES = 1000  # Of other files.
_GREY = "0.6 0.6 0.6 1"
_UNLIMITED = ("fixed", "continuous", "floating", "ball")  # Joints that have no limits.
_SUSPICIOUS = 10.0  # Smaller meshes are in metres, [m].
_PLACED = ("link", "joint", "visual", "collision")  # Not models, which stand anywhere in a world.
_USUAL = 0.5  # Size of an object of which nothing else is known, [m].
_SCENERY = ("sun", "ground_plane")  # Gazebo's own, in most of its worlds.
_EXPRESSION = re.compile(r"\$\{|\$\((find|arg|env|optenv|eval|dirname)\b")  # Of xacro.
_MeshKey = tuple[Path, tuple[float, ...], bool]  # See `Repair._mesh_key`.
ElementTree.register_namespace("drake", "drake.mit.edu")
_DRAKE = "{drake.mit.edu}"
_LARGEST = 1e6  # Size of a shape, [m].


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
    """

    root: Element
    suffix: str
    masses: dict[str, float | None] = field(default_factory=dict)
    mimics: dict[str, Mimic] = field(default_factory=dict)


def read_model(path: Path) -> ModelSource:
    """The model in a file, as it stands.

    Raises:
        ValueError: in one line, if the file is neither SDF nor URDF.
    """
    if not os.path.isfile(path):
        what = "is no file" if os.path.exists(path) else "there is no such file"
        raise ValueError(f"{path}: {what}")
    try:
        if is_lfs_pointer(path):
            raise ValueError(f"{path}: {STANDS_FOR_ANOTHER}")
        root = ElementTree.fromstring(_with_known_prefixes(_text(path.read_bytes())))
    except OSError as error:
        raise ValueError(f"{path}: cannot be read as SDF or URDF: {error}") from None
    except ElementTree.ParseError as error:
        raise ValueError(f"{path}: is not valid XML: {error}") from None
    _check_depth(root, path)
    if _is_xacro(root):
        raise ValueError(
            f"{path}: is a xacro file; expand it first: xacro {path.name} > model.urdf"
        )
    if root.tag not in _MODEL_TYPES:
        raise ValueError(f"{path}: <{root.tag}> is neither SDF (<sdf>) nor URDF (<robot>)")
    suffix = f".{_MODEL_TYPES[root.tag].lower()}"
    return ModelSource(root=root, suffix=suffix)


def _is_xacro(root: Element) -> bool:
    """Whether something is left for xacro to expand; many files only declare its namespace."""
    for element in root.iter():
        if "xacro}" in str(element.tag) or any("xacro}" in key for key in element.attrib):
            return True
        if any(_EXPRESSION.search(text or "") for text in (element.text, *element.attrib.values())):
            return True
    return False


def _text(content: bytes) -> str:
    """XML without its declaration, which many files have in the wrong place or unquoted."""
    said = _ENCODING.search(content[:1000])
    return _DECLARATION.sub("", decoded(content, said[1].decode() if said else ""), count=1)


def _check_depth(root: Element, path: Path) -> None:
    elements, depth = [root], 0
    while elements:
        depth += 1
        if depth > _DEEPEST:
            raise ValueError(f"{path}: more than {_DEEPEST} elements stand within each other")
        elements = [child for element in elements for child in element]


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
        self._files = ModelFiles(source, warn)
        self._included_files = 0
        self._missing: list[str] = []  # Meshes that there are not, or that hold nothing.
        self._links: dict[str, dict[str, None]] = {}  # Links by the note about them.
        self._surfaces: dict[_MeshKey, list[Surface]] = {}
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
        defined = self._defined_materials(root)
        for link in root.iter("link"):
            self._leave_out(link)
            self._touch_what_is_seen(link)
        self._repair_materials(root, defined)
        shapes = [s for link in root.iter("link") for s in link if s.tag in ("visual", "collision")]
        if self._missing and not shapes:
            raise ValueError(self._missing[0])
        self._guess_unit(root)
        for link in root.iter("link"):
            for shape in link.findall("visual") + link.findall("collision"):
                self._convert_mesh(link, shape)
            self._repair_friction(link)
            self._repair_inertia(link, model)
        for joint in root.iter("joint"):
            self._repair_limits(joint)
            self._note_mimic(joint, model)
        self._free_followers(model)
        for what, links in self._links.items():
            self._warn(f"{what}: {', '.join(links)}")

    def _note(self, what: str, link: Element) -> None:
        """Notes something about a link, once for all links of which it is true."""
        self._links.setdefault(what, {})[link.get("name", "")] = None

    def _expand_includes(self, element: Element, within: tuple[Path, ...]) -> None:
        """Puts included models into the file, and makes the names of all files absolute.

        Args:
            within: The files that include each other down to this element, the last its own.
        """
        base = within[-1].parent
        for node in list(element.iter()):
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
        self._included_files += 1
        if self._included_files > _MOST_INCLUDES:
            raise ValueError(f"{self._source}: includes more than {_MOST_INCLUDES} files")
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
        if node.tag == "mesh":
            uri = node.find("uri")  # SDF, else URDF.
            text = node.get("filename") if uri is None else (uri.text or "").strip()
            element = "<mesh>" if uri is None else "<mesh><uri>"
            if text is None:
                return
            try:
                text = str(self._files.find(text, base, element))
            except MissingFileError as error:
                self._missing.append(str(error))
                node.set("missing", text)
            if uri is None:
                node.set("filename", text)
            else:
                uri.text = text
        elif node.tag == "material":
            self._find_texture(node, base)

    def _defined_materials(self, root: Element) -> dict[str | None, Element]:
        """Those of a URDF that have a look, by their names; wherever it stands."""
        found: dict[str | None, Element] = {}
        for material in root.iter("material") if root.tag == "robot" else ():
            if len(material):
                found.setdefault(material.get("name"), material)
        return found

    def _repair_materials(self, root: Element, defined: Mapping[str | None, Element]) -> None:
        """Gives each visual of a URDF its material's look; grey, where there is none."""
        for visual in root.iter("visual") if root.tag == "robot" else ():
            for material in visual.findall("material"):
                name = material.get("name")
                if not len(material) and name in defined:
                    material.extend(copy.deepcopy(list(defined[name])))
                elif not len(material):
                    self._warn(f"material '{name}' is defined nowhere, so it is grey")
                    ElementTree.SubElement(material, "color", {"rgba": _GREY})

    def _find_texture(self, material: Element, base: Path) -> None:
        """Leaves a material the texture that is an image of the model's, or none."""
        for given in material.findall("texture"):  # URDF
            if given.get("filename") is not None:
                path = self._image(given.get("filename", ""), base, "<texture>")
                given.set("filename", str(path))
                if path is None:
                    material.remove(given)
                    if material.find("color") is None:
                        ElementTree.SubElement(material, "color", {"rgba": _GREY})
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

    def _leave_out(self, link: Element) -> None:
        """Removes shapes that nothing can be made of, and reads the meshes of the others."""
        for shape in link.findall("visual") + link.findall("collision"):
            geometry = shape.find("geometry")
            kind = None if geometry is None or not len(geometry) else geometry[0]
            mesh = None if geometry is None else geometry.find("mesh")
            why = ""
            if mesh is not None:
                why = self._mesh_is_unusable(mesh)
            elif kind is None:
                link.remove(shape)
            elif kind.tag not in LENGTHS:
                why = f"<{kind.tag}> left out"
            elif not all(size > 0.0 for size in _sizes(kind)):
                why = f"<{kind.tag}> without an extent left out"
            if why:
                self._note(why, link)
                link.remove(shape)

    def _mesh_is_unusable(self, mesh: Element) -> str:
        """Why a <mesh> is left out; empty for one that was read."""
        if mesh.get("missing") is not None:
            return f"mesh '{mesh.get('missing')}', which there is not, left out"
        key = path, scale, _ = self._mesh_key(mesh)
        files = MeshFiles(self._files, path.parent, lambda line: self._warn(f"{path.name}: {line}"))
        try:
            if key not in self._surfaces:
                found = read_surfaces(path, np.array(scale), files, files.warn)
                self._surfaces[key] = found
        except EmptyMeshError as error:
            self._missing.append(str(error))
            return f"mesh {path.name}, which holds no triangles, left out"
        return ""

    def _touch_what_is_seen(self, link: Element) -> None:
        """Gives a link without collision geometry that of its visual one."""
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

    def _mesh_key(self, mesh: Element) -> _MeshKey:
        """File and scale of a <mesh>, and whether its unit may be another than metres."""
        path = Path(mesh.get("filename") or mesh.findtext("uri") or "")
        text = mesh.get("scale") or mesh.findtext("scale")
        scale = self._numbers(text or "1 1 1", (1, 3), f"<mesh> {path.name}: scale")
        return path, tuple(np.broadcast_to(scale, 3).tolist()), text is None

    def _guess_unit(self, root: Element) -> None:
        """Takes meshes for millimetres that are so large beside the rest of the model.

        Most exporters write meshes in the unit of the drawing, and all else in metres. A mesh whose
        scale the file gives is as large as it says.
        """
        sizes = {
            key: extent(self._surfaces[key])
            for key in map(self._mesh_key, root.iter("mesh"))
            if key in self._surfaces and key[2]
        }
        if not sizes or max(sizes.values()) < _SUSPICIOUS:
            return
        others = _lengths_beside_meshes(root) or [_USUAL]
        # Either may be misled by a single thing, such as a wall.
        for typical in (max, stats.gmean):
            if typical([*sizes.values()]) / typical(others) < np.sqrt(1000.0):
                return
        largest = max(sizes, key=lambda key: sizes[key])
        self._warn(
            f"{largest[0].name}: {sizes[largest]:.0f} m large, so meshes without a <scale> are read"
            " as millimetres; give one of 0.001, or of 1"
        )
        for key in sizes:
            for surface in self._surfaces[key]:
                surface.mesh.apply_scale(0.001)

    def _converted(self, mesh: _MeshKey, is_visual: bool) -> list[Path]:
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
            surfaces = with_sides_apart(surfaces) if is_visual else [merged(surfaces)]
            for number, surface in enumerate(surfaces):
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
                multiplier, offset, reference = (
                    self._number(mimic.get(key) or mimic.findtext(key), joint, usual)
                    for key, usual in (("multiplier", 1.0), ("offset", 0.0), ("reference", 0.0))
                )
                model.mimics[joint.get("name", "")] = Mimic(
                    leader=mimic.get("joint", ""),
                    multiplier=multiplier,
                    offset=offset - multiplier * reference,
                )

    def _free_followers(self, model: ModelSource) -> None:
        """Frees joints that follow themselves, directly or by others."""
        for name in list(model.mimics):
            leaders = list[str]()
            while (leader := model.mimics.get(leaders[-1] if leaders else name)) is not None:
                if leader.leader in leaders:
                    break
                leaders.append(leader.leader)
            if name in leaders:
                del model.mimics[name]
                self._warn(f"joint '{name}' mimics itself; it is free")

    def _repair_limits(self, joint: Element) -> None:
        """URDF knows no infinite limits, so none is given instead. The copy has no motor."""
        if joint.get("type") in _UNLIMITED:
            for parent in (joint, *joint.findall("axis")):
                for limit in parent.findall("limit"):
                    parent.remove(limit)
        for limit in joint.iter("limit"):
            for key in ("effort", "velocity"):
                limit.attrib.pop(key, None)
                for given in limit.findall(key):
                    limit.remove(given)
            values = {}
            for key, usual in (("lower", -np.inf), ("upper", np.inf)):
                values[key] = self._number(limit.get(key) or limit.findtext(key), joint, usual)
                if key in limit.attrib and not np.isfinite(values[key]):
                    del limit.attrib[key]
            if values["lower"] > values["upper"]:
                self._warn(f"joint '{joint.get('name')}': lower limit above the upper, so swapped")
                for key, other in (("lower", "upper"), ("upper", "lower")):
                    node, value = limit.find(key), repr(values[other])
                    if node is None:
                        limit.set(key, value)
                    else:
                        node.text = value

    def _number(self, text: str | None, joint: Element, usual: float) -> float:
        try:
            value = usual if text is None else float(text)
        except ValueError:
            value = np.nan
        if np.isnan(value):
            raise ValueError(
                f"{self._source}: joint '{joint.get('name')}': '{text}' must be a number"
            )
        return value

    def _numbers(self, text: str, counts: tuple[int, ...], what: str) -> Array:
        try:
            values = np.array(text.split(), dtype=float)
        except ValueError:
            values = np.zeros(0)
        if len(values) not in counts or not np.all(np.isfinite(values)) or np.any(values == 0):
            raise ValueError(f"{self._source}: {what} = '{text}', but it must be numbers, not zero")
        return values


def _sizes(shape: Element) -> list[float]:
    """The sizes of a box, a cylinder and so on; those that are no numbers are left to the parser.

    NaN, infinity and what is larger than a thousand kilometres are no sizes.
    """
    sizes = list[float]()
    for key in LENGTHS[shape.tag]:
        text = shape.get(key) or shape.findtext(key) or ""
        try:
            sizes += [float(part) for part in text.split()]
        except ValueError:
            continue
    return [size if abs(size) <= _LARGEST else 0.0 for size in sizes]


def _lengths_beside_meshes(root: Element) -> list[float]:
    """Distances of places from each other and the shapes' longest edges, none of them zero."""
    lengths = list[float]()
    for node in root.iter():
        if node.tag in LENGTHS:
            lengths.append(max(_sizes(node), default=0.0))
        if node.tag not in _PLACED:
            continue
        for text in (node.findtext("pose"), *(each.get("xyz") for each in node.findall("origin"))):
            try:
                values = [float(part) for part in (text or "").split()[:3]]
            except ValueError:
                continue
            lengths.append(float(np.linalg.norm(values)))
    return [length for length in lengths if np.isfinite(length) and length > 1e-6]


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
