"""The estimators of an object's pose: one LeafSystem, and what it may infer by."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from pydrake.systems.framework import Context

from crossmodal.maths.immutable import Immutable
from crossmodal.systems.port_values import (
    NO_MEASUREMENT,
    UNKNOWN_POSE,
    ObjectPose,
    PoseMeasurement,
    PosePrior,
)
from crossmodal.systems.pose.evidence import Evidence, Table, all_displacements
from crossmodal.systems.pose.pose_belief import SolverConfig, infer_pose
from crossmodal.systems.pose.quaternion_filter import QuaternionFilterConfig, filter_pose
from crossmodal.systems.pose.target_model import TargetModel
from crossmodal.systems.recursive_filter import RecursiveFilter

Inference = Callable[[Evidence, PosePrior, TargetModel], ObjectPose]


def sampled_density(config: SolverConfig) -> Inference:
    """The belief by samples of the density under all evidence (`pose_belief`)."""
    return partial(infer_pose, config=config)


def quaternion_filter(config: QuaternionFilterConfig) -> Inference:
    """The translation-invariant quaternion filter, with samples of its Gaussian."""
    return partial(filter_pose, config=config)


@dataclass(frozen=True, kw_only=True)
class PoseState(Immutable):
    """What was measured so far, and what follows.

    Attributes:
        evidence: All of it.
        belief: About the pose.
        number: Of the last measurement.
    """

    evidence: Evidence
    belief: ObjectPose = UNKNOWN_POSE
    number: int = 0


def with_measurement(evidence: Evidence, new: PoseMeasurement) -> Evidence:
    """The evidence with one more measurement; what is displaced alike is one group."""
    if not new.kind:
        return evidence
    new_one = all_displacements(new.displaced)
    alike = [np.array_equal(displaced, new_one) for displaced in evidence.displaced]
    if not any(alike):
        alike.append(True)
        eye, axis = (np.nan_to_num(place) for place in (new.eye, new.axis))
        evidence = evidence.with_group(new_one, np.zeros((0, 3)), 1.0, eye=eye, axis=axis)
    group = alike.index(True)
    return evidence.with_measured(group, new.points, new.sigma, new.facing, new.free)


class PoseEstimator(RecursiveFilter):
    """Where a known object is, from views and touches.

    It infers anew from all that was measured whenever a measurement comes.

    Input ports:
    - `pose_guess`: `PosePrior`, what is known of the pose before.
    - `pose_measurement`: `PoseMeasurement`, with a new `number` whenever there is a new one.

    Output ports:
    - `object_pose_estimated`: `ObjectPose` with this tick's measurement.
    - `object_pose_latest`: the same of the last tick, from the state alone.

    Frames: W world, O the object's mesh, M its middle, with O's axes.
    """

    def __init__(
        self, model: TargetModel, infer: Inference, table: Table | None, period: float
    ) -> None:
        super().__init__()
        self._model, self._infer = model, infer
        guess = PosePrior(X=np.eye(4), rotation_sigma=np.inf, translation_sigma=1.0)
        self._guess = self._declare_value_input("pose_guess", guess)
        self._measurement = self._declare_value_input("pose_measurement", NO_MEASUREMENT)
        self._declare_recursion(PoseState(evidence=Evidence(table=table)), self._calc, period)
        self._declare_estimated("object_pose_estimated", lambda state: state.belief)
        self._declare_latest("object_pose_latest", lambda state: state.belief)

    def _calc(self, context: Context, state: Any) -> PoseState:
        new: PoseMeasurement = self._read(self._measurement, context)
        if state.belief.known and new.number == state.number:
            unchanged: PoseState = state
            return unchanged
        evidence = with_measurement(state.evidence, new)
        belief = self._infer(evidence, self._read(self._guess, context), self._model)
        belief = replace(belief, number=new.number)
        return PoseState(evidence=evidence, belief=belief, number=new.number)
