"""What a tactile fingertip feels at each sample, without the taxels that do not work."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.systems.framework import Context

from maths.arrays import Array, Mask
from maths.immutable import Immutable
from systems.port_values import NO_CONTACT, StreamHealth, TactileContact
from systems.recursive_filter import RecursiveFilter
from systems.tactile.contact_features import (
    ContactFeaturesConfig,
    check_features,
    contact_of_taxels,
)
from systems.tactile.taxel_layout import TaxelLayout


@dataclass(frozen=True, kw_only=True)
class TaxelState(Immutable):
    """What is remembered of the taxels.

    Attributes:
        forces: Last sample (T,), [N]; NaN before the first.
        same_since: Since when each taxel reads that (T,), [s].
        alive_at: When each was last pressed or was not where it must be (T,), [s].
        dead: Which were silent where they must not be, and have not been pressed since (T,).
        usable: Which taxels work (T,).
        contact: What they felt last.
    """

    forces: Array
    same_since: Array
    alive_at: Array
    dead: Mask
    usable: Mask
    contact: TactileContact

    @property
    def fault(self) -> str:
        """What is wrong with the taxels, in words; empty while nothing is."""
        left_out = ", ".join(str(index) for index in np.flatnonzero(~self.usable))
        return f"dead or stuck taxels: {left_out}" if left_out else ""


def unheard_taxels(layout: TaxelLayout) -> TaxelState:
    """What is remembered before the first sample."""
    count = len(layout.p_ST)
    return TaxelState(
        forces=np.full(count, np.nan),
        same_since=np.zeros(count),
        alive_at=np.zeros(count),
        dead=np.zeros(count, bool),
        usable=np.ones(count, bool),
        contact=NO_CONTACT,
    )


def must_be_pressed(
    contact: TactileContact, layout: TaxelLayout, config: ContactFeaturesConfig
) -> Mask:
    """Which taxels (T,) lie so near to a firm contact that they have to feel it."""
    if not contact.force > config.firm_force:
        return np.zeros(len(layout.p_ST), bool)
    return np.asarray(np.linalg.norm(layout.p_ST - contact.p_SC, axis=1) < config.near)


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
        state: Before it.
        time: Of the sample, [s].
        forces: (T,), [N].
        layout: Of the taxels.
        config: Noise and thresholds.
    """
    pressed = np.abs(forces) > config.least_force
    same_since = np.where(forces == state.forces, state.same_since, time)
    stuck = pressed & (time - same_since > config.stuck_after)
    excused = pressed | ~must_be_pressed(state.contact, layout, config)
    alive_at = np.where(excused, time, state.alive_at)
    dead = ~pressed & (state.dead | (time - alive_at > config.dead_after))
    usable = np.isfinite(forces) & ~stuck & ~dead
    touching = state.contact.touching
    return TaxelState(
        forces=forces.copy(),
        same_since=same_since,
        alive_at=alive_at,
        dead=dead,
        usable=usable,
        contact=contact_of_taxels(forces, touching, usable, layout, config),
    )


class TaxelMonitor(RecursiveFilter):
    """What the fingertip feels now, for whoever controls it.

    .. pydrake_system::

        name: TaxelMonitor
        input_ports:
        - taxel_measured
        output_ports:
        - contact_estimated
        - contact_latest
        - health_latest

    - `taxel_measured`: (T,) the taxels' forces, [N].
    - `contact_estimated`: `TactileContact` of this instant; it may be read between ticks.
    - `contact_latest`: `TactileContact` of the last tick, from the state alone.
    - `health_latest`: `StreamHealth`; its fault names the taxels that are left out.

    Frames: S fingertip.

    Source: Q. Li, A. Ückermann, R. Haschke and H. Ritter, "Estimating an articulated tool's
    kinematics via visuo-tactile based robotic interactive manipulation", IROS 2018, section III-A.

    Args:
        config: Noise and thresholds.
        layout: Of the taxels.
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
        self._declare_recursion(unheard_taxels(layout), self._feel, period)
        self._declare_estimated("contact_estimated", lambda state: state.contact)
        self._declare_latest("contact_latest", lambda state: state.contact)
        self._declare_latest("health_latest", lambda state: StreamHealth(fault=state.fault))

    def _feel(self, context: Context, state: Any) -> TaxelState:
        forces = np.asarray(self._taxels.Eval(context))
        return next_taxel_state(state, context.get_time(), forces, self._layout, self._config)
