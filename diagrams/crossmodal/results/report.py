"""Says in words and in a small table what was perceived and how good it was."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from crossmodal.diagrams.crossmodal.modalities import LABELS
from crossmodal.diagrams.crossmodal.results.grasp_episode import grasp_lines
from crossmodal.diagrams.crossmodal.task import GRASP_LOST
from crossmodal.diagrams.drawing.digits import fixed, written
from crossmodal.diagrams.evaluation.metric_table import readable
from crossmodal.diagrams.evaluation.stream_faults import fault_lines
from crossmodal.diagrams.joints.joint_metrics import (
    JointEpisode,
    axis_sign,
    configuration_since_grasp,
    drawn_in,
    last_seen,
    unit_of,
)
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
    scale, unit = drawn_in(joint_type)
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
    modalities = summary["modalities"]
    joints = [modality["joints"][0] for modality in modalities.values()]
    kind = joints[0]["type_true"]

    def row(title: str, key: str, unit: str) -> list[str]:
        return [title, *(_scaled(joint[key], unit) for joint in joints)]

    finest = min(joint["configuration_std"] or math.inf for joint in joints)
    configurations = [
        (joint["configuration_estimated"], joint["type_estimated"]) for joint in joints
    ]
    configurations.append((joints[0]["configuration_true"], kind))
    rows = [
        ["", *(LABELS.get(name, name) for name in modalities), "truth"],
        ["joint", *(joint["type_estimated"] or "-" for joint in joints), kind],
        [
            "configuration",
            *(written_configuration(q, of or "", beside=finest) for q, of in configurations),
        ],
        row("configuration error", "configuration_error", unit_of(kind)),
        row("axis direction error", "axis_angle_error", "rad"),
    ]
    if kind in (JointType.REVOLUTE, JointType.SCREW):
        rows.append(row("axis distance error", "axis_distance_error", "m"))
    if kind == JointType.SCREW:
        finest = min(joint["pitch_std"] or math.inf for joint in joints)
        pitches = [*(joint["pitch"] for joint in joints), joints[0]["pitch_true"]]
        rows.append(
            ["pitch", *(_scaled(p, "m/rad", beside=finest, significant=3) for p in pitches)]
        )
    rows.append(row("type settled after", "type_settled_at", "s"))
    ticks = (modality["tick"]["median"] for modality in modalities.values())
    rows.append(["tick, median", *(written(None if t is None else 1e3 * t, "ms") for t in ticks)])
    return align([[*cells, ""][: len(rows[0])] for cells in rows])


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
    against = summary["modalities"] and episode.truth.joint_type is not None
    sections = {
        "Perceived joint:": perceived(episode),
        "Forces of the joint:": forces(summary),
        "Against the truth:": comparison(summary) if against else [],
        "Manipulation:": manipulation(episode, summary),
        "The grip:": grasp_lines(summary["grasp"]),
        "Streams that were not trusted:": fault_lines(summary["stream_faults"]),
    }
    lines: list[str] = []
    for title, found in sections.items():
        if found or not lines:
            lines += ["", title, *(f"  {line}" for line in found)]
    return lines[1:]


def final_beliefs(summary: Mapping[str, Any]) -> pd.DataFrame:
    """What each modality believes of the joint at the end of a run, as text in mm or deg."""
    rows = {}
    for name, modality in summary["modalities"].items():
        joint = modality["joints"][0]
        unit = unit_of(joint["type_true"])
        rows[LABELS.get(name, name)] = {
            "type": joint["type_estimated"],
            "probability": written(joint["probability"], significant=3),
            "configuration error": _scaled(joint["configuration_error"], unit),
            "its deviation": _scaled(joint["configuration_std"], unit_of(joint["type_estimated"])),
            "axis direction error": _scaled(joint["axis_angle_error"], "rad"),
        }
    return pd.DataFrame.from_dict(rows, orient="index")


def _scaled(value: float | None, unit: str, *, beside: float = math.nan, **shown: Any) -> str:
    """A value in SI as it is written for people."""
    scale, readable_unit = readable(unit)
    scaled = None if value is None else scale * value
    return written(scaled, readable_unit, beside=scale * beside, **shown)
