"""Holds a contact where it should be on the fingertip, with the force that it should have."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from crossmodal.controllers.servoing.twists import from_contact
from crossmodal.maths.arrays import Array, Mask
from crossmodal.maths.validation import check, number, numbers

FEATURES = 6  # x, z [m], f_x, f_y, f_z [N], angle of an edge [rad].


@dataclass(kw_only=True)
class TactileServoingConfig:
    """Gains are in the order of the features: x, z, f_x, f_y, f_z, angle of an edge.

    Attributes:
        force: That the contact should have, [N]. It is no field: the station hands it over.
    """

    force = 0.5
    period: float = number(0.01, at_least=1e-4, at_most=1.0, unit="s")  # Update period.
    # Where the contact should be on the pad, along x and z.
    position: list[float] = numbers([0.0, 0.0], at_least=-0.1, at_most=0.1, unit="m")
    # Gain of each feature's error.
    proportional: list[float] = numbers(
        [1.0, 1.0, 0.0, 0.01, 0.0, 0.0], at_least=0.0, at_most=100.0, unit="1/s or m/(s N)"
    )
    # Gain of the error's integral.
    integral: list[float] = numbers(
        [0.0, 0.0, 0.0, 0.05, 0.0, 0.0], at_least=0.0, at_most=1e3, unit="1/s^2 or m/(s^2 N)"
    )
    # Gain of the error's rate.
    derivative: list[float] = numbers(
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0], at_least=0.0, at_most=10.0, unit="1 or m/N"
    )
    # Largest output of a feature.
    limit: list[float] = numbers(
        [0.006, 0.006, 0.006, 0.006, 0.006, 0.2], above=0.0, at_most=10.0, unit="m/s or rad/s"
    )


def inverted_sensor_jacobian(semi_axes: Array) -> Array:
    """The matrix (6, 6) that maps outputs for the features to a twist V_WC_S that reduces them.

    Rows: w_x, w_y, w_z, v_x, v_y, v_z. Columns: x, z, f_x, f_y, f_z (of the force on the finger),
    angle of an edge; all are actual minus desired.

    Near the middle of the pad, (0, b, 0) on an ellipsoid with semi-axes a, b, c, a flat surface
    with normal n touches at x = R_x n_x, z = R_z n_z, where R_x = a^2 / b and R_z = c^2 / b are the
    radii of curvature. A rotation w of the finger turns n in S by -w x n, n ~ y:

        dx/dt = R_x w_z,  dz/dt = -R_z w_x    so  w_z = -x / R_x,  w_x = z / R_z.

    A point or an edge stays in the world, so that sliding moves the contact against the finger:

        dx/dt = -v_x,  dz/dt = -v_z           so  v_x = x,  v_z = z.

    With stiffness K, pushing along n raises the force on the finger -K n (n . v), so that v_i =
    f_i for each axis: too strong a force on the finger, along -y, moves it back along -y. An edge
    stays in the world, too, and its angle about y falls as the finger turns: w_y = angle.
    """
    a, b, c = semi_axes
    J = np.zeros((6, FEATURES))
    J[2, 0], J[3, 0] = -b / a**2, 1.0
    J[0, 1], J[5, 1] = b / c**2, 1.0
    J[3, 2] = J[4, 3] = J[5, 4] = 1.0
    J[1, 5] = 1.0
    return J


def feature_errors(contact: Any, config: TactileServoingConfig, force: float) -> Array:
    """Actual minus desired features (6,) of a `TactileContact`; zero where it has none.

    Args:
        force: That the contact should have, [N].
    """
    desired = np.array([*config.position, 0.0, -force, 0.0, 0.0])
    x, _, z = contact.p_SC
    actual = np.array([x, z, *-contact.f_S, contact.edge_angle])
    return np.nan_to_num(actual - desired)


@dataclass(frozen=True, kw_only=True)
class Pid:
    """A PID controller of a vector with limited outputs, as lists of gains per component."""

    proportional: Array
    integral: Array
    derivative: Array
    limit: Array
    period: float

    def output(self, error: Array, last: Array, total: Array) -> Array:
        """u = k_P e + k_I sum e dt + k_D de/dt within the limits.

        Args:
            error: Now (n,).
            last: One period ago (n,); NaN where it is not known.
            total: The integral (n,).
        """
        return np.asarray(np.clip(self._free(error, last, total), -self.limit, self.limit))

    def integrate(self, error: Array, last: Array, total: Array, able: bool) -> Array:
        """The next integral (n,).

        A component does not integrate what would drive its output further beyond a limit, and none
        does while what follows is not `able` to do as commanded.
        """
        free = self._free(error, last, total)
        stuck: Mask = (np.abs(free) > self.limit) & (free * error > 0.0)
        return np.where(stuck | (not able), total, total + self.period * error)

    def _free(self, error: Array, last: Array, total: Array) -> Array:
        rate = np.nan_to_num((error - last) / self.period)
        return self.proportional * error + self.integral * total + self.derivative * rate


class TactileServoing(LeafSystem):
    """Moves the fingertip so that the contact's features become what they should be.

    u = PID(actual - desired features), V_WC_S = P_tact J^-1 u, V_WS_S with the point of contact as
    the centre of rotations, so that a roll is one. Without a contact it is zero and forgets.

    Input ports:
    - `contact_latest`: `TactileContact` of the fingertip.
    - `tactile_projector`: (6,) diagonal of P_tact, ones and zeros, in the order of a twist: w_x,
      w_y, w_z, v_x, v_y, v_z.
    - `force_desired`: (1,) of the contact, [N]; the configured one if not connected.
    - `twist_share`: (1,) of `TwistToJoints`; integrals stand still below one. May stay unconnected.

    Output ports:
    - `tactile_twist_desired`: (6,) V_WS_S, [rad/s, m/s].

    State: last errors and integrals (12,); the errors are NaN without a contact.

    Frames: W world, S fingertip, C contact.

    Source: Q. Li, A. Ückermann, R. Haschke and H. Ritter, "Estimating an articulated tool's
    kinematics via visuo-tactile based robotic interactive manipulation", IROS 2018, section III-A.

    Args:
        config: Goal and gains.
        semi_axes: Of the fingertip's ellipsoid (3,), [m].

    Raises:
        ValueError: for an impossible config value.
    """

    def __init__(self, config: TactileServoingConfig, semi_axes: Array) -> None:
        super().__init__()
        check(config, "TactileServoing")
        self._config = config
        names = "proportional", "integral", "derivative", "limit"
        gains = {name: np.array(getattr(config, name)) for name in names}
        self._pid = Pid(**gains, period=config.period)
        self._jacobian = inverted_sensor_jacobian(semi_axes)
        self._contact = self.DeclareAbstractInputPort("contact_latest", Value[object]())
        self._projector = self.DeclareVectorInputPort("tactile_projector", 6)
        self._force = self.DeclareVectorInputPort("force_desired", 1)
        self._share = self.DeclareVectorInputPort("twist_share", 1)
        self.DeclareDiscreteState(np.concatenate([np.full(FEATURES, np.nan), np.zeros(FEATURES)]))
        self.DeclareVectorOutputPort("tactile_twist_desired", 6, self._calc_twist)
        self.DeclarePeriodicDiscreteUpdateEvent(config.period, 0.0, self._update)

    def _remembered(self, context: Context) -> tuple[Array, Array]:
        state = np.asarray(context.get_discrete_state_vector().value())
        return state[:FEATURES], state[FEATURES:]

    def _error(self, context: Context, contact: Any) -> Array:
        force = self._config.force
        if self._force.HasValue(context):
            force = float(self._force.Eval(context)[0])
        return feature_errors(contact, self._config, force)

    def _calc_twist(self, context: Context, output: BasicVector) -> None:
        contact: Any = self._contact.Eval(context)
        if not contact.touching:
            output.SetFromVector(np.zeros(6))
            return
        error = self._error(context, contact)
        u = self._pid.output(error, *self._remembered(context))
        V_WC_S = np.asarray(self._projector.Eval(context)) * (self._jacobian @ u)
        output.SetFromVector(from_contact(V_WC_S, contact.p_SC))

    def _update(self, context: Context, next_state: DiscreteValues) -> None:
        contact: Any = self._contact.Eval(context)
        state = next_state.get_mutable_vector()
        if not contact.touching:
            state.SetFromVector(np.repeat([np.nan, 0.0], FEATURES))
            return
        error = self._error(context, contact)
        able = not self._share.HasValue(context) or bool(self._share.Eval(context)[0] > 0.99)
        total = self._pid.integrate(error, *self._remembered(context), able)
        state.SetFromVector(np.concatenate([error, total]))
