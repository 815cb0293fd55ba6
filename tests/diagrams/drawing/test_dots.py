import re
from base64 import b64decode

import numpy as np
from pydrake.geometry import Rgba

from crossmodal.diagrams.drawing.dots import set_dots
from crossmodal.diagrams.drawing.meshcat import start_meshcat

FRONT, BACK = 0, 1  # Of faces, as three.js numbers them.


def test_only_the_far_side_of_an_outline_is_drawn() -> None:
    meshcat = start_meshcat()
    set_dots(meshcat, "/points", np.array([[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]), 0.01, Rgba(1, 1, 0))
    encoded = re.findall(r'"data:application/octet-binary;base64,([^"]+)"', meshcat.StaticHtml())
    objects = [message for message in map(b64decode, encoded) if b"set_object" in message]
    for path, side in (("/points/dots", FRONT), ("/points/outline", BACK)):
        (message,) = (one for one in objects if path.encode() in one)
        assert b"\xa4side" + bytes([side]) in message
