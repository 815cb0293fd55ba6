"""An episode of the flap as arrays over time: what is true, and what each estimator believes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

import numpy as np

from crossmodal.diagrams.flap.flip_status import FLIPPING, RETREATING, TO_TABLE
from crossmodal.diagrams.flap.results.tip_line import TipLine, tip_line
from crossmodal.diagrams.flap.truth import UNKNOWN_FLAP
from crossmodal.diagrams.run.record import EpisodeRecord, Tick
from crossmodal.diagrams.run.recorder import STATUS_PORT
from crossmodal.maths.arrays import Array, Mask
from crossmodal.systems.port_values import UNKNOWN_TOOL, ToolBelief, unseen


@dataclass(frozen=True, kw_only=True)
class TrueFlap:
    """What is true at the ticks (T); NaN where it is not known.

    Attributes:
        times: [s]
        theta: Angle of the flap since the episode began, [rad].
        k_W: Axis (T, 3), positive turning.
        p_WK: Point on the axis (T, 3) that is nearest to the contact, [m].
        n_W: Normal (T, 3) of the face that the camera sees first.
        touching: Whether the fingertip touches the flap.
        p_WC: Contact (T, 3), [m].
        p_SC: Contact on the fingertip (T, 3), [m].
        Sy_W: Outward normal (T, 3) of the fingertip's pad, the y of S.
        force: Normal force of the contact, [N]; 0 without one.
        edge_force: Of the flap on the fingertip along the axis, by friction, [N].
        p_WE: End-effector (T, 3) of the arm that holds the tool, [m].
        flipping: Whether the robot turns the flap, from when it began to when it ended; it may
            have lost the contact in between.
        retreated_at: When the finger began to leave the flap for good, [s]; infinite if it did not.
    """

    times: Array
    theta: Array
    k_W: Array
    p_WK: Array
    n_W: Array
    touching: Mask
    p_WC: Array
    p_SC: Array
    Sy_W: Array
    force: Array
    edge_force: Array
    p_WE: Array
    flipping: Mask
    retreated_at: float = np.inf

    @property
    def L1_W(self) -> Array:
        """From the holding end-effector to the axis (T, 3), [m]."""
        return self.p_WK - self.p_WE

    @property
    def L2_W(self) -> Array:
        """From the contact to the axis (T, 3), [m]."""
        return self.p_WK - self.p_WC


@dataclass(frozen=True, kw_only=True)
class FlapSeries:
    """What one estimator believes at the ticks (T); NaN where nothing is.

    The series ends when the arm begins to move the tool: what is believed in the world's frame is
    of a tool that is held still.

    Attributes:
        times: [s]
        k_W: Axis (T, 3).
        k_covariance: (T, 3, 3), rank 2.
        theta: [rad]
        theta_std: [rad]
        L1_W: (T, 3), [m].
        L1_covariance: (T, 3, 3), [m^2].
        L2_W: (T, 3), [m].
        L2_covariance: (T, 3, 3), [m^2].
        seen: Whether the camera saw the flap.
    """

    times: Array
    k_W: Array
    k_covariance: Array
    theta: Array
    theta_std: Array
    L1_W: Array
    L1_covariance: Array
    L2_W: Array
    L2_covariance: Array
    seen: Mask


@dataclass(frozen=True, kw_only=True)
class FlapEpisode:
    """An episode's record, its truth, its series by estimator, and the tip on its line.

    Attributes:
        moved_at: When the arm began to move the tool, [s]; None if it did not.
    """

    record: EpisodeRecord
    truth: TrueFlap
    series: dict[str, FlapSeries]
    line: TipLine
    moved_at: float | None = None


def flap_episode(record: EpisodeRecord) -> FlapEpisode:
    """The arrays of a record."""
    count = _held_still(record)
    moved_at = record.station[count].time if count < len(record.station) else None
    return FlapEpisode(
        record=record,
        truth=_truth(record),
        series={name: _series(found.ticks[:count]) for name, found in record.estimators.items()},
        line=tip_line(record),
        moved_at=moved_at,
    )


def _held_still(record: EpisodeRecord) -> int:
    """The number of ticks before the arm begins to move the tool."""
    phases = [status.phase for status in record.station_values(STATUS_PORT)]
    return phases.index(TO_TABLE) if TO_TABLE in phases else len(record.station)


def _stack(values: Sequence[Any], read: Callable[[Any], Any], *shape: int) -> Array:
    """What `read` makes of each value, (T, *shape)."""
    return np.array([read(value) for value in values], dtype=float).reshape(-1, *shape)


def _truth(record: EpisodeRecord) -> TrueFlap:
    ticks = record.station
    flaps = [tick.values.get("cheat_flap", UNKNOWN_FLAP) for tick in ticks]
    of_flap: dict[str, Any] = {
        name: _stack(flaps, attrgetter(name), *np.shape(unknown))
        for name, unknown in vars(UNKNOWN_FLAP).items()
    }
    of_flap["theta"] -= of_flap["theta"][:1]
    of_flap["touching"] = of_flap["touching"].astype(bool)
    poses = [tick.values.get("cheat_end_effector_pose") for tick in ticks]
    phases = [
        tick.values[STATUS_PORT].phase if STATUS_PORT in tick.values else "" for tick in ticks
    ]
    leaving = [tick.time for tick, phase in zip(ticks, phases, strict=True) if phase == RETREATING]
    return TrueFlap(
        times=np.array([tick.time for tick in ticks]),
        p_WE=_stack(poses, lambda X: np.full(3, np.nan) if X is None else X.translation(), 3),
        flipping=_from_first_to_last([phase == FLIPPING for phase in phases]),
        retreated_at=min(leaving, default=np.inf),
        **of_flap,
    )


def _from_first_to_last(flags: Sequence[bool]) -> Mask:
    """Which of the ticks lie between the first and the last that is flagged."""
    flagged = np.array(flags, dtype=bool)
    begun, ended = np.logical_or.accumulate(flagged), np.logical_or.accumulate(flagged[::-1])
    return begun & ended[::-1]


def _series(ticks: Sequence[Tick]) -> FlapSeries:
    tools: list[ToolBelief] = [tick.values.get("tool_latest", UNKNOWN_TOOL) for tick in ticks]
    planes = [tick.values.get("flap_plane_latest", unseen("")) for tick in ticks]
    return FlapSeries(
        times=np.array([tick.time for tick in ticks]),
        k_W=_stack(tools, lambda tool: tool.hinge.k_W, 3),
        k_covariance=_stack(tools, lambda tool: tool.hinge.covariance[:3, :3], 3, 3),
        theta=_stack(tools, lambda tool: tool.angle.theta),
        theta_std=np.sqrt(_stack(tools, lambda tool: tool.angle.variance)),
        L1_W=_stack(tools, lambda tool: tool.L1_W, 3),
        L1_covariance=_stack(tools, lambda tool: tool.L1_covariance, 3, 3),
        L2_W=_stack(tools, lambda tool: tool.L2_W, 3),
        L2_covariance=_stack(tools, lambda tool: tool.L2_covariance, 3, 3),
        seen=np.array([plane.seen for plane in planes], dtype=bool),
    )
