"""Draws an episode of the flap over time, as the paper's Figs. 6 to 11 do, and along its line."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from crossmodal.diagrams.drawing import palette
from crossmodal.diagrams.drawing.plot_style import STYLE, TIME, mark_panels, new_figure
from crossmodal.diagrams.flap.estimator_names import COLORS, LABELS
from crossmodal.diagrams.flap.results.flap_episode import FlapEpisode
from crossmodal.maths.arrays import Array, Mask

_XYZ = ("#CC3311", "#228833", "#0077BB")
_STYLES = {"geometric": "-", "filtered": "--", "planes": ":"}
_IN_WORDS = {"-": "full", "--": "dashed", ":": "dotted"}
_THIN: dict[str, Any] = {"lw": 0.6, "alpha": 0.7}


def hidden_spans(times: Array, seen: Mask) -> list[tuple[float, float]]:
    """Starts and ends of the times in which the camera did not see the flap, [s]."""
    steps = np.diff(np.concatenate([[0], (~seen).astype(int), [0]]))
    starts, ends = np.flatnonzero(steps == 1), np.flatnonzero(steps == -1) - 1
    return [(float(times[a]), float(times[b])) for a, b in zip(starts, ends, strict=True) if b > a]


def draw_servoing(episode: FlapEpisode) -> Figure | None:
    """Where the contact is on the fingertip, how hard it presses and y_S · n_f, over time.

    Thin lines are what the robot has of it: by taxels, encoders and the estimator that it acts by.
    None where the robot never flipped the flap.
    """
    truth = episode.truth
    if not truth.flipping.any():
        return None
    desired, sensed = episode.record.scenario.control.force, _sensed(episode)
    with mpl.rc_context(STYLE):
        figure = new_figure(9.0, 7.5)
        position, force, cosine = panels = figure.subplots(3, 1, sharex=True)
        for axis, name in ((0, "x"), (2, "z")):
            place = 1e3 * truth.p_SC[:, axis]
            position.plot(truth.times, place, color=_XYZ[axis], lw=1.3, label=name)
            position.plot(sensed.times, 1e3 * sensed.p_SC[:, axis], color=_XYZ[axis], **_THIN)
        position.axhline(0.0, color=palette.TRUTH, lw=0.9)
        position.set_title(
            "place of the contact on the fingertip, from the pad's centre [mm] (thin: by taxels)"
        )
        position.legend(loc="lower right", ncols=2)
        force.plot(truth.times, truth.force, color="#444444", lw=1.2)
        force.plot(sensed.times, sensed.force, color="#444444", **_THIN)
        force.axhline(desired, color=palette.TRUTH, lw=0.9, ls="--")
        force.set_title(
            f"normal force [N] (thin: by taxels; dashed: the {desired:.2g} N that are asked for)"
        )
        product = np.sum(truth.Sy_W * truth.n_W, axis=1)
        cosine.plot(truth.times, product, color="#444444", lw=1.2)
        cosine.plot(sensed.times, sensed.product, color="#444444", **_THIN)
        cosine.axhline(0.0, color=palette.TRUTH, lw=0.9)
        cosine.set_title("y_S · n_f (thin: as encoders and estimator have it)")
        cosine.set_ylim(-1.0, 1.0)
        _limit_to_flipping(position, truth.p_SC[:, [0, 2]][truth.flipping] * 1e3, 1.0)
        _limit_to_flipping(force, np.append(truth.force[truth.flipping], [0.0, desired]), 0.1)
        _finish(panels, episode)
    return figure


class _Sensed(NamedTuple):
    """What the robot has of its contact at the ticks (T); NaN for what it does not know."""

    times: Array
    p_SC: Array
    force: Array
    product: Array


def _sensed(episode: FlapEpisode) -> _Sensed:
    ticks = [
        tick
        for found in list(episode.record.estimators.values())[:1]
        for tick in found.ticks
        if "fingertip_contact_latest" in tick.values and "flap_angle_latest" in tick.values
    ]
    fingers = [tick.values["fingertip_contact_latest"] for tick in ticks]
    normals = [tick.values["flap_angle_latest"].n_W for tick in ticks]
    touching = [finger.contact.touching for finger in fingers]
    p_SC = [
        np.where(is_on, f.contact.p_SC, np.nan) for is_on, f in zip(touching, fingers, strict=True)
    ]
    return _Sensed(
        times=np.array([tick.time for tick in ticks]),
        p_SC=np.array(p_SC, dtype=float).reshape(-1, 3),
        force=np.array([f.contact.force if f.contact.touching else 0.0 for f in fingers]),
        product=np.array([f.X_WS[:3, 1] @ n for f, n in zip(fingers, normals, strict=True)]),
    )


def draw_angle(episode: FlapEpisode) -> Figure | None:
    """The flap's angle as each estimator believes it, and the true one."""
    truth = episode.truth
    if not np.isfinite(truth.theta).any():
        return None
    with mpl.rc_context(STYLE):
        figure = new_figure(9.0, 5.6)
        angle, error = panels = figure.subplots(
            2, 1, sharex=True, gridspec_kw={"height_ratios": [3, 2]}
        )
        angle.plot(
            truth.times,
            np.rad2deg(truth.theta),
            color=palette.TRUTH,
            lw=1.2,
            ls="--",
            label="truth",
        )
        for name, series in episode.series.items():
            true = np.interp(series.times, truth.times, truth.theta)
            color, label = COLORS.get(name, palette.QUIET), LABELS.get(name, name)
            theta, std = np.rad2deg(series.theta), np.rad2deg(series.theta_std)
            angle.plot(series.times, theta, color=color, lw=1.6, label=label)
            off = theta - np.rad2deg(true)
            error.plot(series.times, off, color=color, lw=1.4)
            error.fill_between(
                series.times, off - 2 * std, off + 2 * std, color=color, alpha=0.15, lw=0
            )
        error.axhline(0.0, color=palette.TRUTH, lw=0.9)
        angle.set_title("angle of the flap [deg] (shaded: the camera does not see it)")
        error.set_title("its error [deg] (band: 2σ as reported)")
        error.set_ylim(-12.0, 12.0)
        angle.legend(loc="lower right", ncols=3)
        _finish(panels, episode)
    return figure


