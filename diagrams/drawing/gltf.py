"""Surfaces made in memory as meshes that Meshcat shows, with their textures inside."""

import trimesh
from pydrake.common import MemoryFile
from pydrake.geometry import InMemoryMesh, Mesh
from trimesh.exchange.gltf import export_gltf


def in_memory(surface: trimesh.Trimesh, name: str) -> Mesh:
    """A surface as glTF with everything embedded; glTF's y is up, Drake turns it to z."""
    files = export_gltf(trimesh.Scene(surface), embed_buffers=True)
    text = str(files["model.gltf"].decode())
    return Mesh(InMemoryMesh(mesh_file=MemoryFile(text, ".gltf", name)))
