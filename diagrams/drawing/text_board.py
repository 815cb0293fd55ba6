"""A line of text as an object for Meshcat, which has no text of its own."""

import base64
import io
import json
import struct
from functools import lru_cache
from pathlib import Path

import matplotlib
from PIL import Image, ImageDraw, ImageFont
from pydrake.common import MemoryFile
from pydrake.geometry import InMemoryMesh, Mesh

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
    positions = [(-x, -y, 0.0), (x, -y, 0.0), (x, y, 0.0), (-x, y, 0.0)]
    uv = [(0.0, 1.0), (1.0, 1.0), (1.0, 0.0), (0.0, 0.0)]
    data = b"".join(struct.pack("<3f", *p) for p in positions)
    data += b"".join(struct.pack("<2f", *p) for p in uv)
    data += struct.pack("<6H", 0, 1, 2, 0, 2, 3)
    png = io.BytesIO()
    texture.save(png, format="png")
    material = {
        "pbrMetallicRoughness": {
            "baseColorTexture": {"index": 0},
            "metallicFactor": 0.0,
            "roughnessFactor": 1.0,
        },
        "emissiveTexture": {"index": 0},
        "emissiveFactor": [0.6, 0.6, 0.6],
        "doubleSided": True,
    }
    return json.dumps(
        {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [
                {
                    "primitives": [
                        {
                            "attributes": {"POSITION": 0, "TEXCOORD_0": 1},
                            "indices": 2,
                            "material": 0,
                        }
                    ]
                }
            ],
            "materials": [material],
            "textures": [{"source": 0}],
            "images": [{"uri": _data_uri("image/png", png.getvalue())}],
            "buffers": [
                {"byteLength": len(data), "uri": _data_uri("application/octet-stream", data)}
            ],
            "bufferViews": [
                {"buffer": 0, "byteOffset": 0, "byteLength": 48},
                {"buffer": 0, "byteOffset": 48, "byteLength": 32},
                {"buffer": 0, "byteOffset": 80, "byteLength": 12},
            ],
            "accessors": [
                {
                    "bufferView": 0,
                    "componentType": 5126,
                    "count": 4,
                    "type": "VEC3",
                    "min": [-x, -y, 0.0],
                    "max": [x, y, 0.0],
                },
                {"bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC2"},
                {"bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR"},
            ],
        }
    )


def _data_uri(kind: str, data: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"
