"""Whether it is the camera that has jumped, since all that it sees has, and by how much.

What is at rest is seen displaced by Y if the camera is displaced by X_SC:

    p_seen = Y p_expected,    Y = X_WS X_SC^-1 X_WS^-1,

and so is all that moves, from where it is expected. A scene can look alike: a body that fills the
view begins to move. What tells them apart is compared as probabilities:

- how often cameras are knocked, and bodies begin to move;
- how far: a knocked camera by any size, a body from one tick to the next only by what its
  acceleration allows;
- how many of the features move: with a camera all, but for outliers; with a body any share of them
  is as likely;
- that something that rests and something that moves already jump by the same: by chance, if it is
  no camera.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaln, logsumexp

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array, Mask
from crossmodal.maths.gaussian import outlier_gate
from crossmodal.maths.rigid_points import pose_jacobian
from crossmodal.maths.validation import number
from crossmodal.systems.vision.bodies.feature_displacements import squared_distances
from crossmodal.systems.vision.bodies.rigid_body_motion_config import BodyDynamicsConfig
from crossmodal.systems.vision.camera_geometry import transform

_GATE = outlier_gate(3)
_ROUNDS = 8  # Of the robust fit; its width halves in each.
_SIZES = (0.1, 0.3, 1.0)  # Of a jump, as shares of a hard knock's; each as likely.


@dataclass(kw_only=True)
class CameraJumpConfig:
    """How cameras are knocked, and how bodies begin to move."""

    # How often a camera is knocked.
    rate: float = number(1.0 / 600.0, above=0.0, at_most=1.0, unit="1/s")
    # Standard deviation of its turn, of knocks that are hard.
    rotation: float = number(0.02, above=0.0, at_most=3.0, unit="rad")
    # The same of its shift.
    translation: float = number(0.01, above=0.0, at_most=10.0, unit="m")
    # How often a body begins to move.
    onset_rate: float = number(0.1, above=0.0, at_most=100.0, unit="1/s")
    # Share of features that are lost or mistaken when a camera jumps.
    outliers: float = number(0.05, above=0.0, below=0.5)
    # Odds from which on a jump is believed.
    odds: float = number(100.0, at_least=1.0, at_most=1e9)
    # Least number of features that have to be displaced.
    least_features: int = number(12, at_least=6, at_most=10000)


@dataclass(frozen=True, kw_only=True)
class Displacement:
    """A rigid motion that features share, and which follow it.

    Attributes:
        Y: p = Y q of expected q and seen p, in W (4, 4).
        centre: About which the covariance is (3,), [m].
        covariance: (6, 6) of xi in p - c = exp(xi) Y_c (q - c), rotation first, [rad, m].
        follows: Which features (N,) fit.
    """

    Y: Array
    centre: Array
    covariance: Array
    follows: Mask


def fit_displacement(p: Array, q: Array, C: Array) -> Displacement:
    """The rigid motion of most features: weighted least squares, robust against the others.

    Args:
        p: Where features are seen (N, 3), [m].
        q: Where they are expected (N, 3), [m].
        C: Covariances (N, 3, 3) of p - q, [m^2].
    """
    centre, information = q.mean(axis=0), np.linalg.inv(C)
    Y, width = np.eye(4), np.inf
    normal = np.eye(6)
    for _ in range(_ROUNDS):
        now = transform(Y, q - centre)
        e = p - centre - now
        distance = np.einsum("ni,nij,nj->n", e, information, e)
        width = max(_GATE, min(0.5 * width, 2.0 * float(np.median(distance))))
        weight = (width / (width + distance)) ** 2
        J = pose_jacobian(now)
        JI = J.transpose(0, 2, 1) @ information
        normal = np.einsum("n,nab->ab", weight, JI @ J)
        Y = se3.exp(np.linalg.solve(normal, np.einsum("n,nai,ni->a", weight, JI, e))) @ Y
    e = p - centre - transform(Y, q - centre)
    shift = np.eye(4)
    shift[:3, 3] = centre
    return Displacement(
        Y=shift @ Y @ se3.inverse(shift),
        centre=centre,
        covariance=np.asarray(np.linalg.inv(normal)),
        follows=squared_distances(e, C)[0] < _GATE,
    )


def jump_odds(
    config: CameraJumpConfig,
    dynamics: BodyDynamicsConfig,
    found: Displacement,
    displaced: Mask,
    groups: int,
    X_WC: Array,
    Y_expected: Array,
    period: float,
) -> float:
    """Log of the odds that the camera has jumped, against that a body has begun to move.

    Args:
        config: How cameras are knocked.
        dynamics: How bodies accelerate.
        found: The motion.
        displaced: Which features (N,) are not where they were expected.
        groups: How many bodies have jumped by it, the resting world as one.
        X_WC: Of the camera (4, 4).
        Y_expected: What the motion would be if it went on as before (4, 4).
        period: Of the ticks, [s].
    """
    moved = int(np.sum(found.follows & displaced))
    stayed = int(np.sum(~found.follows & ~displaced))
    shift = np.eye(4)
    shift[:3, 3] = found.centre
    seen = se3.log(se3.inverse(shift) @ found.Y @ se3.inverse(Y_expected) @ shift)
    camera = se3.log(se3.inverse(X_WC) @ found.Y @ X_WC)
    scales = np.repeat([config.rotation, config.translation], 3)
    by_camera = float(
        logsumexp([_log_normal(camera, (size * scales) ** 2) for size in _SIZES])
        - np.log(len(_SIZES))
    )
    # What is expected is extrapolated from two ticks: once, twice and once this tick's error.
    of_body = dynamics.process_noise * period**3 / 3.0 + 6.0 * np.diagonal(found.covariance)
    by_body = _log_normal(seen, of_body)
    # As likely any share of them: a beta distribution.
    share = gammaln(moved + 1) + gammaln(stayed + 1) - gammaln(moved + stayed + 2)
    camera_odds = np.log(config.rate) + by_camera + stayed * np.log(config.outliers)
    body_odds = np.log(config.onset_rate) + by_body + share
    alike = _log_normal(np.zeros(6), np.diagonal(found.covariance))
    again = np.log(config.onset_rate * period) + by_body - alike
    return float(camera_odds - body_odds - max(groups - 1, 0) * min(again, 0.0))


def _log_normal(x: Array, variances: Array) -> float:
    return -0.5 * float(np.sum(x**2 / variances + np.log(2.0 * np.pi * variances)))
