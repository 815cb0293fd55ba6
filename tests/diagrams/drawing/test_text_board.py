import json

import numpy as np
from numpy.testing import assert_allclose

from crossmodal.diagrams.drawing.text_board import text_board


def test_a_text_board_is_as_wide_as_its_text() -> None:
    def width(text: str) -> float:
        file = text_board(text, 0.05, (10, 120, 40)).source().in_memory().mesh_file
        accessors = json.loads(file.contents())["accessors"]
        (positions,) = (one for one in accessors if one["type"] == "VEC3")
        size = np.subtract(positions["max"], positions["min"])
        assert_allclose(size[1], 0.05)
        return float(size[0])

    assert 2.0 * width("q") < width("q = 12.3 ± 0.1 cm") < 1.0
