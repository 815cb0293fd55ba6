"""Bars that a hand could close around: what there is at a grasp frame."""

from dataclasses import dataclass

import numpy as np
import trimesh

from crossmodal.maths.arrays import Array
from crossmodal.plants.hands.soft_hand import GraspRange

_SPACING = 0.002  # Between points on the outline of a section, [m].
_FINGERS = 0.036  # From the frame to the outermost fingers, along the bar, [m].
_BEHIND = 0.03  # Half height of what the fingers pass through behind the bar, [m].


@dataclass(kw_only=True)
class Bar:
    """A bar where a hand is to close.

    Attributes:
        thickness: Largest extent (2,) of its cross-section along the frame's x and z, [m].
        clearance: Free space behind it, against the frame's x, [m]; infinite where nothing is.
        tilt: From the frame's y to its direction, [rad].
        distance: From the frame's origin to it, 0 inside of it, [m].
        middle: Of its section (3,), in the frame, [m].
        behind: From the frame's origin to what is behind the bar, [m]; infinite where nothing is.
        ahead: How far it reaches from the frame's origin along its x, [m].
        beside: Distance from the frame's origin along its z to the nearest of what else is where
            fingers close around an edge, [m]; infinite where nothing is.
    """

    thickness: Array
    clearance: float
    tilt: float
    distance: float
    middle: Array
    behind: float
    ahead: float
    beside: float


def bar_at(solid: trimesh.Trimesh, reach: float) -> Bar | None:
    """The bar around the origin of a grasp frame; None where nothing is within `reach`.

    Args:
        solid: What can be touched, in the grasp frame: x out of the object, y along the bar.
        reach: Greatest distance of the bar from the origin, [m].
    """
    here, others, distance = _section(solid, 0.0)
    if len(here) == 0 or distance > reach:
        return None
    middle = 0.5 * (here.min(axis=0) + here.max(axis=0))
    along, rest = [np.array([middle[0], 0.0, middle[2]])], [others]
    for y in (-_FINGERS, _FINGERS):
        there, beside, _ = _section(solid, y, middle)
        # The bar goes on where a section of about its size is near.
        if len(there) and np.all(np.ptp(there, axis=0) < 1.5 * np.ptp(here, axis=0) + 0.01):
            center = 0.5 * (there.min(axis=0) + there.max(axis=0))
            if np.hypot(*(center - middle)[[0, 2]]) < 1.5 * _FINGERS:
                along.append(center)
                rest.append(beside)
    points = np.concatenate(rest)
    around = np.abs(points[points[:, 0] > -_FINGERS, 2])
    face = float(here[:, 0].min())
    # Fingers close on both sides of a stem in the middle.
    rest[0] = others[np.abs(others[:, 2] - middle[2]) > 0.5 * np.ptp(here[:, 2])]
    points = np.concatenate(rest)
    near = (np.abs(points[:, 2] - middle[2]) < _BEHIND) & (points[:, 0] < face + _SPACING)
    points = points[near]
    behind = -float(min(points[:, 0].max(), face)) if len(points) else np.inf
    way = along[-1] - along[1] if len(along) > 2 else along[-1] - along[0]
    tilt = float(np.arctan2(np.hypot(way[0], way[2]), abs(way[1]))) if np.any(way) else 0.0
    thickness = np.ptp(here, axis=0)[[0, 2]] * np.cos(tilt)
    return Bar(
        thickness=thickness,
        clearance=face + behind,
        tilt=tilt,
        distance=distance,
        middle=along[0],
        behind=behind,
        ahead=float(here[:, 0].max()),
        beside=float(around.min(initial=np.inf)),
    )


