"""The evidence of the joint types, from what the models say near each other's limits.

A slide is the limit of hinges far away, a hinge the limit of screws without pitch. What a model's
own solution says is Laplace's approximation about it; near a limit the other model's is better.
"""

from maths.arrays import Array
from maths.compiled import hot
from systems.kinematics.joint_solver.axis_prior import may_be_far
from systems.kinematics.joint_solver.bent_slide import bent_evidence
from systems.kinematics.joint_solver.joint_geometry import PRISMATIC, REVOLUTE, SCREW
from systems.kinematics.joint_solver.joint_models import Models
from systems.kinematics.joint_solver.joint_pitch import hinge_evidence
from systems.kinematics.joint_solver.joint_solver import Priors
from systems.kinematics.joint_solver.pose_keyframes import Keyframes

_AHEAD = 3.0  # Log evidence over the slide's from which a hinge's own solution counts, [nat].
_FAR_BEHIND = 20.0  # Log evidence below the most from which a slide's makes no difference, [nat].


@hot
def type_evidence(m: Models, kf: Keyframes, priors: Priors) -> Array:
    """Log evidence (5,) of each type.

    Args:
        m: Models, solved.
        kf: Keyframes.
        priors: See `Priors`.
    """
    evidence = m.log_evidence.copy()
    pitch, variance = m.pitch[SCREW], m.covariance[SCREW, 10, 10]
    hinge = evidence[SCREW] + hinge_evidence(pitch, variance, priors.hinge_pitch)
    evidence[REVOLUTE] = max(evidence[REVOLUTE], hinge)
    slide = evidence[PRISMATIC]
    matters = evidence.max() - _FAR_BEHIND < slide and evidence[REVOLUTE] < slide + _AHEAD
    if matters and priors.far_axes and may_be_far(kf):
        far = slide + bent_evidence(m, kf, priors)
        evidence[REVOLUTE] = max(evidence[REVOLUTE], far)
        # So far away a screw's pitch makes no difference.
        evidence[SCREW] = max(evidence[SCREW], far)
    return evidence
