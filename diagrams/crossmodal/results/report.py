"""Says in words and in a small table what was perceived and how good it was."""

import math
from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
import pandas as pd

from crossmodal.diagrams.crossmodal.modalities import LABELS
from crossmodal.diagrams.crossmodal.results.grasp_episode import grasp_lines
from crossmodal.diagrams.crossmodal.task import GRASP_LOST
from crossmodal.diagrams.drawing.digits import fixed, written
from crossmodal.diagrams.evaluation.stream_faults import fault_lines
from crossmodal.diagrams.joints.joint_episode import JointEpisode
from crossmodal.diagrams.joints.joint_metrics import axis_sign, configuration_since_grasp, last_seen
from crossmodal.diagrams.joints.joint_truth import Truth
from crossmodal.diagrams.joints.mechanics_record import mechanics_line
from crossmodal.systems.port_values import MOVING_TYPES, JointBelief, JointType


def describe_configuration(joint: JointBelief | None, truth: Truth, time: float) -> str:
    """A joint's configuration at a time, counted from the grasp, with its deviation."""
    if joint is None:
        return "no joint seen"
    if joint.type not in MOVING_TYPES:
        return str(joint.type)
    std = float(np.sqrt(max(joint.model.configuration_covariance[0, 0], 0.0)))
    return written_configuration(
        configuration_since_grasp(joint, truth, time), joint.type, spread=std
    )


def written_configuration(
    value: float | None,
    joint_type: JointType | str,
    *,
    spread: float = math.nan,
    beside: float = math.nan,
) -> str:
    """A configuration [m or rad] in a unit to read, with its deviation where it has one.

    Args:
        spread: Its standard deviation.
        beside: What it stands next to, which says how many digits it gets.
    """
    prismatic = joint_type not in (JointType.REVOLUTE, JointType.SCREW)
    scale, unit = (100.0, "cm") if prismatic else (180.0 / math.pi, "deg")
    scaled = None if value is None else scale * value
    return written(scaled, unit, spread=scale * spread, beside=scale * beside)


def describe_pitch(joint: JointBelief) -> str:
    """A screw's pitch with its deviation, begins with ', '; nothing for other types."""
    if joint.type != JointType.SCREW:
        return ""
    std = float(np.sqrt(joint.model.pitch_variance))
    return f", pitch {written(1e3 * joint.model.pitch, 'mm/rad', spread=1e3 * std)}"


def describe_fit(joint: JointBelief) -> str:
    """What a joint leaves unexplained of what was measured, and what was not used; each after '; '.

    Being nearer to the path than is usual is no fault: of correlated errors the most is claimed
    that they may be.
    """
    parts, fit = [], joint.fit
    if fit is not None and fit.reduced_chi_square > fit.bounds[1]:  # NaN is not.
        off = fixed(math.sqrt(fit.reduced_chi_square), 1)
        parts.append(f"off its path by {off} times what the measurements' errors explain")
    if fit is not None and fit.outlier_share >= 0.005:
        parts.append(f"{fixed(100.0 * fit.outlier_share, 0)} % outliers")
    if fit is not None and fit.noise_correlation > 0.0:
        parts.append(f"errors of neighbours correlated by {fixed(fit.noise_correlation, 1)}")
    if joint.skipped:
        reasons = ", ".join(f"{count} {reason}" for reason, count in joint.skipped.items())
        parts.append(f"not used: {reasons}")
    return "".join(f"; {part}" for part in parts)


def perceived(episode: JointEpisode) -> list[str]:
    """One sentence per modality: type, axis and configuration, each with its uncertainty."""
    lines = []
    for name, series in episode.series.items():
        last = last_seen(series)
        joint = None if last is None else series.joints[last]
        label = f"{LABELS.get(name, name)}:".ljust(16)
        if joint is None:
            lines.append(f"{label}no joint seen")
            continue
        text = f"{joint.type} (p = {joint.probabilities[joint.type]:.3f})"
        if joint.type in MOVING_TYPES:
            axis = axis_sign(joint.model.axis_P, episode.truth.axis_W) * joint.model.axis_P
            components = ", ".join(fixed(component, 3, signed=True) for component in axis)
            spread = written(float(np.rad2deg(series.axis_std[last])), "deg")
            text += f", axis ({components}) ± {spread}"
            q, std = float(series.configuration[last]), float(series.configuration_std[last])
            text += f", configuration {written_configuration(q, joint.type, spread=std)}"
        text += describe_pitch(joint)
        text += describe_fit(joint)
        if last is not None and episode.record.duration - series.times[last] > 0.5:
            text += f"; last seen at {series.times[last]:.1f} s"
        lines.append(label + text)
    return lines


def forces(summary: Mapping[str, Any]) -> list[str]:
    """What moving the joint takes and how far it goes, for each modality that measured it."""
    lines = []
    for name, value in summary["modalities"].items():
        if mechanics := value["joints"][0]["mechanics"]:
            label = f"{LABELS.get(name, name)}:".ljust(16)
            lines.append(label + mechanics_line(mechanics))
    return lines


