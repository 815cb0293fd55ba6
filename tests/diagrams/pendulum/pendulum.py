"""A pendulum with a noisy encoder, and two Kalman filters that trust their model differently."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from pydrake.examples import PendulumPlant
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from diagrams.evaluation.estimates import error_metrics, evaluate_rows, scalar
from diagrams.run.application import Application, Experiment, Quantity, Scenario, Station
from systems.sensors.randomness import WhiteNoise
from systems.sensors.sampled_sensor import SampledSensor


@dataclass(kw_only=True)
class Swing(Scenario):
    noise: float = 0.02  # Standard deviation of the encoder, [rad] and [rad/s].


class Encoder(SampledSensor):
    def __init__(self, swing):
        super().__init__("state", "angle", 2, 0.01, swing.network_period)
        self._noise, self._white = swing.noise, WhiteNoise(swing.seed, "encoder", 2)

    def measure(self, value, index):
        return value + self._noise * self._white(index)


class KalmanFilter(LeafSystem):
    def __init__(self, swing, process_noise):
        super().__init__()
        window = Encoder(swing).GetOutputPort("angle_window").Allocate()
        self._angle = self.DeclareAbstractInputPort("angle_window", window)
        self.DeclareStateOutputPort("state_latest", self.DeclareDiscreteState([0, 0, 1, 0, 0, 1]))
        self._A = np.eye(2) + swing.network_period * np.array([[0, 1], [-9.81 / 0.5, -0.4]])
        self._Q, self._R = process_noise * np.eye(2), swing.noise**2
        self.DeclarePeriodicUnrestrictedUpdateEvent(swing.network_period, 0.0, self._update)

    def _update(self, context, state):
        stored = context.get_discrete_state_vector().value()
        mean, P = self._A @ stored[:2], self._A @ stored[2:].reshape(2, 2) @ self._A.T + self._Q
        gain = P[:, 0] / (P[0, 0] + self._R)
        mean += gain * (self._angle.Eval(context).values[-1, 0] - mean[0])
        state.get_mutable_discrete_state().set_value([*mean, *(P - np.outer(gain, P[0])).ravel()])


def make_station(swing, calibration):
    builder = DiagramBuilder()
    pendulum, encoder = builder.AddSystem(PendulumPlant()), builder.AddSystem(Encoder(swing))
    builder.Connect(pendulum.get_output_port(), encoder.get_input_port())
    builder.ExportOutput(encoder.GetOutputPort("angle_window"), "angle_window")
    builder.ExportOutput(pendulum.get_output_port(), "cheat_state")
    return Station(diagram=builder.Build(), initialise=lambda c: c.SetContinuousState([0.3, 0.0]))


def rows(tick, station):
    angle, _, variance, *_ = tick.values["state_latest"]
    yield scalar("angle", angle, std=variance**0.5, true=station.values["cheat_state"][0])


APPLICATION = Application(
    name="pendulum",
    description="a pendulum swings, and an encoder reads its angle",
    scenario=Swing,
    scenarios=Path(__file__).parent,
    make_station=make_station,
    make_estimators=lambda swing, calibration: {
        "stubborn": KalmanFilter(swing, 1e-6),
        "open": KalmanFilter(swing, 1e-3),
    },
    quantities=[Quantity(port="state_latest", model=np.zeros(6))],
    station_quantities=[Quantity(port="cheat_state", model=np.zeros(2))],
    evaluate=partial(evaluate_rows, rows=rows, units={"angle": "rad"}),
    metrics=error_metrics({"angle": "rad"}),
    experiments={"swing": Experiment(scenario="swing", description="it swings for 10 s")},
)
