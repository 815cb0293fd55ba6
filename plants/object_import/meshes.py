"""Reads meshes of any common format and writes them as OBJ, which Drake renders and touches."""

import hashlib
import io
import json
import os
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

from crossmodal.maths.arrays import Array
from crossmodal.maths.git_lfs import STANDS_FOR_ANOTHER, is_lfs_pointer
from crossmodal.plants.object_import.model_files import MeshFiles
from crossmodal.plants.object_import.wavefront import LIBRARY, opacity, plain_obj

Warn = Callable[[str], None]

MANY_FACES = 20_000  # From here on contact with a mesh is slow.
_MOST_REPEATS = 64  # Of a texture within a mesh.
_LARGEST_IMAGE = 2048  # [pixels]
_CREASE = 0.6  # Edges sharper than this stay sharp in the shading, [rad].
# Extensions of glTF without which its geometry cannot be read.
_COMPRESSIONS = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_mesh_quantization")
_STL_HEAD, _STL_FACE = 84, 50  # Of binary ones, [bytes].
_STL_TEXT = 1000  # Others say "facet" in so many bytes.
# glTF is y-up by its standard; models here are z-up.
_X_FROM_Y_UP = trimesh.transformations.rotation_matrix(np.pi / 2, [1.0, 0.0, 0.0])


class EmptyMeshError(ValueError):
    """A mesh holds nothing that has an extent."""


@dataclass(kw_only=True)
class Surface:
    """A part of a mesh with one material.

    Attributes:
        mesh: In the frame of the link's geometry, [m].
        color: RGBA (4,) in [0, 1]; None where the file gives none.
        texture: A PIL image; None without.
    """

    mesh: trimesh.Trimesh
    color: Array | None
    texture: Image.Image | None


def read_surfaces(path: Path, scale: Array, files: MeshFiles, warn: Warn) -> list[Surface]:
    """The surfaces in a mesh file, one for each of its materials.

    Units that a COLLADA file declares are applied, its up-axis is not (as in ROS); glTF is turned
    from y-up to z-up (as in Drake).

    Args:
        scale: Along x, y and z (3,).
        files: Gives the materials and pictures that the mesh names.
        warn: Takes a line for what of the looks is left out.

    Raises:
        EmptyMeshError: in one line, if the file holds no triangles.
        ValueError: in one line, if it cannot be read.
    """
    try:
        scene = _loaded(path, files, warn)
    except EmptyMeshError:
        raise
    except Exception as error:  # Every loader of trimesh raises its own kinds.
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"{path}: cannot be read as a mesh: {reason}") from error
    placed: dict[object, list[trimesh.Trimesh]] = {}
    for node in scene.graph.nodes_geometry:
        X_SG, name = scene.graph[node]
        geometry = scene.geometry[name]
        if isinstance(geometry, trimesh.Trimesh) and len(geometry.faces):
            mesh = geometry.copy()
            mesh.apply_transform(X_SG)
            placed.setdefault(_material_key(mesh), []).append(mesh)
    if not placed:
        raise EmptyMeshError(f"{path}: holds no triangles")
    if scene.units is not None:
        scale = scale * trimesh.units.unit_conversion(scene.units, "meters")
    surfaces = []
    for meshes in placed.values():
        mesh = trimesh.util.concatenate(meshes) if len(meshes) > 1 else meshes[0]
        color, texture = _look(mesh)
        surfaces.append(Surface(mesh=mesh, color=color, texture=texture))
    for surface in surfaces:
        if path.suffix.lower() in (".glb", ".gltf"):
            surface.mesh.apply_transform(_X_FROM_Y_UP)
        surface.mesh.apply_transform(np.diag([*scale, 1.0]))
    if not 0 < extent(surfaces) < np.inf:
        raise EmptyMeshError(f"{path}: has no extent")
    return surfaces


