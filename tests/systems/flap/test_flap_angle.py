"""The flap's angle: laws, a blackout, and what to do before the hinge is known."""

from dataclasses import replace

import numpy as np
import pytest
from flap_episode import run
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation
from synthetic_flap import PERIOD, Errors, Laboratory

from crossmodal.maths.arrays import Array
from crossmodal.maths.consistency import chi_square_bounds
from crossmodal.systems.flap.flap_angle import (
    UNTOUCHED,
    FlapAngleConfig,
    FlapAngleState,
    contact_rate,
    correct,
    predict,
    read_angle,
    update_angle,
)
from crossmodal.systems.flap.flap_geometry import angle_about, turned_normal
from crossmodal.systems.port_values import UNKNOWN_FINGERTIP, UNKNOWN_HINGE, HingeBelief, unseen

CONFIG = FlapAngleConfig()
EXACT = Errors(
    camera_rotation=0.0, camera_translation=0.0, depth_scale=0.0, focal_length=0.0,
    arm_rotation=0.0, arm_translation=0.0, taxels=0.0,
)  # fmt: skip


def _unit(v: Array) -> Array:
    return np.asarray(v / np.linalg.norm(v))


def _true_hinge(lab: Laboratory) -> HingeBelief:
    return HingeBelief(
        known=True,
        k_W=lab.tool.k_W,
        p_WK=lab.tool.p_WK,
        covariance=np.diag(np.repeat([1e-8, 1e-8], 3)),
    )


def test_rodrigues_is_the_rotation_of_what_is_across_the_axis() -> None:
    rng = np.random.default_rng(0)
    k, n0 = _unit(rng.normal(size=3)), _unit(rng.normal(size=3))
    for angle in (-2.0, 0.0, 0.3, 3.0):
        n = turned_normal(k, n0, angle)
        across = _unit(n0 - k * (k @ n0))
        assert_allclose(n, Rotation.from_rotvec(k * angle).apply(across), atol=1e-12)
        assert angle_about(k, n0, n) == pytest.approx(angle)


def test_the_contacts_velocity_over_the_lever_is_the_rate_with_its_sign() -> None:
    lab = Laboratory(0, EXACT)
    for rate in (0.08, -0.05):
        contact = lab.contact(0.7, rate)
        found, variance, share = contact_rate(_true_hinge(lab), contact, None, CONFIG)
        assert abs(found - rate) < 4.0 * np.sqrt(variance)
        assert np.sqrt(variance) == pytest.approx(0.0005 / lab.tool.length, rel=0.1)
        assert share == pytest.approx(CONFIG.least_lever_error)


def test_before_the_hinge_is_known_an_assumed_lever_serves() -> None:
    lab = Laboratory(0, EXACT)
    contact, plane = lab.contact(0.0, 0.08), lab.plane(0.0)
    rate, _, share = contact_rate(UNKNOWN_HINGE, contact, plane.n_W, CONFIG)
    assert rate == pytest.approx(0.08, rel=3.0 * CONFIG.lever_error)
    assert share == CONFIG.lever_error


def _seen_state() -> tuple[Laboratory, FlapAngleState]:
    lab, state = Laboratory(0, EXACT), UNTOUCHED
    for _ in range(20):
        state = update_angle(state, lab.plane(0.0), lab.contact(0.0, 0.0), _true_hinge(lab), CONFIG)
    return lab, state


@pytest.mark.parametrize("theta", [0.2, 1.9])
def test_either_face_corrects_the_angle(theta: float) -> None:
    lab, state = _seen_state()
    plane = lab.plane(theta)
    assert (plane.n_W @ lab.tool.frame(theta)[:, 1] > 0.0) == (theta < 1.0)
    near = replace(state, x=np.array([theta + 0.1, 0.0, 0.0]), P=np.diag([0.02, 1e-6, 1e-6]))
    after = correct(near, lab.tool.k_W, plane, True, CONFIG)
    assert after.x[0] == pytest.approx(theta, abs=0.03)
    assert after.P[0, 0] < 0.1 * near.P[0, 0]
    assert after.measured


def test_a_measurement_far_out_counts_for_less() -> None:
    lab, state = _seen_state()
    plane = lab.plane(0.5)
    sure = replace(state, x=np.zeros(3), P=np.diag([1e-4, 1e-6, 1e-6]))
    unsure = replace(sure, P=np.diag([1.0, 1e-6, 1e-6]))
    assert correct(sure, lab.tool.k_W, plane, True, CONFIG).x[0] < 0.1
    assert correct(unsure, lab.tool.k_W, plane, True, CONFIG).x[0] == pytest.approx(0.5, abs=0.03)


def test_a_flap_that_somebody_moves_is_followed_at_once_if_nobody_touches_it() -> None:
    lab, state = _seen_state()
    sure = replace(state, x=np.zeros(3), P=np.diag([1e-4, 1e-6, 1e-6]))
    moved = correct(sure, lab.tool.k_W, lab.plane(0.7), False, CONFIG)
    assert moved.x[0] == pytest.approx(0.7, abs=0.03)
    assert np.sqrt(moved.P[0, 0]) < 0.05
    assert abs(moved.x[1]) < 1e-6


