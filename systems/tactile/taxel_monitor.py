"""What a tactile fingertip senses at each sample, without the taxels that do not work."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.systems.framework import Context

from crossmodal.maths.arrays import Array, Mask
from crossmodal.maths.immutable import Immutable
from crossmodal.systems.port_values import NO_CONTACT, StreamHealth, TactileContact
from crossmodal.systems.recursive_filter import RecursiveFilter
from crossmodal.systems.tactile.contact_features import (
    ContactFeaturesConfig,
    check_features,
    contact_of_taxels,
)
from crossmodal.systems.tactile.taxel_layout import TaxelLayout

_PLAIN = 3.0  # A force that is no noise, as a multiple of `least_force`.
_KEPT = 0.8  # Share of their force that the others keep while one falls silent.


@dataclass(frozen=True, kw_only=True)
class TaxelState(Immutable):
    """What is remembered of the taxels.

    Attributes:
        forces: Last sample (T,), [N]; NaN before the first.
        same_since: Since when each taxel reads that (T,), [s].
        alive_at: When each was last pressed or was not where it must be (T,), [s].
        dead: Which were silent where they must not be, and have not been pressed since (T,).
        usable: Which taxels work (T,).
        contact: What they sensed last.
        time: Of that sample, [s]; minus infinity before the first.
        p_SC: Where the last contact was (3,), [m]; NaN before the first.
        trusted_at: When it was last certain whether there is a contact, [s].
    """

    forces: Array
    same_since: Array
    alive_at: Array
    dead: Mask
    usable: Mask
    contact: TactileContact
    time: float
    p_SC: Array
    trusted_at: float

    @property
    def health(self) -> StreamHealth:
        """What is wrong with the taxels, and since when no contact could be decided on, [s]."""
        left_out = ", ".join(str(index) for index in np.flatnonzero(~self.usable))
        fault = f"dead or stuck taxels: {left_out}" if left_out else ""
        return StreamHealth(age=max(self.time - self.trusted_at, 0.0), fault=fault)


def unread_taxels(layout: TaxelLayout) -> TaxelState:
    """What is remembered before the first sample."""
    count = len(layout.p_ST)
    return TaxelState(
        forces=np.full(count, np.nan),
        same_since=np.zeros(count),
        alive_at=np.zeros(count),
        dead=np.zeros(count, bool),
        usable=np.ones(count, bool),
        contact=NO_CONTACT,
        time=-np.inf,
        p_SC=np.full(3, np.nan),
        trusted_at=0.0,
    )


def must_be_pressed(
    contact: TactileContact, layout: TaxelLayout, config: ContactFeaturesConfig
) -> Mask:
    """Which taxels (T,) lie so near to a firm contact that they have to feel it."""
    if not contact.force > config.firm_force:
        return np.zeros(len(layout.p_ST), bool)
    return np.asarray(np.linalg.norm(layout.p_ST - contact.p_SC, axis=1) < config.near)


def fell_silent(before: TaxelState, forces: Array, config: ContactFeaturesConfig) -> Mask:
    """Which taxels (T,) feel nothing from one sample to the next, while the others feel on.

    What goes away from all of them has gone; what goes away from one is the taxel's own fault.
    """
    pressed = before.usable & (before.forces > _PLAIN * config.least_force)
    silent = pressed & (np.abs(forces) <= config.least_force)
    others = pressed & ~silent
    kept = np.sum(forces[others]) > _KEPT * np.sum(before.forces[others])
    return silent & bool(others.sum() >= silent.sum() and kept)


def can_feel(usable: Mask, p_SC: Array, layout: TaxelLayout, config: ContactFeaturesConfig) -> bool:
    """Whether most taxels around the last contact (3,) work, so that its end can be noticed.

    Before the first contact, whether most taxels do.
    """
    around = np.linalg.norm(layout.p_ST - p_SC, axis=1) < config.near
    concerned = usable[around] if around.any() else usable
    return bool(2 * concerned.sum() > len(concerned))


def next_taxel_state(
    state: TaxelState,
    time: float,
    forces: Array,
    layout: TaxelLayout,
    config: ContactFeaturesConfig,
) -> TaxelState:
    """What is remembered after one more sample; the same sample twice changes nothing.

    A taxel is left out while it reads no number, while it has read the same force for too long (no
    force excepted: a sensor may have a threshold), and from when it has been silent for too long
    where it must be pressed until it is pressed.

    Args:
        time: Of the sample, [s].
        forces: (T,), [N].
    """
    pressed = np.abs(forces) > config.least_force
    same_since = np.where(forces == state.forces, state.same_since, time)
    stuck = pressed & (time - same_since > config.stuck_after)
    excused = pressed | ~must_be_pressed(state.contact, layout, config)
    alive_at = np.where(excused, time, state.alive_at)
    silent = state.dead | (time - alive_at > config.dead_after)
    dead = ~pressed & (silent | fell_silent(state, forces, config))
    usable = np.isfinite(forces) & ~stuck & ~dead
    contact = contact_of_taxels(forces, state.contact.touching, usable, layout, config)
    p_SC = contact.p_SC if contact.touching else state.p_SC
    trusted = contact.touching or can_feel(usable, p_SC, layout, config)
    return TaxelState(
        forces=forces.copy(),
        same_since=same_since,
        alive_at=alive_at,
        dead=dead,
        usable=usable,
        contact=contact,
        time=time,
        p_SC=p_SC,
        trusted_at=time if trusted else state.trusted_at,
    )


class TaxelMonitor(RecursiveFilter):
    """What the fingertip senses now, for whoever controls it.

    Input ports:
    - `taxel_measured`: (T,) the taxels' forces, [N].

    Output ports:
    - `contact_estimated`: `TactileContact` of this instant; it may be read between ticks.
    - `contact_latest`: `TactileContact` of the last tick, from the state alone.
    - `health_latest`: `StreamHealth`; its fault names the taxels that are left out, its age is
      for how long it is not known whether there is a contact.

    Frames: S fingertip.

    Source: Q. Li, A. Ückermann, R. Haschke and H. Ritter, "Estimating an articulated tool's
    kinematics via visuo-tactile based robotic interactive manipulation", IROS 2018, section III-A.

    Args:
        period: Of the taxels' samples, [s].

    Raises:
        ValueError: for an impossible config value.
    """

    def __init__(
        self, config: ContactFeaturesConfig, layout: TaxelLayout, period: float = 0.01
    ) -> None:
        super().__init__()
        check_features(config, "TaxelMonitor")
        self._config, self._layout = config, layout
        self._taxels = self.DeclareVectorInputPort("taxel_measured", len(layout.p_ST))
        self._declare_recursion(unread_taxels(layout), self._feel, period)
        self._declare_estimated("contact_estimated", lambda state: state.contact)
        self._declare_latest("contact_latest", lambda state: state.contact)
        self._declare_latest("health_latest", lambda state: state.health)

    def _feel(self, context: Context, state: Any) -> TaxelState:
        forces = np.asarray(self._taxels.Eval(context))
        return next_taxel_state(state, context.get_time(), forces, self._layout, self._config)
