"""The taxels of a tactile fingertip: normal forces from the pressure on its skin."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.geometry import GeometryId
from pydrake.math import RigidTransform
from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import check, number, require
from crossmodal.systems.sensors.randomness import WhiteNoise, make_generator
from crossmodal.systems.sensors.sampled_sensor import SampledSensor
from crossmodal.systems.ticks import NETWORK_PERIOD

# Distance, in `spread`, at which a lone taxel senses half of a force.
_EDGE = 2.5


@dataclass(kw_only=True)
class TaxelFault:
    """A taxel that reads one value for a time, whatever is pressed on it."""

    taxel: int = number(0, at_least=0, at_most=1000)  # Its number, from 0 on.
    reading: float = number(0.0, at_least=0.0, at_most=1000.0, unit="N")  # 0 for a dead one.
    start: float = number(0.0, at_least=0.0, at_most=86400.0, unit="s")  # Since the episode began.
    # When it ends, since the episode began.
    end: float = number(float("inf"), above=0.0, at_most=86400.0, unit="s", infinite=True)


@dataclass(kw_only=True)
class TaxelsConfig:
    period: float = number(0.01, at_least=1e-4, at_most=1.0, unit="s")  # Between samples.
    # Standard deviation of how far the skin spreads a force.
    spread: float = number(0.0025, at_least=1e-4, at_most=0.1, unit="m")
    noise: float = number(0.01, at_least=0.0, at_most=100.0, unit="N")  # Standard deviation.
    # Less than this reads as nothing.
    threshold: float = number(0.03, at_least=0.0, at_most=100.0, unit="N")
    # Of all taxels together on the fingertip, along each axis; standard deviation over episodes.
    place: float = number(0.0005, at_least=0.0, at_most=0.1, unit="m")


def felt_shares(p_SQ: Array, p_ST: Array, spread: float) -> Array:
    """Share (Q, T) of a force at each point that each taxel senses.

    The taxels' cells tile the pad, and between two of them the skin divides a force smoothly:
    exp(-r^2 / 2 spread^2), normalised over the taxels. A force beside the pad goes into the
    fingertip's core and is lost.

    Args:
        p_SQ: Points (Q, 3), [m].
        p_ST: Taxels (T, 3), [m].
        spread: [m].
    """
    squared = np.sum((p_SQ[:, None] - p_ST) ** 2, axis=2)
    weight = np.exp(-0.5 * squared / spread**2)
    core = np.exp(-0.5 * _EDGE**2)
    return np.asarray(weight / (core + weight.sum(axis=1, keepdims=True)))


def calibration_factor(p_ST: Array, n_S: Array, spread: float) -> float:
    """By what the readings are multiplied so that their vector sum is the force on the pad.

    The forces of the taxels are not parallel, so that their sum is less than what is pressed. The
    factor is that of a force in the middle of the pad, along its normal.

    Args:
        p_ST: Taxels (T, 3), [m].
        n_S: Their normals (T, 3).
        spread: [m].
    """
    shares = felt_shares(np.mean(p_ST, axis=0, keepdims=True), p_ST, spread)
    return 1.0 / float(np.linalg.norm(shares @ n_S))


@dataclass(frozen=True, kw_only=True)
class Pressure:
    """What presses on a shape: a force at each of some points, along the normal there.

    Attributes:
        p_SQ: Points (Q, 3), [m].
        n_S: Normals (Q, 3) out of the shape.
        force: Magnitudes (Q,), [N].
        f_S: Sum of the forces with which the shape acts on others (3,), friction included, [N].
    """

    p_SQ: Array
    n_S: Array
    force: Array
    f_S: Array


def pressure_on(contacts: ContactResults, shape: GeometryId, X_WS: RigidTransform) -> Pressure:
    """What presses on a shape of a body, expressed in its frame S.

    Args:
        contacts: Of the plant.
        shape: The shape.
        X_WS: Pose of S.
    """
    p, n, force, total = [np.empty((0, 3))], [np.empty((0, 3))], [np.empty(0)], np.zeros(3)
    for index in range(contacts.num_hydroelastic_contacts()):
        info = contacts.hydroelastic_contact_info(index)
        surface = info.contact_surface()
        if shape not in (surface.id_M(), surface.id_N()):
            continue
        out = -1.0 if shape == surface.id_M() else 1.0  # Normals point into M.
        field_ = surface.tri_e_MN() if surface.is_triangle() else surface.poly_e_MN()
        faces = range(surface.num_faces())
        p.append(np.array([surface.centroid(face) for face in faces]))
        n.append(out * np.array([surface.face_normal(face) for face in faces]))
        pressure = [field_.EvaluateCartesian(face, p[-1][face]) for face in faces]
        force.append(np.array(pressure) * [surface.area(face) for face in faces])
        total += out * info.F_Ac_W().translational()
    for index in range(contacts.num_point_pair_contacts()):
        point = contacts.point_pair_contact_info(index)
        pair = point.point_pair()
        if shape not in (pair.id_A, pair.id_B):
            continue
        out = -1.0 if shape == pair.id_A else 1.0  # The normal points into A, the force acts on B.
        p.append(np.reshape(point.contact_point(), (1, 3)))
        n.append(out * np.reshape(pair.nhat_BA_W, (1, 3)))
        force.append(np.abs([point.contact_force() @ pair.nhat_BA_W]))
        total -= out * point.contact_force()
    X_SW = X_WS.inverse()
    return Pressure(
        p_SQ=np.vstack(p) @ X_SW.rotation().matrix().T + X_SW.translation(),
        n_S=np.vstack(n) @ X_SW.rotation().matrix().T,
        force=np.concatenate(force),
        f_S=X_SW.rotation() @ total,
    )


class TaxelForces(LeafSystem):
    """What each taxel is truly pressed by: the normal force that the skin passes on to it.

    Input ports:
    - `contact_results`: `ContactResults` of the plant; a plant with sampled outputs has none until
      its first step.
    - `body_poses`: list of `RigidTransform` X_WB, one per body, from the plant.

    Output ports:
    - `taxel_forces`: (T,), [N].

    Frames: S the fingertip.
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        frame: Frame,
        skin: GeometryId,
        p_ST: Array,
        n_S: Array,
        spread: float,
    ) -> None:
        """Keeps where the taxels are.

        Args:
            plant: The simulated one, finalized.
            frame: S.
            skin: The fingertip's shape.
            p_ST: Where the taxels truly are (T, 3), [m].
            n_S: Their normals (T, 3), by which they are calibrated.
            spread: Of the skin, [m].
        """
        super().__init__()
        self._body = int(frame.body().index())
        self._X_BS = frame.GetFixedPoseInBodyFrame()
        self._skin = skin
        self._p_ST, self._spread = p_ST, spread
        self._factor = calibration_factor(p_ST, n_S, spread)
        self._contacts = self.DeclareAbstractInputPort(
            "contact_results", plant.get_contact_results_output_port().Allocate()
        )
        self._poses = self.DeclareAbstractInputPort(
            "body_poses", plant.get_body_poses_output_port().Allocate()
        )
        self.DeclareVectorOutputPort("taxel_forces", len(p_ST), self._calc)

    def _calc(self, context: Context, output: BasicVector) -> None:
        X_WS = self._poses.Eval(context)[self._body] @ self._X_BS
        pressure = pressure_on(self._contacts.Eval(context), self._skin, X_WS)
        shares = felt_shares(pressure.p_SQ, self._p_ST, self._spread)
        output.set_value(self._factor * pressure.force @ shares)


