from crossmodal.diagrams.drawing.legend import Entry, legend_image, show_legend
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
