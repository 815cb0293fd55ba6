"""The direction in which exploration pulls: as taught, then along the joint as it is perceived."""

from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from crossmodal.controllers.arm.kinematics import ArmModel
from crossmodal.controllers.interaction.phases import Phase
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import check, number


@dataclass(kw_only=True)
class PullDirectionConfig:
    period: float = number(0.01, at_least=1e-4, at_most=1.0, unit="s")  # Update period.
    follow_joint: bool = False  # Whether to pull along the perceived joint, not as taught.
    # Displacement of the hand by the joint before the joint is followed.
    start: float = number(0.03, above=0.0, at_most=10.0, unit="m")
    # Time constant with which the pull turns to the joint's direction.
    time: float = number(0.2, at_least=1e-3, at_most=3600.0, unit="s")
    # Largest angle between pull and joint for the joint to be believed.
    limit: float = number(45.0, above=0.0, at_most=90.0, unit="deg")


class PullDirection(LeafSystem):
    """Turns the pull, which is fixed in the hand, to where the perceived joint lets the hand go.

    A hand that turns on its handle takes its direction of pulling along and soon pulls across the
    joint: it shifts the handle in the fingers and drags the object along.

    Input ports:
    - `joint_state_measured`: (2 n,) positions [rad] and velocities [rad/s].
    - `joint_remembered`, `end_effector_screw_remembered`: of `JointMemory`; NaN while none is
      known.
    - `phase`: (1,) `Phase`; the direction turns while it is EXPLORE, and is as taught before.

    Output ports:
    - `pull_direction`: (3,) unit vector in E.

    State: the direction.

    Args:
        config: Whether and how fast to follow.
        arm: The robot's own model.
        direction_E: Taught (3,), in E.

    Raises:
        ValueError: for impossible values.
    """

    def __init__(self, config: PullDirectionConfig, arm: ArmModel, direction_E: Array) -> None:
        super().__init__()
        check(config, "PullDirection")
        self._config = config
        self._arm = arm
        self._joint_state = self.DeclareVectorInputPort("joint_state_measured", 2 * arm.num_joints)
        self._joint = self.DeclareVectorInputPort("joint_remembered", 8)
        self._screw = self.DeclareVectorInputPort("end_effector_screw_remembered", 6)
        self._phase = self.DeclareVectorInputPort("phase", 1)
        self._taught = direction_E / np.linalg.norm(direction_E)
        state = self.DeclareDiscreteState(self._taught)
        self.DeclareStateOutputPort("pull_direction", state)
        if config.follow_joint:
            self.DeclarePeriodicDiscreteUpdateEvent(config.period, 0.0, self._update)

    def _update(self, context: Context, next_state: DiscreteValues) -> None:
        phase = self._phase.Eval(context)[0]
        if phase < Phase.EXPLORE:
            next_state.get_mutable_vector().SetFromVector(self._taught)
        if phase != Phase.EXPLORE:
            return
        config = self._config
        X_WE = self._arm.Evaluate(np.asarray(self._joint_state.Eval(context))).X_WE
        tangent = (se3.adjoint(se3.inverse(X_WE)) @ np.asarray(self._screw.Eval(context)))[3:]
        rate = float(np.linalg.norm(tangent))
        if not rate * abs(float(self._joint.Eval(context)[6])) > config.start:
            return
        direction = np.asarray(context.get_discrete_state_vector().value())
        along = float(tangent @ direction) / rate
        if abs(along) < np.cos(np.deg2rad(config.limit)):
            return
        share = 1.0 - np.exp(-config.period / config.time)
        direction = direction + share * (np.sign(along) * tangent / rate - direction)
        next_state.get_mutable_vector().SetFromVector(direction / np.linalg.norm(direction))
