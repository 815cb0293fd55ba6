"""What is known of a screw's pitch before and after the measurements, compiled.

How steep screws are is a matter of scale: the lid of a jar climbs a millimetre per radian, a press
ten, a chute a hundred. The prior is an equal mixture of normal distributions about zero, one a
scale. All of it is even near zero, so that no small pitch is favoured and a screw that does not
climb loses to the revolute joint by what its pitch could have been.

The model is solved with the widest of them; what the others would have given follows, since the
likelihood of the pitch, all other parameters marginalised, is near normal.
"""

import numpy as np

from maths.compiled import hot

PITCHES = (1e-3, 1e-2, 1e-1)  # Standard deviations, the widest last, [m/rad].
WIDEST = PITCHES[-1]


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
    for scale in PITCHES:
        total += np.exp(_component(scale, pitch, variance)[0] - widest)
    return np.log(total / len(PITCHES))


@hot
def pitch_posterior(pitch: float, variance: float) -> tuple[float, float]:
    """Mean and variance of the pitch; see `pitch_evidence`."""
    mean, square, total, widest = 0.0, 0.0, 0.0, _component(WIDEST, pitch, variance)[0]
    for scale in PITCHES:
        evidence, m, v = _component(scale, pitch, variance)
        weight = np.exp(evidence - widest)
        total += weight
        mean += weight * m
        square += weight * (m**2 + v)
    mean /= total
    return mean, square / total - mean**2
