"""The direction in which exploration pulls: as taught, along the perceived joint, or as it goes."""

from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from crossmodal.controllers.arm.kinematics import ArmModel
from crossmodal.controllers.interaction.phases import Phase
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import check, number, require


@dataclass(kw_only=True)
class PullDirectionConfig:
    period: float = number(0.01, at_least=1e-4, at_most=1.0, unit="s")  # Update period.
    # What the pull keeps to: `hand`, in which it is fixed; `joint`, as it is perceived; or `path`,
    # that of the handle.
    along: str = "hand"
    # Displacement of the hand by the joint before it is followed; length of the path that counts.
    start: float = number(0.03, above=0.0, at_most=10.0, unit="m")
    # Time constant with which the pull turns to the joint's direction.
    time: float = number(0.2, at_least=1e-3, at_most=3600.0, unit="s")
    # Largest angle between pull and joint for the joint to be believed.
    limit: float = number(45.0, above=0.0, at_most=90.0, unit="deg")


class PullDirection(LeafSystem):
    """Says where to pull: as taught, then along the hand, the perceived joint or the path.

    A hand that turns on its handle takes along a pull that is fixed in it, and soon pulls across
    the joint: it shifts the handle in the fingers, falls over the bar and drags the object along.
    The path needs no perception: the handle, which E holds, goes on as it has gone, and the pull is
    the direction of a string of length `start` that it draws behind it.

    Input ports:
    - `joint_state_measured`: (2 n,) positions [rad] and velocities [rad/s].
    - `joint_remembered`, `end_effector_screw_remembered`: of `JointMemory`; NaN while none is
      known.
    - `phase`: (1,) `Phase`; the direction is as taught before EXPLORE, and stays in the hand after.

    Output ports:
    - `pull_direction`: (3,) unit vector in E.

    State: (3, 3) the direction in E and in the world, and the string's end p_W; both NaN at first.

    Args:
        config: What to follow, and how fast.
        arm: The robot's own model.
        direction_E: Taught (3,), in E.

    Raises:
        ValueError: for impossible values.

    Source: G. Niemeyer and J.-J. Slotine, A Simple Strategy for Opening an Unknown Door, ICRA 1997
    (to follow the path that the hand is led on).
    """

    def __init__(self, config: PullDirectionConfig, arm: ArmModel, direction_E: Array) -> None:
        super().__init__()
        check(config, "PullDirection")
        allowed = ("hand", "joint", "path")
        require(config.along in allowed, "PullDirection", config, "along", " or ".join(allowed))
        self._config = config
        self._arm = arm
        self._joint_state = self.DeclareVectorInputPort("joint_state_measured", 2 * arm.num_joints)
        self._joint = self.DeclareVectorInputPort("joint_remembered", 8)
        self._screw = self.DeclareVectorInputPort("end_effector_screw_remembered", 6)
        self._phase = self.DeclareVectorInputPort("phase", 1)
        self._taught = direction_E / np.linalg.norm(direction_E)
        state = self.DeclareDiscreteState(np.r_[self._taught, np.full(6, np.nan)])
        self.DeclareVectorOutputPort(
            "pull_direction", 3, self._calc_direction, {self.discrete_state_ticket(state)}
        )
        if config.along != "hand":
            self.DeclarePeriodicDiscreteUpdateEvent(config.period, 0.0, self._update)

    def _calc_direction(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(context.get_discrete_state_vector().value()[:3])

    def _update(self, context: Context, next_state: DiscreteValues) -> None:
        phase = self._phase.Eval(context)[0]
        if phase > Phase.EXPLORE:
            return
        X_WE = self._arm.Evaluate(np.asarray(self._joint_state.Eval(context))).X_WE
        R_WE, p_WE = X_WE[:3, :3], X_WE[:3, 3]
        direction, direction_W, p_WEnd = context.get_discrete_state_vector().value().reshape(3, 3)
        if phase < Phase.EXPLORE or np.isnan(direction_W[0]):
            direction, direction_W, p_WEnd = self._taught, R_WE @ self._taught, p_WE
        if phase == Phase.EXPLORE and self._config.along == "joint":
            direction = self._turned_to_joint(context, X_WE, direction)
        if phase == Phase.EXPLORE and self._config.along == "path":
            string = p_WE - p_WEnd
            if np.linalg.norm(string) > self._config.start:
                direction_W = string / np.linalg.norm(string)
                p_WEnd = p_WE - self._config.start * direction_W
            direction = R_WE.T @ direction_W
        next_state.get_mutable_vector().SetFromVector(np.r_[direction, direction_W, p_WEnd])

    def _turned_to_joint(self, context: Context, X_WE: Array, direction: Array) -> Array:
        """The direction (3,) in E, a step nearer to where the joint lets the hand go."""
        config = self._config
        tangent = (se3.adjoint(se3.inverse(X_WE)) @ np.asarray(self._screw.Eval(context)))[3:]
        rate = float(np.linalg.norm(tangent))
        if not rate * abs(float(self._joint.Eval(context)[6])) > config.start:
            return direction
        along = float(tangent @ direction) / rate
        if abs(along) < np.cos(np.deg2rad(config.limit)):
            return direction
        share = 1.0 - np.exp(-config.period / config.time)
        direction = direction + share * (np.sign(along) * tangent / rate - direction)
        return np.asarray(direction / np.linalg.norm(direction))
