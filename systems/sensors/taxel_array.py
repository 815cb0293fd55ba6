"""Taxels that give a force of three components each: arrays on the fingers of a gripper."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.geometry import GeometryId
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from crossmodal.maths.arrays import Array, Ids
from crossmodal.maths.validation import check, number
from crossmodal.models.gripper_taxels import GripperTaxels
from crossmodal.systems.sensors.randomness import WhiteNoise, make_generator
from crossmodal.systems.sensors.sampled_sensor import SampledSensor
from crossmodal.systems.ticks import NETWORK_PERIOD


@dataclass(kw_only=True)
class TaxelArrayFault:
    """An array of taxels that reads one value for a time, whatever is pressed on it."""

    array: str = ""  # Its name in the gripper.
    # Of each component of each of its taxels; zero for a silent array.
    reading: float = number(0.0, at_least=-1000.0, at_most=1000.0, unit="N")
    start: float = number(0.0, at_least=0.0, at_most=86400.0, unit="s")  # Since the episode began.
    # When it ends, since the episode began.
    end: float = number(float("inf"), above=0.0, at_most=86400.0, unit="s", infinite=True)


@dataclass(kw_only=True)
class TaxelArrayConfig:
    period: float = number(0.005, at_least=1e-4, at_most=1.0, unit="s")  # Between samples.
    noise: float = number(0.01, at_least=0.0, at_most=100.0, unit="N")  # Standard deviation.
    # Of each component's constant offset, over episodes.
    offset: float = number(0.05, at_least=0.0, at_most=100.0, unit="N")
    largest: float = number(3.0, above=0.0, at_most=1000.0, unit="N")  # Beyond it, it saturates.
    # Touches per second on the whole gripper that no object causes: `false_force` on one taxel.
    false_contacts: float = number(0.0, at_least=0.0, at_most=10.0, unit="1/s")
    false_force: float = number(0.3, at_least=0.0, at_most=100.0, unit="N")  # Of such a touch.
    # How long such a touch lasts.
    false_time: float = number(0.05, at_least=1e-3, at_most=10.0, unit="s")


class TaxelArrayForces(LeafSystem):
    """The forces that truly act on each taxel, a shape of its own.

    What gets between taxels and presses on the core of the finger presses on the skin that covers
    it, and counts for the taxel there.

    Input ports:
    - `contact_results`: `ContactResults` of the plant; a plant with sampled outputs has none until
      its first step.
    - `body_poses`: list of `RigidTransform` X_WB, one per body, from the plant.

    Output ports:
    - `taxel_forces`: (3 T,) on each taxel, in E, [N].

    Frames: E of the gripper.

    Args:
        plant: The simulated one, finalized.
        frame: E.
        taxels: Their shapes, in order.
        cores: The shapes of the fingers' cores, in the order of `FINGERS`.
        layout: Of the taxels.
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        frame: Frame,
        taxels: Sequence[GeometryId],
        cores: Sequence[GeometryId],
        layout: GripperTaxels,
    ) -> None:
        super().__init__()
        self._layout = layout
        self._cores: Mapping[GeometryId, int] = {shape: n for n, shape in enumerate(cores)}
        self._body = int(frame.body().index())
        self._X_BE = frame.GetFixedPoseInBodyFrame()
        self._taxels: Mapping[GeometryId, int] = {shape: n for n, shape in enumerate(taxels)}
        self._contacts = self.DeclareAbstractInputPort(
            "contact_results", plant.get_contact_results_output_port().Allocate()
        )
        self._poses = self.DeclareAbstractInputPort(
            "body_poses", plant.get_body_poses_output_port().Allocate()
        )
        self.DeclareVectorOutputPort("taxel_forces", 3 * len(taxels), self._calc)

    def _calc(self, context: Context, output: BasicVector) -> None:
        contacts = self._contacts.Eval(context)
        forces = np.zeros((len(self._taxels), 3))
        for index in range(contacts.num_point_pair_contacts()):
            contact = contacts.point_pair_contact_info(index)
            pair, force = contact.point_pair(), contact.contact_force()
            # The force acts on B.
            for shape, body, f_W in (
                (pair.id_A, contact.bodyA_index(), -force),
                (pair.id_B, contact.bodyB_index(), force),
            ):
                taxel = self._taxels.get(shape)
                if shape in self._cores:
                    X_FW = self._poses.Eval(context)[int(body)].inverse()
                    taxel = self._layout.under(
                        self._cores[shape], X_FW @ contact.contact_point(), X_FW.rotation() @ f_W
                    )
                if taxel is not None:
                    forces[taxel] += f_W
        if forces.any():
            R_WE = (self._poses.Eval(context)[self._body] @ self._X_BE).rotation().matrix()
            forces = forces @ R_WE
        output.SetFromVector(forces.ravel())


class TaxelArraySensor(SampledSensor):
    """Samples the taxels: offsets, noise, saturation, false contacts, arrays that fail.

    Input ports:
    - `taxel_forces`: (3 T,), true forces in E, [N].

    Output ports:
    - `taxel_measured`: (3 T,), the last sample, held.
    - `taxel_window`: `SampleWindow` of the samples since the last tick, (K, 3 T).

    Args:
        config: Of the sensor.
        arrays: Names of the arrays.
        array_of: Of each taxel, the index of its array (T,).
        seed: Of offsets, noise and false contacts.
        faults: Of arrays.
        tick: Period of the estimators, [s].

    Raises:
        ValueError: for impossible values and for a fault of an array that is not there.
    """

    def __init__(
        self,
        config: TaxelArrayConfig,
        arrays: Sequence[str],
        array_of: Ids,
        seed: int,
        faults: Sequence[TaxelArrayFault] = (),
        tick: float = NETWORK_PERIOD,
    ) -> None:
        c, name, taxels = config, "TaxelArraySensor", len(array_of)
        check(c, name)
        for fault in faults:
            check(fault, name)
            if fault.array not in arrays:
                known = ", ".join(arrays)
                raise ValueError(f"{name}: array = '{fault.array}', but it must be one of {known}")
        super().__init__("taxel_forces", "taxel", 3 * taxels, c.period, tick)
        self._config, self._seed, self._taxels = c, seed, taxels
        self._noise = WhiteNoise(seed, f"{name} noise", 3 * taxels)
        self._offset = c.offset * make_generator(seed, f"{name} offset").standard_normal(3 * taxels)
        self._faults = [
            (np.repeat(array_of == arrays.index(fault.array), 3), fault) for fault in faults
        ]

    def measure(self, value: Array, index: int) -> Array:
        c = self._config
        sample = np.asarray(value) + self._false_contact(index)
        sample = np.clip(
            sample + self._offset + c.noise * self._noise(index), -c.largest, c.largest
        )
        for where, fault in self._faults:
            if fault.start <= index * c.period < fault.end:
                sample[where] = fault.reading
        return np.asarray(sample)

    def _false_contact(self, index: int) -> Array:
        """What a false contact adds at a sample: it lasts for a slot of the time or not at all."""
        c, force = self._config, np.zeros(3 * self._taxels)
        if c.false_contacts > 0.0:
            slot = int(index * c.period / c.false_time)
            rng = make_generator(self._seed, "TaxelArraySensor false", slot)
            if rng.uniform() < c.false_contacts * c.false_time:
                direction = rng.standard_normal(3)
                taxel = int(rng.integers(self._taxels))
                force[3 * taxel : 3 * taxel + 3] = (
                    c.false_force * direction / np.linalg.norm(direction)
                )
        return force
