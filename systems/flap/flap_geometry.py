"""The lever from a hinge to a contact, normals that turn about it, and when a hinge is believed."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import number
from crossmodal.systems.port_values import (
    DisplacementBelief,
    FingertipContact,
    HingeBelief,
    displacement_at,
)


@dataclass(kw_only=True)
class HingeLimitsConfig:
    """Limits that every estimator of a hinge keeps to."""

    # Turn below which nothing is believed.
    least_turn: float = number(0.12, above=0.0, at_most=3.0, unit="rad")
    # Largest standard deviation of an axis that is believed.
    largest_direction: float = number(0.15, above=0.0, at_most=1.0, unit="rad")
    # Likewise of where it is.
    largest_distance: float = number(0.025, above=0.0, at_most=1.0, unit="m")


def is_believed(direction: Array, point: Array, limits: HingeLimitsConfig) -> bool:
    """Whether an axis is known well enough.

    Args:
        direction: Covariance (3, 3) of its direction, [rad^2]; NaN where there is none.
        point: Covariance (3, 3) of where it is, across it, [m^2].
    """
    if not (np.isfinite(direction).all() and np.isfinite(point).all()):
        return False
    return bool(
        np.linalg.eigvalsh(direction)[-1] < limits.largest_direction**2
        and np.linalg.eigvalsh(point)[-1] < limits.largest_distance**2
    )


CAMERA, FINGER, HOLDER = "camera", "finger", "holder"
NAMES = (CAMERA, HOLDER, FINGER)


def holder_given_others(belief: DisplacementBelief) -> tuple[Array, Array, Array]:
    """The holder's displacement by the camera's and the finger's x: m + G x, with a covariance.

    Returns:
        m (6,), G (6, 12) and the covariance (6, 6) of what they do not say.
    """
    mean, P = belief.of(CAMERA, FINGER, HOLDER)
    G = np.asarray(np.linalg.solve(P[:12, :12] + 1e-12 * np.eye(12), P[:12, 12:]).T, dtype=float)
    return mean[12:] - G @ mean[:12], G, P[12:, 12:] - G @ P[:12, 12:]


class Lever(NamedTuple):
    """From the axis to the contact, in the world.

    Attributes:
        u_W: From the nearest point on the axis (3,), [m].
        covariance: (3, 3); what displaces axis and contact together is not in it.
    """

    u_W: Array
    covariance: Array

    @property
    def length(self) -> float:
        """[m]"""
        return float(np.linalg.norm(self.u_W))

    @property
    def length_variance(self) -> float:
        """[m^2]"""
        unit = self.u_W / self.length
        return float(unit @ self.covariance @ unit)


def place_error(contact: FingertipContact) -> Array:
    """Covariance (3, 3) of the contact relative to the fingertip: its place on it, and noise."""
    p_SC_W = contact.p_WC - contact.X_WS[:3, 3]
    R = contact.X_WS[:3, :3]
    J = np.hstack([np.cross(np.eye(3), p_SC_W) @ R, R])
    common = J @ (contact.covariance - contact.white_covariance) @ J.T
    rest = contact.p_WC_covariance - common
    values, vectors = np.linalg.eigh(0.5 * (rest + rest.T))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)


def lever(hinge: HingeBelief, contact: FingertipContact) -> Lever:
    """The lever of a known hinge and a sensed contact."""
    across = np.eye(3) - np.outer(hinge.k_W, hinge.k_W)
    J = displacement_at(contact.p_WC, hinge.p_WQ)
    u = across @ (contact.p_WC - J @ hinge.displacements[:6] - hinge.p_WK)
    with_p = J @ hinge.displacement_covariance[3:6, :6].T
    displaced = J @ hinge.displacement_covariance[6:12, :6] @ J.T
    covariance = hinge.covariance[3:, 3:] + with_p + with_p.T + displaced + place_error(contact)
    return Lever(u, across @ covariance @ across)


def turned_normal(k: Array, n0: Array, angle: float) -> Array:
    """The normal (3,) turned by an angle about k, without its part along k (Rodrigues)."""
    n = n0 - k * (k @ n0)
    n = n / np.linalg.norm(n)
    return np.asarray(n * np.cos(angle) + np.cross(k, n) * np.sin(angle))


def angle_about(k: Array, n0: Array, n: Array) -> float:
    """Angle from n0 to n (3,) about k, within ±pi, [rad]."""
    return float(np.arctan2(k @ np.cross(n0, n), n0 @ n - (k @ n0) * (k @ n)))
