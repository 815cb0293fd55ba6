"""How an episode goes on from tick to tick, simulated or replayed."""

import math
from collections.abc import Callable

from pydrake.systems.analysis import Simulator

from crossmodal.diagrams.run.recorder import EpisodeRecorder

_SAME_INSTANT = 1e-9  # [s]


def advance_by_ticks(
    simulator: Simulator,
    recorder: EpisodeRecorder,
    period: float,
    end: float,
    stop_time: float = math.inf,
    progress: Callable[[float], None] | None = None,
) -> None:
    """Advances an initialised simulation to its end, tick by tick.

    The tick k is at the instant k * period, where Drake's periodic events are: sums of periods
    would lie beside it, and whether a tick still belongs to an episode would be left to rounding.
    A tick at which it ends is not recorded, but what the robot then begins to do is.

    Args:
        simulator: Of a Diagram with the recorder in it.
        recorder: Knows whether the robot is done.
        period: Of the ticks, [s].
        end: When it ends at the latest, [s].
        stop_time: How long it goes on when the robot is done, [s].
        progress: Called with the time [s] after every tick.
    """
    tick, done = 0, False
    end = _at_tick(end, period)
    while simulator.get_context().get_time() < end:
        tick += 1
        now = min(tick * period, end)
        simulator.AdvanceTo(now)
        if not done and recorder.status.done:
            done, end = True, min(end, _at_tick(now + stop_time, period))
        if progress is not None:
            progress(now)


def _at_tick(time: float, period: float) -> float:
    """The tick's own instant for a time that means a tick, else the time, [s]."""
    nearest = round(time / period) * period if math.isfinite(time) else time
    return nearest if abs(nearest - time) < _SAME_INSTANT else time
