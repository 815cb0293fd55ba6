"""Friction, range and detents of an episode's joint: rows of the table, summary, printed lines."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from crossmodal.diagrams.drawing.digits import written
from crossmodal.diagrams.evaluation.estimates import Row, scalar
from crossmodal.diagrams.joints.joint_metrics import JointSeries, axis_sign, travel_at_reference
from crossmodal.diagrams.joints.joint_truth import Truth
from crossmodal.diagrams.run.record import Tick
from crossmodal.systems.port_values import (
    DetentBelief,
    JointMechanicsBelief,
    JointMechanicsBeliefs,
    JointType,
    LimitBelief,
)

CLAIMED = 0.95  # Probability from which an end stop or a detent is reported.
_UNITS = {
    JointType.PRISMATIC: ("N", "N s/m", "m", "m/s"),
    JointType.REVOLUTE: ("N m", "N m s/rad", "rad", "rad/s"),
    JointType.SCREW: ("N m", "N m s/rad", "rad", "rad/s"),
}


@dataclass(kw_only=True)
class TickMechanics:
    """What was believed at a tick, turned to the true axis' side, counted from the grasp.

    Attributes:
        joint_type: The likeliest, which slides or turns.
        belief: Of that; friction and limits as they stand in `lower` and `upper`.
        force: Along the true axis, [N or N m].
        configuration: [m or rad].
        lower: The end of the range against the true axis.
        upper: The other.
        detent: The likeliest.
    """

    joint_type: JointType
    belief: JointMechanicsBelief
    force: float
    configuration: float
    lower: LimitBelief
    upper: LimitBelief
    detent: DetentBelief

    @property
    def resistance(self) -> tuple[float, float]:
        """Friction at the mean speed so far, and its standard deviation, [N or N m]."""
        at = np.array([1.0, self.belief.mean_speed])
        variance = float(at @ self.belief.friction_covariance @ at)
        return float(at @ self.belief.friction), math.sqrt(max(variance, 0.0))


def mechanics_at(tick: Tick, series: JointSeries, k: int, truth: Truth) -> TickMechanics | None:
    """Of the estimator's tick k; None without a moving joint or without a force."""
    joint = series.joints[k]
    beliefs: JointMechanicsBeliefs | None = tick.values.get("joint_mechanics_latest")
    if joint is None or beliefs is None or joint.type not in _UNITS:
        return None
    belief = next(
        (
            one.models[joint.type]
            for one in beliefs.joints
            if (one.parent_id, one.child_id) == (joint.parent_id, joint.child_id)
            and joint.type in one.models
        ),
        None,
    )
    if belief is None:
        return None
    sign = axis_sign(joint.model.axis_P, truth.axis_W)
    offset = travel_at_reference(joint, series.times[k], truth)
    lower, upper = (belief.lower, belief.upper) if sign > 0 else (belief.upper, belief.lower)
    return TickMechanics(
        joint_type=joint.type,
        belief=belief,
        force=sign * belief.force,
        configuration=float(series.configuration[k]),
        lower=_turned(lower, sign, offset),
        upper=_turned(upper, sign, offset),
        detent=replace(belief.detent, position=sign * belief.detent.position + offset),
    )


def _turned(limit: LimitBelief, sign: float, offset: float) -> LimitBelief:
    position, bound = sign * limit.position + offset, sign * limit.bound + offset
    return replace(limit, position=position, bound=bound)


def true_range(truth: Truth) -> tuple[float, float]:
    """The true end stops, counted from the grasp, [m or rad]; NaN where they are not known."""
    if len(truth.times) == 0:
        return math.nan, math.nan
    start = float(truth.configuration[0] - truth.opening()[0])
    return truth.mechanics.lower - start, truth.mechanics.upper - start


def mechanics_rows(tick: Tick, series: JointSeries, k: int, truth: Truth) -> list[Row]:
    """What an estimator believed of the joint's forces at its tick k.

    Quantities:

    - `joint_force` of the hand along the joint, [N or N m];
    - `joint_friction`: `coulomb` [N or N m] and `viscous` [the same per (m or rad)/s];
    - `joint_limit` (`lower`, `upper`), [m or rad] since the grasp, of end stops that were reached;
      `joint_bound`, how far the joint went, and `joint_limit_probability`, that a stop was reached;
    - `joint_detent`: its `probability`, `position` and `force`.
    """
    now = mechanics_at(tick, series, k, truth)
    if now is None:
        return []
    belief, ends = now.belief, true_range(truth)
    same = now.joint_type == truth.joint_type
    rows = [scalar("joint_force", now.force)] if math.isfinite(now.force) else []
    true = (truth.mechanics.friction, truth.mechanics.damping)
    for i, name in enumerate(("coulomb", "viscous")):
        std = math.sqrt(max(belief.friction_covariance[i, i], 0.0))
        expected = true[i] if same else math.nan
        rows.append(scalar("joint_friction", belief.friction[i], name, std=std, true=expected))
    for name, limit, end in zip(("lower", "upper"), (now.lower, now.upper), ends, strict=True):
        rows.append(scalar("joint_limit_probability", limit.probability, name))
        rows.append(scalar("joint_bound", limit.bound, name, std=math.sqrt(limit.bound_variance)))
        if limit.probability > CLAIMED:
            std, expected = math.sqrt(limit.variance), end if same else math.nan
            rows.append(scalar("joint_limit", limit.position, name, std=std, true=expected))
    detent = now.detent
    rows.append(scalar("joint_detent", detent.probability, "probability"))
    if detent.probability > CLAIMED:
        std, force_std = math.sqrt(detent.variance), math.sqrt(detent.force_variance)
        rows.append(scalar("joint_detent", detent.position, "position", std=std))
        held = truth.mechanics.detent if same else math.nan
        rows.append(scalar("joint_detent", detent.force, "force", std=force_std, true=held))
    return rows


