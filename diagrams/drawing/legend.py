"""A legend and the newest events, which stay in corners of Meshcat's view, live and in a page."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from PIL import Image, ImageDraw
from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform, RotationMatrix

from crossmodal.diagrams.drawing.meshcat import Shown
from crossmodal.diagrams.drawing.text_board import font, picture_board

_CAMERA = "/Cameras/default/rotated/<object>"  # What lies below the camera moves with it.
_DISTANCE = 0.6  # In front of the camera, [m].
_LINE = 0.022  # Height of a line, [m].
# Of a board, right of and above the camera's axis, [m].
_LOWER_LEFT, _UPPER_LEFT = (-0.53, -0.43), (-0.53, 0.37)
_PIXELS = 44  # Height of a line.
_BACKGROUND, _INK = "#F6F6F4", "#202020"

# Of a page with a recording: fits the boards into any window. A live page has no place for it.
KEEPS_BOARDS = f"<script>{Path(__file__).with_name('boards.js').read_text()}</script>"

Entry = tuple[Literal["dot", "bar", "line"], str, str]  # Form, colour '#RRGGBB' and what it is.


def show_legend(meshcat: Meshcat, title: str, entries: Sequence[Entry]) -> None:
    """Puts a legend into the lower left corner of the view, in place of an earlier one.

    Args:
        title: A line above the entries.
    """
    _show_in_corner(meshcat, f"{_CAMERA}/legend", legend_image(title, entries), _LOWER_LEFT, 0.5)


class EventBoard:
    """Lines of text in the upper left corner of the view, live and in a page.

    A recording holds no new geometry, so that each text is an object of its own, which is shown
    from its time on.
    """

    def __init__(self, meshcat: Meshcat) -> None:
        self._meshcat, self._path = meshcat, f"{_CAMERA}/events"
        meshcat.Delete(self._path)
        self._lines: list[str] = []
        self._board, self._number = Shown(meshcat), 0

    def show(self, lines: Sequence[str], time: float = 0.0) -> None:
        """Shows the lines from a time [s] on in place of those before; does nothing without new."""
        if list(lines) == self._lines:
            return
        self._lines = list(lines)
        self._number += 1
        path = f"{self._path}/{self._number}"
        image = text_image([(0.4 * _PIXELS, line) for line in lines])
        _show_in_corner(self._meshcat, path, image, _UPPER_LEFT, -0.5)
        self._board.show(path, time)


def _show_in_corner(
    meshcat: Meshcat, path: str, image: Image.Image, corner: tuple[float, float], up: float
) -> None:
    """Puts a picture into a corner of the view.

    Args:
        corner: Of the picture on its left, right of and above the camera's axis, [m].
        up: Of the picture's middle above the corner, as a share of its height.
    """
    height = _LINE * image.height / _PIXELS
    width = height * image.width / image.height
    # The camera looks along -z, its y is up; a board is seen from its -y, its z is up.
    X_CB = RigidTransform(
        RotationMatrix.MakeXRotation(-0.5 * np.pi),
        [corner[0] + 0.5 * width, corner[1] + up * height, -_DISTANCE],
    )
    meshcat.SetObject(path, picture_board(image, width, height, path))
    meshcat.SetTransform(path, X_CB)


def text_image(texts: Sequence[tuple[float, str]]) -> Image.Image:
    """Lines of text, each so far from the left [px], as a picture."""
    letters = font().font_variant(size=round(0.6 * _PIXELS))
    width = max(left + letters.getlength(text) for left, text in texts) + 0.5 * _PIXELS
    image = Image.new("RGB", (round(width), round((len(texts) + 0.3) * _PIXELS)), _BACKGROUND)
    draw = ImageDraw.Draw(image)
    for line, (left, text) in enumerate(texts):
        draw.text((left, _middle(line)), text, font=letters, fill=_INK, anchor="lm")
    return image


def _middle(line: int) -> float:
    return (line + 0.65) * _PIXELS


def legend_image(title: str, entries: Sequence[Entry]) -> Image.Image:
    """The legend as a picture, a line for the title and one for each entry."""
    image = text_image([(0.4 * _PIXELS, title), *((1.7 * _PIXELS, text) for *_, text in entries)])
    draw = ImageDraw.Draw(image)
    for line, (form, color, _) in enumerate(entries, start=1):
        _draw_form(draw, form, color, 0.95 * _PIXELS, _middle(line))
    return image


def _draw_form(draw: ImageDraw.ImageDraw, form: str, color: str, x: float, y: float) -> None:
    half = 0.5 * _PIXELS
    if form == "dot":
        r = 0.5 * half
        draw.ellipse((x - r, y - r, x + r, y + r), fill=color, outline=_INK, width=5)
    else:
        r = 0.3 * half if form == "bar" else 0.12 * half
        draw.rectangle((x - half, y - r, x + half, y + r), fill=color)
