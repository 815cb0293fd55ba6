"""The axis of a flap as the line in which its planes at different times meet: the paper's own way.

It is the baseline beside the estimators that know by how much planes and contacts err.
"""

from dataclasses import dataclass, replace

import numpy as np
from pydrake.systems.framework import Context

from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.validation import check, number
from crossmodal.systems.flap.flap_geometry import HingeLimitsConfig
from crossmodal.systems.port_values import (
    UNKNOWN_FINGERTIP,
    UNKNOWN_HINGE,
    FingertipContact,
    FlapPlane,
    HingeBelief,
    unseen,
)
from crossmodal.systems.recursive_filter import RecursiveFilter
from crossmodal.systems.ticks import Ticked


@dataclass(kw_only=True)
class PlaneIntersectionConfig(Ticked):
    """Configuration of `PlaneIntersection`."""

    # Images over which axes are averaged.
    window: int = number(30, at_least=2, at_most=10**4)


@dataclass(frozen=True, kw_only=True)
class PlaneIntersectionState(Immutable):
    """What is known at one tick.

    Attributes:
        first: The plane when the flap was touched first; not seen before.
        axes: Directions and points (N, 6) of the newest intersections, oldest first.
        belief: What is reported of them.
    """

    first: FlapPlane
    axes: Array
    belief: HingeBelief = UNKNOWN_HINGE


def intersection(first: FlapPlane, plane: FlapPlane, p_WC: Array) -> Array:
    """The line in which two planes meet (6,): its direction and its point nearest to p_WC (3,).

    The direction is that in which the first normal turns to the other one; a back face counts as
    the front's plane, by which the flap is as thin as a sheet.
    """
    k = np.cross(first.n_W, plane.n_W)
    k = k / np.linalg.norm(k)
    rows = np.vstack([first.n_W, plane.n_W, k])
    distances = np.array([first.d, plane.d, k @ p_WC])
    return np.concatenate([k, np.linalg.solve(rows, distances)])


def believed_axis(axes: Array, p_WC: Array) -> HingeBelief:
    """The mean of axes (N, 6), with the scatter of single ones as its covariance."""
    mean = axes.mean(axis=0)
    k = mean[:3] / np.linalg.norm(mean[:3])
    across = np.eye(3) - np.outer(k, k)
    projection = np.kron(np.eye(2), across)
    p_WK = mean[3:] + k * float(k @ (p_WC - mean[3:]))
    covariance = projection @ np.cov(axes.T) @ projection
    return HingeBelief(known=True, k_W=k, p_WK=p_WK, covariance=covariance, p_WQ=p_WC)


def update_intersection(
    state: PlaneIntersectionState,
    plane: FlapPlane,
    contact: FingertipContact,
    config: PlaneIntersectionConfig,
    limits: HingeLimitsConfig,
) -> PlaneIntersectionState:
    """The state after one tick; without a plane or a contact it stays."""
    if not (plane.seen and contact.contact.touching):
        return state
    if not state.first.seen:
        return replace(state, first=plane)
    if np.linalg.norm(np.cross(state.first.n_W, plane.n_W)) < np.sin(limits.least_turn):
        return state
    axis = intersection(state.first, plane, contact.p_WC)
    if len(state.axes) and state.axes[-1, :3] @ axis[:3] < 0.0:
        axis[:3] = -axis[:3]  # The back face is seen, or the flap was turned beyond.
    axes = np.vstack([state.axes, axis])[-config.window :]
    if len(axes) < config.window:
        return replace(state, axes=axes)
    return replace(state, axes=axes, belief=believed_axis(axes, contact.p_WC))


class PlaneIntersection(RecursiveFilter):
    """Axis of the flap's hinge, from the intersection of its first plane with each later one.

    Directions and points are averaged over a window. Neither the flap's thickness nor what the
    camera's and the arms' calibrations err is known to it.

    Input ports:
    - `flap_plane_estimated`: `FlapPlane` of this tick, in W.
    - `fingertip_contact_estimated`: `FingertipContact`.

    Output ports:
    - `hinge_estimated`: `HingeBelief` of this tick, in W.
    - `hinge_latest`: the one of the last tick, from the state.

    Source: the paper on visuo-tactile servoing of articulated tools, section III-B (Q. Li et al.).
    """

    def __init__(
        self, config: PlaneIntersectionConfig, limits: HingeLimitsConfig | None = None
    ) -> None:
        super().__init__()
        check(config, "PlaneIntersection")
        self._config, self._limits = config, limits or HingeLimitsConfig()
        check(self._limits, "PlaneIntersection")
        self._plane = self._declare_value_input("flap_plane_estimated", unseen("none yet"))
        self._contact = self._declare_value_input("fingertip_contact_estimated", UNKNOWN_FINGERTIP)
        initial = PlaneIntersectionState(first=unseen("none yet"), axes=np.empty((0, 6)))
        self._declare_recursion(initial, self._calc_state, config.period)
        self._declare_estimated("hinge_estimated", lambda state: state.belief)
        self._declare_latest("hinge_latest", lambda state: state.belief)

    def _calc_state(
        self, context: Context, state: PlaneIntersectionState
    ) -> PlaneIntersectionState:
        return update_intersection(
            state,
            self._read(self._plane, context),
            self._read(self._contact, context),
            self._config,
            self._limits,
        )