def faults_of_bar(bar: Bar, can: GraspRange) -> list[str]:
    """What of a bar or a board's edge is outside of what a hand can hold, in a few words each."""
    depth, height = bar.thickness
    if depth > can.most_depth and height <= can.most_thickness and bar.ahead <= can.edge:
        if bar.beside >= can.beside:
            return []
        return [
            f"{1e3 * bar.beside:.0f} mm are free beside the edge's middle, the fingers need"
            f" {1e3 * can.beside:.0f} mm"
        ]
    closes = (
        f"it closes around {1e3 * can.least_thickness:.0f} to {1e3 * can.most_thickness:.0f} mm"
    )
    faults = []
    if height > can.most_thickness or depth > can.most_depth:
        faults.append(
            f"it is {1e3 * max(depth, height):.0f} mm thick, {closes}"
            " (y of the frame along the bar, x out of the object)"
        )
    elif min(depth, height) < can.least_thickness:
        faults.append(f"it is {1e3 * min(depth, height):.1f} mm thin, {closes}")
    if bar.tilt > can.tilt and not faults:
        faults.append(
            f"it is {np.rad2deg(bar.tilt):.0f} deg off the frame's y, and may be"
            f" {np.rad2deg(can.tilt):.0f}; turn the frame's y along the bar"
        )
    if bar.clearance < can.clearance:
        faults.append(
            f"{1e3 * bar.clearance:.0f} mm are free behind it, the fingers need"
            f" {1e3 * can.clearance:.0f} mm"
        )
    elif bar.behind < can.behind:
        faults.append(
            f"{1e3 * bar.behind:.0f} mm are between the frame and what is behind it, the fingers"
            f" need {1e3 * can.behind:.0f} mm; put the frame farther out, along its x"
        )
    return faults


def _section(
    solid: trimesh.Trimesh, y: float, near: Array | None = None
) -> tuple[Array, Array, float]:
    """Outline of the part nearest to a point, of the other parts, and the distance to it.

    Args:
        solid: What is cut by the plane at `y`.
        near: The point (3,), of which x and z count; by default the origin.

    Returns:
        Points (n, 3) and (m, 3), and a distance [m].
    """
    point = np.zeros(3) if near is None else near
    # Off the symmetry of models, where the plane would run along edges.
    segments = trimesh.intersections.mesh_plane(solid, [0.0, 1.0, 0.0], [0.0, y + 1.3e-5, 0.0])
    if len(segments) == 0:
        return np.zeros((0, 3)), np.zeros((0, 3)), np.inf
    labels = _connected(segments)
    outlines = [segments[labels == label] for label in range(labels.max() + 1)]
    pieces = [_points(outline) for outline in outlines]
    distances = [
        0.0
        if _is_inside(outline[:, :, [0, 2]], point[[0, 2]])
        else float(np.linalg.norm((piece - point)[:, [0, 2]], axis=1).min())
        for outline, piece in zip(outlines, pieces, strict=True)
    ]
    # Of those that hold the point, the bar is the smallest.
    nearest = min(range(len(pieces)), key=lambda k: (distances[k], np.ptp(pieces[k], axis=0).max()))
    low, high = pieces[nearest].min(axis=0), pieces[nearest].max(axis=0)
    others = [
        piece
        for piece in (*pieces[:nearest], *pieces[nearest + 1 :])
        if np.any(piece.min(axis=0) < low - 1e-6) or np.any(piece.max(axis=0) > high + 1e-6)
    ]  # Without what is inside of it.
    rest = np.concatenate(others) if others else np.zeros((0, 3))
    return pieces[nearest], rest, distances[nearest]


def _connected(segments: Array) -> Array:
    """A label (n,) for each of the segments (n, 2, 3); those that share an end have the same."""
    _, ends = np.unique(np.round(segments.reshape(-1, 3), 6), axis=0, return_inverse=True)
    pairs = ends.reshape(-1, 2)
    labels = trimesh.graph.connected_component_labels(pairs, int(ends.max()) + 1)
    _, labels = np.unique(labels[pairs[:, 0]], return_inverse=True)
    return np.asarray(labels)


def _points(segments: Array) -> Array:
    """Points (m, 3) along segments (n, 2, 3)."""
    lengths = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1)
    counts = np.ceil(lengths / _SPACING).astype(int) + 1
    rows = [
        start + np.linspace(0.0, 1.0, count)[:, None] * (end - start)
        for (start, end), count in zip(segments, counts, strict=True)
    ]
    return np.concatenate(rows)


def _is_inside(segments: Array, point: Array) -> bool:
    """Whether a point (2,) is inside of an outline of segments (n, 2, 2), each once or twice.

    A ray from it crosses the outline an odd number of times.
    """
    ends = np.round(segments, 6)
    ends = np.unique([sorted(pair) for pair in ends.tolist()], axis=0) - point
    (x, y), (other_x, other_y) = ends[:, 0].T, ends[:, 1].T
    crossing = (y > 0.0) != (other_y > 0.0)
    slope = (other_x - x)[crossing] / (other_y - y)[crossing]
    return bool(np.sum(x[crossing] - y[crossing] * slope > 0.0) % 2)