def summarise_mechanics(
    ticks: Sequence[Tick], series: JointSeries, truth: Truth
) -> dict[str, Any] | None:
    """The last belief about the joint's forces beside the truth; None where there was none.

    What was believed while the joint was taken for another type than in the end does not count.
    """
    types = [None if joint is None else joint.type for joint in series.joints]
    final = next((t for t in reversed(types) if t is not None), None)
    last = next(
        (
            found
            for k in reversed(range(len(ticks)))
            if types[k] == final and (found := mechanics_at(ticks[k], series, k, truth)) is not None
        ),
        None,
    )
    if last is None:
        return None
    belief, speed = last.belief, last.belief.mean_speed
    nothing = math.nan
    friction, damping, held, (lower, upper) = nothing, nothing, nothing, (nothing, nothing)
    if last.joint_type == truth.joint_type:
        friction, damping = truth.mechanics.friction, truth.mechanics.damping
        held = truth.mechanics.detent
        lower, upper = true_range(truth)
    stds = np.sqrt(np.maximum(np.diag(belief.friction_covariance), 0.0))
    detent = last.detent
    return {
        "type": str(last.joint_type),
        "samples": belief.samples,
        "noise": belief.noise,
        "coulomb": _beside(belief.friction[0], stds[0], friction),
        "viscous": _beside(belief.friction[1], stds[1], damping),
        "resistance": {
            "speed": speed,
            **_beside(*last.resistance, friction + damping * speed),
        },
        "lower": _limit(last.lower, -1, lower),
        "upper": _limit(last.upper, 1, upper),
        "detent": {
            "probability": detent.probability,
            "claimed": detent.probability > CLAIMED,
            "position": detent.position,
            "position_std": math.sqrt(detent.variance),
            **_beside(detent.force, math.sqrt(detent.force_variance), held),
        },
    }


def _beside(value: float, std: float, true: float) -> dict[str, Any]:
    error = float(value) - true
    known = math.isfinite(error) and math.isfinite(std)
    return {
        "estimated": float(value),
        "std": float(std),
        "true": true,
        "error": error,
        "inside_two_sigma": bool(abs(error) <= 2.0 * std) if known else None,
    }


def _limit(limit: LimitBelief, side: int, true: float) -> dict[str, Any]:
    """A stop that was reached is where it is reported, one that was not is not before the bound."""
    reached = limit.probability > CLAIMED
    value, variance = (
        (limit.position, limit.variance) if reached else (limit.bound, limit.bound_variance)
    )
    found = {"reached": reached, "probability": limit.probability}
    found |= _beside(value, math.sqrt(variance), true)
    if not reached and found["inside_two_sigma"] is not None:
        found["inside_two_sigma"] = bool(side * found["error"] <= 2.0 * found["std"])
    return found


def mechanics_line(summary: dict[str, Any]) -> str:
    """Friction, range and detent of a joint in words, each beside the truth where that is known."""
    force, rate, length, speed = _UNITS[JointType(summary["type"])]
    parts = []
    if summary["samples"]:
        resistance = summary["resistance"]
        parts += [
            f"friction {_in_words(summary['coulomb'], force)}",
            f"viscous {_in_words(summary['viscous'], rate)}",
            f"together {_in_words(resistance, force)} at {written(resistance['speed'], speed)}",
        ]
    else:
        parts.append("friction not known, it has hardly moved")
    for side, name in ((-1, "lower"), (1, "upper")):
        limit = summary[name]
        if limit["reached"]:
            parts.append(f"{name} end stop at {_in_words(limit, length)} (reached)")
        else:
            at = written(limit["estimated"], length, beside=limit["std"])
            beyond = "below" if side > 0 else "above"
            parts.append(
                f"{name} end stop not {beyond} {at} (not reached){_verdict(limit, length)}"
            )
    detent = summary["detent"]
    if detent["claimed"]:
        held = written(detent["estimated"], force, spread=detent["std"])
        at = written(detent["position"], length, spread=detent["position_std"])
        parts.append(f"detent of {held} beyond friction at {at}{_verdict(detent, force)}")
    return ", ".join(parts)


def _in_words(value: dict[str, Any], unit: str) -> str:
    return written(value["estimated"], unit, spread=value["std"]) + _verdict(value, unit)


def _verdict(value: dict[str, Any], unit: str) -> str:
    if value["inside_two_sigma"] is None:
        return ""
    true = written(value["true"], unit, beside=value["std"])
    return f" [truth {true}{'' if value['inside_two_sigma'] else ', OUTSIDE 2σ'}]"
