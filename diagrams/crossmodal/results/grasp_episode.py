"""How long the hand truly held the handle, and when the robot noticed that it no longer did."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pydrake.math import RigidTransform

from crossmodal.diagrams.crossmodal.modalities import LABELS
from crossmodal.diagrams.crossmodal.task import GRASP_LOST
from crossmodal.diagrams.run.record import EpisodeRecord, Quantity, Tick
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array, Mask
from crossmodal.systems.port_values import GraspType

# Where hand and handle truly are; the handle's y lies along its bar.
GRASP_QUANTITIES = (
    Quantity(port="cheat_hand_pose", model=RigidTransform()),
    Quantity(port="cheat_handle_pose", model=RigidTransform()),
)
_OUT_OF_HAND = 0.035  # Shift of the bar, across itself, by which it has left the hand, [m].


@dataclass(frozen=True, kw_only=True)
class GraspEpisode:
    """The last grasp of an episode.

    Attributes:
        closed_at: When the hand had closed, [s]; NaN if it never did.
        held_until: When the bar truly left its place in the hand for good, [s]; infinite if it
            never did, NaN where the truth is not known.
        noticed_at: By estimator, when it began to believe for good that the hand holds nothing,
            [s]; infinite while it does not. An estimator without touch is left out.
        given_up_at: When the robot gave the grasp up for good, [s]; infinite if it did not.
    """

    closed_at: float = float("nan")
    held_until: float = float("nan")
    noticed_at: Mapping[str, float] = field(default_factory=dict)
    given_up_at: float = float("inf")

    @property
    def lost_at(self) -> float:
        """From when on the hand held nothing, as the truth or else the robot says, [s]."""
        known = [self.given_up_at, np.inf if np.isnan(self.held_until) else self.held_until]
        return float(min(known))


def last_since(times: Array, holds: Mask) -> float:
    """Since when something has held without a break up to the end; infinite if it does not."""
    if len(times) == 0 or not holds[-1]:
        return float("inf")
    breaks = np.flatnonzero(~holds)
    return float(times[breaks[-1] + 1] if len(breaks) else times[0])


def bar_shift(X_WHands: Array, X_WHandles: Array) -> Array:
    """How far the bar has moved in the hand, across itself, since the first tick (T,), [m].

    Args:
        X_WHands: Of any frame of the palm (T, 4, 4).
        X_WHandles: Of the handle (T, 4, 4), y along the bar.
    """
    handles = [
        se3.inverse(hand) @ handle for hand, handle in zip(X_WHands, X_WHandles, strict=True)
    ]
    along = handles[0][:3, 1]
    moved = np.array([handle[:3, 3] - handles[0][:3, 3] for handle in handles])
    return np.asarray(np.linalg.norm(moved - np.outer(moved @ along, along), axis=1))


def _poses(ticks: list[Tick], port: str) -> Array:
    return np.array([tick.values[port].GetAsMatrix4() for tick in ticks])


def grasp_episode(record: EpisodeRecord) -> GraspEpisode:
    """The last grasp in a record."""
    closing, held = -1, False
    for k, tick in enumerate(record.station):
        before, held = held, bool(tick.values.get("interaction_active", np.zeros(1))[0] > 0.5)
        closing = k if held and not before else closing
    if closing < 0:
        return GraspEpisode()
    closed_at = record.station[closing].time
    held_until = float("nan")
    ticks = [
        tick
        for tick in record.station[closing:]
        if all(quantity.port in tick.values for quantity in GRASP_QUANTITIES)
    ]
    if ticks:
        hands, handles = (_poses(ticks, quantity.port) for quantity in GRASP_QUANTITIES)
        out = bar_shift(hands, handles) > _OUT_OF_HAND
        held_until = last_since(np.array([tick.time for tick in ticks]), out)
    given_up = [event.time for event in record.events if event.name == GRASP_LOST]
    given_up_at = given_up[-1] if given_up else float("inf")
    noticed = {}
    for name, estimator in record.estimators.items():
        touched = [
            tick
            for tick in estimator.ticks
            if "grasp_latest" in tick.values and closed_at <= tick.time <= given_up_at
        ]
        if touched:
            failed = np.array([t.values["grasp_latest"].type == GraspType.FAILED for t in touched])
            since = last_since(np.array([tick.time for tick in touched]), failed)
            noticed[name] = min(since, given_up_at)
    return GraspEpisode(
        closed_at=closed_at, held_until=held_until, noticed_at=noticed, given_up_at=given_up_at
    )


def summarise_grasp(grasp: GraspEpisode) -> dict[str, Any]:
    """The grasp as a part of the summary, [s]; null where it was held, or nobody knows."""

    def known(time: float) -> float | None:
        return time if np.isfinite(time) else None

    return {
        "closed_at": known(grasp.closed_at),
        "held_until_true": known(grasp.held_until),
        "given_up_at": known(grasp.given_up_at),
        "noticed_at": {name: known(time) for name, time in grasp.noticed_at.items()},
    }


def grasp_lines(grasp: Mapping[str, Any]) -> list[str]:
    """What a person should know of a grasp that did not hold, as a summary has it."""
    noticed = {name: time for name, time in grasp["noticed_at"].items() if time is not None}
    if grasp["held_until_true"] is None and not noticed:
        return []
    lines = []
    if grasp["held_until_true"] is not None:
        lines.append(f"the handle left it at {grasp['held_until_true']:.1f} s")
    found = ", ".join(f"{LABELS.get(name, name)} at {time:.1f} s" for name, time in noticed.items())
    lines.append(f"found lost by {found}" if found else "nobody noticed")
    return lines
