"""Says in words and in a small table what was perceived and how good it was."""

from pathlib import Path
from typing import Any

import numpy as np

from diagrams.crossmodal.task import GRASP_LOST
from diagrams.drawing.palette import MODALITY_LABEL
from diagrams.joints.joint_metrics import axis_sign, joint_series, last_seen
from diagrams.run.record import EpisodeResult
from maths.arrays import Array
from systems.port_values import JointBelief, JointType


def describe_configuration(joint: JointBelief | None, axis_true: Array | None = None) -> str:
    """The opening a joint belief stands for, with its standard deviation, in cm or deg."""
    if joint is None:
        return "no joint seen"
    if joint.type not in (JointType.PRISMATIC, JointType.REVOLUTE):
        return str(joint.type)
    model = joint.model
    sign = 1.0 if axis_true is None else axis_sign(model.axis_P, axis_true)
    std = float(np.sqrt(max(model.configuration_covariance[0, 0], 0.0)))
    return format_opening(sign * float(model.configuration[0]), std, joint.type)


def format_opening(value: float | None, std: float | None, joint_type: JointType | str) -> str:
    """An opening with its uncertainty in a unit to read."""
    if value is None:
        return "-"
    prismatic = joint_type != JointType.REVOLUTE
    scale, unit = (100.0, "cm") if prismatic else (180.0 / np.pi, "deg")
    digits = 2 if prismatic else 1
    spread = "" if std is None else f" ± {scale * std:.{digits}f}"
    return f"{scale * value:.{digits}f}{spread} {unit}"


def perceived(result: EpisodeResult) -> list[str]:
    """One sentence per modality: type, axis and opening, each with its uncertainty."""
    lines = []
    for name, record in result.modalities.items():
        series = joint_series(record.ticks, result.truth)
        last = last_seen(series)
        joint = None if last is None else series.joints[last]
        label = f"{MODALITY_LABEL[name]}:".ljust(16)
        if joint is None:
            lines.append(f"{label}no joint seen")
            continue
        text = f"{joint.type} (p = {joint.probabilities[joint.type]:.3f})"
        if joint.type in (JointType.PRISMATIC, JointType.REVOLUTE):
            axis = axis_sign(joint.model.axis_P, result.truth.axis_W) * joint.model.axis_P
            components = ", ".join(f"{component:+.3f}" for component in axis)
            spread = np.rad2deg(series.axis_std[last])
            text += f", axis ({components}) ± {spread:.2f} deg"
            opening = float(series.configuration[last])
            std = float(series.configuration_std[last])
            text += f", opening {format_opening(opening, std, joint.type)}"
        if last is not None and result.duration - series.times[last] > 0.5:
            text += f"; last seen at {series.times[last]:.1f} s"
        lines.append(label + text)
    return lines


def comparison(summary: dict[str, Any]) -> list[str]:
    """The estimates beside the truth as an aligned table."""
    joints = {name: value["joints"][0] for name, value in summary["modalities"].items()}
    header = ["", *(MODALITY_LABEL[name] for name in joints), "truth"]
    first = next(iter(joints.values()))
    kind = first["type_true"]

    def row(title: str, cells: list[str], truth: str = "") -> list[str]:
        return [title, *cells, truth]

    def cells(key: str, scale: float, digits: int, unit: str) -> list[str]:
        return [
            "-" if joint[key] is None else f"{scale * joint[key]:.{digits}f} {unit}"
            for joint in joints.values()
        ]

    small, small_unit = (1000.0, "mm") if kind == JointType.PRISMATIC else (180.0 / np.pi, "deg")
    rows = [
        header,
        row("joint", [joint["type_estimated"] or "-" for joint in joints.values()], kind),
        row(
            "opening",
            [
                format_opening(
                    joint["configuration_estimated"], None, joint["type_estimated"] or ""
                )
                for joint in joints.values()
            ],
            format_opening(first["configuration_true"], None, kind),
        ),
        row("opening error", cells("configuration_error", small, 1, small_unit)),
        row("axis error", cells("axis_angle_error", 180.0 / np.pi, 2, "deg")),
        row("type settled after", cells("type_settled_at", 1.0, 1, "s")),
        row(
            "tick, median",
            [_milliseconds(summary["modalities"][name]["tick"]["median"]) for name in joints],
        ),
    ]
    if kind == JointType.REVOLUTE:
        rows.insert(5, row("axis distance", cells("axis_distance_error", 1000.0, 1, "mm")))
    return align(rows)


def _milliseconds(seconds: float | None) -> str:
    return "-" if seconds is None else f"{1000.0 * seconds:.1f} ms"


def align(rows: list[list[str]]) -> list[str]:
    """Rows of cells as lines; the first column to the left, the others to the right."""
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    lines = []
    for row in rows:
        cells = [row[0].ljust(widths[0])]
        cells += [cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True)]
        lines.append("  ".join(cells).rstrip())
    return lines


def speed(summary: dict[str, Any]) -> str:
    """How fast it ran and what memory it took."""
    factor = summary["real_time_factor"]
    text = f"{summary['duration']:.1f} s simulated in {summary['wall_time']:.1f} s"
    if factor is not None:
        text += f" (real-time factor {factor:.2f})"
    if summary["peak_memory"]:
        text += f", peak memory {summary['peak_memory'] / 1e9:.2f} GB"
    return text


def manipulation(result: EpisodeResult, summary: dict[str, Any]) -> list[str]:
    """What the robot did, and what that truly came to in each phase.

    Nothing for a mere exploration that went as it should.
    """
    lost = any(event.name == GRASP_LOST for event in result.events)
    if result.scenario.task.goal is None and not lost:
        return []
    kind = result.truth.joint_type
    done = ", ".join(f"{event.name} from {event.time:.1f} s" for event in result.events)
    rows = [["", "goal", "reached", "error"]]
    for name, phase in summary["phases"].items():
        values = (phase["target"], phase["reached"], phase["error"])
        rows.append([name, *(format_opening(value, None, kind) for value in values)])
    return [done, *align(rows)]


def report(result: EpisodeResult, summary: dict[str, Any], written: list[Path]) -> str:
    """All that a person wants to know after a run."""
    lines = ["", "Perceived joint:"]
    lines += [f"  {line}" for line in perceived(result)]
    if summary["modalities"]:
        lines += ["", "Against the truth:"] + [f"  {line}" for line in comparison(summary)]
    if done := manipulation(result, summary):
        lines += ["", "Manipulation:"] + [f"  {line}" for line in done]
    lines += ["", speed(summary), "", "Files:"]
    lines += [f"  {path}" for path in written]
    if result.failure is not None and not result.interrupted:
        lines += ["", f"The episode failed: {result.failure}"]
    return "\n".join(lines)
