from typing import Any

import numpy as np
from matplotlib.colors import to_hex
from toy_application import TOY, toy_summary

from crossmodal.diagrams.evaluation.campaign_plots import (
    Panel,
    common_events,
    draw_metrics,
    draw_spreads,
    spread,
)
from crossmodal.diagrams.evaluation.metric_table import tidy_metrics
from crossmodal.diagrams.run.scenario import Disturbances, LightsOff

NAN = float("nan")


def test_what_is_missing_in_a_spread_counts_as_infinitely_large_or_as_said() -> None:
    series = [
        (np.array([0.0, 0.1, 0.2]), np.array([1.0, 2.0, NAN])),
        (np.array([0.1, 0.2]), np.array([4.0, NAN])),
        (np.array([0.1, 0.2]), np.array([6.0, 8.0])),
    ]
    times, (low, median, high) = spread(series, 0.1)
    np.testing.assert_allclose(times, [0.0, 0.1, 0.2])
    np.testing.assert_allclose(median, [np.inf, 4.0, np.inf])
    np.testing.assert_allclose(low[1:], [2.2, np.inf])
    np.testing.assert_allclose(high, [np.inf, 5.8, np.inf])
    _, (_, median, _) = spread(series, 0.1, missing=0.0)
    np.testing.assert_allclose(median, [0.0, 4.0, 0.0])


def test_the_spread_of_steady_episodes_does_not_jump_where_one_of_them_ends() -> None:
    series = [
        (0.1 * np.arange(length), np.full(length, value))
        for length, value in ((30, 1.0), (34, 9.0), (35, 2.0), (41, 3.0), (41, 4.0), (42, 50.0))
    ]
    times, quantiles = spread(series, 0.1)
    assert len(times) == 42
    np.testing.assert_allclose(quantiles, np.repeat(quantiles[:, :1], 42, axis=1))
    np.testing.assert_allclose(quantiles[1, -1], 3.5)


def test_the_legend_says_what_the_band_is_and_of_how_many_episodes() -> None:
    times = np.arange(0.0, 3.0, 0.1)
    left = [(times, np.full(30, value)) for value in (1.0, 2.0, NAN)]
    panel = Panel(title="error [mm]", series={"left": left, "right": left[:2]})
    figure = draw_spreads(TOY, [panel], 0.1, Disturbances(), {})
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == [
        "the left eye (n = 3)",
        "right (n = 2)",
    ]
    assert "band: 5 to 95 %" in legend.get_title().get_text()
    assert figure.axes[0].get_ylim()[1] < 10.0


def test_the_spread_of_nothing_is_empty() -> None:
    times, quantiles = spread([(np.zeros(0), np.zeros(0))], 0.1)
    assert len(times) == 0
    assert quantiles.shape == (3, 0)


def test_disturbances_and_events_are_marked_above_the_estimators_spreads() -> None:
    times = np.arange(0.0, 12.0, 0.1)
    series = {"left": [(times, 1.0 + 0.0 * times)], "right": []}
    panels = [
        Panel(title="error [mm]", series=series),
        Panel(title="share", series=series, logarithmic=False),
    ]
    disturbances = Disturbances(lights_off=[LightsOff(start=9.5)])
    figure = draw_spreads(TOY, panels, 0.1, disturbances, {"returning": 8.0, "never": 99.0})
    first, second = figure.axes
    assert first.get_title(loc="left") == "error [mm]"
    assert [text.get_text() for text in first.texts] == ["returning", "lights off"]
    assert any(np.allclose(line.get_xdata(), 9.5) for line in first.lines)
    assert (first.get_yscale(), second.get_yscale()) == ("log", "linear")
    (label,) = {text.get_text() for text in figure.legends[0].get_texts()}
    assert label == "the left eye (n = 1)"
    assert to_hex(first.lines[0].get_color()) == TOY.colors["left"].lower()


def test_events_are_marked_where_half_of_the_episodes_have_them() -> None:
    def summary(**times: float) -> dict[str, Any]:
        return {"events": [{"name": name, "time": time} for name, time in times.items()]}

    twice = {"events": [{"name": "exploring", "time": time} for time in (5.0, 9.0)]}
    assert common_events([summary(exploring=3.0, returning=8.0), twice, {}, {}]) == {
        "exploring": 4.0
    }


def test_pictures_are_drawn_even_if_all_episodes_broke() -> None:
    broken: dict[str, Any] = {"seed": 1, "success": False, "failure": "no", "modalities": {}}
    titles = {"distance_error": "distance", "score": "score"}
    figure = draw_metrics(TOY, tidy_metrics(TOY, "toy", [broken]), titles)
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["distance", "score"]


def test_every_episode_is_a_dot_in_its_estimators_row_in_units_for_people() -> None:
    summaries = [toy_summary(seed, left=0.001 * (seed + 1), right=None) for seed in range(4)]
    figures = tidy_metrics(TOY, "toy", summaries)
    figure = draw_metrics(TOY, figures, {"distance_error": "distance"})
    (axes,) = figure.axes
    assert axes.get_title(loc="left") == "distance [mm]"
    assert [tick.get_text() for tick in axes.get_yticklabels()] == [
        "the left eye\n(n = 4)",
        "right\n(n = 0 of 4)",
    ]
    (dots,) = axes.collections
    np.testing.assert_allclose(np.asarray(dots.get_offsets())[:, 0], [1.0, 2.0, 3.0, 4.0])


def test_a_median_that_leaves_the_frame_is_marked_and_explained() -> None:
    times = np.arange(0.0, 3.0, 0.1)
    lost = np.where(times > 1.95, NAN, 1.0)
    panel = Panel(title="error [mm]", series={"left": [(times, lost)] * 2, "right": []})
    figure = draw_spreads(TOY, [panel], 0.1, Disturbances(), {})
    (mark,) = (line for line in figure.axes[0].lines if line.get_marker() == "^")
    np.testing.assert_allclose(mark.get_xdata(), [2.0, 2.9])
    assert to_hex(mark.get_markerfacecolor()) == TOY.colors["left"].lower()
    assert figure.legends[0].get_texts()[-1].get_text() == "beyond the frame"


def test_the_bar_of_a_metric_is_the_median_of_the_tables() -> None:
    summaries = [toy_summary(seed, left=0.001 * (seed + 1), right=None) for seed in range(2)]
    summaries += [toy_summary(seed, left=None, right=None) for seed in (2, 3, 4)]
    (axes,) = draw_metrics(
        TOY, tidy_metrics(TOY, "toy", summaries), {"distance_error": "distance"}
    ).axes
    assert axes.get_yticklabels()[0].get_text() == "the left eye\n(n = 2 of 5)"
    assert not axes.lines