def test_in_a_blackout_of_nine_seconds_the_angle_is_as_wrong_as_it_says() -> None:
    ends, blind = [], round(9.0 / PERIOD)
    for seed in range(20):
        lab, state = Laboratory(seed, EXACT), UNTOUCHED
        hinge = _true_hinge(lab)
        for i in range(30 + blind):
            theta = 0.08 * PERIOD * i
            plane = lab.plane(theta) if i < 30 else unseen("dark")
            state = update_angle(state, plane, lab.contact(theta, 0.08), hinge, CONFIG)
        belief = read_angle(state, lab.camera)
        assert not belief.measured
        assert abs(belief.theta - theta) < np.deg2rad(4.0)
        ends.append((belief.theta - theta) ** 2 / belief.variance)
    low, high = chi_square_bounds(20, 0.999)
    assert 0.1 * low < sum(ends) < high


def test_uncertainty_grows_while_nothing_is_seen_and_shrinks_after() -> None:
    _, state = _seen_state()
    dark = predict(state, 0.08, 1e-6, PERIOD, CONFIG)
    assert dark.P[0, 0] > state.P[0, 0]
    assert np.all(np.linalg.eigvalsh(dark.P) >= -1e-15)


def test_a_flap_that_nobody_touches_stays_but_not_for_sure() -> None:
    lab, state = _seen_state()
    loose = state
    for _ in range(15):
        loose = update_angle(loose, unseen(""), UNKNOWN_FINGERTIP, _true_hinge(lab), CONFIG)
    assert loose.x[0] == pytest.approx(state.x[0])
    assert np.sqrt(loose.P[0, 0]) > 0.5 * CONFIG.free_rate * np.sqrt(15) * PERIOD


def test_nothing_is_known_before_the_first_touch() -> None:
    lab = Laboratory(0)
    state = update_angle(UNTOUCHED, lab.plane(0.0), UNKNOWN_FINGERTIP, UNKNOWN_HINGE, CONFIG)
    assert not read_angle(state, lab.camera).known


def test_a_flap_that_is_first_touched_while_it_is_not_seen_is_believed_where_it_was_seen() -> None:
    lab, state = Laboratory(0, EXACT), UNTOUCHED
    for _ in range(5):
        state = update_angle(state, lab.plane(0.0), UNKNOWN_FINGERTIP, UNKNOWN_HINGE, CONFIG)
    spreads = []
    for _ in range(3):
        contact = lab.contact(0.0, 0.0)
        state = update_angle(state, unseen("no samples"), contact, UNKNOWN_HINGE, CONFIG)
        assert np.isfinite(state.x).all()
        assert np.isfinite(state.P).all()
        assert state.n_W is not None
        assert state.n_covariance is not None
        assert_allclose(state.n_W, lab.plane(0.0).n_W, atol=0.02)
        spreads.append(float(np.trace(state.n_covariance)))
    assert 0.0 < spreads[0] < spreads[1] < spreads[2]


@pytest.mark.parametrize("swing", [0.0, 0.15, -0.2])
def test_a_loose_flap_counts_from_where_it_hung_although_nobody_felt_it_swing(swing: float) -> None:
    """A finger that is not felt yet has turned it by `swing`; then it is turned by 40 deg."""
    squares = []
    for seed in range(6):
        lab, state = Laboratory(seed, EXACT), UNTOUCHED
        for _ in range(30):
            plane = lab.plane(0.0)
            state = update_angle(state, plane, UNKNOWN_FINGERTIP, UNKNOWN_HINGE, CONFIG)
        rate = 0.2
        for k in range(50):
            theta = swing + rate * k * PERIOD
            hinge = _true_hinge(lab) if k > 15 else UNKNOWN_HINGE
            contact = lab.contact(theta, rate if k else 0.0)
            state = update_angle(state, lab.plane(theta), contact, hinge, CONFIG)
        belief = read_angle(state, lab.camera)
        squares.append((belief.theta - theta) ** 2 / belief.variance)
        assert belief.theta == pytest.approx(theta, abs=0.02)
    assert np.mean(squares) < 2.5


def test_a_flap_that_is_moved_before_the_first_touch_counts_from_where_it_is_then() -> None:
    lab, state = Laboratory(0, EXACT), UNTOUCHED
    for k in range(40):
        plane = lab.plane(0.0 if k < 20 else 0.3)
        state = update_angle(state, plane, UNKNOWN_FINGERTIP, UNKNOWN_HINGE, CONFIG)
    assert state.rest_images == 20
    assert state.n0_W @ lab.tool.plane(0.3, lab.X_WC_true[:3, 3])[0] > np.cos(0.02)


def test_whole_episodes_are_followed_to_a_degree_seen_and_to_two_hidden() -> None:
    for seed in (0, 4):
        episode = run(Laboratory(seed))
        assert episode.rms("theta", True) < np.deg2rad(1.0)
        assert episode.rms("theta", False) < np.deg2rad(3.0)


def test_what_wrong_planes_said_of_an_earlier_lever_is_forgotten_before_the_flap_is_hidden() -> (
    None
):
    lab, state = _seen_state()
    wrong = np.diag([1e-4, 1e-4, 1e-6])
    state = replace(state, x=np.array([0.0, -0.3, 0.0]), P=wrong)
    theta = 0.0
    for i in range(210):
        theta += 0.08 * PERIOD
        plane = lab.plane(theta) if i < 60 else unseen("hidden")
        state = update_angle(state, plane, lab.contact(theta, 0.08), _true_hinge(lab), CONFIG)
    assert state.x[0] == pytest.approx(theta, abs=0.03)
    assert abs(state.x[0] - theta) < 3.0 * np.sqrt(state.P[0, 0])
