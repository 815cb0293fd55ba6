"""Draws camera images with what was believed of the flap in them."""

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from crossmodal.diagrams.drawing.plot_style import STYLE, new_figure
from crossmodal.diagrams.flap.estimator_names import COLORS, LABELS
from crossmodal.diagrams.flap.results.flap_episode import FlapEpisode
from crossmodal.diagrams.run.calibration import Camera
from crossmodal.diagrams.run.record import Picture, Tick
from crossmodal.maths.arrays import Array
from crossmodal.systems.port_values import (
    UNKNOWN_FINGERTIP,
    UNKNOWN_TOOL,
    FlapPlane,
    ToolBelief,
    unseen,
)

_COLUMNS, _ROWS = 3, 2
_AXIS_LENGTH = 0.25  # [m]
_NORMAL_LENGTH = 0.06  # [m]
_NORMAL, _CONTACT = "#66CCEE", "#CC3311"


def chosen(pictures: list[Picture], count: int) -> list[Picture]:
    """At most `count` pictures, evenly from the first to the last."""
    if len(pictures) <= count:
        return pictures
    indices = np.linspace(0, len(pictures) - 1, count).round().astype(int)
    return [pictures[index] for index in indices]


def draw_frames(episode: FlapEpisode) -> Figure | None:
    """Images with the believed axis, the flap's normal and the contact; None without images.

    The beliefs are those of the first estimator, by which both arms act. Once the tool is moved,
    the line and the tip take their place.
    """
    record = episode.record
    pictures = chosen(record.pictures, _COLUMNS * _ROWS)
    if not pictures or not record.estimators:
        return None
    name, estimator = next(iter(record.estimators.items()))
    moved = episode.moved_at
    with mpl.rc_context({**STYLE, "axes.grid": False}):
        figure = new_figure(12.0, 6.6)
        all_axes = np.atleast_1d(figure.subplots(_ROWS, _COLUMNS)).ravel()
        for axes in all_axes:
            axes.set_axis_off()
        for axes, picture in zip(all_axes, pictures, strict=False):
            axes.imshow(picture.color)
            axes.set_title(f"{picture.time:.1f} s")
            if moved and picture.time >= moved:
                _draw_line(axes, episode, picture.time, record.calibration.camera)
            elif (tick := estimator.tick_at(picture.time)) is not None:
                _draw_beliefs(axes, tick, record.calibration.camera, COLORS.get(name, "white"))
            axes.set_xlim(0, picture.color.shape[1])
            axes.set_ylim(picture.color.shape[0], 0)
        figure.suptitle(
            f"seed {record.scenario.seed}; as believed by {LABELS.get(name, name)}: axis of the"
            " hinge (thick), normal of the flap where it is seen (light), contact (dot); then the"
            " line on the table and the tip (dot)",
            fontsize=9.5,
        )
    return figure


def _draw_line(axes: Axes, episode: FlapEpisode, time: float, camera: Camera) -> None:
    line = episode.line
    u, v = camera.project(np.vstack([line.start, line.end])).T
    axes.plot(u, v, color="white", lw=1.6)
    index = int(np.argmin(np.abs(line.times - time)))
    if np.isfinite(line.p_WT_estimated[index]).all():
        (pixel,) = camera.project(line.p_WT_estimated[index][None])
        axes.plot(*pixel, "o", color=_CONTACT, mec="white", ms=6)


def _draw_beliefs(axes: Axes, tick: Tick, camera: Camera, color: str) -> None:
    tool: ToolBelief = tick.values.get("tool_latest", UNKNOWN_TOOL)
    plane: FlapPlane = tick.values.get("flap_plane_latest", unseen(""))
    contact = tick.values.get("fingertip_contact_latest", UNKNOWN_FINGERTIP)

    def line(p_WA: Array, p_WB: Array, color: str, width: float) -> None:
        u, v = camera.project(np.vstack([p_WA, p_WB])).T
        axes.plot(u, v, color=color, lw=width, solid_capstyle="round")

    if tool.hinge.known:
        half = 0.5 * _AXIS_LENGTH * tool.hinge.k_W
        line(tool.hinge.p_WK - half, tool.hinge.p_WK + half, "white", 4.0)
        line(tool.hinge.p_WK - half, tool.hinge.p_WK + half, color, 2.6)
    if plane.seen:
        line(plane.p_WF, plane.p_WF + _NORMAL_LENGTH * plane.n_W, _NORMAL, 2.4)
    if np.isfinite(contact.p_WC).all():
        (pixel,) = camera.project(contact.p_WC[None])
        axes.plot(*pixel, "o", color=_CONTACT, mec="white", ms=6)
