import numpy as np
from matplotlib.axes import Axes

from crossmodal.diagrams.drawing import palette
from crossmodal.diagrams.drawing.plot_style import (
    mark_leaving,
    mark_panels,
    mark_times,
    new_figure,
)
from crossmodal.diagrams.run.scenario import Interval
from crossmodal.maths.arrays import Array

TIMES = np.arange(0.0, 10.0, 0.1)


def drawn(values: Array) -> Axes:
    axes = new_figure(4.0, 3.0).subplots()
    axes.plot(TIMES, values, color="#AA3377")
    axes.set_xlim(0.0, 10.0)
    axes.set_ylim(-1.0, 1.0)
    return axes


def triangles(axes: Axes) -> dict[str, list[float]]:
    """Where the triangles are, [s], by their form."""
    return {
        str(line.get_marker()): np.round(np.asarray(line.get_xdata(), float), 6).tolist()
        for line in axes.lines[1:]
    }


def test_a_curve_has_a_triangle_where_it_leaves_the_frame_and_where_it_returns() -> None:
    axes = drawn(np.where((TIMES > 2.05) & (TIMES < 4.05), 7.0, np.where(TIMES > 7.95, -3.0, 0.0)))
    (entry,) = mark_leaving(axes)
    assert entry.get_label() == "beyond the frame"
    assert triangles(axes) == {"^": [2.1, 4.0], "v": [8.0, 9.9]}
    assert {line.get_markerfacecolor() for line in axes.lines[1:]} == {"#AA3377"}


def test_a_curve_within_the_frame_has_none() -> None:
    axes = drawn(np.where(TIMES < 3.0, np.nan, 0.5))
    assert mark_leaving(axes) == []
    assert triangles(axes) == {}


def test_a_curve_that_becomes_infinite_has_left_but_one_that_begins_so_has_not() -> None:
    axes = drawn(np.where((TIMES < 3.0) | (TIMES > 5.95), np.inf, 0.5))
    mark_leaving(axes)
    assert triangles(axes) == {"^": [6.0, 9.9]}


def test_excursions_in_quick_succession_are_marked_once() -> None:
    axes = drawn(np.where(np.isclose(TIMES, 5.0) | np.isclose(TIMES, 5.1), 2.0, 0.0))
    mark_leaving(axes)
    assert triangles(axes) == {"^": [5.0]}


def test_what_lies_outside_the_time_shown_is_not_marked() -> None:
    axes = drawn(np.where(TIMES < 3.0, 2.0, 0.0))
    axes.set_xlim(4.0, 10.0)
    assert mark_leaving(axes) == []


def test_events_close_together_are_written_below_each_other() -> None:
    axes = drawn(0.0 * TIMES)
    mark_times(
        axes,
        [("b", 2.2), ("a", 2.0), ("late", 12.0)],
        [("dark", Interval(start=5.0, end=99.0))],
        label=True,
    )
    heights = {text.get_text(): text.get_position()[1] for text in axes.texts}
    assert set(heights) == {"a", "b", "dark"}
    assert heights["b"] < heights["a"]
    assert axes.get_xlim() == (0.0, 10.0)


def test_a_dotted_curve_has_hollow_triangles() -> None:
    axes = drawn(np.where(TIMES < 3.0, 2.0, 0.0))
    axes.lines[0].set_linestyle(":")
    mark_leaving(axes)
    (mark,) = axes.lines[1:]
    assert (mark.get_markerfacecolor(), mark.get_markeredgecolor()) == ("white", "#AA3377")


def test_the_legend_tells_hollow_triangles_from_filled_ones_and_names_each_kind_once() -> None:
    panels = [drawn(np.where(TIMES < 3.0, 2.0, 0.0)) for _ in range(2)]
    for axes in panels:
        axes.plot(TIMES, np.where(TIMES > 5.0, -2.0, 0.0), color="#AA3377", ls=":")
    entries = mark_panels(panels, [], [])
    assert [(entry.get_label(), entry.get_markerfacecolor()) for entry in entries] == [
        ("beyond the frame", palette.QUIET),
        ("dotted curve beyond the frame", "white"),
    ]
