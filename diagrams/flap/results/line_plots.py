"""Draws how the tool's tip followed its line on the table."""

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from crossmodal.diagrams.drawing import palette
from crossmodal.diagrams.drawing.plot_style import STYLE, new_figure
from crossmodal.diagrams.flap.estimator_names import COLORS, LABELS
from crossmodal.diagrams.flap.results.flap_episode import FlapEpisode


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
