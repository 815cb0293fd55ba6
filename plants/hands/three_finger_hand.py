"""The hand with three fingers: how it closes around a bar."""

import numpy as np

from crossmodal.maths.arrays import Array

JOINTS = [f"{finger}_joint_{n}" for finger in ("thumb", "left", "right") for n in (1, 2)]

# Of models/sdf/three_finger_hand.sdf, [m].
_PROXIMAL = 0.045  # Length of a finger's first link.
_JOINT = 0.040  # Of a finger's first joint, from the hand's middle plane.
_PAD = 0.013  # From a finger's line to the surface of its pad.
_PAD_PLACE = 0.025  # Of the pad's middle, along a finger's second link.
# Share of the thumb's force that each finger bears: thumb, left, right.
_SHARES = np.array([1.0, 0.5, 0.5])


def closed_posture(thickness: float) -> Array:
    """Joint angles (6,) at which the pads touch a bar, parallel to it, [rad].

    Args:
        thickness: Of the bar, [m].

    Raises:
        ValueError: for a bar that does not fit between the fingers.
    """
    angle = _proximal_angle(thickness)
    return np.tile([angle, -angle], 3)


def grip_torques(thickness: float, force: float) -> Array:
    """Joint torques (6,) at which the closed fingers press on a bar, [N m].

    Args:
        thickness: Of the bar, [m].
        force: Of the thumb, against which the two others press, [N].
    """
    lever = _PROXIMAL * np.cos(_proximal_angle(thickness)) + _PAD_PLACE
    return np.asarray(force * np.outer(_SHARES, [lever, _PAD_PLACE]).ravel())


def _proximal_angle(thickness: float) -> float:
    sine = (_JOINT - _PAD - 0.5 * thickness) / _PROXIMAL
    if not 0.0 <= sine < 0.8:
        raise ValueError(f"the hand does not close around a bar of {1e3 * thickness:.0f} mm")
    return float(np.arcsin(sine))
