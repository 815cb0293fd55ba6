"""How likely a joint is if what the child strays from its path is smooth along the path.

The models are solved with strays that are independent from keyframe to keyframe (`path_floor`). But
a rail that bends or a camera's calibration errs alike at neighbouring places: a bend is one
accident, not one a keyframe, and no proof of a hinge far away or of a pitch. Here the strays are a
`stray_series`, whose coefficients are marginalised. The models' own solutions are where it is
linearised.
"""

import numpy as np

from crossmodal.maths import cholesky
from crossmodal.maths.arrays import Array
from crossmodal.maths.compiled import hot
from crossmodal.maths.in_place import assign
from crossmodal.systems.kinematics.joint_solver.axis_prior import may_be_far
from crossmodal.systems.kinematics.joint_solver.bent_slide import far_evidence
from crossmodal.systems.kinematics.joint_solver.joint_chain import (
    Chain,
    new_chain,
    run_chain,
    solve,
)
from crossmodal.systems.kinematics.joint_solver.joint_geometry import (
    BENT_SLIDE,
    JOINTS,
    PARAMETERS,
    REVOLUTE,
    RIGID,
    SCREW,
    dimension,
)
from crossmodal.systems.kinematics.joint_solver.joint_linearisation import (
    Linear,
    add_priors,
    clear,
    new_linear,
)
from crossmodal.systems.kinematics.joint_solver.joint_models import Models
from crossmodal.systems.kinematics.joint_solver.joint_pitch import pitch_evidence
from crossmodal.systems.kinematics.joint_solver.joint_solver import Priors, lever, trusted
from crossmodal.systems.kinematics.joint_solver.pose_keyframes import Keyframes
from crossmodal.systems.kinematics.joint_solver.stray_series import (
    add_keyframes,
    marginalise,
    new_series,
)

_ROUGH = 0.25  # Standard deviation of what is independent still, as a share of the strays'.
_FAR_BEHIND = 200.0  # Log evidence below the most from which it makes no difference, [nat].
# Log evidence that a model claims beyond what it has, from which it has not been solved yet, [nat].
_WAITS = 10.0


@hot
def _evidence(
    kind: int,
    m: Models,
    kf: Keyframes,
    priors: Priors,
    strays: Array,
    rough: Array,
    lin: Linear,
    chain: Chain,
) -> float:
    """Log evidence of a model about its own solution; solves `chain`.

    With smooth strays, if their covariance is not zero; a body at rest has none.
    """
    clear(lin)
    zero, still = int(np.int64(0)), np.zeros(PARAMETERS)
    series, is_smooth = new_series(), np.trace(strays) > 0.0 and kind != RIGID
    add_keyframes(kind, m, kf, rough, is_smooth, lin, series)
    if is_smooth:
        marginalise(dimension(kind), strays, series, lin)
    far = priors.far_axes and may_be_far(kf)
    add_priors(kind, m, priors.axis_distance, far, lin)
    n, value = dimension(kind), lin.value[0]
    if kind == RIGID:
        for i in range(n):
            chain.h[i] = lin.vector[i]
            for j in range(i + 1):
                chain.H[i, j] = lin.information[i, j]
    else:
        by = lever(kind, m, priors)
        S, J, sigma_v = m.process_noise[kind], priors.jump_noise / by**2, priors.speed / by
        value = run_chain(
            n, S, J, priors.jumps, sigma_v, 1.0, m.q[kind], kf, lin, still, zero, chain
        )
    evidence, gain = solve(n, value, chain)
    if kind == RIGID:
        return evidence
    # Of a step that goes too far, only a share can be trusted.
    share = trusted(kind, m.c[kind], m.pitch[kind], chain.step)
    assign(chain.step, share * chain.step)
    return evidence - gain * (1.0 - share) ** 2


def smooth_evidence(
    m: Models, kf: Keyframes, priors: Priors, strays: Array, evidence: Array, covariance: Array
) -> tuple[float, float]:
    """Writes log evidence (5,) of each model with smooth strays and covariance (J, N, N) of theta.

    That of the model's own solution, and by how much it is more with smooth instead of independent
    strays, both linearised there. A model that has not been solved lately keeps its own.

    Args:
        m: Models, solved.
        kf: Keyframes.
        priors: See `Priors`.
        strays: Their covariance (6, 6), in B.
        evidence: Result.
        covariance: Result; about the models' own solutions, which are not moved.

    Returns:
        The screw's pitch and its variance.
    """
    capacity, size = kf.time.size, kf.size[0]
    lin, chain, none = new_linear(capacity), new_chain(capacity), 0.0 * strays
    pitch, variance = m.pitch[SCREW], m.covariance[SCREW, 10, 10]
    evidence[:], covariance[:] = m.log_evidence, m.covariance
    # A screw that is no likelier than its limit, the hinge, is not solved for itself.
    is_hinge = evidence[SCREW] <= evidence[REVOLUTE]
    least, log_det = evidence.max() - _FAR_BEHIND, 0.5 * kf.log_det[:size].sum()
    for kind in range(JOINTS - 1, -1, -1):
        if evidence[kind] < least or (kind == SCREW and is_hinge):
            continue
        independent = _evidence(kind, m, kf, priors, none, kf.floor, lin, chain)
        if independent < evidence[kind] - m.marginal_evidence[kind] - log_det - _WAITS:
            continue
        smooth = _evidence(kind, m, kf, priors, strays, _ROUGH**2 * strays, lin, chain)
        evidence[kind] += smooth - independent
        n = dimension(kind)
        cholesky.inverse(chain.H, covariance[kind], n)
        covariance[kind, :n, :n] += np.outer(chain.step[:n], chain.step[:n])
        if kind == REVOLUTE and is_hinge:
            evidence[SCREW] += smooth - independent
        if kind == SCREW:
            evidence[SCREW] -= pitch_evidence(pitch, variance)
            pitch, variance = pitch + chain.step[10], chain.H[10, 10] ** -2
            evidence[SCREW] += pitch_evidence(pitch, variance)
    return pitch, variance


def bend(m: Models, kf: Keyframes, priors: Priors, strays: Array) -> float:
    """See `far_evidence`; with smooth strays if their covariance (6, 6) is not zero."""
    lin, series = new_linear(kf.time.size), new_series()
    is_smooth = np.trace(strays) > 0.0
    rough = _ROUGH**2 * strays if is_smooth else kf.floor
    add_keyframes(BENT_SLIDE, m, kf, rough, is_smooth, lin, series)
    if is_smooth:
        marginalise(dimension(BENT_SLIDE), strays, series, lin)
    return far_evidence(m, kf, priors, lin)
