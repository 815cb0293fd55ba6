"""A pendulum with a noisy encoder, and two Kalman filters that trust their model differently."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from pydrake.examples import PendulumPlant
from pydrake.systems.framework import DiagramBuilder
from scipy.linalg import expm

from crossmodal.diagrams.evaluation.estimates import error_metrics, evaluate_rows, scalar
from crossmodal.diagrams.run.application import Application, Experiment, Quantity, Scenario, Station
from crossmodal.maths.validation import number
from crossmodal.systems.port_values import SampleWindow
from crossmodal.systems.recursive_filter import RecursiveFilter
from crossmodal.systems.sensors.randomness import WhiteNoise
from crossmodal.systems.sensors.sampled_sensor import SampledSensor


@dataclass(kw_only=True)
class Swing(Scenario):
    noise: float = number(0.02, at_least=0.0, at_most=10.0, unit="rad or rad/s")  # 1 sigma.


class Encoder(SampledSensor):
    def __init__(self, swing):
        super().__init__("state", "state", 2, 0.01, swing.network_period)
        self._noise, self._white = swing.noise, WhiteNoise(swing.seed, "encoder", 2)

    def measure(self, value, index):
        return value + self._noise * self._white(index)


class KalmanFilter(RecursiveFilter):
    def __init__(self, swing, acceleration):
        super().__init__()
        dt, self._R = swing.network_period, swing.noise**2
        self._F = np.array([[0, 1], [-9.81 / 0.5, -0.4]])
        self._A = expm(dt * self._F)
        self._Q = acceleration**2 * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        window = SampleWindow(times=np.zeros(0), values=np.zeros((0, 2)))
        self._window = self._declare_value_input("state_window", window)
        self._declare_recursion((np.zeros(2), np.eye(2)), self._update, dt)
        self._declare_latest("state_latest", lambda posterior: posterior)

    def _update(self, context, posterior):
        mean, P = self._A @ posterior[0], self._A @ posterior[1] @ self._A.T + self._Q
        window = self._read(self._window, context)
        # A sample is older than the tick: it measures where the pendulum was then.
        age = round(context.get_time() - window.times[-1], 6)  # [s]
        H = expm(-age * self._F)[0]
        gain = P @ H / (H @ P @ H + self._R)
        return mean + gain * (window.values[-1, 0] - H @ mean), P - np.outer(gain, H @ P)


def make_station(swing, calibration):
    builder = DiagramBuilder()
    pendulum, encoder = builder.AddSystem(PendulumPlant()), builder.AddSystem(Encoder(swing))
    builder.Connect(pendulum.get_output_port(), encoder.get_input_port())
    builder.ExportOutput(encoder.GetOutputPort("state_window"), "state_window")
    builder.ExportOutput(pendulum.get_output_port(), "cheat_state")
    return Station(diagram=builder.Build(), initialise=lambda c: c.SetContinuousState([0.3, 0.0]))


def rows(estimator, tick, station):
    mean, P = tick.values["state_latest"]
    yield scalar("angle", mean[0], std=P[0, 0] ** 0.5, true=station.values["cheat_state"][0])


APPLICATION = Application(
    name="pendulum",
    description="a pendulum swings, and an encoder reads its angle",
    scenario=Swing,
    scenarios=Path(__file__).parent,
    make_station=make_station,
    make_estimators=lambda swing, calibration: {
        name: KalmanFilter(swing, a) for name, a in {"stubborn": 0.001, "open": 0.1}.items()
    },
    quantities=lambda swing: [Quantity(port="state_latest", model=(np.zeros(2), np.eye(2)))],
    station_quantities=lambda swing: [Quantity(port="cheat_state", model=np.zeros(2))],
    evaluate=partial(evaluate_rows, rows=rows, units={"angle": "rad"}),
    metrics=error_metrics({"angle": "rad"}),
    experiments={"swing": Experiment(scenario="swing", description="it swings for 10 s")},
)
