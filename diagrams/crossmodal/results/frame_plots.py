"""Draws what the camera saw, with the features and the joint that a modality believed in."""

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from crossmodal.diagrams.crossmodal.modalities import LABELS
from crossmodal.diagrams.crossmodal.results.report import (
    describe_configuration,
    describe_fit,
    describe_pitch,
)
from crossmodal.diagrams.drawing.plot_style import STYLE, new_figure
from crossmodal.diagrams.joints.joint_drawing import draw_joint
from crossmodal.diagrams.joints.joint_metrics import (
    JointEpisode,
    bodies_of,
    joint_in_world,
    joints_of,
    motion_start,
)
from crossmodal.diagrams.joints.joint_palette import JOINT, body_color, body_label
from crossmodal.diagrams.joints.joint_truth import Truth
from crossmodal.diagrams.run.record import Picture
from crossmodal.systems.port_values import (
    MOVING_TYPES,
    STATIC_BODY,
    BodyMotions,
    FeatureBelief,
    JointBelief,
    JointType,
)


def draw_frames(episode: JointEpisode, modality: str | None = None) -> Figure | None:
    """Camera images from start, middle and end of the motion with features and the joint.

    Args:
        modality: Whose belief is drawn; by default the cross-modal one where it exists.
    """
    frames = _choose_frames(episode)
    if not frames or not episode.record.estimators:
        return None
    names = list(episode.record.estimators)
    modality = modality or ("crossmodal" if "crossmodal" in names else names[0])
    height, width = frames[0].color.shape[:2]
    with mpl.rc_context(STYLE | {"axes.grid": False}):
        figure = new_figure(4.6 * len(frames), 4.6 * height / width + 0.55)
        bodies: set[int] = set()
        joints: set[JointType] = set()
        for axes, frame in zip(np.atleast_1d(figure.subplots(1, len(frames))), frames, strict=True):
            draw_frame(axes, frame, episode, modality, bodies, joints)
        _frame_legend(figure, modality, bodies, joints)
    return figure


def _choose_frames(episode: JointEpisode) -> list[Picture]:
    """The images at the start of the motion, in its course and at its end.

    Where the lights go off or the camera is covered in the course of it, the last image before
    that is taken, else the one half way.
    """
    frames, truth = episode.record.pictures, episode.truth
    if len(frames) <= 3:
        return frames
    times = np.array([frame.time for frame in frames])
    start = motion_start(truth) if len(truth.times) else None
    begin, end = times[0] if start is None else start, times[-1]
    disturbances = episode.record.scenario.disturbances
    starts = [span.start for span in disturbances.lights_off + disturbances.camera_covered]
    seen = times[(times > begin) & (times < min([t for t in starts if t < end], default=begin))]
    middle = seen[-1] if len(seen) else 0.5 * (begin + end)
    chosen = sorted({int(np.argmin(np.abs(times - time))) for time in (begin, middle, end)})
    return [frames[k] for k in chosen]


def draw_frame(
    axes: Axes,
    frame: Picture,
    episode: JointEpisode,
    modality: str,
    bodies: set[int],
    joints: set[JointType],
) -> None:
    """Draws one image and notes in `bodies` and `joints` what the legend has to explain."""
    height, width = frame.color.shape[:2]
    axes.imshow(frame.color, interpolation="none")
    axes.set_axis_off()
    axes.set_xlim(-0.5, width - 0.5)
    axes.set_ylim(height - 0.5, -0.5)
    tick = episode.record.estimators[modality].tick_at(frame.time)
    if tick is None:
        return
    features = tick.values.get("features_latest")
    bodies_now = bodies_of(tick)
    if features is not None and len(features.ids):
        owners = _owners(features, bodies_now)
        bodies.update(owners)
        u, v = features.uv.T
        colors = [body_color(owner) for owner in owners]
        axes.scatter(u, v, s=9, c=colors, edgecolors="#202020", linewidths=0.35)
    joint = joint_in_world(joints_of(tick), bodies_now, episode.truth.parent_moves)
    if joint is not None and joint.type in MOVING_TYPES:
        body = bodies_now.find(joint.child_id)
        if draw_joint(axes, joint, body, episode.record.calibration.camera):
            joints.add(joint.type)
    spans = episode.record.scenario.disturbances.spans()
    note = "".join(f", {name}" for name, interval in spans if frame.time in interval)
    belief = _belief(joint, episode.truth, tick.time)
    axes.text(
        0.025,
        0.965,
        f"t = {frame.time:.1f} s{note}\n{belief}",
        transform=axes.transAxes,
        va="top",
        fontsize=10,
        color="white",
        linespacing=1.35,
        bbox={"boxstyle": "round,pad=0.35", "facecolor": "black", "alpha": 0.62, "lw": 0},
    )


def _belief(joint: JointBelief | None, truth: Truth, time: float) -> str:
    belief = describe_configuration(joint, truth, time)
    if joint is not None and joint.type in MOVING_TYPES:
        belief = f"{joint.type}, configuration {belief}"
        if pitch := describe_pitch(joint):
            belief += f"\n{pitch.removeprefix(', ')}"
        if fit := describe_fit(joint):
            belief += f"\n{fit.removeprefix('; ')}"
    return belief


def _owners(features: FeatureBelief, bodies: BodyMotions) -> list[int]:
    """The body of each feature."""
    owner = {int(feature): body.body_id for body in bodies.bodies for feature in body.assigned_ids}
    return [owner.get(int(feature), STATIC_BODY) for feature in features.ids]


def _frame_legend(figure: Figure, modality: str, bodies: set[int], joints: set[JointType]) -> None:
    dot: dict[str, Any] = {"marker": "o", "ls": "", "mec": "#202020", "mew": 0.4}
    handles = [
        Line2D([], [], color=body_color(body), label=body_label(body), **dot)
        for body in sorted(bodies)
    ]
    handles += [
        Line2D([], [], color=JOINT[joint], lw=4, label=f"{joint} joint") for joint in sorted(joints)
    ]
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=max(len(handles), 1),
        title=f"as believed by {LABELS.get(modality, modality)}",
    )
