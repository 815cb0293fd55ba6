import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from synthetic_episode import LIGHTS_OFF, PERIOD, synthetic_episode

from diagrams.crossmodal.studies.experiments import EXPERIMENTS
from diagrams.evaluation.campaign import Evaluation, episode_folder, prepare
from diagrams.evaluation.campaign_plots import (
    common_events,
    draw_errors_at_end,
    draw_errors_over_time,
    errors_over_time,
    spread,
)
from diagrams.evaluation.campaign_report import write_experiment, write_overview
from diagrams.evaluation.metric_table import tidy_figures
from diagrams.joints.joint_metrics import joint_series
from diagrams.joints.joint_record import estimates_table
from diagrams.run.run_folder import finished_summary, write_run
from systems.port_values import JointType

NAN = float("nan")


def finished_evaluation(folder: Path, name: str = "drawer") -> Evaluation:
    """Two episodes that have ended and one that broke off."""
    evaluation = prepare(name, EXPERIMENTS[name], [1, 2, 3], folder)
    for scenario in evaluation.scenarios[:2]:
        episode = synthetic_episode(seed=scenario.seed)
        episode.scenario = scenario
        place = episode_folder(folder, scenario.seed)
        write_run(place, episode)
        summary = finished_summary(place, scenario)
        assert summary is not None
        evaluation.summaries.append(summary)
    evaluation.summaries.append(broken(3))
    return evaluation


def broken(seed: int) -> dict[str, Any]:
    return {"scenario": "drawer", "seed": seed, "success": False, "failure": "no <way>",
            "modalities": {}, "phases": {}}  # fmt: skip


@pytest.mark.parametrize("kind", [JointType.PRISMATIC, JointType.REVOLUTE])
def test_errors_over_time_are_those_of_the_episode(kind: JointType) -> None:
    episode = synthetic_episode(kind, seed=1)
    errors = errors_over_time(estimates_table(episode))
    for name, record in episode.modalities.items():
        series = joint_series(record.ticks, episode.truth)
        at = np.searchsorted(series.times, errors[name].times - 1e-9)
        np.testing.assert_allclose(errors[name].configuration, np.abs(series.error[at]))
        np.testing.assert_allclose(errors[name].axis, series.axis_error[at], atol=1e-7)
        np.testing.assert_allclose(errors[name].probability, series.probability_true_type[at])
        assert errors[name].joint_type == str(kind)


def test_the_spread_is_over_the_episodes_that_reach_an_instant() -> None:
    series = [
        (np.array([0.0, 0.1, 0.2]), np.array([1.0, 2.0, NAN])),
        (np.array([0.1, 0.2]), np.array([4.0, NAN])),
        (np.array([0.1, 0.2, 0.3]), np.array([6.0, 8.0, 9.0])),
        (np.array([0.0, 0.1]), np.array([3.0, 8.0])),
    ]
    times, (low, median, high) = spread(series, 0.1)
    np.testing.assert_allclose(times, [0.0, 0.1])
    np.testing.assert_allclose(median, [2.0, 5.0])
    np.testing.assert_allclose(low, [1.1, 2.3])
    np.testing.assert_allclose(high, [2.9, 7.7])


def test_the_spread_of_nothing_is_empty() -> None:
    times, quantiles = spread([(np.zeros(0), np.zeros(0))], 0.1)
    assert len(times) == 0
    assert quantiles.shape == (3, 0)


def test_the_disturbance_is_marked_and_the_units_are_for_people() -> None:
    episode = synthetic_episode(JointType.REVOLUTE)
    errors = errors_over_time(estimates_table(episode))
    disturbances = episode.scenario.disturbances
    figure = draw_errors_over_time([errors, errors], PERIOD, disturbances, {"returning": 8.0})
    assert figure is not None
    axes = figure.axes[0]
    assert axes.get_title(loc="left") == "configuration error [deg]"
    assert [text.get_text() for text in axes.texts] == ["returning", "lights off"]
    assert any(np.allclose(line.get_xdata(), LIGHTS_OFF) for line in axes.lines)
    assert draw_errors_over_time([{}], PERIOD, disturbances, {}) is None


def test_events_are_marked_where_half_of_the_episodes_have_them() -> None:
    def summary(**times: float) -> dict[str, Any]:
        return {"events": [{"name": name, "time": time} for name, time in times.items()]}

    twice = {"events": [{"name": "exploring", "time": time} for time in (5.0, 9.0)]}
    assert common_events([summary(exploring=3.0, returning=8.0), twice, {}, {}]) == {
        "exploring": 4.0
    }


def test_pictures_are_drawn_even_if_all_episodes_broke() -> None:
    assert len(draw_errors_at_end(tidy_figures("drawer", [broken(1)])).axes) == 2


def test_the_page_holds_every_picture_and_every_reason(tmp_path: Path) -> None:
    evaluation = finished_evaluation(tmp_path)
    written = write_experiment(evaluation, "`crossmodal evaluate drawer`")
    assert {path.name for path in written} == {
        "results.csv", "table.md", "errors_over_time.png", "errors_at_end.png", "report.html",
    }  # fmt: skip
    page = (tmp_path / "report.html").read_text()
    sources = re.findall(r'src="([^"]*)"', page)
    assert len(sources) == 4
    assert all(source.startswith("data:image/png;base64,") for source in sources)
    assert "no &lt;way&gt;" in page
    for link in re.findall(r'href="([^"]*)"', page):
        assert (tmp_path / link).is_file()
    assert set(pd.read_csv(tmp_path / "results.csv").seed) == {1, 2, 3}


def test_nothing_is_written_before_an_episode_has_ended(tmp_path: Path) -> None:
    evaluation = prepare("drawer", EXPERIMENTS["drawer"], [1], tmp_path)
    assert write_experiment(evaluation, "") == []
    assert write_overview([evaluation], tmp_path, "") == []


def test_the_overview_holds_all_experiments(tmp_path: Path) -> None:
    evaluations = [
        finished_evaluation(tmp_path / name, name) for name in ("drawer", "drawer-lights-off")
    ]
    for evaluation in evaluations:
        write_experiment(evaluation, "")
    write_overview(evaluations, tmp_path, "made so")
    table = (tmp_path / "table.md").read_text()
    assert "| all | 4/6 (67 %) |" in table
    assert "## drawer-lights-off: 3 episodes, seeds 1 to 3" in table
    assert set(pd.read_csv(tmp_path / "results.csv").experiment) == {"drawer", "drawer-lights-off"}
    page = (tmp_path / "report.html").read_text()
    assert page.count("<h2") == 2
    for link in re.findall(r'href="([^"]*)"', page):
        assert (tmp_path / link).is_file()
