"""Which grasps hold, by geometry and statics on the true mesh of an object.

The fingers come down beside the object, close along x and touch it where their taxels and, a little
behind them, their cores meet it first. A grasp holds if, on both sides, most of the contact lies
within the friction cone and hardly turned aside: what is askew turns between the fingers, and may
leave them. Friction carries the weight, as far as fingers that press on a slope do not push it
down, without the object turning about the line between the contacts, the limit surface of both
loads taken for an ellipse, nor about the horizontal axis across it.

How strict that is was chosen on 110 simulated lifts of goods at random places and angles: all 22
that are said to hold were held, and so were 25 of the 88 others.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from crossmodal.controllers.primitives.move_object_config import GripConfig
from crossmodal.diagrams.clutter.training.shapes import Shape
from crossmodal.maths.arrays import Array, Mask
from crossmodal.maths.compiled import hot
from crossmodal.models.gripper_taxels import STICKS_OUT
from crossmodal.systems.grasping.grasp_geometry import (
    MARGIN,
    STROKE,
    fingertip_height,
    is_blocked,
    tops,
)
from crossmodal.systems.grasping.height_map import HeightMap

PAD_FRICTION = 0.8
_GRAVITY = 9.81  # [m/s²]
_GRIP = GripConfig()
# Where the fingers' faces are looked at: heights above their ends and places across, [m].
_ROWS = np.arange(0.003, 0.075, 0.005)
_COLUMNS = np.linspace(-0.009, 0.009, 5)
_CORE = (_ROWS > 0.025) & (_ROWS < 0.047)  # Between the arrays there are no taxels.
_POINTS = np.stack(np.meshgrid(_COLUMNS, _ROWS), axis=-1).reshape(-1, 2)
_RECESS = np.repeat(np.where(_CORE, STICKS_OUT, 0.0), len(_COLUMNS))
_GIVE = 1e-3  # By which taxels give: what is so near to the first contact is contact, [m].
_TAXEL = 0.002  # Mean distance from a contact's middle within a single taxel's part of it, [m].
_OPENINGS = (0.04, 0.07, 0.1, STROKE)  # In which an object is looked for, [m].
_ASKEW = np.tan(np.deg2rad(25.0))  # Largest slope of what faces a finger, to the side.
_ON_PAD = 0.009  # Farthest place of both contacts' middle from that of the fingers, across, [m].
_ERROR = 0.005  # Of a place, by arm and camera together; an object must not turn for it, [m].
_OFF_CENTRE = 0.004  # By which a grasp may be off the middle between the contacts, [m].
_LEAST_TOP = 0.01  # Of an object where it is grasped, [m].


@dataclass(frozen=True, kw_only=True)
class Contacts:
    """How grasps (N,) hold.

    Attributes:
        holds: Whether they do.
        middle: Of both contacts along x of the grasp, [m]; NaN without contacts.
        width: Between both contacts, [m].
        askew: Mean size of the contacts' slope to the side, the greater of both sides.
    """

    holds: Mask
    middle: Array
    width: Array
    askew: Array


def grip_force(mass: float) -> float:
    """Normal force of each finger that holds a mass [kg], as `Grip` lets it grow, [N]."""
    needed = 0.5 * mass * _GRAVITY / _GRIP.load
    return min(max(needed, _GRIP.force), _GRIP.largest_force)


@hot
def _first_contacts(corners: Array, grasps: Array, points: Array) -> tuple[Array, Array]:
    """Where closing fingers meet triangles first.

    Args:
        corners: (T, 3, 3) in W, counterclockwise from outside, heights above the table.
        grasps: (N, 5).
        points: Across and above the fingers' ends (P, 2), [m].

    Returns:
        x of the contacts (N, 2, P), of the finger at negative x and of the other one, both counted
        outwards from the middle, -inf where there is none; slopes (N, 2, P, 2) of the surface
        there, across and upwards: of its outward normal, over the part along x.
    """
    count = len(points)
    found = np.full((len(grasps), 2, count), -np.inf)
    slope = np.zeros((len(grasps), 2, count, 2))
    p = np.empty((3, 3))
    for n in range(len(grasps)):
        c, s, half = np.cos(grasps[n, 2]), np.sin(grasps[n, 2]), 0.5 * grasps[n, 3]
        for t in range(len(corners)):
            for i in range(3):
                dx, dy = corners[t, i, 0] - grasps[n, 0], corners[t, i, 1] - grasps[n, 1]
                p[i, 0], p[i, 1] = c * dx + s * dy, c * dy - s * dx
                p[i, 2] = corners[t, i, 2] - grasps[n, 4]
            low_y, high_y = min(p[0, 1], p[1, 1], p[2, 1]), max(p[0, 1], p[1, 1], p[2, 1])
            low_z, high_z = min(p[0, 2], p[1, 2], p[2, 2]), max(p[0, 2], p[1, 2], p[2, 2])
            if high_z < points[0, 1] or low_z > points[-1, 1]:
                continue
            if high_y < points[0, 0] or low_y > points[-1, 0]:
                continue
            ay, az = p[1, 1] - p[0, 1], p[1, 2] - p[0, 2]
            by, bz = p[2, 1] - p[0, 1], p[2, 2] - p[0, 2]
            ax, bx = p[1, 0] - p[0, 0], p[2, 0] - p[0, 0]
            nx = ay * bz - az * by
            if nx == 0.0:
                continue
            across, upwards = (az * bx - ax * bz) / abs(nx), (ax * by - ay * bx) / abs(nx)
            side = 1 if nx > 0.0 else 0
            for k in range(count):
                y, z = points[k, 0] - p[0, 1], points[k, 1] - p[0, 2]
                u, v = (y * bz - z * by) / nx, (ay * z - az * y) / nx
                if u < 0.0 or v < 0.0 or u + v > 1.0:
                    continue
                x = p[0, 0] + u * ax + v * bx
                x = x if side == 1 else -x
                if found[n, side, k] < x <= half:
                    found[n, side, k] = x
                    slope[n, side, k, 0], slope[n, side, k, 1] = across, upwards
    return found, slope


def find_contacts(shape: Shape, corners: Array, p_WCm: Array, grasps: Array) -> Contacts:
    """What grasps (N, 5) meet of a shape, and whether that holds.

    Args:
        shape: With mass and friction.
        corners: Of its triangles (T, 3, 3), in W, heights above the table, [m].
        p_WCm: Its centre of mass (3,), likewise.
        grasps: (N, 5).
    """
    friction = 2.0 * PAD_FRICTION * shape.friction / (PAD_FRICTION + shape.friction)
    met, slope = _first_contacts(corners, grasps, _POINTS)
    met = met - _RECESS
    first = met.max(axis=2)  # (N, 2)
    touched = np.isfinite(first).all(axis=1)
    first = np.where(touched[:, None], first, 0.0)
    contact = (met > first[..., None] - _GIVE) & touched[:, None, None]
    count = np.maximum(contact.sum(axis=2), 1)
    aside = np.abs(slope[..., 0])
    faces = (np.hypot(aside, slope[..., 1]) <= friction) & (aside <= _ASKEW)
    antipodal = ((contact & faces).sum(axis=2) >= 0.5 * count).all(axis=1)
    # Middle (N, 2, 2) of each contact, across and above the ends, and its extent.
    middle = np.einsum("nsp,pi->nsi", contact, _POINTS) / count[..., None]
    away = np.linalg.norm(_POINTS - middle[:, :, None], axis=-1)
    radius = np.maximum((contact * away).sum(axis=2) / count, _TAXEL).mean(axis=1)
    height = np.where(contact, _POINTS[:, 1], np.nan)
    with np.errstate(invalid="ignore"):
        high = np.where(contact, height, -np.inf).max(axis=2)
        low = np.where(contact, height, np.inf).min(axis=2)
    extent = np.where(touched, np.where(touched[:, None], high - low, 0.0).mean(axis=1), 0.0)
    width = first.sum(axis=1)
    apart = np.linalg.norm(middle[:, 0] - middle[:, 1], axis=1)
    antipodal &= np.abs(middle[:, :, 0].mean(axis=1)) <= _ON_PAD
    antipodal &= apart <= friction * np.maximum(width, 1e-3)
    x_middle = 0.5 * (first[:, 1] - first[:, 0])
    c, s = np.cos(grasps[:, 2]), np.sin(grasps[:, 2])
    dx, dy = (p_WCm[:2] - grasps[:, :2]).T
    along, across = c * dx + s * dy - x_middle, c * dy - s * dx - middle[:, :, 0].mean(axis=1)
    weight, force = shape.mass * _GRAVITY, grip_force(shape.mass)
    upwards = (contact * slope[..., 1]).sum(axis=2) / count
    carried = force * np.maximum(friction - upwards, 1e-6).sum(axis=1)
    load = weight / carried
    turn = weight * (np.abs(across) + _ERROR) / (2.0 * friction * force * radius)
    tilted = weight * np.abs(along)
    resists = np.maximum(carried - weight, 0.0) * 0.5 * width + force * extent
    holds = touched & antipodal & (load**2 + turn**2 <= 1.0) & (tilted <= resists)
    return Contacts(
        holds=holds,
        middle=np.where(touched, x_middle, np.nan),
        width=width,
        askew=((contact * aside).sum(axis=2) / count).max(axis=1),
    )


def find_grasps(
    shape: Shape,
    corners: Array,
    p_WCm: Array,
    view: HeightMap,
    heights: Array,
    count: int,
    rng: np.random.Generator,
    holding: bool = True,
) -> tuple[Array, Array]:
    """Grasps of an object that hold and are not blocked by itself.

    Args:
        shape: Of the object.
        corners: Of its triangles (T, 3, 3), in W, heights above the table, [m].
        p_WCm: Its centre of mass (3,), likewise.
        view: What is seen of it: that decides how deep the fingers go.
        heights: The object's true ones on the cells of the view, [m].
        count: How many places and angles are tried.
        rng: Draws them.
        holding: If not, all grasps at which both fingers meet the object, whether it holds or not.

    Returns:
        Rows (N, 5), see `grasp_geometry`, and how well each is liked (N,): straight contacts first,
        then narrow ones.
    """
    rows, columns = np.nonzero(_filled(view.heights > _LEAST_TOP))
    if len(rows) == 0:
        return np.zeros((0, 5)), np.zeros(0)
    chosen = rng.integers(len(rows), size=count)
    cells = np.column_stack([columns, rows])[chosen] + rng.uniform(-0.5, 0.5, (count, 2))
    left = np.column_stack(
        [view.places(cells), rng.uniform(0.0, np.pi, count), np.zeros((count, 2))]
    )
    found = []
    for opening in _OPENINGS:
        left[:, 3] = opening
        left[:, 4] = fingertip_height(tops(view.heights, left, view))
        contacts = find_contacts(shape, corners, p_WCm, left)
        good = contacts.holds if holding else np.isfinite(contacts.middle)
        good[good] = ~is_blocked(heights, left[good], view)
        grasps, middle, width = left[good], contacts.middle[good], contacts.width[good]
        left = left[~good]
        grasps[:, 0] += middle * np.cos(grasps[:, 2])
        grasps[:, 1] += middle * np.sin(grasps[:, 2])
        grasps[:, 3] = width + 2.0 * MARGIN
        found.append(grasps[grasps[:, 3] <= STROKE])
    grasps = np.concatenate(found)
    grasps[:, 4] = fingertip_height(tops(view.heights, grasps, view))
    contacts = find_contacts(shape, corners, p_WCm, grasps)
    good = contacts.holds if holding else np.isfinite(contacts.middle)
    good &= np.abs(contacts.middle) <= _OFF_CENTRE
    good &= ~is_blocked(heights, grasps, view)
    liking = -contacts.askew - 0.2 * grasps[:, 3] / STROKE
    return grasps[good], liking[good]


def _filled(mask: Mask) -> Mask:
    """With what is around holes, as of an open box."""
    parts, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    filled = np.zeros(mask.shape, np.uint8)
    cv2.drawContours(filled, parts, -1, 1, cv2.FILLED)
    return filled > 0
