from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from synthetic_episode import empty_episode, nudged, synthetic_episode, without_truth

from crossmodal.diagrams.crossmodal.modalities import COLORS
from crossmodal.diagrams.crossmodal.results.frame_plots import draw_frames
from crossmodal.diagrams.crossmodal.results.plots import draw_configurations, draw_errors
from crossmodal.diagrams.crossmodal.results.report import written_configuration
from crossmodal.diagrams.crossmodal.results.results import evaluate
from crossmodal.diagrams.drawing.plot_style import save
from crossmodal.diagrams.evaluation.campaign_plots import common_events
from crossmodal.diagrams.joints.joint_errors import error_panels, errors_over_time
from crossmodal.diagrams.joints.joint_metrics import JointEpisode, joint_episode
from crossmodal.systems.port_values import JointType


def episode(joint_type: JointType = JointType.PRISMATIC) -> JointEpisode:
    return joint_episode(synthetic_episode(joint_type))


def texts(figure: Figure | None) -> str:
    assert figure is not None
    figure.canvas.draw()
    return "\n".join(text.get_text() for text in figure.findobj(lambda a: hasattr(a, "get_text")))


@pytest.mark.parametrize("joint_type", [JointType.PRISMATIC, JointType.REVOLUTE, JointType.SCREW])
def test_all_figures_are_drawn(joint_type: JointType, tmp_path: Path) -> None:
    one = episode(joint_type)
    for draw in (draw_errors, draw_configurations, draw_frames):
        figure = draw(one)
        assert figure is not None
        path = tmp_path / "figure.partial"
        save(figure, path)
        assert path.read_bytes().startswith(b"\x89PNG")


def test_the_frames_say_the_pitch_of_a_screw_and_of_nothing_else() -> None:
    assert "pitch 13.08 ± 0.65 mm/rad" in texts(draw_frames(episode(JointType.SCREW)))
    assert "pitch" not in texts(draw_frames(episode(JointType.REVOLUTE)))


def test_the_error_plot_shows_every_modality_the_events_and_the_unit() -> None:
    words = texts(draw_errors(episode()))
    for label in (
        "vision",
        "proprioception",
        "cross-modal",
        "lights off",
        "exploring",
        "error [mm]",
    ):
        assert label in words
    assert "error [deg]" in texts(draw_errors(episode(JointType.REVOLUTE)))


def test_each_curve_is_the_error_in_millimetres_in_its_modalitys_colour() -> None:
    figure = draw_errors(episode())
    assert figure is not None
    axes = figure.axes[0]
    (curve,) = (
        line
        for line in axes.lines
        if line.get_color() == COLORS["crossmodal"] and len(line.get_xdata()) > 10
    )
    error = np.asarray(curve.get_ydata())
    assert 0.1 < np.nanmedian(np.abs(error)) < 5.0
    low, high = axes.get_ylim()
    assert -low == high < 60.0


@pytest.mark.parametrize("draw", [draw_errors, draw_configurations])
def test_a_band_is_drawn_where_a_rigid_joint_is_claimed(
    draw: Callable[[JointEpisode], Figure | None],
) -> None:
    one = episode()
    figure, series = draw(one), one.series["proprioception"]
    assert figure is not None
    claims = [joint is not None and joint.type == JointType.RIGID for joint in series.joints]
    (band,) = (
        band
        for band in figure.axes[0].collections
        if to_hex(band.get_facecolor()[0]) == COLORS["proprioception"].lower()
    )
    times = np.concatenate([path.vertices[:, 0] for path in band.get_paths()])
    assert np.all(np.isin(series.times[claims], times))


def test_frames_come_from_start_middle_and_end_of_the_motion() -> None:
    one = episode()
    words = texts(draw_frames(one))
    for time in ("t = 4.5 s", "t = 9.5 s\nprismatic", "t = 15.5 s, lights off"):
        assert time in words
    one.record.scenario.disturbances.lights_off.clear()
    assert "t = 10.0 s" in texts(draw_frames(one))
    assert "prismatic, configuration 22." in texts(draw_frames(one))


