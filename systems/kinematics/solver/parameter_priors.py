"""Priors of an axis' distance and of a screw's pitch, mixtures over scales, compiled.

Most hinges are within reach of the body that they hold, a gate's is farther away, and a path that
is nearly straight may belong to a hinge at any distance. The prior of the axis' place is an equal
mixture of normal distributions about the body, one a scale, so that a far axis is not pulled near
and a straight path does not send it to infinity.

How steep screws are is a matter of scale, too: the lid of a jar climbs a millimetre per radian, a
press ten, a chute a hundred. The prior is a mixture of normal distributions about zero, each half
as common as the one before. It is flat near zero, so that no small pitch is favoured and a screw
that does not climb loses to the revolute joint by the pitches that it could have had. A real hinge
has a small pitch of its own. The model is solved with the widest of them; the others follow, since
the likelihood of the pitch, all other parameters marginalised, is near normal.
"""

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.compiled import hot
from crossmodal.systems.kinematics.keyframes.pose_keyframes import Keyframes

_FARTHER = (1.0, 4.0, 16.0)  # Multiples of the nearest scale.
_WELL_SEEN = 0.1**2  # Variance of a measured rotation, [rad^2].


@hot
def may_be_far(kf: Keyframes) -> bool:
    """Whether rotations are measured well enough to tell a far hinge from a bent slide."""
    R = kf.R[kf.size[0] - 1]
    return bool(max(R[0, 0], R[1, 1], R[2, 2]) < _WELL_SEEN)


@hot
def axis_prior(square: float, sigma: float, far: bool) -> tuple[float, float]:
    """Log density of an axis' place and its information per direction, linearised there.

    Without the constant of all normal densities.

    Args:
        square: Of the distance, [m^2].
        sigma: The nearest scale, standard deviation per direction, [m].
        far: Whether the axis may be farther away than that.
    """
    if not far:
        return -0.5 * square / sigma**2 - 2.0 * np.log(sigma), 1.0 / sigma**2
    total, information = 0.0, 0.0
    # Relative to this, no density is above one, and the widest is not zero.
    widest = sigma * _FARTHER[-1]
    top = -0.5 * square / widest**2 - 2.0 * np.log(sigma)
    for factor in _FARTHER:
        s = sigma * factor
        density = np.exp(-0.5 * square / s**2 - 2.0 * np.log(s) - top)
        total += density
        information += density / s**2
    return top + np.log(total / len(_FARTHER)), information / total


PITCHES = (1e-3, 1e-2, 1e-1)  # Standard deviations, the widest last, [m/rad].
WIDEST = PITCHES[-1]
_SHARES = (4.0 / 7.0, 2.0 / 7.0, 1.0 / 7.0)


@hot
def _component(scale: float, pitch: float, variance: float) -> tuple[float, float, float]:
    """Log evidence, mean and variance with one of the priors instead of the widest.

    Without the normaliser that all have in common.
    """
    information = 1.0 / variance - 1.0 / WIDEST**2 + 1.0 / scale**2
    mean = pitch / variance / information
    return 0.5 * mean**2 * information - 0.5 * np.log(information * scale**2), mean, 1 / information


@hot
def pitch_evidence(pitch: float, variance: float) -> float:
    """By how much the mixture's log evidence is more than that with the widest prior.

    Args:
        pitch: Its mean with the widest prior, [m/rad].
        variance: Its variance with it.
    """
    total, widest = 0.0, _component(WIDEST, pitch, variance)[0]
    for i in range(len(PITCHES)):
        scale, share = PITCHES[i], _SHARES[i]
        total += share * np.exp(_component(scale, pitch, variance)[0] - widest)
    return np.log(total)


@hot
def hinge_evidence(pitch: float, variance: float, of_hinges: float) -> float:
    """By how much a hinge's log evidence, with a small pitch of its own, is more than a screw's.

    Args:
        pitch: Of the screw, see `pitch_evidence`.
        variance: Of it.
        of_hinges: Standard deviation of a hinge's pitch, [m/rad].
    """
    widest = _component(WIDEST, pitch, variance)[0]
    hinge = _component(of_hinges, pitch, variance)[0]
    return hinge - widest - pitch_evidence(pitch, variance)


@hot
def pitch_posterior(pitch: float, variance: float) -> Array:
    """Weights, means and variances (S, 3) of the pitch, by scale; see `pitch_evidence`."""
    found, total, widest = np.empty((len(PITCHES), 3)), 0.0, _component(WIDEST, pitch, variance)[0]
    for i in range(len(PITCHES)):
        scale, share = PITCHES[i], _SHARES[i]
        evidence, found[i, 1], found[i, 2] = _component(scale, pitch, variance)
        found[i, 0] = share * np.exp(evidence - widest)
        total += found[i, 0]
    found[:, 0] /= total
    return found
