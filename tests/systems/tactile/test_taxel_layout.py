import numpy as np
import pytest
from numpy.testing import assert_allclose

from crossmodal.systems.tactile.taxel_layout import (
    SEMI_AXES,
    fingertip_layout,
    indentation,
    pad_layout,
)


def test_every_taxel_lies_on_the_ellipsoid_with_its_normal_out_of_it() -> None:
    layout = fingertip_layout()
    assert layout.p_ST.shape == layout.n_S.shape == (12, 3)
    assert_allclose(np.sum((layout.p_ST / SEMI_AXES) ** 2, axis=1), 1.0, atol=1e-12)
    assert_allclose(np.linalg.norm(layout.n_S, axis=1), 1.0, atol=1e-12)
    out = layout.p_ST + 1e-4 * layout.n_S
    assert np.all(np.sum((out / SEMI_AXES) ** 2, axis=1) > 1.0)


def test_a_normal_is_across_the_surface() -> None:
    layout = fingertip_layout()
    step = np.array([1e-6, 0.0])
    places = layout.p_ST[:, [0, 2]]
    for direction in (step, step[::-1]):
        tangent = pad_layout(places + direction).p_ST - pad_layout(places - direction).p_ST
        assert_allclose(np.sum(tangent * layout.n_S, axis=1), 0.0, atol=1e-13)


def test_four_taxels_are_around_the_centre() -> None:
    x, _, z = fingertip_layout().p_ST[[0, 3, 8, 11]].T
    assert_allclose(
        sorted(zip(x, z, strict=True)),
        [(-3e-3, -3.5e-3), (-3e-3, 3.5e-3), (3e-3, -3.5e-3), (3e-3, 3.5e-3)],
    )


def test_three_taxels_are_refused() -> None:
    with pytest.raises(ValueError, match="3 taxels, need at least 4"):
        pad_layout(np.array([[0.0, 0.0], [3e-3, 0.0], [0.0, 3e-3]]))


def test_a_taxel_beside_the_pad_is_refused() -> None:
    places = np.array([[0.0, 0.0], [3e-3, 0.0], [0.0, 3e-3], [0.02, 0.0]])
    with pytest.raises(ValueError, match="taxel 3 at"):
        pad_layout(places)


SPHERE = np.array([0.01, 0.01, 0.01])


def test_the_force_grows_with_the_depth_as_hertz_says() -> None:
    depth = indentation(0.5, 3e5, SPHERE)
    force = 4.0 / 3.0 * 3e5 / (1.0 - 0.25) * np.sqrt(0.01) * depth**1.5
    assert force == pytest.approx(0.5)
    assert indentation(4.0, 3e5, SPHERE) == pytest.approx(4.0 * depth)


def test_a_long_fingertip_is_pressed_in_less() -> None:
    assert indentation(0.5, 3e5, np.array([0.01, 0.01, 0.02])) < indentation(0.5, 3e5, SPHERE)
    assert indentation(0.0, 3e5, SPHERE) == 0.0