def test_the_frames_count_from_the_grasp_as_the_estimates_do() -> None:
    one = joint_episode(nudged(synthetic_episode(), 0.015))
    series = one.series["vision"]
    k = int(np.argmin(np.abs(series.times - 9.0)))
    assert abs(series.error[k]) < 0.01
    one.record.pictures[:] = [
        picture for picture in one.record.pictures if abs(picture.time - 9.0) < 0.1
    ]
    belief = written_configuration(
        float(series.configuration[k]), "prismatic", spread=float(series.configuration_std[k])
    )
    assert f"configuration {belief}" in texts(draw_frames(one, "vision"))


def test_an_episode_that_hardly_began_has_nothing_to_draw() -> None:
    one = joint_episode(empty_episode())
    for draw in (draw_frames, draw_errors, draw_configurations):
        assert draw(one) is None


def test_without_the_truth_there_are_no_errors_to_draw_but_there_is_what_was_seen() -> None:
    one = joint_episode(without_truth(synthetic_episode()))
    assert draw_errors(one) is None
    assert draw_configurations(one) is None
    assert "prismatic" in texts(draw_frames(one))


@pytest.mark.parametrize("joint_type", [JointType.PRISMATIC, JointType.REVOLUTE, JointType.SCREW])
def test_a_joint_that_goes_to_negative_q_is_in_the_frame(joint_type: JointType) -> None:
    figure = draw_configurations(joint_episode(synthetic_episode(joint_type, opens_to=-1.0)))
    assert figure is not None
    (axes,) = figure.axes
    low, high = sorted(axes.get_ylim())
    curves = [np.asarray(line.get_ydata(), float) for line in axes.lines]
    crossmodal = next(
        values
        for line, values in zip(axes.lines, curves, strict=True)
        if line.get_color() == COLORS["crossmodal"]
    )
    assert np.nanmin(crossmodal) < -20.0
    assert low < np.nanmin(crossmodal) < np.nanmax(crossmodal) < high
    assert not any(line.get_marker() in ("^", "v") for line in axes.lines)


def test_a_curve_that_leaves_an_episodes_plot_is_marked() -> None:
    figure = draw_errors(episode())
    assert figure is not None
    marked = [line for line in figure.axes[0].lines if line.get_marker() == "v"]
    assert {line.get_markerfacecolor() for line in marked} == {
        COLORS["proprioception"],
        COLORS["crossmodal"],
    }
    assert "beyond the frame" in texts(figure)


@pytest.mark.parametrize("draw", [draw_errors, draw_configurations])
def test_the_legend_says_what_the_band_is_and_of_how_many_episodes(
    draw: Callable[[JointEpisode], Figure | None],
) -> None:
    figure = draw(episode())
    assert figure is not None
    (legend,) = figure.legends
    assert legend.get_title().get_text() == (
        "band: 2σ as reported; where a rigid joint is claimed, of all types with this unit\n"
        "n = 1 episode, seed 3"
    )


def test_an_episode_and_its_campaign_are_drawn_in_the_same_words() -> None:
    record = synthetic_episode()
    one = joint_episode(record)
    figure = draw_errors(one)
    assert figure is not None
    mine = [axes.get_title(loc="left") for axes in figure.axes]
    table = evaluate(record).estimates
    panels = error_panels([errors_over_time(table)], ["crossmodal"])
    for title, panel in zip(mine, panels, strict=True):
        assert title.startswith(panel.title)
    summary = {"events": [asdict(event) for event in record.events]}
    words = texts(figure)
    for name in common_events([summary]):
        assert name in words
    both = words + texts(draw_configurations(one)) + texts(draw_frames(one))
    assert "opening" not in both + " ".join(evaluate(record).plots)
    assert "grasped" not in both