def draw_tool(episode: FlapEpisode) -> Figure | None:
    """k · k_ref and the errors of L1 and L2 of each estimator, over time."""
    truth = episode.truth
    if not np.isfinite(truth.theta).any():
        return None
    with mpl.rc_context(STYLE):
        figure = new_figure(9.0, 8.0)
        panels = figure.subplots(3, 1, sharex=True)
        for name, series in episode.series.items():
            count = min(len(series.times), len(truth.times))
            times, color = series.times[:count], COLORS.get(name, palette.QUIET)
            product = np.sum(series.k_W[:count] * truth.k_W[:count], axis=1)
            panels[0].plot(times, product, color=color, lw=1.6, label=LABELS.get(name, name))
            for axes, error in (
                (panels[1], series.L1_W[:count] - truth.L1_W[:count]),
                (panels[2], series.L2_W[:count] - truth.L2_W[:count]),
            ):
                _draw_components(axes, times, error, name)
        panels[0].set_title("k · k_ref")
        panels[0].set_ylim(0.9, 1.005)
        panels[0].legend(loc="lower right", ncols=2)
        lines = ", ".join(
            f"{LABELS.get(name, name)} {_IN_WORDS[_STYLES.get(name, ':')]}"
            for name in episode.series
        )
        for axes, vector in ((panels[1], "L1"), (panels[2], "L2")):
            axes.set_title(f"error of {vector} [mm] along x (red), y (green), z (blue): {lines}")
            axes.axhline(0.0, color=palette.TRUTH, lw=0.9)
            axes.set_ylim(-25.0, 25.0)
        _finish(panels, episode)
    return figure


