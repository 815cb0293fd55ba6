"""What `crossmodal inspect` says of a model."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from crossmodal.plants.hands.soft_hand import SOFT_HAND_RANGE
from crossmodal.plants.object_import.inspection import Handle, Inspection, JointFacts


def report(found: Inspection, source: Path) -> list[str]:
    """Links, joints, frames and handles, in lines for a terminal."""
    moving = [joint for joint in found.joints if joint.moves]
    lines = [
        f"{source.name}: {_count(len(found.links), 'link')}, {_count(len(moving), 'moving joint')},"
        f" {_size(found.size)}",
        "",
        "Links",
        *_table((x.name, _size(x.size), _mass(x.mass)) for x in found.links),
        "Joints",
        *_table((x.name, x.kind, f"{x.parent} -> {x.child}", _limits(x)) for x in found.joints),
    ]
    if found.frames:
        lines += ["Frames", *_table((name, f"on {link}") for name, link in found.frames.items())]
    lines.append("Likely handles, x out of the object, y along the bar")
    lines += _table((x.grasp_frame, _bar(x), f"moved by {x.joint}") for x in found.handles)
    if all(handle.faults for handle in found.handles):
        can = SOFT_HAND_RANGE
        lines.append(
            f"  none: the hand holds bars of {1e3 * can.least_thickness:.0f} to"
            f" {1e3 * can.most_thickness:.0f} mm with {1e3 * can.clearance:.0f} mm free behind"
            " them; --grasp-frame LINK@x,y,z,roll,pitch,yaw names another place"
        )
    return lines


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def _size(size: np.ndarray) -> str:
    if not np.any(size):
        return "no geometry"
    return " x ".join(f"{value:.3g}" for value in size.round(3)) + " m"


def _mass(mass: float) -> str:
    return f"{mass:.3g} kg" if np.isfinite(mass) else ""


def _limits(joint: JointFacts) -> str:
    if not joint.moves:
        return ""
    if np.isinf(joint.lower) and np.isinf(joint.upper):
        return "no limits"
    if joint.kind == "prismatic":
        return f"{joint.lower:zg} to {joint.upper:zg} m"
    low, high = np.rad2deg([joint.lower, joint.upper])
    return f"{joint.lower:z.3g} to {joint.upper:z.3g} rad ({low:z.0f} to {high:z.0f} deg)"


def _bar(handle: Handle) -> str:
    bar = handle.bar
    is_edge = max(bar.thickness) > SOFT_HAND_RANGE.most_depth and not handle.faults
    if is_edge:
        return (
            f"free edge, {1e3 * min(bar.thickness):.0f} mm thick, {1e3 * handle.length:.0f} mm long"
        )
    text = f"{1e3 * max(bar.thickness):.0f} mm thick"
    if np.isfinite(handle.length):
        text += f", {1e3 * handle.length:.0f} mm long"
    if np.isfinite(bar.clearance):
        text += f", {1e3 * bar.clearance:.0f} mm free behind it"
    if handle.faults:
        text += f"; the hand may not hold it: {', '.join(handle.faults)}"
    return text


def _table(rows: Iterable[Sequence[str]]) -> list[str]:
    """Rows with their columns below each other."""
    listed = list(rows)
    widths = [max(map(len, column)) for column in zip(*listed, strict=True)]
    return [
        "  "
        + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in listed
    ]
