"""Somebody takes a tool's flap by its free edge, carries it on and lets go."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.common.value import Value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce, MultibodyPlant
from pydrake.multibody.tree import BodyIndex, Frame, RevoluteJoint
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import check, number, require
from crossmodal.plants.scene import position_index

# The frequency of the hand that leads the flap, times the plant's step: the root of x^2 + 4 x = 2.
# With inertia I and step dt, stiffness K and damping D that act by where the flap was before the
# step are stable for K dt^2 / I + 2 D dt / I < 4. Of this, critical damping takes half.
_FREQUENCY = 6.0**0.5 - 2.0
_PERIOD = 0.01  # Period at which the hand checks whether a jerk has begun, [s].


@dataclass(kw_only=True)
class FlapJerk:
    """A jerk at the flap's free edge."""

    # Displacement of the edge, positive as the finger turns the flap.
    displacement: float = number(0.03, at_least=-0.5, at_most=0.5, unit="m")
    start: float = number(0.0, at_least=0.0, at_most=86400.0, unit="s")  # Since the episode began.
    end: float = number(0.3, above=0.0, at_most=86400.0, unit="s")  # The hand lets go.


def share_of_displacement(jerk: FlapJerk, time: float) -> tuple[float, float]:
    """Share of its displacement that is done, from 0 to 1, and its rate [1/s]: minimum jerk."""
    duration = jerk.end - jerk.start
    s = float(np.clip((time - jerk.start) / duration, 0.0, 1.0))
    return s**3 * (10.0 - 15.0 * s + 6.0 * s**2), 30.0 * s**2 * (1.0 - s) ** 2 / duration


class FlapJerks(LeafSystem):
    """The force of a hand at the free edge, across the flap, while it leads the flap.

    Input ports:
    - `body_poses`: list of `RigidTransform` X_WB, one per body, from the plant (true).
    - `tool_state`: positions and velocities of the tool (true), [rad], [rad/s].

    Output ports:
    - `spatial_forces`: list of `ExternallyAppliedSpatialForce`.

    State: the hinge's angle at the beginning of each jerk, NaN before, [rad].

    Frames: J the hinge, F the frame at the free edge.

    Args:
        plant: The simulated one, finalized.
        hinge: Of the flap.
        edge: F, on the flap.
        jerks: Any number of them.

    Raises:
        ValueError: for impossible values.
    """

    def __init__(
        self, plant: MultibodyPlant, hinge: RevoluteJoint, edge: Frame, jerks: Sequence[FlapJerk]
    ) -> None:
        super().__init__()
        for jerk in jerks:
            check(jerk, "FlapJerk")
            require(jerk.start < jerk.end, "FlapJerk", jerk, "end", "> start")
        self._jerks = list(jerks)
        tool = hinge.model_instance()
        joints = [plant.get_joint(index) for index in plant.GetJointIndices(tool)]
        moving = [joint for joint in joints if joint.num_velocities() > 0]
        v = hinge.velocity_start() - min(joint.velocity_start() for joint in moving)
        self._theta, self._rate = position_index(plant, hinge), plant.num_positions(tool) + v
        self._axis = hinge.revolute_axis()
        M = plant.CalcMassMatrix(plant.CreateDefaultContext())
        row = hinge.velocity_start()
        inertia = 1.0 / np.linalg.inv(M)[row, row]  # Where all else gives way, [kg m^2].
        omega = _FREQUENCY / plant.time_step()
        self._stiffness, self._damping = inertia * omega**2, 2.0 * inertia * omega
        frames = (hinge.frame_on_child(), edge)
        self._frames = [(int(f.body().index()), f.GetFixedPoseInBodyFrame()) for f in frames]
        self._poses = self.DeclareAbstractInputPort(
            "body_poses", plant.get_body_poses_output_port().Allocate()
        )
        self._state = self.DeclareVectorInputPort("tool_state", plant.num_multibody_states(tool))
        self.DeclareDiscreteState(np.full(len(jerks), np.nan))
        self.DeclarePeriodicDiscreteUpdateEvent(_PERIOD, 0.0, self._note)
        self.DeclareAbstractOutputPort(
            "spatial_forces",
            lambda: Value[list[ExternallyAppliedSpatialForce]](),
            lambda context, output: output.set_value(self._forces(context)),
        )

    def _note(self, context: Context, next_state: DiscreteValues) -> None:
        first, now = next_state.get_mutable_vector(), context.get_time()
        theta = float(self._state.Eval(context)[self._theta])
        for index, jerk in enumerate(self._jerks):
            if np.isnan(first.GetAtIndex(index)) and now >= jerk.start:
                first.SetAtIndex(index, theta)

    def _torque(self, context: Context, lever: float) -> float:
        """What the hand turns the flap with, [N m]."""
        state, now = self._state.Eval(context), context.get_time()
        torque = 0.0
        taken = context.get_discrete_state_vector().value()
        for jerk, first in zip(self._jerks, taken, strict=True):
            if np.isnan(first) or not jerk.start <= now < jerk.end:
                continue
            share, rate = share_of_displacement(jerk, now)
            angle = jerk.displacement / lever
            torque += self._stiffness * (first + share * angle - state[self._theta])
            torque += self._damping * (rate * angle - state[self._rate])
        return torque

    def _forces(self, context: Context) -> list[ExternallyAppliedSpatialForce]:
        X_WBs = self._poses.Eval(context)
        (child, X_BJ), (flap, X_BF) = self._frames
        X_WJ = X_WBs[child] @ X_BJ
        k_W = X_WJ.rotation() @ self._axis
        p_JF_W: Array = (X_WBs[flap] @ X_BF).translation() - X_WJ.translation()
        across = np.cross(k_W, p_JF_W)
        lever = float(np.linalg.norm(across))
        torque = self._torque(context, lever)
        if torque == 0.0:
            return []
        applied = ExternallyAppliedSpatialForce()
        applied.body_index = BodyIndex(flap)
        applied.p_BoBq_B = X_BF.translation()
        applied.F_Bq_W = SpatialForce(np.zeros(3), torque / lever**2 * across)
        return [applied]