def _loaded(path: Path, files: MeshFiles, warn: Warn) -> trimesh.Scene:
    """What trimesh reads of a file; refuses those of which it would read something else."""
    if not os.path.isfile(path):
        raise ValueError("is no file")
    if is_lfs_pointer(path):
        raise ValueError(STANDS_FOR_ANOTHER)
    suffix = path.suffix.lower()
    if suffix == ".obj":
        obj, library = plain_obj(path.read_bytes(), files.read, warn)
        files = files.with_made(LIBRARY, library)
        return trimesh.load_scene(io.BytesIO(obj), file_type="obj", resolver=files)
    content = path.read_bytes() if suffix in (".glb", ".gltf", ".stl") else b""
    if suffix in (".glb", ".gltf"):
        needed = str(_gltf_header(content).get("extensionsRequired"))
        for name in (name for name in _COMPRESSIONS if name in needed):
            raise ValueError(f"is compressed by {name}; export it without")
    elif suffix == ".stl" and b"facet" not in content[:_STL_TEXT].lower():
        if content.lstrip().lower().startswith(b"solid") and b"endsolid" in content.lower():
            raise EmptyMeshError(f"{path}: holds no triangles")
        count = struct.unpack("<I", content[80:_STL_HEAD])[0] if len(content) >= _STL_HEAD else 0
        whole = (len(content) - _STL_HEAD) // _STL_FACE
        if len(content) < _STL_HEAD or whole < count:
            raise ValueError(f"is cut off: {max(whole, 0)} of {count or 'its'} triangles are there")
    return trimesh.load_scene(path, resolver=files)


def _gltf_header(content: bytes) -> dict[str, object]:
    """The JSON of a glTF file, binary or not."""
    if content.startswith(b"glTF"):
        length = struct.unpack("<I", content[12:16])[0]
        content = content[20 : 20 + length]
    header = json.loads(content)
    if not isinstance(header, dict):
        raise ValueError("holds no glTF")
    return header


def extent(surfaces: list[Surface]) -> float:
    """The longest edge of the surfaces' bounding box, [m]."""
    bounds = np.array([surface.mesh.bounds for surface in surfaces])
    return float(np.max(bounds[:, 1].max(axis=0) - bounds[:, 0].min(axis=0)))


def _material_key(mesh: trimesh.Trimesh) -> object:
    material = getattr(mesh.visual, "material", None)
    if material is not None:
        return hash(material), opacity(getattr(material, "kwargs", {}))
    color, _ = _look(mesh)
    return None if color is None else tuple(color.round(3))


def _look(mesh: trimesh.Trimesh) -> tuple[Array | None, Image.Image | None]:
    """Colour and texture of a mesh."""
    visual = mesh.visual
    if visual.kind == "texture":
        material = visual.material
        if isinstance(material, trimesh.visual.material.PBRMaterial):
            material = material.to_simple()
        texture = material.image if visual.uv is not None else None
        if texture is not None:
            visual.uv, texture = _without_repeats(visual.uv, texture)
        color = np.asarray(material.main_color, dtype=float) / 255.0
        # Exporters do not agree on what Tr counts; nobody models what cannot be seen.
        color[3] *= opacity(material.kwargs) or 1.0
        return color, texture
    if visual.kind in ("face", "vertex"):
        colors = visual.face_colors if visual.kind == "face" else visual.vertex_colors
        return np.asarray(colors, dtype=float).mean(axis=0) / 255.0, None
    return None, None


def _without_repeats(uv: Array, image: Image.Image) -> tuple[Array, Image.Image]:
    """Texture coordinates within one image, which is laid side by side where they repeat it.

    Drake's renderer repeats no image on a mesh.
    """
    first = np.floor(uv.min(axis=0) + 1e-6)
    count = np.maximum(np.ceil(uv.max(axis=0) - 1e-6) - first, 1.0)
    if count.prod() > _MOST_REPEATS:
        return uv, image
    tiled = Image.fromarray(
        np.tile(np.asarray(image.convert("RGB")), (*count[::-1].astype(int), 1))
    )
    tiled.thumbnail((_LARGEST_IMAGE, _LARGEST_IMAGE))
    return (uv - first) / count, tiled


