import pandas as pd
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from crossmodal.diagrams.crossmodal.estimators import CROSSMODAL_CONNECTIONS
from crossmodal.diagrams.crossmodal.modalities import COLORS
from crossmodal.diagrams.drawing import palette
from crossmodal.diagrams.drawing.estimate_plots import draw_estimates, draw_probabilities
from crossmodal.diagrams.evaluation.estimates import estimates_table, scalar


@pytest.fixture
def table() -> pd.DataFrame:
    """Two estimators of an angle, of which one has seen nothing at first."""

    def rows(k: int, error: float) -> list:
        return [
            scalar("angle", 0.1 * k + error, std=0.01, true=0.1 * k),
            scalar("kind", 0.25, "door"),
            scalar("kind", 0.75, "drawer"),
        ]

    return estimates_table(
        {
            "left": [(float(k), rows(k, 0.01)) for k in range(5)],
            "right": [(float(k), rows(k, -0.02) if k > 2 else []) for k in range(5)],
        }
    )


def words(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.findobj(lambda a: hasattr(a, "get_text"))]


def test_estimates_are_drawn_with_the_truth_in_the_given_unit(table: pd.DataFrame) -> None:
    figure = draw_estimates(
        table,
        "angle",
        scale=1000.0,
        unit="mrad",
        labels={"left": "the left one"},
        colors={"left": "#AA0000"},
        shaded=[(2.0, 3.0), (9.0, 10.0)],
    )
    (axes,) = figure.axes
    left = axes.lines[0]
    assert to_hex(left.get_color()) == "#aa0000"
    assert left.get_ydata()[-1] == pytest.approx(410.0)
    assert {"the left one", "right", "[mrad]", "angle"} <= set(words(figure))
    dashed = [line for line in axes.lines if line.get_linestyle() == "--"]
    assert dashed[0].get_ydata()[-1] == pytest.approx(400.0)
    assert len(axes.patches) == 1  # The second shade begins after the end.


def test_an_estimator_without_a_colour_gets_one_that_no_other_has(table: pd.DataFrame) -> None:
    for taken in palette.OTHERS:
        (axes,) = draw_estimates(table, "angle", colors={"left": taken}).axes
        colors = {to_hex(line.get_color()) for line in axes.lines if line.get_linestyle() == "-"}
        assert len(colors) == 2


def test_the_networks_of_the_second_notebook_have_a_colour_each() -> None:
    names = [
        "proprioception",
        "crossmodal",
        *(f"without {wire}" for wire in CROSSMODAL_CONNECTIONS),
    ]
    colors = {palette.estimator_color(COLORS, name, k) for k, name in enumerate(names)}
    assert len(colors) == len(names)


def test_errors_are_drawn_without_the_truth(table: pd.DataFrame) -> None:
    (axes,) = draw_estimates(table, "angle", errors=True).axes
    assert axes.lines[0].get_ydata() == pytest.approx(0.01)
    assert all(line.get_linestyle() == "-" for line in axes.lines)


def test_a_tick_without_an_estimate_is_a_gap(table: pd.DataFrame) -> None:
    (axes,) = draw_estimates(table, "angle", errors=True).axes
    right = pd.Series(axes.lines[1].get_ydata())
    assert right.isna().tolist() == [True, True, True, False, False]


def test_an_unknown_quantity_lists_the_known_ones(table: pd.DataFrame) -> None:
    with pytest.raises(ValueError, match="no quantity 'angel'; there are angle, kind"):
        draw_estimates(table, "angel")


def test_probabilities_are_stacked_to_one_for_each_estimator(table: pd.DataFrame) -> None:
    figure = draw_probabilities(table, "kind", labels={"left": "the left one"}, shaded=[(1, 2)])
    assert [axes.get_title() or axes.get_title(loc="left") for axes in figure.axes] == [
        "the left one",
        "right",
    ]
    assert {"door", "drawer"} <= set(words(figure))
    top = figure.axes[0].collections[-1].get_paths()[0].vertices[:, 1].max()
    assert top == pytest.approx(1.0)


def test_the_legend_of_estimates_says_what_the_band_is(table: pd.DataFrame) -> None:
    (legend,) = draw_estimates(table, "angle").legends
    assert legend.get_title().get_text() == "band: 2σ as reported; n = 1 episode"
