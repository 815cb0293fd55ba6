"""How the tip of the tool followed its line on the table, and the figure of it."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from crossmodal.diagrams.flap.flip_status import DONE, FLIPPING, ON_LINE
from crossmodal.diagrams.run.record import EpisodeRecord, Tick
from crossmodal.diagrams.run.recorder import STATUS_PORT
from crossmodal.maths.arrays import Array, Mask
from crossmodal.systems.port_values import UNKNOWN_TOOL, ToolBelief


@dataclass(frozen=True, kw_only=True)
class TipLine:
    """The tip at the ticks (T); NaN where it is not known.

    The true tip is the point of the flap in which the finger touched it at last while it flipped
    it: the point that the robot takes as the tip, where it truly is.

    Attributes:
        times: [s]
        p_WT: True tip (T, 3), [m].
        p_WT_estimated: As the robot believes it to be (T, 3), [m].
        link_error_of: By estimator, from where its tool puts the tip, as a link of the true
            end-effector, to the true tip (T, 3), in the world, [m].
        p_WE_of: By estimator, where it takes the end-effector to be at the end of the flip (3,).
        acting: By which estimator the arm moved.
        on_line: Whether the arm moves the tip along the line.
        finished: Whether it came to the line's end.
        start: Of the line (3,), in the world, [m].
        end: Likewise.
    """

    times: Array
    p_WT: Array
    p_WT_estimated: Array
    link_error_of: Mapping[str, Array]
    p_WE_of: Mapping[str, Array]
    acting: str
    on_line: Mask
    finished: bool
    start: Array
    end: Array

    def p_WT_of(self, name: str) -> Array:
        """Where the true tip would have been had the arm acted by an estimator (T, 3), [m].

        For the acting one that is the true tip; for another it is displaced by what the two
        beliefs differ, as if the table were not there.
        """
        by_link = self.link_error_of[name] - self.link_error_of[self.acting]
        return self.p_WT + by_link + self.p_WE_of[self.acting] - self.p_WE_of[name]

    def offsets(self, p_WT: Array) -> tuple[Array, Array]:
        """Ways along the line (T,) and offsets from it (T, 3) of points (T, 3), [m]."""
        along = (self.end - self.start) / np.linalg.norm(self.end - self.start)
        way = (p_WT - self.start) @ along
        return way, p_WT - self.start - way[:, None] * along

    def rms(self, p_WT: Array) -> float:
        """RMS distance from the line while on it, [m]; NaN unless the line was finished."""
        if not self.finished:
            return float("nan")
        _, offset = self.offsets(p_WT[self.on_line])
        return float(np.sqrt(np.mean(np.sum(offset**2, axis=1))))

    def link_rms(self, name: str) -> float:
        """The same of an estimator's link alone: without what the arm itself is off by, [m]."""
        return self.rms(self.start + self.link_error_of[name])


def tip_line(record: EpisodeRecord) -> TipLine:
    """The tip in an episode."""
    ticks, config = record.station, record.scenario.control.line
    phases = [_phase(tick) for tick in ticks]
    touch = last_touch(ticks)
    poses = record.station_values("cheat_edge_pose")
    p_WT = np.full((len(ticks), 3), np.nan)
    if touch is not None and len(poses) == len(ticks):
        p_FT = poses[touch].inverse() @ ticks[touch].values["cheat_flap"].p_WC
        p_WT = np.array([pose @ p_FT for pose in poses])
    estimated = [tick.values.get("tip_estimated", np.full(3, np.nan)) for tick in ticks]
    tools: dict[str, ToolBelief] = dict.fromkeys(record.estimators, UNKNOWN_TOOL)
    if touch is not None:
        for name, found in record.estimators.items():
            after = found.ticks[min(touch + 1, len(found.ticks) - 1)]  # It has touched at last.
            tools[name] = after.values.get("tool_latest", UNKNOWN_TOOL)
    return TipLine(
        times=np.array([tick.time for tick in ticks]),
        p_WT=p_WT,
        p_WT_estimated=np.array(estimated).reshape(-1, 3),
        link_error_of=_link_errors(record, p_WT, tools),
        p_WE_of={name: tool.hinge.p_WK - tool.L1_W for name, tool in tools.items()},
        acting=record.scenario.acting_estimator,
        on_line=np.array([phase == ON_LINE for phase in phases], dtype=bool),
        finished=line_finished(record) and ON_LINE in phases,
        start=np.asarray(config.start, dtype=float),
        end=np.asarray(config.end, dtype=float),
    )


def line_finished(record: EpisodeRecord) -> bool:
    """Whether the tip came to the line's end, as the robot says."""
    return DONE in [event.name for event in record.events]


def _phase(tick: Tick) -> str:
    status = tick.values.get(STATUS_PORT)
    return "" if status is None else str(status.phase)


def last_touch(ticks: list[Tick]) -> int | None:
    """Index of the last tick at which the finger touched the flap and flipped it."""
    touched = [
        index
        for index, tick in enumerate(ticks)
        if _phase(tick) == FLIPPING and tick.values["cheat_flap"].touching
    ]
    return touched[-1] if touched else None


def _link_errors(
    record: EpisodeRecord, p_WT: Array, tools: Mapping[str, ToolBelief]
) -> dict[str, Array]:
    """See `TipLine.link_error_of`."""
    poses = record.station_values("cheat_end_effector_pose")
    if len(poses) != len(p_WT):
        return {name: np.full(p_WT.shape, np.nan) for name in tools}
    p_ET = {name: (tool.X_EK @ tool.X_KT)[:3, 3] for name, tool in tools.items()}
    return {
        name: p_WT - np.array([X_WE @ p for X_WE in poses]).reshape(-1, 3)
        for name, p in p_ET.items()
    }
