"""A line of text as an object for Meshcat, which has no text of its own."""

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
def _font() -> ImageFont.FreeTypeFont:
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
    file = MemoryFile(_gltf(texture, width, height), ".gltf", text)
    return Mesh(InMemoryMesh(mesh_file=file))


def _texture(text: str, color: tuple[int, int, int]) -> Image.Image:
    width = round(_font().getlength(text)) + _PIXELS // 2
    image = Image.new("RGB", (width, _PIXELS), color)
    ImageDraw.Draw(image).text(
        (width / 2, _PIXELS / 2), text, font=_font(), fill="white", anchor="mm"
    )
    return image


def _gltf(texture: Image.Image, width: float, height: float) -> str:
    """A textured quad with everything embedded; glTF's y is up, Drake turns it to z."""
    x, y = 0.5 * width, 0.5 * height
    material = PBRMaterial(
        baseColorTexture=texture,
        metallicFactor=0.0,
        roughnessFactor=1.0,
        emissiveTexture=texture,
        emissiveFactor=[0.6, 0.6, 0.6],
        doubleSided=True,
    )
    board = trimesh.Trimesh(
        vertices=[(-x, -y, 0.0), (x, -y, 0.0), (x, y, 0.0), (-x, y, 0.0)],
        faces=[(0, 1, 2), (0, 2, 3)],
        visual=TextureVisuals(uv=[(0, 0), (1, 0), (1, 1), (0, 1)], material=material),
        process=False,
    )
    files = export_gltf(trimesh.Scene(board), embed_buffers=True)
    return str(files["model.gltf"].decode())