def comparison(summary: Mapping[str, Any]) -> list[str]:
    """The estimates beside the truth as an aligned table."""
    joints = {name: value["joints"][0] for name, value in summary["modalities"].items()}
    header = ["", *(LABELS.get(name, name) for name in joints), "truth"]
    first = next(iter(joints.values()))
    kind = first["type_true"]

    def row(title: str, cells: list[str], truth: str = "") -> list[str]:
        return [title, *cells, truth]

    def cells(key: str, scale: float, unit: str) -> list[str]:
        return [
            written(None if joint[key] is None else scale * joint[key], unit)
            for joint in joints.values()
        ]

    small, small_unit = (1000.0, "mm") if kind == JointType.PRISMATIC else (180.0 / np.pi, "deg")
    claims = [joint["configuration_std"] for joint in joints.values()]
    finest = min((claim for claim in claims if claim), default=math.nan)

    def configuration(value: float | None, joint_type: str | None) -> str:
        return written_configuration(value, joint_type or "", beside=finest)

    rows = [
        header,
        row("joint", [joint["type_estimated"] or "-" for joint in joints.values()], kind),
        row(
            "configuration",
            [
                configuration(joint["configuration_estimated"], joint["type_estimated"])
                for joint in joints.values()
            ],
            configuration(first["configuration_true"], kind),
        ),
        row("configuration error", cells("configuration_error", small, small_unit)),
        row("axis direction error", cells("axis_angle_error", 180.0 / np.pi, "deg")),
        row("type settled after", cells("type_settled_at", 1.0, "s")),
        row(
            "tick, median",
            [_milliseconds(summary["modalities"][name]["tick"]["median"]) for name in joints],
        ),
    ]
    if kind in (JointType.REVOLUTE, JointType.SCREW):
        rows.insert(5, row("axis distance error", cells("axis_distance_error", 1000.0, "mm")))
    if kind == JointType.SCREW:
        rows.insert(6, _pitch_row(joints.values()))
    return align(rows)


def _pitch_row(joints: Collection[Mapping[str, Any]]) -> list[str]:
    finest = min((joint["pitch_std"] for joint in joints if joint["pitch_std"]), default=math.nan)

    def cell(pitch: float | None) -> str:
        value = None if pitch is None else 1000.0 * pitch
        return written(value, "mm/rad", beside=1000.0 * finest, significant=3)

    pitches = [joint["pitch"] for joint in joints]
    return ["pitch", *map(cell, pitches), cell(next(iter(joints))["pitch_true"])]


def _milliseconds(seconds: float | None) -> str:
    return written(None if seconds is None else 1000.0 * seconds, "ms")


def align(rows: list[list[str]]) -> list[str]:
    """Rows of cells as lines; the first column to the left, the others to the right."""
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    lines = []
    for row in rows:
        cells = [row[0].ljust(widths[0])]
        cells += [cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True)]
        lines.append("  ".join(cells).rstrip())
    return lines


def manipulation(episode: JointEpisode, summary: Mapping[str, Any]) -> list[str]:
    """What the robot did, and what that truly came to in each phase.

    Nothing for a mere exploration that went as it should.
    """
    lost = any(event.name == GRASP_LOST for event in episode.record.events)
    if episode.record.scenario.task.goal is None and not lost:
        return []
    kind = episode.truth.joint_type
    if kind is None:
        return []
    done = ", ".join(f"{event.name} from {event.time:.1f} s" for event in episode.record.events)
    rows = [["", "goal", "reached", "error"]]
    for name, phase in summary["phases"].items():
        values = (phase["target"], phase["reached"], phase["error"])
        fine = phase["error"] or math.nan
        rows.append([name, *(written_configuration(v, kind, beside=fine) for v in values)])
    return [done, *align(rows)]


def report(episode: JointEpisode, summary: Mapping[str, Any]) -> list[str]:
    """What was perceived, how far that is from the truth, and what the robot did."""
    lines = ["Perceived joint:"]
    lines += [f"  {line}" for line in perceived(episode)]
    if measured := forces(summary):
        lines += ["", "Forces of the joint:"] + [f"  {line}" for line in measured]
    if summary["modalities"] and episode.truth.joint_type is not None:
        lines += ["", "Against the truth:"] + [f"  {line}" for line in comparison(summary)]
    if done := manipulation(episode, summary):
        lines += ["", "Manipulation:"] + [f"  {line}" for line in done]
    if held := grasp_lines(summary["grasp"]):
        lines += ["", "The grip:"] + [f"  {line}" for line in held]
    if faults := fault_lines(summary["stream_faults"]):
        lines += ["", "Streams that were not trusted:"] + [f"  {line}" for line in faults]
    return lines


def final_beliefs(summary: Mapping[str, Any]) -> pd.DataFrame:
    """What each modality believes of the joint at the end of a run, as text in mm or deg."""
    rows = {}
    for name, modality in summary["modalities"].items():
        joint = modality["joints"][0]
        scale, unit = (1e3, "mm") if joint["type_true"] == "prismatic" else (180.0 / np.pi, "deg")
        rows[LABELS.get(name, name)] = {
            "type": joint["type_estimated"],
            "probability": written(joint["probability"], significant=3),
            "configuration error": _scaled(joint["configuration_error"], scale, unit),
            "its deviation": _scaled(joint["configuration_std"], scale, unit),
            "axis direction error": _scaled(joint["axis_angle_error"], 180.0 / np.pi, "deg"),
        }
    return pd.DataFrame.from_dict(rows, orient="index")


def _scaled(value: float | None, scale: float, unit: str) -> str:
    return written(None if value is None else scale * value, unit)
