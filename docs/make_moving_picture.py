"""Makes README's moving picture: what the camera sees, and the opening as perceived.

    python docs/make_moving_picture.py [docs/images/drawer.gif]

It simulates one episode (drawer-lights-off, seed 7) and draws each of the kept camera images.
"""

import sys
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image, ImageColor

from crossmodal import load_scenario, run_episode
from crossmodal.diagrams.crossmodal.modalities import COLORS, LABELS
from crossmodal.diagrams.crossmodal.results.frame_plots import draw_frame
from crossmodal.diagrams.drawing import palette
from crossmodal.diagrams.drawing.plot_style import STYLE
from crossmodal.diagrams.joints.joint_metrics import JointEpisode, joint_episode
from crossmodal.diagrams.joints.joint_palette import JOINT
from crossmodal.diagrams.run.record import Picture

SCENARIO = "drawer-lights-off"
CHANGES = ["seed=7", "duration=15.4"]  # So short that a picture is kept every second.
FIRST = 4.0  # Before it only the arm moves, [s].
DARK = "#DDDDDD"
FRAME, LAST = 320, 2500  # How long they are shown, [ms].


def draw(episode: JointEpisode, picture: Picture) -> Image.Image:
    """The camera's image with features and joint, beside the opening up to its time."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(8.0, 3.0), dpi=90)
        draw_frame(
            figure.add_axes((0.0, 0.0, 0.5, 1.0)),
            replace(picture, color=_smoothed(picture.color)),
            episode,
            "crossmodal",
            set(),
            set(),
        )
        _draw_openings(figure.add_axes((0.55, 0.16, 0.43, 0.73)), episode, picture.time)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")


def _smoothed(color: np.ndarray) -> np.ndarray:
    """Means of 2 x 2 pixels: half of the noise, which takes most of the file."""
    height, width = color.shape[:2]
    means = color.reshape(height // 2, 2, width // 2, 2, 3).mean(axis=(1, 3))
    return means.astype(np.uint8).repeat(2, axis=0).repeat(2, axis=1)


def _draw_openings(axes: Axes, episode: JointEpisode, until: float) -> None:
    for span in episode.record.scenario.disturbances.lights_off:
        if until >= span.start:
            axes.axvspan(span.start, min(until, span.end), color=DARK, lw=0)
            axes.text(span.start + 0.2, 0.3, "dark", color="#555555")
    for name, series in episode.series.items():
        seen = series.times <= until
        times, q = series.times[seen], 100 * series.configuration[seen]
        std = 100 * series.configuration_std[seen]
        axes.fill_between(times, q - 2 * std, q + 2 * std, color=COLORS[name], alpha=0.2, lw=0)
        width = 2.8 if name == "crossmodal" else 1.6
        axes.plot(times, q, color=COLORS[name], lw=width, label=LABELS[name])
    truth = episode.truth
    known, opening = truth.times <= until, 100 * truth.opening()
    axes.plot(truth.times[known], opening[known], "--", color=palette.TRUTH, lw=1.2, label="truth")
    axes.set_xlim(FIRST - 1.0, episode.record.duration)
    axes.set_ylim(-1.5, 1.1 * float(np.max(opening)))
    axes.set_title("opening [cm], ± two standard deviations")
    axes.set_xlabel("time [s]", labelpad=1)
    axes.legend(loc="upper left", fontsize=9)


def _palette(frames: list[Image.Image]) -> Image.Image:
    """Colours of the first, the middle and the last frame, and those of thin lines and bands."""
    drawn = (*COLORS.values(), *JOINT.values(), palette.TRUTH)
    lines = [ImageColor.getrgb(color)[:3] for color in drawn]
    bands = [
        tuple(round(0.2 * c + 0.8 * b) for c, b in zip(line, ImageColor.getrgb(back), strict=False))
        for line in lines
        for back in ("#FFFFFF", DARK)
    ]
    stripes = np.array([*lines, *bands], dtype=np.uint8).repeat(40, axis=0)
    patch = np.broadcast_to(stripes, (frames[0].height, *stripes.shape))
    parts = [frames[0], frames[len(frames) // 2], frames[-1], Image.fromarray(patch.copy())]
    everything = np.concatenate([np.asarray(part) for part in parts], axis=1)
    return Image.fromarray(everything).quantize(128)


def save(frames: list[Image.Image], path: Path) -> None:
    colors = _palette(frames)
    reduced = [frame.quantize(palette=colors, dither=Image.Dither.NONE) for frame in frames]
    times = [FRAME] * (len(frames) - 1) + [LAST]
    reduced[0].save(path, save_all=True, append_images=reduced[1:], duration=times, loop=0)
    print(f"{path}: {len(frames)} frames, {path.stat().st_size / 1e6:.2f} MB")


def main(path: Path) -> None:
    application, scenario = load_scenario(SCENARIO, CHANGES)
    episode = joint_episode(run_episode(application, scenario))
    kept = [picture for picture in episode.record.pictures if picture.time >= FIRST]
    save([draw(episode, picture) for picture in kept], path)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "docs/images/drawer.gif"))
