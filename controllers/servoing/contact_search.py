"""Where the edge of a flap has gone that is no longer touched, and the path to it."""

from typing import Any

import numpy as np

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.vectors import cross


def turned_about(hinge: Any, angle: float, X_WS: Array) -> Array:
    """A pose (4, 4) after the flap, and what touches it, has turned about a `HingeBelief`."""
    k, p = hinge.k_W, hinge.p_WK
    screw = np.concatenate([k, -cross(k, p)])
    return np.asarray(se3.exp(angle * screw) @ X_WS)


def hinge_shift(hinge: Any, angle: float, p_W: Array) -> float:
    """How far a point (3,) goes in that, [m]."""
    return abs(angle) * float(np.linalg.norm(cross(hinge.k_W, p_W - hinge.p_WK)))


def next_on_arc(hinge: Any, X_WS_contact: Array, turn: float, X_WS: Array, step: float) -> float:
    """The angle [rad] to go to next, so that the path keeps outside of the flap's arc.

    Args:
        hinge: `HingeBelief`.
        X_WS_contact: Where the finger touched before the flap turned (4, 4).
        turn: Of the flap since then, [rad].
        X_WS: Where the finger is (4, 4).
        step: Largest angle from where the finger is, [rad].
    """
    rotation = np.ascontiguousarray(X_WS[:3, :3] @ X_WS_contact[:3, :3].T)
    turned = float(se3.so3_log(rotation) @ hinge.k_W)
    return turned + float(np.clip(turn - turned, -step, step))


def probe_offset(count: int, step: float) -> float:
    """By how much beside the expected place to seek next: 0, one step on, one back, two on."""
    return (count + 1) // 2 * (step if count % 2 else -step)


def backed_off(X_WS: Array, distance: float) -> Array:
    """A pose (4, 4) so far along its own -y, [m]."""
    back = X_WS.copy()
    back[:3, 3] -= distance * X_WS[:3, 1]
    return back


def twist_towards(X_WS: Array, X_WS_goal: Array, speed: float, time: float) -> Array:
    """V_WS_S (6,) that takes S to a goal in `time` [s] at the end, before at `speed` [m/s].

    The turn is spread over the whole path.
    """
    xi = se3.log(se3.inverse(X_WS) @ X_WS_goal)
    left = float(np.linalg.norm(xi[3:]))
    return np.asarray(xi / max(time, left / speed))


def is_there(X_WS: Array, X_WS_goal: Array, distance: float, angle: float) -> bool:
    """Whether S is at a goal within a distance [m] and an angle [rad]."""
    xi = se3.log(se3.inverse(X_WS) @ X_WS_goal)
    return bool(np.linalg.norm(xi[3:]) < distance and np.linalg.norm(xi[:3]) < angle)
