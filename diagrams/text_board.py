"""A line of text as an object for Meshcat, which has no text of its own."""

import base64
import json
import struct
from functools import lru_cache

import cv2
import numpy as np
from pydrake.common import MemoryFile
from pydrake.geometry import InMemoryMesh, Mesh

_FONT = cv2.FONT_HERSHEY_DUPLEX
_PIXELS = 44  # Height of the texture.
_MARGIN = 12


@lru_cache(maxsize=256)
def text_board(text: str, height: float, color: tuple[int, int, int]) -> Mesh:
    """A board in the x-z plane, seen from -y, with white text on a colour.

    Args:
        height: Of the board, [m]; its width follows from the text.
        color: Red, green and blue, 0 to 255.
    """
    texture = _texture(text, color)
    width = height * texture.shape[1] / texture.shape[0]
    file = MemoryFile(_gltf(texture, width, height), ".gltf", text)
    return Mesh(InMemoryMesh(mesh_file=file))


def _texture(text: str, color: tuple[int, int, int]) -> np.ndarray:
    (width, _), _ = cv2.getTextSize(text, _FONT, 1.0, 2)
    image = np.empty((_PIXELS, width + 2 * _MARGIN, 3), dtype=np.uint8)
    image[:] = color[::-1]
    cv2.putText(image, text, (_MARGIN, 33), _FONT, 1.0, (255, 255, 255), 2, cv2.LINE_AA)
    return image


def _gltf(texture: np.ndarray, width: float, height: float) -> str:
    """A textured quad with everything embedded; glTF's y is up, Drake turns it to z."""
    x, y = 0.5 * width, 0.5 * height
    positions = [(-x, -y, 0.0), (x, -y, 0.0), (x, y, 0.0), (-x, y, 0.0)]
    uv = [(0.0, 1.0), (1.0, 1.0), (1.0, 0.0), (0.0, 0.0)]
    data = b"".join(struct.pack("<3f", *p) for p in positions)
    data += b"".join(struct.pack("<2f", *p) for p in uv)
    data += struct.pack("<6H", 0, 1, 2, 0, 2, 3)
    ok, png = cv2.imencode(".png", texture)
    assert ok
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
            "images": [{"uri": _data_uri("image/png", png.tobytes())}],
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
