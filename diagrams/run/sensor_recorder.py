"""Keeps the sensor streams of an episode, so that they can be perceived again."""

from pathlib import Path

from pydrake.systems.framework import Context, LeafSystem

from diagrams.run.sensor_log import STREAMS, SensorLogWriter


class SensorRecorder(LeafSystem):
    """Writes what flows through its ports at every tick into a file of sensor streams.

    The file lies outside the Context, so one recorder serves one simulation.

    .. pydrake_system::

        name: SensorRecorder
        input_ports:
        - <stream>

    - `<stream>`: each of `STREAMS`, as the station has it.

    Args:
        path: The file, replaced where it exists.
        period: Of the ticks, [s].
    """

    def __init__(self, path: Path, period: float) -> None:
        super().__init__()
        self.log = SensorLogWriter(path)
        for port, stream in STREAMS.items():
            if stream.model is None:
                self.DeclareVectorInputPort(port, 1)
            else:
                self.DeclareAbstractInputPort(port, stream.model())
        self.DeclarePeriodicPublishEvent(period, 0.0, self._write)

    def _write(self, context: Context) -> None:
        for port, stream in STREAMS.items():
            value = self.GetInputPort(port).Eval(context)
            self.log.write(stream, value, context.get_time())
