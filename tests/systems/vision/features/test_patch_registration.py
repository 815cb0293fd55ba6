"""Registration of patches, on textures that are known at every point."""

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from crossmodal.systems.vision.features import patch_registration, patch_templates

RNG = np.random.default_rng(0)
WAVES = RNG.normal(0.0, 0.25, (30, 2))
PHASES = RNG.uniform(0.0, 2 * np.pi, 30)
UV = np.array([[60.0, 60.0], [100.0, 70.0], [75.0, 110.0], [130.0, 130.0]])


def scene(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A smooth texture."""
    waves = np.sin(x[..., None] * WAVES[:, 0] + y[..., None] * WAVES[:, 1] + PHASES)
    return 128.0 + 15.0 * waves.sum(axis=-1)


def image_of(A: np.ndarray, t: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """The image in which the scene's point x appears at centre + t + A (x - centre)."""
    v, u = np.mgrid[0:200, 0:200].astype(float)
    back = np.linalg.inv(A)
    d = np.stack([u, v], axis=-1) - centre - t
    x = centre + d @ back.T
    return scene(x[..., 0], x[..., 1]).astype(np.float32)


FIRST = image_of(np.eye(2), np.zeros(2), np.zeros(2))


def test_templates_have_zero_mean_and_unit_norm() -> None:
    templates, valid = patch_templates.cut_templates(FIRST, UV, 7)
    assert valid.all()
    assert_allclose(templates.values.sum(axis=1), 0.0, atol=1e-5)
    assert_allclose(np.sum(templates.values**2, axis=1), 1.0, atol=1e-5)
    scores = patch_templates.score_patches(FIRST, templates, np.tile(np.eye(2), (4, 1, 1)), UV)
    assert_allclose(scores, 1.0, atol=1e-6)


def test_gradients_are_those_of_the_normalised_patch() -> None:
    templates, _ = patch_templates.cut_templates(FIRST, UV, 7)
    patch = FIRST[53:68, 53:68].astype(float)
    wider = FIRST[53:68, 52:69].astype(float)
    norm = np.linalg.norm(patch - patch.mean())
    expected = 0.5 * (wider[:, 2:] - wider[:, :-2]) / norm
    assert_allclose(templates.gradients[0, 0], expected.ravel(), atol=1e-6)


@pytest.mark.parametrize("shift", [(0.3, -0.4), (2.3, 1.6), (-3.1, 2.2)])
def test_a_shift_is_recovered_whatever_gain_and_offset(shift: tuple[float, float]) -> None:
    templates, _ = patch_templates.cut_templates(FIRST, UV, 7)
    moved = 0.4 * image_of(np.eye(2), np.array(shift), np.zeros(2)) + 60.0
    uv, scores, _ = patch_registration.register_patches(
        moved, templates, np.tile(np.eye(2), (4, 1, 1)), UV
    )
    assert np.all(scores > 0.99)
    assert np.abs(uv - UV - shift).max() < 0.03


def test_a_known_change_of_scale_is_accounted_for() -> None:
    scale = 1.25 * np.eye(2)
    for centre in UV:
        templates, _ = patch_templates.cut_templates(FIRST, centre[None], 7)
        moved = image_of(scale, np.array([0.6, -0.7]), centre)
        uv, scores, _ = patch_registration.register_patches(
            moved, templates, scale[None], centre[None]
        )
        assert scores[0] > 0.98
        assert np.abs(uv[0] - centre - [0.6, -0.7]).max() < 0.05


def test_an_unknown_change_of_shape_is_found_step_by_step() -> None:
    A = np.array([[0.8, 0.1], [-0.05, 1.05]])
    for centre in UV:
        templates, _ = patch_templates.cut_templates(FIRST, centre[None], 7)
        shape, uv = np.eye(2)[None], centre[None]
        for share in np.linspace(0.0, 1.0, 12):
            now = np.eye(2) + share * (A - np.eye(2))
            moved = image_of(now, np.zeros(2), centre)
            uv, scores, shape = patch_registration.register_patches(
                moved, templates, shape, uv, shape_sigma=np.array([0.05])
            )
        assert scores[0] > 0.98
        assert_allclose(shape[0], A, atol=0.05)
        assert np.abs(uv[0] - centre).max() < 0.05


def test_patches_that_leave_the_image_score_minus_one() -> None:
    templates, _ = patch_templates.cut_templates(FIRST, UV[:1], 7)
    uv, scores, _ = patch_registration.register_patches(
        FIRST, templates, np.eye(2)[None], np.array([[3.0, 100.0]])
    )
    assert scores[0] == -1.0
    assert_allclose(uv[0], [3.0, 100.0])


def test_covariance_matches_the_scatter_under_noise() -> None:
    rng = np.random.default_rng(1)
    templates, _ = patch_templates.cut_templates(FIRST, UV, 7)
    identity = np.tile(np.eye(2), (4, 1, 1))
    found, covariances = [], []
    for _ in range(300):
        noisy = FIRST + rng.normal(0.0, 6.0, FIRST.shape).astype(np.float32)
        uv, scores, _ = patch_registration.register_patches(noisy, templates, identity, UV)
        found.append(uv - UV)
        covariances.append(
            patch_registration.registration_covariance(templates, identity, scores, 1.0, 0.0)
        )
    scatter = np.einsum("kni,knj->nij", found, found) / len(found)
    claimed = np.mean(covariances, axis=0)
    ratio = np.trace(scatter, axis1=1, axis2=2) / np.trace(claimed, axis1=1, axis2=2)
    assert np.all((ratio > 0.6) & (ratio < 1.6))


def test_noise_does_not_look_like_a_template() -> None:
    rng = np.random.default_rng(2)
    templates, _ = patch_templates.cut_templates(FIRST, UV, 7)
    noise = cv2.GaussianBlur(rng.normal(10, 5, FIRST.shape).astype(np.float32), (5, 5), 1.0)
    _, scores, _ = patch_registration.register_patches(
        noise, templates, np.tile(np.eye(2), (4, 1, 1)), UV
    )
    assert np.all(scores < 0.6)
