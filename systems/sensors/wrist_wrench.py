"""A six-axis force and torque sensor between arm and hand."""

from dataclasses import dataclass

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import check, number
from crossmodal.systems.sensors.randomness import WhiteNoise, make_generator
from crossmodal.systems.sensors.sampled_sensor import SampledSensor
from crossmodal.systems.ticks import NETWORK_PERIOD


@dataclass(kw_only=True)
class WristWrenchConfig:
    period: float = number(0.01, at_least=1e-4, at_most=1.0, unit="s")  # Between samples.
    # Standard deviation.
    noise_torque: float = number(0.005, at_least=0.0, at_most=1000.0, unit="N·m")
    noise_force: float = number(0.1, at_least=0.0, at_most=1e4, unit="N")  # Standard deviation.
    # Left after taring, standard deviation over episodes.
    bias_torque: float = number(0.02, at_least=0.0, at_most=1000.0, unit="N·m")
    # Left after taring, standard deviation over episodes.
    bias_force: float = number(0.3, at_least=0.0, at_most=1e4, unit="N")
    # Quantisation.
    step_torque: float = number(1.0 / 800.0, at_least=1e-9, at_most=1000.0, unit="N·m")
    step_force: float = number(1.0 / 40.0, at_least=1e-9, at_most=1e4, unit="N")  # Quantisation.
    range_torque: float = number(10.0, above=0.0, at_most=1e4, unit="N·m")  # Saturation per axis.
    # Saturation per axis across the sensor.
    range_force: float = number(130.0, above=0.0, at_most=1e5, unit="N")
    # Saturation along the sensor's z.
    range_force_axial: float = number(400.0, above=0.0, at_most=1e5, unit="N")


def force_in_sensor(F_Jc: SpatialForce, X_JcS: RigidTransform, sign: float) -> Array:
    """`sign` times a spatial force (6,) at Jc in Jc's axes, moved to So and expressed in S."""
    F_S = F_Jc.Shift(X_JcS.translation())
    R_SJc = X_JcS.rotation().inverse()
    return sign * np.concatenate([R_SJc @ F_S.rotational(), R_SJc @ F_S.translational()])


class ReactionWrench(LeafSystem):
    """Takes the load on one joint out of the plant's reaction forces.

    A joint's reaction force is what its parent does to its child, at the child's joint frame Jc
    and in its axes: it carries the child. A sensor that is mounted there reports the opposite, what
    the child (the hand, its weight and all that pulls on it) does to the parent: sign -1. A
    plant with sampled outputs gives zeros until its first step.

    Input ports:
    - `reaction_forces`: list of `SpatialForce`, one per joint, from the plant.

    Output ports:
    - `F_S`: (6,), torque [N·m] about So, then force [N], both in S.

    Frames: J the joint's frame on its child C (Jc), S the sensor.
    """

    def __init__(
        self, plant: MultibodyPlant, joint: Joint, X_JcS: RigidTransform, sign: float = -1.0
    ) -> None:
        super().__init__()
        self._index = int(joint.index())
        self._X_JcS = X_JcS
        self._sign = sign
        model = plant.get_reaction_forces_output_port().Allocate()
        self._forces = self.DeclareAbstractInputPort("reaction_forces", model)
        self.DeclareVectorOutputPort("F_S", 6, self._calc)

    def _calc(self, context: Context, output: BasicVector) -> None:
        F_Jc = self._forces.Eval(context)[self._index]
        output.set_value(force_in_sensor(F_Jc, self._X_JcS, self._sign))


class WristWrenchSensor(SampledSensor):
    """Measures the spatial force at the wrist with noise, bias, quantisation and saturation.

    F_measured = round_to_step(clip(F + bias + noise)); the seed draws the bias once per episode.

    Input ports:
    - `F_S`: (6,), torque [N·m] about So, then force [N], both in S.

    Output ports:
    - `wrench_measured`: (6,), the last sample, held.
    - `wrench_window`: `SampleWindow` of the samples since the last tick, (K, 6).

    Frames: S the sensor, z along the arm's last link.

    Source: range and resolution are those of the ATI Gamma SI-130-10 (ATI Industrial Automation,
    F/T Gamma data sheet); noise is larger than its electronics', as on an arm with moving cables.
    """

    def __init__(self, config: WristWrenchConfig, seed: int, tick: float = NETWORK_PERIOD) -> None:
        c, name = config, "WristWrenchSensor"
        check(c, name)
        super().__init__("F_S", "wrench", 6, c.period, tick)
        rng = make_generator(seed, "WristWrenchSensor bias")
        self._bias = np.repeat([c.bias_torque, c.bias_force], 3) * rng.standard_normal(6)
        self._sigma = np.repeat([c.noise_torque, c.noise_force], 3)
        self._step = np.repeat([c.step_torque, c.step_force], 3)
        self._range = np.repeat([c.range_torque, c.range_force], 3)
        self._range[5] = c.range_force_axial
        self._noise = WhiteNoise(seed, "WristWrenchSensor noise", 6)

    def measure(self, value: Array, index: int) -> Array:
        sample = value + self._bias + self._sigma * self._noise(index)
        sample = np.minimum(np.maximum(sample, -self._range), self._range)
        return np.asarray(self._step * np.rint(sample / self._step))
