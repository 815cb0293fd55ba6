"""Where and how hard a tactile fingertip is pressed, from the forces of its taxels."""

from dataclasses import dataclass

import numpy as np

from crossmodal.maths.arrays import Array, Mask
from crossmodal.maths.validation import check, number, require
from crossmodal.systems.port_values import NO_CONTACT, TactileContact
from crossmodal.systems.shared_settings import SensorNoise
from crossmodal.systems.tactile.taxel_layout import TaxelLayout, surface_normals

_FILLINGS = 6  # Number of iterations by which the forces of left-out taxels are found.
_NEAREST = 3  # Number of taxels whose distance to a contact is the spacing there.


@dataclass(kw_only=True)
class ContactFeaturesConfig:
    noise = SensorNoise()
    # Force of a taxel from which on it counts.
    least_force: float = number(0.025, at_least=0.0, at_most=10.0, unit="N")
    # Total force at which a contact begins.
    touch_force: float = number(0.08, above=0.0, at_most=10.0, unit="N")
    # Total force at which a contact ends.
    release_force: float = number(0.04, at_least=0.0, at_most=10.0, unit="N")
    # Error of a contact between taxels, as a share of their distance from it, 1 sigma.
    spacing_share: float = number(0.1, at_least=0.0, at_most=1.0)
    # Distance up to which a taxel senses a contact.
    reach: float = number(0.009, above=0.0, at_most=1.0, unit="m")
    # Standard deviation of a firm contact's pressure around its middle.
    footprint: float = number(0.003, above=0.0, at_most=0.1, unit="m")
    # By how much the taxels may be off on the fingertip, 1 sigma.
    placement: float = number(5e-4, at_least=0.0, at_most=0.01, unit="m")
    # Least ratio of a contact's variances along and across an edge.
    edge_ratio: float = number(2.0, at_least=1.0, at_most=100.0)
    # A pressed taxel is noisy: one that reads the same for so long is stuck.
    stuck_after: float = number(0.1, at_least=1e-3, at_most=3600.0, unit="s", infinite=True)
    # A taxel so near to a firm contact is pressed: one that is silent there is dead.
    near: float = number(0.006, at_least=0.0, at_most=1.0, unit="m")
    # Force of a contact that a taxel near it has to feel.
    firm_force: float = number(0.3, at_least=0.0, at_most=10.0, unit="N")
    # How long a taxel that is pressed may be silent before it counts as dead.
    dead_after: float = number(0.3, at_least=1e-3, at_most=3600.0, unit="s", infinite=True)


def check_features(config: ContactFeaturesConfig, system: str) -> None:
    """Refuses what is impossible in `config`, in the name of `system`."""
    check(config, system)
    lower = config.release_force <= config.touch_force
    require(lower, system, config, "release_force", "<= touch_force")


def contact_position(counted: Array, layout: TaxelLayout) -> Array:
    """The force-weighted mean of the taxels' places, put back onto the ellipsoid (3,), [m]."""
    p = counted @ layout.p_ST / counted.sum()
    return np.asarray(p / np.linalg.norm(p / layout.semi_axes))


def filled_forces(
    counted: Array, usable: Mask, layout: TaxelLayout, config: ContactFeaturesConfig
) -> Array:
    """Forces (T,) in which a left-out taxel has what a round pressure would give it, [N].

    Pressure and forces are found in turns, since the pressure's middle is the contact that the
    forces show.
    """
    filled = counted.copy()
    if usable.all():
        return filled
    for _ in range(_FILLINGS):
        distances = np.linalg.norm(layout.p_ST - contact_position(filled, layout), axis=1)
        share = np.exp(-0.5 * (distances / config.footprint) ** 2)
        filled[~usable] = share[~usable] / share[usable].sum() * counted.sum()
    return filled


def tangent_projection(p_SC: Array, layout: TaxelLayout) -> Array:
    """The matrix (3, 3) that keeps the part of a vector along the surface at `p_SC` (3,)."""
    n = surface_normals(p_SC, layout.semi_axes)
    return np.asarray(np.eye(3) - np.outer(n, n))


def noise_covariance(counted: Array, p_SC: Array, layout: TaxelLayout, noise: float) -> Array:
    """Covariance (3, 3) of the position by the taxels' noise: d p / d f_i = (p_i - p) / sum f."""
    lever = (layout.p_ST[counted > 0.0] - p_SC) @ tangent_projection(p_SC, layout)
    return np.asarray((noise / counted.sum()) ** 2 * lever.T @ lever)


def lasting_covariance(
    p_SC: Array, usable: Mask, layout: TaxelLayout, config: ContactFeaturesConfig
) -> Array:
    """Covariance (3, 3) of the position's error that does not change from sample to sample.

    It comes from the taxels' number, which the distance of the nearest ones stands for, from their
    places, and from the taxels that are left out: each near the contact may feel as much as one of
    the nearest.
    """
    lever = layout.p_ST - p_SC
    distances = np.linalg.norm(lever, axis=1)
    spacing = float(np.mean(np.sort(distances[usable])[:_NEAREST]))
    sigma = np.hypot(config.spacing_share * spacing, config.placement)
    missing = lever[~usable & (distances < config.reach)] / _NEAREST
    across = tangent_projection(p_SC, layout)
    return np.asarray(across @ (sigma**2 * np.eye(3) + missing.T @ missing) @ across)


def edge_angle(counted: Array, p_SC: Array, layout: TaxelLayout, ratio: float) -> float:
    """Angle about y, from z, of the longer axis of the pressed region, [rad].

    NaN where the region's variance along that axis is not `ratio` times that across it.
    """
    x, _, z = (layout.p_ST - p_SC).T
    xx, zz, xz = counted @ (x * x), counted @ (z * z), counted @ (x * z)
    middle, half = 0.5 * (xx + zz), float(np.hypot(0.5 * (zz - xx), xz))
    if not middle + half > ratio * (middle - half):
        return float("nan")
    return float(0.5 * np.arctan2(2.0 * xz, zz - xx))


def contact_of_taxels(
    forces: Array,
    touching: bool,
    usable: Mask,
    layout: TaxelLayout,
    config: ContactFeaturesConfig,
    samples: int = 1,
) -> TactileContact:
    """What the taxels sense.

    The taxels are calibrated so that the vectors f_i n_i sum up to the force. Weak ones count in
    it, too, since their noise averages; the others show where the contact is.

    Args:
        forces: Of the taxels (T,), [N].
        touching: Whether there was a contact before.
        usable: Which taxels work (T,).
        samples: Number of samples of which `forces` is the mean.
    """
    counted = np.where(usable & (forces > config.least_force), forces, 0.0)
    least = config.release_force if touching else config.touch_force
    if usable.sum() < _NEAREST or not counted.sum() > least:
        return NO_CONTACT
    pressed = filled_forces(counted, usable, layout, config)
    p_SC = contact_position(pressed, layout)
    normal = pressed @ layout.n_S
    white = noise_covariance(counted, p_SC, layout, config.noise.taxel / np.sqrt(samples))
    return TactileContact(
        touching=True,
        p_SC=p_SC,
        covariance=white + lasting_covariance(p_SC, usable, layout, config),
        n_S=np.asarray(normal / np.linalg.norm(normal)),
        f_S=np.where(usable, forces, pressed) @ layout.n_S,
        edge_angle=edge_angle(pressed, p_SC, layout, config.edge_ratio),
    )
