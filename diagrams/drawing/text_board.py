"""Boards with text or a picture as objects for Meshcat, which has none of its own."""

from functools import lru_cache
from pathlib import Path

import matplotlib
import trimesh
from PIL import Image, ImageDraw, ImageFont
from pydrake.common import MemoryFile
from pydrake.geometry import InMemoryMesh, Mesh
from trimesh.exchange.gltf import export_gltf
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

_PIXELS = 96  # Height of the texture.


@lru_cache(maxsize=1)
def font() -> ImageFont.FreeTypeFont:
    """The typeface that Matplotlib brings along."""
    path = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans-Bold.ttf"
    return ImageFont.truetype(str(path), round(0.62 * _PIXELS))


@lru_cache(maxsize=256)
def text_board(text: str, height: float, color: tuple[int, int, int]) -> Mesh:
    """A board in the x-z plane, seen from -y, with white text on a colour.

    Args:
        height: Of the board, [m]; its width follows from the text.
        color: Red, green and blue, 0 to 255.
    """
    texture = _texture(text, color)
    width = height * texture.width / texture.height
    return picture_board(texture, width, height, text)


def picture_board(texture: Image.Image, width: float, height: float, name: str) -> Mesh:
    """A board in the x-z plane, seen from -y, with a picture on it that shines by itself.

    Args:
        width: Of the board, [m].
        height: Of the board, [m].
    """
    x, y = 0.5 * width, 0.5 * height
    material = PBRMaterial(
        baseColorFactor=[0.0, 0.0, 0.0, 1.0],  # Only what it shines: its colours stay as they are.
        emissiveTexture=texture,
        emissiveFactor=[1.0, 1.0, 1.0],
        metallicFactor=0.0,
        roughnessFactor=1.0,
        doubleSided=True,
    )
    board = trimesh.Trimesh(
        vertices=[(-x, -y, 0.0), (x, -y, 0.0), (x, y, 0.0), (-x, y, 0.0)],
        faces=[(0, 1, 2), (0, 2, 3)],
        visual=TextureVisuals(uv=[(0, 0), (1, 0), (1, 1), (0, 1)], material=material),
        process=False,
    )
    return in_memory(board, name)


def in_memory(surface: trimesh.Trimesh, name: str) -> Mesh:
    """A surface as glTF with everything embedded; glTF's y is up, Drake turns it to z."""
    files = export_gltf(trimesh.Scene(surface), embed_buffers=True)
    text = str(files["model.gltf"].decode())
    return Mesh(InMemoryMesh(mesh_file=MemoryFile(text, ".gltf", name)))


def _texture(text: str, color: tuple[int, int, int]) -> Image.Image:
    width = round(font().getlength(text)) + _PIXELS // 2
    image = Image.new("RGB", (width, _PIXELS), color)
    ImageDraw.Draw(image).text(
        (width / 2, _PIXELS / 2), text, font=font(), fill="white", anchor="mm"
    )
    return image