def write_png(image: Path, path: Path) -> None:
    """Writes the picture in a file, and nothing else that the file may hold."""
    with Image.open(image) as picture:
        transparent = picture.mode in ("RGBA", "LA", "PA") or "transparency" in picture.info
        plain = picture.convert("RGBA" if transparent else "RGB")
    plain.info.clear()
    plain.save(path)


def write_contact_obj(surface: Surface, path: Path) -> None:
    """Writes OBJ of shape alone, its triangles joined at their corners."""
    mesh = surface.mesh
    lines = _rows("v", mesh.vertices) + ["f {} {} {}".format(*face) for face in mesh.faces + 1]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def encloses_volume(path: Path) -> bool:
    """Whether the mesh in a file has an inside."""
    mesh = trimesh.load_mesh(path)
    return bool(mesh.is_watertight and mesh.volume > 0)


def write_obj(surface: Surface, path: Path) -> None:
    """Writes OBJ with normals; with MTL and PNG beside it where there is a colour or texture."""
    mesh = surface.mesh
    uv = getattr(mesh.visual, "uv", None)
    if uv is None and len(mesh.faces) < 200_000:
        mesh = trimesh.graph.smooth_shade(mesh, angle=_CREASE, facet_minarea=None)
    lines = []
    if surface.color is not None or surface.texture is not None:
        lines = [f"mtllib {path.stem}.mtl", "usemtl surface"]
        _write_mtl(surface, path)
    lines += _rows("v", mesh.vertices) + _rows("vn", mesh.vertex_normals)
    pattern = "{0}//{0}"
    if uv is not None:
        lines += _rows("vt", uv)
        pattern = "{0}/{0}/{0}"
    lines += ["f " + " ".join(pattern.format(i) for i in face) for face in mesh.faces + 1]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _write_mtl(surface: Surface, path: Path) -> None:
    color = np.ones(4) if surface.color is None else surface.color
    lines = ["newmtl surface", "Ks 0 0 0"]
    if surface.texture is not None:
        color = np.array([1.0, 1.0, 1.0, color[3]])
        lines.append(f"map_Kd {_write_picture(surface.texture, path.parent)}")
    lines.append("Kd " + " ".join(f"{value:.6g}" for value in color[:3]))
    lines.append(f"d {color[3]:.6g}")
    path.with_suffix(".mtl").write_text("\n".join(lines) + "\n", encoding="utf-8")


def opacity_in(path: Path) -> float:
    """Of the surface in an MTL file that `write_obj` has written, in [0, 1]."""
    rows = [line.split() for line in path.read_text(encoding="utf-8").splitlines()]
    return next((float(row[1]) for row in rows if row[:1] == ["d"]), 1.0)


def _write_picture(image: Image.Image, folder: Path) -> str:
    """Name of a picture's file, which surfaces with the same picture share."""
    plain = image.convert("RGB")
    content = f"{plain.size}".encode() + plain.tobytes()
    path = folder / f"{hashlib.sha256(content).hexdigest()[:16]}.png"
    if not path.exists():
        plain.save(path)
    return path.name


def _rows(kind: str, values: Array) -> list[str]:
    return [f"{kind} " + " ".join(f"{value:.9g}" for value in row) for row in np.asarray(values)]


def merged(surfaces: list[Surface]) -> Surface:
    """All surfaces as one, without looks, for contact."""
    meshes = [trimesh.Trimesh(s.mesh.vertices, s.mesh.faces) for s in surfaces]
    mesh = trimesh.util.concatenate(meshes) if len(meshes) > 1 else meshes[0]
    mesh.merge_vertices()
    if mesh.is_watertight and mesh.volume < 0:
        mesh.invert()  # Contact needs to know the inside.
    return Surface(mesh=mesh, color=None, texture=None)