def draw_line(episode: FlapEpisode) -> Figure | None:
    """Sideways and up from the line, along the line; None where no tip came to a line."""
    line, scenario = episode.line, episode.record.scenario
    if not line.on_line.any():
        return None
    acting = scenario.acting_estimator
    along = (line.end - line.start) / np.linalg.norm(line.end - line.start)
    aside = np.cross([0.0, 0.0, 1.0], along)
    aside = aside / max(float(np.linalg.norm(aside)), 1e-9)
    others = [(name, line.p_WT_of(name)) for name in line.link_error_of if name != acting]
    paths = [
        ("true tip", line.p_WT, palette.TRUTH, "-", 2.0),
        (
            "tip as the arm believes it",
            line.p_WT_estimated,
            COLORS.get(acting, "#444444"),
            "-",
            1.4,
        ),
        *(
            (f"true tip, had it acted by {LABELS.get(name, name)}", p, COLORS.get(name), "--", 1.2)
            for name, p in others
        ),
    ]
    with mpl.rc_context(STYLE):
        figure = new_figure(9.0, 5.6)
        sideways, up = figure.subplots(2, 1, sharex=True)
        for label, p_WT, color, style, width in paths:
            way, offset = line.offsets(p_WT[line.on_line])
            for axes, direction in ((sideways, aside), (up, np.cross(along, aside))):
                across = 1e3 * offset @ direction
                axes.plot(1e3 * way, across, color=color, ls=style, lw=width, label=label)
        for axes, title in ((sideways, "sideways from the line [mm]"), (up, "above it [mm]")):
            axes.axhline(0.0, color=palette.QUIET, lw=0.9)
            axes.set_title(title)
            low, high = axes.get_ylim()
            axes.set_ylim(min(low, -12.0), max(high, 12.0))
        up.set_xlabel("along the line [mm]")
        sideways.legend(loc="best")
        rms = line.rms(line.p_WT)
        reported = f"RMS distance {1e3 * rms:.1f} mm" if np.isfinite(rms) else "not finished"
        figure.suptitle(f"n = 1 episode, seed {scenario.seed}; {reported}", fontsize=9.5)
    return figure


def _draw_components(axes: Axes, times: Array, error: Array, name: str) -> None:
    for index, color in enumerate(_XYZ):
        axes.plot(times, 1e3 * error[:, index], color=color, lw=1.2, ls=_STYLES.get(name, ":"))


def _limit_to_flipping(axes: Axes, values: Array, least: float) -> None:
    """Shows the bulk of what is drawn: the first touch must not flatten the rest."""
    known = values[np.isfinite(values)]
    if len(known) == 0:
        return
    low, high = np.percentile(known, [1.0, 99.0])
    margin = max(0.3 * (high - low), least)
    axes.set_ylim(low - margin, high + margin)


def _finish(panels: Sequence[Axes], episode: FlapEpisode) -> None:
    """Marks events, disturbances and when the camera did not see the flap; says which episode."""
    panels[-1].set_xlabel(TIME)
    panels[-1].set_xlim(0.0, max(episode.record.duration, 1e-3))
    events = [(event.name, event.time) for event in episode.record.events]
    if episode.series and len(episode.truth.times):
        series = next(iter(episode.series.values()))
        for start, end in hidden_spans(series.times, series.seen):
            for axes in panels:
                axes.axvspan(start, end, color="#000000", alpha=0.05, lw=0)
    scenario = episode.record.scenario
    beyond = mark_panels(panels, events, scenario.disturbances.spans())
    figure, title = panels[0].figure, f"n = 1 episode, seed {scenario.seed}"
    figure.suptitle(title, fontsize=9.5)
    if beyond:
        figure.legend(handles=beyond, loc="outside lower center", ncols=2)
