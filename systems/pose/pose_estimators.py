"""The estimators of an object's pose: one LeafSystem, and what it may infer by."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from pydrake.systems.framework import Context

from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable
from crossmodal.systems.port_values import (
    NO_MEASUREMENT,
    NO_PRIOR,
    UNKNOWN_POSE,
    ObjectPose,
    PoseMeasurement,
    PosePrior,
    of_middle,
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
    new_one = all_displacements(new.displaced, evidence.displaced.shape[2])
    alike = [np.array_equal(displaced, new_one) for displaced in evidence.displaced]
    if not any(alike):
        alike.append(True)
        eye, axis = (np.nan_to_num(place) for place in (new.eye, new.axis))
        evidence = evidence.with_group(new_one, np.zeros((0, 3)), 1.0, eye=eye, axis=axis)
    group = alike.index(True)
    known = evidence.with_outline(group, new.outline, new.outline_sigma)
    return known.with_measured(group, new.points, new.sigma, new.facing, new.free)


def motions_on_a_table(table: Table, prior: PosePrior, model: TargetModel, sigma: float) -> Array:
    """Twists (6, 3) in W about Wo, by which an object that is pushed slides and turns on its table.

    Args:
        table: What it stands on.
        prior: Where it is, about.
        model: Of the object.
        sigma: Standard deviation of how far, [m], of its middle, and by the turn half way outside.
    """
    up, p = table.up, of_middle(prior.X, model.middle)[:3, 3]
    twists = np.zeros((6, 3))
    twists[:3, 0], twists[3:, 0] = up, np.cross(p, up)
    twists[:, 0] *= sigma / (0.5 * model.radius)
    twists[3:, 1:] = sigma * np.linalg.svd(up[None])[2][1:].T  # Across `up`.
    return twists


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

    Args:
        model: Of the object.
        infer: What makes a belief of the evidence.
        table: What the object stands on; None if nothing is known of that.
        period: Of the ticks, [s].
        moved: Standard deviation of how far a contact moves an object that stands on a table, [m].
    """

    def __init__(
        self,
        model: TargetModel,
        infer: Inference,
        table: Table | None,
        period: float,
        moved: float = 0.0,
    ) -> None:
        super().__init__()
        self._model, self._infer, self._moved = model, infer, moved
        self._guess = self._declare_value_input("pose_guess", NO_PRIOR)
        self._measurement = self._declare_value_input("pose_measurement", NO_MEASUREMENT)
        self._declare_recursion(PoseState(evidence=Evidence(table=table)), self._calc, period)
        self._declare_estimated("object_pose_estimated", lambda state: state.belief)
        self._declare_latest("object_pose_latest", lambda state: state.belief)

    def _calc(self, context: Context, state: Any) -> PoseState:
        new: PoseMeasurement = self._read(self._measurement, context)
        guess: PosePrior = self._read(self._guess, context)
        if not guess.given or (state.belief.known and new.number == state.number):
            unchanged: PoseState = state
            return unchanged
        evidence = state.evidence
        is_pushed = new.kind == "touch" and len(new.points) > 0
        if is_pushed and self._moved > 0.0 and evidence.table is not None:
            twists = motions_on_a_table(evidence.table, guess, self._model, self._moved)
            evidence = evidence.after_a_motion(twists)
        evidence = with_measurement(evidence, new)
        belief = self._infer(evidence, guess, self._model)
        belief = replace(belief, number=new.number)
        return PoseState(evidence=evidence, belief=belief, number=new.number)
