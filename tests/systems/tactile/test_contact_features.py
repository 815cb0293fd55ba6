"""The contact of an ellipsoidal fingertip, from pressures that are known."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from crossmodal.systems.sensors.taxels import calibration_factor, felt_shares
from crossmodal.systems.tactile.contact_features import (
    ContactFeaturesConfig,
    contact_of_taxels,
    contact_position,
    noise_covariance,
)
from crossmodal.systems.tactile.taxel_layout import SEMI_AXES as AXES
from crossmodal.systems.tactile.taxel_layout import fingertip_layout

LAYOUT, CONFIG = fingertip_layout(), ContactFeaturesConfig()
ALL = np.ones(12, bool)
SKIN = 0.0025
CENTRE = [0, 3, 8, 11]


_GRID = np.stack(np.meshgrid(*2 * [np.linspace(-1.0, 1.0, 41)]), axis=-1).reshape(-1, 2)
DISC = _GRID[np.sum(_GRID**2, axis=1) < 1.0]


def pressed(x: float, z: float, force: float = 0.5, width: tuple[float, float] = (3.7e-3, 5.5e-3)):  # type: ignore[no-untyped-def]
    """Forces (12,) of a flat pressed against the pad, through the skin, without noise."""
    pressure = 1.0 - np.sum(DISC**2, axis=1)
    p_S = np.column_stack([x + width[0] * DISC[:, 0], 0.0 * pressure, z + width[1] * DISC[:, 1]])
    p_S[:, 1] = AXES[1] * np.sqrt(1.0 - np.sum((p_S / AXES) ** 2, axis=1))
    shares = felt_shares(p_S, LAYOUT.p_ST, SKIN) * calibration_factor(LAYOUT.p_ST, LAYOUT.n_S, SKIN)
    return force * pressure / pressure.sum() @ shares


def felt(forces: np.ndarray, touching: bool = True, usable: np.ndarray = ALL):  # type: ignore[no-untyped-def]
    return contact_of_taxels(forces, touching, usable, LAYOUT, CONFIG)


def test_four_equal_taxels_around_the_centre_are_a_contact_at_the_pole() -> None:
    forces = np.zeros(12)
    forces[CENTRE] = 0.125
    contact = felt(forces)
    assert_allclose(contact.p_SC, [0.0, AXES[1], 0.0], atol=1e-15)
    assert_allclose(contact.n_S, [0.0, 1.0, 0.0], atol=1e-15)
    assert_allclose(contact.f_S, [0.0, 0.5 * LAYOUT.n_S[0, 1], 0.0], atol=1e-15)


@pytest.mark.parametrize("place", [(2e-3, -1e-3), (-4e-3, 5e-3), (0.0, 6e-3)])
def test_a_contact_lies_on_the_ellipsoid_and_its_normal_points_out_of_it(place) -> None:  # type: ignore[no-untyped-def]
    contact = felt(pressed(*place))
    assert np.sum((contact.p_SC / AXES) ** 2) == pytest.approx(1.0)
    assert np.linalg.norm(contact.n_S) == pytest.approx(1.0)
    assert contact.n_S @ (contact.p_SC / AXES**2) > 0.0
    assert_allclose(contact.p_SC[[0, 2]], place, atol=6e-4)


def test_the_force_is_the_sum_of_the_taxels_vectors() -> None:
    forces = pressed(1e-3, -2e-3)
    assert_allclose(felt(forces).f_S, forces @ LAYOUT.n_S, atol=1e-15)


def test_a_contact_begins_at_more_force_than_it_ends_at() -> None:
    four = np.isin(np.arange(12), CENTRE) * 0.03
    two = np.isin(np.arange(12), CENTRE[:2]) * 0.03
    assert felt(four, touching=False).touching
    assert not felt(two, touching=False).touching
    assert felt(two, touching=True).touching
    assert not felt(0.5 * two, touching=True).touching


def test_noise_alone_is_no_contact() -> None:
    rng = np.random.default_rng(0)
    noise = rng.normal(0.0, CONFIG.noise.taxel, (2000, 12))
    assert not any(felt(sample, touching=False).touching for sample in noise)


def test_noise_of_the_position_is_as_large_as_claimed() -> None:
    rng = np.random.default_rng(1)
    clean = np.zeros(12)
    clean[CENTRE] = [0.15, 0.1, 0.15, 0.1]
    noisy = clean + (clean > 0.0) * rng.normal(0.0, CONFIG.noise.taxel, (4000, 12))
    positions = np.array([contact_position(sample, LAYOUT) for sample in noisy])
    claimed = noise_covariance(clean, contact_position(clean, LAYOUT), LAYOUT, CONFIG.noise.taxel)
    assert_allclose(np.cov(positions.T)[::2, ::2], claimed[::2, ::2], rtol=0.1, atol=2e-9)


def test_the_error_between_taxels_and_of_their_places_is_as_large_as_claimed() -> None:
    """Over contacts everywhere between the four taxels, with taxels that are off together."""
    rng = np.random.default_rng(2)
    scores = []
    for _ in range(400):
        x, z = rng.uniform(-1, 1, 2) * [3e-3, 3.5e-3]
        shift = rng.normal(0.0, CONFIG.placement, 2)
        contact = felt(pressed(x - shift[0], z - shift[1]))
        error = contact.p_SC[[0, 2]] - [x, z]
        scores.append(error @ np.linalg.solve(contact.covariance[::2, ::2], error))
    assert 0.8 < np.mean(scores) < 2.5


def test_an_edge_across_the_pad_is_found_with_its_angle() -> None:
    for angle in np.deg2rad([-30.0, 0.0, 30.0]):
        across = np.array([np.cos(angle), -np.sin(angle)])
        along = np.array([np.sin(angle), np.cos(angle)])
        places = LAYOUT.p_ST[:, [0, 2]]
        share = np.exp(-0.5 * (places @ across / 2e-3) ** 2 - 0.5 * (places @ along / 8e-3) ** 2)
        assert felt(share / share.sum()).edge_angle == pytest.approx(angle, abs=0.2)


def test_a_round_contact_has_no_edge() -> None:
    assert np.isnan(felt(pressed(0.0, 0.0, width=(3.7e-3, 3.7e-3))).edge_angle)


def test_fewer_than_three_taxels_tell_nothing() -> None:
    usable = np.zeros(12, bool)
    usable[[0, 3]] = True
    assert not felt(pressed(0.0, 0.0), usable=usable).touching


@pytest.mark.parametrize("place", [(0.0, 0.0), (1e-3, -1e-3), (-1.5e-3, 1e-3)])
def test_a_taxel_that_is_left_out_hardly_changes_force_and_place(place) -> None:  # type: ignore[no-untyped-def]
    forces = pressed(*place)
    for index in CENTRE:
        usable = ALL.copy()
        usable[index] = False
        whole, part = felt(forces), felt(np.where(usable, forces, np.nan), usable=usable)
        assert part.force == pytest.approx(whole.force, rel=0.2)
        assert np.linalg.norm(part.p_SC - whole.p_SC) < 1.2e-3


def test_less_taxels_make_the_contact_less_certain() -> None:
    usable = ALL.copy()
    usable[0] = False
    few, all_ = felt(pressed(0.0, 0.0), usable=usable), felt(pressed(0.0, 0.0))
    assert np.trace(few.covariance) > np.trace(all_.covariance)
