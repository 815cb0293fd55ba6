"""Writes down what the estimators believe and what the station gives, tick by tick."""

import copy
from collections.abc import Sequence
from time import perf_counter
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, InputPort, LeafSystem, State
from pydrake.systems.sensors import ImageRgba8U

from crossmodal.diagrams.run.record import (
    EstimatorRecord,
    Event,
    Picture,
    Quantity,
    TaskStatus,
    Tick,
)
from crossmodal.systems.port_values import StampedImage

STATUS_PORT = "task_status"  # Of a station that says what the robot does.


class EpisodeRecorder(LeafSystem):
    """Logs the outputs of each estimator, those of the station and some images into lists.

    At the instant of a tick, before the estimators update, it reads what the station gives there:
    the truth, the robot's task and the image. What the robot begins to do there is an event. Half a
    period later it reads the estimators' outputs,
    which are still those of the tick, and stamps them with the tick's time. So what is believed and
    what is true belong to one instant, and a tick at which an episode ends counts for neither.

    The lists live outside the Context, so one recorder serves one simulation. `status` is what the
    robot does at the last tick.

    Input ports:
    - `<station_port>`: each quantity and each picture of the station, by its port's name;
      `task_status`, where the station has it, is a `TaskStatus`; a picture is a `StampedImage`
      in colour.
    - `<estimator>_<port>`: each quantity of each estimator that has it.

    What has no source stays unconnected.

    Args:
        period: Tick of the estimators, [s].
        estimators: Names.
        quantities: Of the estimators.
        station: Quantities of the station.
        pictures: Ports of the station that give colour images.
        picture_interval: Least time between kept images of a camera, [s].
        max_pictures: Kept images of a camera; beyond it every other one is given up.
    """

    def __init__(
        self,
        period: float,
        estimators: Sequence[str],
        quantities: Sequence[Quantity],
        station: Sequence[Quantity] = (),
        pictures: Sequence[str] = (),
        picture_interval: float = 0.5,
        max_pictures: int = 16,
    ) -> None:
        super().__init__()
        self._picture_interval = dict.fromkeys(pictures, picture_interval)
        self._max_pictures = max_pictures
        self._pictures: dict[str, list[Picture]] = {port: [] for port in pictures}
        self.status = TaskStatus()
        self.estimators = {name: EstimatorRecord() for name in estimators}
        self.station: list[Tick] = []
        self._tick: Tick | None = None  # The latest one.
        self.events: list[Event] = []
        self._station_ports = {q.port: declare_input(self, q.port, q.model) for q in station}
        if STATUS_PORT not in self._station_ports:
            self._station_ports[STATUS_PORT] = declare_input(self, STATUS_PORT, TaskStatus())
        self._picture_ports = {
            port: declare_input(self, port, StampedImage(time=0.0, image=ImageRgba8U()))
            for port in pictures
        }
        self._estimator_ports = {
            name: {
                q.port: declare_input(self, f"{name}_{q.port}", q.model)
                for q in quantities
                if not q.estimators or name in q.estimators
            }
            for name in estimators
        }
        self.DeclarePeriodicPublishEvent(period, 0.0, self._record_station)
        self.DeclarePeriodicPublishEvent(period, 0.5 * period, self._record_beliefs)

    @property
    def pictures(self) -> list[Picture]:
        """The images of all cameras in order of time."""
        kept = [picture for pictures in self._pictures.values() for picture in pictures]
        return sorted(kept, key=lambda picture: picture.time)

    def note_status(self, time: float, status: TaskStatus) -> None:
        """Keeps what the robot begins to do at `time` [s] as an event, if it has a name."""
        if status != self.status and status.event and status.event != self.status.event:
            self.events.append(Event(time=time, name=status.event))
        self.status = status

    def _record_station(self, context: Context) -> None:
        time = context.get_time()
        values = read_inputs(self._station_ports, context)
        self._tick = Tick(time=time, values=values)
        self.note_status(time, values.get(STATUS_PORT, self.status))
        for name, port in self._picture_ports.items():
            kept = self._pictures[name]
            due = not kept or time >= kept[-1].time + self._picture_interval[name] - 1e-6
            if due and port.HasValue(context):
                color = np.array(port.Eval(context).image.data[:, :, :3])
                kept.append(Picture(time=time, port=name, color=color))

    def _record_beliefs(self, context: Context) -> None:
        if self._tick is None:
            return
        self.station.append(self._tick)
        time = self._tick.time
        for name, ports in self._estimator_ports.items():
            self.estimators[name].ticks.append(Tick(time=time, values=read_inputs(ports, context)))
        for name, kept in self._pictures.items():
            if len(kept) > self._max_pictures:
                del kept[1::2]
                self._picture_interval[name] *= 2.0


def declare_input(system: LeafSystem, name: str, model: Any) -> InputPort:
    """A port for values like the model: a vector port for an array."""
    if isinstance(model, np.ndarray):
        return system.DeclareVectorInputPort(name, len(model))
    return system.DeclareAbstractInputPort(name, AbstractValue.Make(model))


def read_inputs(ports: dict[str, InputPort], context: Context) -> dict[str, Any]:
    """The values of those ports that have a source, to be kept, by the ports' names."""
    return {
        name: _kept(port.Eval(context)) for name, port in ports.items() if port.HasValue(context)
    }


def _kept(value: Any) -> Any:
    """Port values of our own are never written again; Drake's are, in place.

    A value with a method `recorded` says itself what of it is worth keeping at every tick.
    """
    if isinstance(value, np.ndarray) or type(value).__module__.startswith("pydrake"):
        return copy.copy(value)
    return value.recorded() if hasattr(value, "recorded") else value


class TickStopwatch(LeafSystem):
    """Marks the wall time when its turn comes within the updates of one tick.

    Drake updates the systems of a Diagram in the order in which they were added. A stopwatch added
    before an estimator's filters and one after them measure what the filters' tick takes, as
    `stop.marks[k] - start.marks[k]`. What a stopwatch reads first, such as rendered images, is
    computed before it takes the time, and thereby left out.

    Input ports:
    - `input_<n>`: abstract, of any type given.
    """

    def __init__(self, period: float, inputs: Sequence[AbstractValue] = ()) -> None:
        super().__init__()
        self.marks: list[float] = []
        self._inputs = [
            self.DeclareAbstractInputPort(f"input_{index}", model)
            for index, model in enumerate(inputs)
        ]
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._mark)

    def _mark(self, context: Context, _: State) -> None:
        for port in self._inputs:
            if port.HasValue(context):
                port.EvalAbstract(context)
        self.marks.append(perf_counter())
