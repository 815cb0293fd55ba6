from pathlib import Path

import pytest
from chromium import opened_page

from crossmodal.diagrams.drawing.legend import (
    KEEPS_BOARDS,
    Entry,
    EventBoard,
    legend_image,
    show_legend,
)
from crossmodal.diagrams.drawing.meshcat import start_meshcat

ENTRIES: list[Entry] = [
    ("dot", "#FFCC22", "features of the held body"),
    ("bar", "#228833", "prismatic joint"),
    ("line", "#2255EE", "planned way"),
]


def test_every_entry_has_its_colour_in_a_line_of_its_own() -> None:
    image = legend_image("as believed", ENTRIES)
    places = {}
    for y in range(image.height):
        for x in range(image.width // 3):
            red, green, blue = image.getpixel((x, y))
            places.setdefault(f"#{red:02X}{green:02X}{blue:02X}", []).append(y)
    middles = [sum(places[color]) / len(places[color]) for _, color, _ in ENTRIES]
    line = image.height / (len(ENTRIES) + 1.3)
    assert [round(middle / line - 0.5) for middle in middles] == [1, 2, 3]


def test_the_legend_moves_with_the_camera() -> None:
    meshcat = start_meshcat()
    show_legend(meshcat, "as believed", ENTRIES)
    assert meshcat.HasPath("/Cameras/default/rotated/<object>/legend")


@pytest.mark.parametrize("width", [250, 390, 1200])
def test_in_any_window_the_boards_are_whole_and_readable(tmp_path: Path, width: int) -> None:
    meshcat = start_meshcat()
    show_legend(meshcat, "as believed", ENTRIES)
    EventBoard(meshcat).show(["door, seed 3", "  1.0 s  moving"])
    place = tmp_path / "meshcat.html"
    place.write_text(meshcat.StaticHtml() + KEEPS_BOARDS)
    corners = """() => {
      const { camera, scene_tree } = viewer;
      const held = scene_tree.find(["Cameras", "default", "rotated", "<object>"]).object;
      const found = [];
      held.updateWorldMatrix(true, true);
      held.traverse((board) => {
        if (!board.userData.first) return; // It has not been placed yet.
        board.traverse((one) => {
          const { min, max } = one.geometry?.boundingBox ?? {};
          for (const end of min ? [min, max] : []) {
            const { x, y } = one.localToWorld(end.clone()).project(camera);
            found.push([x, y]);
          }
        });
      });
      return found;
    }"""
    with opened_page(place.as_uri(), width=width) as page:
        page.wait_for_function(f"globalThis.viewer && ({corners})().length === 4")
        shown = page.evaluate(corners)
        height = page.evaluate("innerHeight")
    assert all(abs(x) <= 1.0 and abs(y) <= 1.0 for x, y in shown)
    lines = [abs(a[1] - b[1]) * height / 2 for a, b in (shown[:2], shown[2:])]
    assert min(lines) >= 2 * 18 or width < 300  # Two lines and more, of 18 pixels.
