"""Whether an arm has moved as a step of the force at its wrist must move it.

The wrist's sensor measures what the hand exerts on the arm. If that changes by F at once, and the
motors do not change to the contrary at the same instant, the joints accelerate by

    M^-1 J_S^T F

from then on; a sensor that jumps moves nothing.
"""

from dataclasses import dataclass

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable

from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import number
from crossmodal.systems.monitoring.steps import Step
from crossmodal.systems.port_values import SampleWindow


@dataclass(kw_only=True)
class ArmResponseConfig:
    # How long the rates are looked at before the step.
    before: float = number(0.05, at_least=1e-3, at_most=1.0, unit="s")
    # How long the rates are looked at from the step on.
    after: float = number(0.03, at_least=1e-3, at_most=1.0, unit="s")
    # Least samples of each.
    samples: int = number(4, at_least=2, at_most=1000)
    # Of the motion that the step would make, share that is none.
    share: float = number(0.1, above=0.0, below=1.0)


def share_of_motion(
    joints: SampleWindow, step: Step, acceleration: Array, config: ArmResponseConfig
) -> float:
    """How much the rates have changed by a step, over how much the acceleration would change them.

    Against a straight line through what was before; infinite if there are too few samples.

    Args:
        joints: Samples (K, 2 n).
        step: Of the wrench.
        acceleration: From the step on (n,), [rad/s^2].
        config: Of what is looked at.
    """
    instant = 0.5 * (step.since + step.time)
    times = joints.times - instant
    rates = joints.values[:, len(acceleration) :]
    earlier = (joints.times <= step.since + 1e-9) & (times >= -config.before)
    later = (joints.times >= step.time - 1e-9) & (times <= config.after)
    if min(earlier.sum(), later.sum()) < config.samples:
        return float("inf")
    A = np.column_stack([np.ones(len(times)), times])
    line = np.linalg.lstsq(A[earlier], rates[earlier], rcond=None)[0]
    change = rates[later] - A[later] @ line
    expected = np.outer(times[later], acceleration)
    return float(np.linalg.norm(change)) / max(float(np.linalg.norm(expected)), 1e-12)


class ArmResponse:
    """Finds steps of a wrist's wrench to which the arm has responded.

    Args:
        config: Of what is looked at.
        arm: The robot's own model; with its load, so that it moves a little less than without.
        frame: Name of the sensor's frame S in it.
    """

    def __init__(
        self, config: ArmResponseConfig, arm: MultibodyPlant, frame: str = "sensor"
    ) -> None:
        self._config, self._arm = config, arm
        self._frame = arm.GetFrameByName(frame)
        self._scratch = arm.CreateDefaultContext()  # Holds no state between two calls.

    def acceleration(self, q: Array, F_S: Array) -> Array:
        """That of the joints (n,) by a spatial force (6,) at So in S, at positions q (n,)."""
        arm, context = self._arm, self._scratch
        arm.SetPositions(context, q)
        J_S = arm.CalcJacobianSpatialVelocity(
            context,
            JacobianWrtVariable.kV,
            self._frame,
            np.zeros(3),  # type: ignore[arg-type]
            arm.world_frame(),
            self._frame,
        )
        return np.asarray(np.linalg.solve(arm.CalcMassMatrix(context), J_S.T @ F_S))

    def is_sensed(self, step: Step, joints: SampleWindow) -> bool:
        """Whether the joints (K, 2 n) have moved as the step would move them, or may have."""
        n = self._arm.num_positions()
        if not len(joints.times):
            return True
        at = int(np.argmin(np.abs(joints.times - step.time)))
        expected = self.acceleration(joints.values[at, :n], step.size)
        return share_of_motion(joints, step, expected, self._config) > self._config.share
