"""What is known of a screw's pitch before and after the measurements, compiled.

How steep screws are is a matter of scale: the lid of a jar climbs a millimetre per radian, a press
ten, a chute a hundred. The prior is a mixture of normal distributions about zero, one a scale, each
half as common as the one before. All of it is even near zero, so that no small pitch is favoured
and a screw that does not climb loses to the revolute joint by what its pitch could have been. Nor
does a real hinge keep its height: it has a small pitch of its own.

The model is solved with the widest of them; what the others would have given follows, since the
likelihood of the pitch, all other parameters marginalised, is near normal.
"""

import numpy as np

from crossmodal.maths.compiled import hot

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
def pitch_posterior(pitch: float, variance: float) -> tuple[float, float]:
    """Mean and variance of the pitch; see `pitch_evidence`."""
    mean, square, total, widest = 0.0, 0.0, 0.0, _component(WIDEST, pitch, variance)[0]
    for i in range(len(PITCHES)):
        scale, share = PITCHES[i], _SHARES[i]
        evidence, m, v = _component(scale, pitch, variance)
        weight = share * np.exp(evidence - widest)
        total += weight
        mean += weight * m
        square += weight * (m**2 + v)
    mean /= total
    return mean, square / total - mean**2