class TaxelSensor(SampledSensor):
    """Samples the taxels: noise, a threshold, and taxels that are dead or stuck.

    Input ports:
    - `taxel_forces`: (T,), true normal forces, [N].

    Output ports:
    - `taxel_measured`: (T,), the last sample, held.
    - `taxel_window`: `SampleWindow` of the samples since the last tick, (K, T).

    Args:
        config: Of the sensor.
        taxels: How many there are.
        seed: Of the noise.
        faults: Of single taxels.
        tick: Period of the estimators, [s].

    Raises:
        ValueError: for impossible values and for a fault of a taxel that is not there.
    """

    def __init__(
        self,
        config: TaxelsConfig,
        taxels: int,
        seed: int,
        faults: Sequence[TaxelFault] = (),
        tick: float = NETWORK_PERIOD,
    ) -> None:
        c, name = config, "TaxelSensor"
        check(c, name)
        for fault in faults:
            check(fault, name)
            require(fault.taxel < taxels, name, fault, "taxel", f"< {taxels}, their number")
        super().__init__("taxel_forces", "taxel", taxels, c.period, tick)
        self._config, self._faults = c, list(faults)
        self._noise = WhiteNoise(seed, "TaxelSensor noise", taxels)

    def measure(self, value: Array, index: int) -> Array:
        c = self._config
        sample = value + c.noise * self._noise(index)
        sample = np.where(sample < c.threshold, 0.0, sample)
        for fault in self._faults:
            if fault.start <= index * c.period < fault.end:
                sample[fault.taxel] = fault.reading
        return np.asarray(sample)


def draw_places(p_ST: Array, config: TaxelsConfig, seed: int) -> Array:
    """Where the taxels truly are (T, 3), all shifted by what the seed draws."""
    rng = make_generator(seed, "TaxelSensor place")
    return np.asarray(p_ST + config.place * rng.standard_normal(3))
