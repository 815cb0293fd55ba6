"""Makes README's moving picture: what the camera sees, and the opening as perceived.

    python docs/make_moving_picture.py [docs/images/drawer.gif]

It simulates one episode (drawer-lights-off, seed 7) and draws each of the kept camera images.
"""

import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image

from crossmodal import load_scenario, run_episode
from crossmodal.diagrams.crossmodal.modalities import COLORS, LABELS
from crossmodal.diagrams.crossmodal.results.frame_plots import draw_frame
from crossmodal.diagrams.drawing import palette
from crossmodal.diagrams.drawing.plot_style import STYLE, new_figure
from crossmodal.diagrams.joints.joint_episode import JointEpisode, joint_episode
from crossmodal.diagrams.run.record import Picture

SCENARIO, SEED = "drawer-lights-off", 7
FIRST = 3.0  # Before it only the arm moves, [s].
PER_FRAME = 180  # A picture is kept every half second of the episode, [ms].
AT_THE_END = 2500  # [ms]


def draw(episode: JointEpisode, picture: Picture) -> Image.Image:
    """The camera's image with features and joint, beside the opening up to its time."""
    with mpl.rc_context(STYLE):
        figure = new_figure(8.0, 3.1)
        left, right = figure.subplots(1, 2, width_ratios=[1.2, 1.0])
        draw_frame(left, picture, episode, "crossmodal", set(), set())
        _draw_openings(right, episode, picture.time)
        canvas = FigureCanvasAgg(figure)
        figure.set_dpi(100)
        canvas.draw()
    image = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    return image.quantize(96, dither=Image.Dither.NONE)


def _draw_openings(axes: Axes, episode: JointEpisode, until: float) -> None:
    duration = episode.record.duration
    for span in episode.record.scenario.disturbances.lights_off:
        if until >= span.start:
            axes.axvspan(span.start, min(until, span.end), color="#D9D9D9", lw=0)
            axes.text(span.start + 0.2, 0.5, "dark", color="#555555")
    for name, series in episode.series.items():
        seen = series.times <= until
        q = 100 * np.where(np.isnan(series.error), np.nan, series.configuration)[seen]
        std = 100 * series.configuration_std[seen]
        times, color = series.times[seen], COLORS[name]
        axes.fill_between(times, q - 2 * std, q + 2 * std, color=color, alpha=0.18, lw=0)
        axes.plot(
            times, q, color=color, lw=2.6 if name == "crossmodal" else 1.6, label=LABELS[name]
        )
    known = episode.truth.times <= until
    opening = 100 * episode.truth.opening()
    axes.plot(
        episode.truth.times[known], opening[known], "--", color=palette.TRUTH, lw=1.1, label="truth"
    )
    axes.set_xlim(FIRST, duration)
    axes.set_ylim(-2.0, 1.15 * float(np.nanmax(opening)))
    axes.set_title("opening [cm], ± two standard deviations")
    axes.set_xlabel("time [s]")
    axes.legend(loc="upper left", fontsize=9)


def main(path: Path) -> None:
    application, scenario = load_scenario(SCENARIO, [f"seed={SEED}"])
    record = run_episode(application, scenario)
    episode = joint_episode(record)
    frames = [draw(episode, picture) for picture in record.pictures if picture.time >= FIRST]
    times = [PER_FRAME] * (len(frames) - 1) + [AT_THE_END]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=times, loop=0)
    print(f"{path}: {len(frames)} frames, {path.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "docs/images/drawer.gif"))
