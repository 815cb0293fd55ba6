"""Ticks are counted: none comes or goes with the rounding of sums of periods."""

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem

from crossmodal.diagrams.run.record import Quantity, TaskStatus
from crossmodal.diagrams.run.recorder import STATUS_PORT, EpisodeRecorder
from crossmodal.diagrams.run.ticks import advance_by_ticks

PERIOD = 1 / 15
PHASES = {10: TaskStatus(phase="pulling"), 20: TaskStatus(phase="stopped", done=True)}


class Robot(LeafSystem):
    """Begins its phases in updates at the ticks, so that they are seen from the next tick on."""

    def __init__(self) -> None:
        super().__init__()
        self._status = self.DeclareAbstractState(Value[object](TaskStatus()))
        self.DeclareStateOutputPort(STATUS_PORT, self._status)
        self.DeclareVectorOutputPort("clock", 1, lambda c, o: o.SetAtIndex(0, c.get_time()))
        self.DeclarePeriodicUnrestrictedUpdateEvent(PERIOD, 0.0, self._update)

    def _update(self, context: Context, state: object) -> None:
        phase = PHASES.get(round(context.get_time() / PERIOD))
        if phase is not None:
            state.get_mutable_abstract_state(int(self._status)).set_value(phase)


def advanced(end: float, stop_time: float = np.inf) -> tuple[EpisodeRecorder, float]:
    builder = DiagramBuilder()
    robot = builder.AddSystem(Robot())
    clock = Quantity(port="clock", model=np.zeros(1))
    recorder = builder.AddSystem(EpisodeRecorder(PERIOD, ["filter"], [clock], [clock]))
    for port in (STATUS_PORT, "clock"):
        builder.Connect(robot.GetOutputPort(port), recorder.GetInputPort(port))
    builder.Connect(robot.GetOutputPort("clock"), recorder.GetInputPort("filter_clock"))
    simulator = Simulator(builder.Build())
    simulator.Initialize()
    advance_by_ticks(simulator, recorder, PERIOD, end, stop_time)
    return recorder, simulator.get_context().get_time()


@pytest.mark.parametrize("count", [1, 33, 150, 601])
def test_an_episode_of_so_many_ticks_ends_at_the_last_ones_own_instant(count: int) -> None:
    sums = float(np.cumsum(np.full(count, PERIOD))[-1])
    for end in (count * PERIOD, sums, round(count * PERIOD, 12)):
        recorder, time = advanced(end)
        assert time == count * PERIOD
        assert [tick.time for tick in recorder.station] == [k * PERIOD for k in range(count)]
        assert len(recorder.estimators["filter"].ticks) == count


def test_an_episode_may_end_between_two_ticks() -> None:
    for end, beliefs in ((2.4 * PERIOD, 2), (2.6 * PERIOD, 3)):
        recorder, time = advanced(end)
        assert time == end
        assert len(recorder.station) == beliefs
        assert len(recorder.estimators["filter"].ticks) == beliefs


def test_what_the_robot_does_is_an_event_at_the_first_tick_that_sees_it() -> None:
    recorder, _ = advanced(3.0)
    assert [(event.time, event.name) for event in recorder.events] == [
        (11 * PERIOD, "pulling"),
        (21 * PERIOD, "stopped"),
    ]


@pytest.mark.parametrize(("stop_time", "end"), [(0.0, 1.4), (1.0, 36 * PERIOD), (0.25, 1.65)])
def test_it_goes_on_for_the_stop_time_once_the_robot_is_done(stop_time: float, end: float) -> None:
    _, time = advanced(40.0, stop_time)
    assert time == pytest.approx(end, abs=1e-12)
    assert advanced(1.5, stop_time)[1] == min(1.5, time)
