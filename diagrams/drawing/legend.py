"""A legend that stays in the corner of Meshcat's view, live and in a page."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from PIL import Image, ImageDraw
from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform, RotationMatrix

from crossmodal.diagrams.drawing.text_board import font, picture_board

_PATH = "/Cameras/default/rotated/<object>/legend"  # What lies below the camera moves with it.
_DISTANCE = 0.6  # In front of the camera, [m].
_LINE = 0.022  # Height of a line, [m].
_CORNER = (-0.53, -0.43)  # The board's lower left one: right of and above the camera's axis, [m].
_PIXELS = 44  # Height of a line.
_BACKGROUND, _INK = "#F6F6F4", "#202020"

Entry = tuple[Literal["dot", "bar", "line"], str, str]  # Form, colour '#RRGGBB' and what it is.


def show_legend(meshcat: Meshcat, title: str, entries: Sequence[Entry]) -> None:
    """Puts a legend into the lower left corner of the view, in place of an earlier one.

    Args:
        title: A line above the entries.
    """
    image = legend_image(title, entries)
    height = _LINE * image.height / _PIXELS
    width = height * image.width / image.height
    # The camera looks along -z, its y is up; a board is seen from its -y, its z is up.
    X_CB = RigidTransform(
        RotationMatrix.MakeXRotation(-0.5 * np.pi),
        [_CORNER[0] + 0.5 * width, _CORNER[1] + 0.5 * height, -_DISTANCE],
    )
    meshcat.SetObject(_PATH, picture_board(image, width, height, "legend"))
    meshcat.SetTransform(_PATH, X_CB)


def legend_image(title: str, entries: Sequence[Entry]) -> Image.Image:
    """The legend as a picture, a line for the title and one for each entry."""
    letters = font().font_variant(size=round(0.6 * _PIXELS))
    texts = [(0.4 * _PIXELS, title), *((1.7 * _PIXELS, text) for _, _, text in entries)]
    width = max(left + letters.getlength(text) for left, text in texts) + 0.5 * _PIXELS
    image = Image.new("RGB", (round(width), round((len(texts) + 0.3) * _PIXELS)), _BACKGROUND)
    draw = ImageDraw.Draw(image)
    for line, (left, text) in enumerate(texts):
        y = (line + 0.65) * _PIXELS
        draw.text((left, y), text, font=letters, fill=_INK, anchor="lm")
        if line > 0:
            form, color, _ = entries[line - 1]
            _draw_form(draw, form, color, 0.95 * _PIXELS, y)
    return image


def _draw_form(draw: ImageDraw.ImageDraw, form: str, color: str, x: float, y: float) -> None:
    half = 0.5 * _PIXELS
    if form == "dot":
        r = 0.5 * half
        draw.ellipse((x - r, y - r, x + r, y + r), fill=color, outline=_INK, width=5)
    else:
        r = 0.3 * half if form == "bar" else 0.12 * half
        draw.rectangle((x - half, y - r, x + half, y + r), fill=color)
