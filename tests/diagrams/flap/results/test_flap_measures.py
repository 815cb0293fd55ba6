"""The figures of an episode of the flap."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from crossmodal.diagrams.flap.results.flap_episode import FlapSeries, TrueFlap
from crossmodal.diagrams.flap.results.flap_measures import (
    aligned_after,
    angles_between,
    longest_run,
    measure_estimation,
    measure_servoing,
    recovery,
    share_inside,
    summarise_recoveries,
)
from crossmodal.plants.tools.flap_jerk import FlapJerk

TIMES = np.arange(300) / 15.0
JERK = FlapJerk(start=4.99, end=5.3)
X, Y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])


def every_tick(vector):
    return np.tile(vector, (len(TIMES), 1))


def true_flap(**changed):
    """A flap turned by 115 deg in 20 s, touched all the time as asked for."""
    values = {
        "times": TIMES,
        "theta": 0.1 * TIMES,
        "k_W": every_tick(Y),
        "p_WK": every_tick([0.5, 0.0, 0.4]),
        "n_W": every_tick(X),
        "touching": np.ones(len(TIMES), bool),
        "p_WC": every_tick([0.5, 0.0, 0.32]),
        "p_SC": every_tick([0.002, 0.01, 0.0]),
        "Sy_W": every_tick(Y),
        "force": np.full(len(TIMES), 0.5),
        "edge_force": np.zeros(len(TIMES)),
        "p_WE": every_tick([0.5, 0.0, 0.7]),
        "flipping": np.ones(len(TIMES), bool),
    }
    return TrueFlap(**{**values, **changed})


def beliefs(truth, **changed):
    """All that is true, believed to a millimetre and a degree."""
    n = len(TIMES)
    values = {
        "times": TIMES,
        "k_W": truth.k_W,
        "k_covariance": np.tile(np.deg2rad(1.0) ** 2 * np.diag([1.0, 0.0, 1.0]), (n, 1, 1)),
        "theta": truth.theta,
        "theta_std": np.full(n, np.deg2rad(1.0)),
        "L1_W": truth.L1_W,
        "L1_covariance": np.tile(1e-6 * np.eye(3), (n, 1, 1)),
        "L2_W": truth.L2_W,
        "L2_covariance": np.tile(1e-6 * np.eye(3), (n, 1, 1)),
        "seen": np.ones(n, bool),
    }
    return FlapSeries(**{**values, **changed})


def test_a_contact_that_stays_where_it_is_does_not_oscillate_but_has_an_offset():
    servoing = measure_servoing(true_flap(), 0.5)
    assert servoing.contact_position_rms == pytest.approx(0.0)
    assert servoing.contact_position_offset == pytest.approx(0.002)
    assert servoing.turned == pytest.approx(0.1 * TIMES[-1])


def test_oscillation_is_the_rms_about_the_mean():
    p_SC = every_tick([0.0, 0.01, 0.0])
    p_SC[:, 0] = 0.004 + 0.001 * (-1.0) ** np.arange(len(TIMES))
    servoing = measure_servoing(true_flap(p_SC=p_SC), 0.5)
    assert servoing.contact_position_rms == pytest.approx(0.001)
    assert servoing.contact_position_offset == pytest.approx(0.004)


def test_force_error_is_that_of_the_force_asked_for():
    servoing = measure_servoing(true_flap(force=np.full(len(TIMES), 0.62)), 0.5)
    assert servoing.force_rms == pytest.approx(0.12)


def test_a_loss_of_contact_is_as_long_as_its_longest_stretch():
    touching = np.ones(len(TIMES), bool)
    touching[20:25] = touching[100:103] = False
    assert measure_servoing(true_flap(touching=touching), 0.5).longest_loss == pytest.approx(5 / 15)
    assert longest_run(TIMES, np.zeros(len(TIMES), bool)) == 0.0


def test_normals_are_aligned_once_they_stay_so_for_a_second():
    cosine = np.full(len(TIMES), 0.5)
    cosine[30:40] = 0.0  # Two thirds of a second.
    cosine[90:] = 0.05
    assert aligned_after(TIMES, cosine) == pytest.approx(90 / 15)
    assert np.isnan(aligned_after(TIMES, np.full(len(TIMES), 0.5)))


def test_a_finger_that_is_rolled_away_from_the_flap_is_not_aligned_whatever_it_presses_on():
    roll = np.deg2rad(20.0) * np.clip(1.0 - TIMES / 6.0, 0.0, 1.0)
    Sy_W = np.column_stack([np.sin(roll), np.cos(roll), 0.0 * roll])
    servoing = measure_servoing(true_flap(Sy_W=Sy_W), 0.5)
    assert servoing.misaligned_at_first == pytest.approx(np.deg2rad(20.0))
    # 6 deg, whose sine is 0.1, are left after 71 % of 6 s.
    assert servoing.aligned_after == pytest.approx(6.0 * (1.0 - 5.74 / 20.0), abs=0.07)


def test_a_slide_along_the_edge_is_that_of_the_contact_against_the_tool():
    slide = np.linspace(0.0, 0.004, len(TIMES))[:, None] * Y
    p_WE, p_WC = every_tick([0.5, 0.0, 0.7]), every_tick([0.5, 0.0, 0.32])
    assert measure_servoing(true_flap(p_WC=p_WC + slide), 0.5).edge_slide == pytest.approx(0.004)
    carried = true_flap(p_WC=p_WC + slide, p_WE=p_WE + slide)
    assert measure_servoing(carried, 0.5).edge_slide == pytest.approx(0.0, abs=1e-9)
    friction = true_flap(edge_force=np.full(len(TIMES), -0.3))
    assert measure_servoing(friction, 0.5).edge_force == pytest.approx(0.3)


def test_an_episode_that_never_flips_has_no_figures_of_it():
    servoing = measure_servoing(true_flap(flipping=np.zeros(len(TIMES), bool)), 0.5)
    assert np.isnan([servoing.force_rms, servoing.longest_loss]).all()


def test_the_axis_is_judged_at_30_deg():
    truth = true_flap()
    angle = np.where(truth.theta < np.deg2rad(40.0), np.deg2rad(3.0), 0.0)
    k_W = np.column_stack([np.sin(angle), np.cos(angle), 0.0 * angle])
    estimation = measure_estimation(truth, beliefs(truth, k_W=k_W))
    assert estimation.axis_angle_error == pytest.approx(np.deg2rad(3.0))
    assert estimation.axis_angle_error_at_end == pytest.approx(0.0, abs=1e-9)


def test_errors_of_the_angle_are_told_apart_by_what_the_camera_saw():
    truth = true_flap()
    seen = TIMES < 10.0
    theta = truth.theta + np.where(seen, 0.01, 0.04)
    estimation = measure_estimation(truth, beliefs(truth, theta=theta, seen=seen))
    assert estimation.theta_rmse_visible == pytest.approx(0.01)
    assert estimation.theta_rmse_hidden == pytest.approx(0.04)


def test_vectors_are_compared_by_the_length_of_their_error():
    truth = true_flap()
    estimation = measure_estimation(
        truth, beliefs(truth, L1_W=truth.L1_W + np.array([0.003, 0.0, 0.004]))
    )
    assert estimation.L1_error == pytest.approx(0.005)
    assert estimation.L2_error == pytest.approx(0.0)
    assert estimation.inside_two_sigma["L1"] == 0.0
    assert estimation.inside_two_sigma["L2"] == 1.0


def test_what_is_never_believed_has_no_figures():
    truth = true_flap()
    unknown = np.full((len(TIMES), 3), np.nan)
    estimation = measure_estimation(truth, beliefs(truth, L1_W=unknown, k_W=unknown))
    assert np.isnan([estimation.L1_error, estimation.axis_angle_error]).all()
    assert np.isnan(estimation.inside_two_sigma["axis"])


@pytest.mark.parametrize("n", [1, 2, 3])
def test_gaussian_errors_are_inside_as_often_as_two_deviations_of_one_dimension(n):
    rng = np.random.default_rng(n)
    A = rng.normal(size=(n, n))
    errors = rng.normal(size=(20000, n)) @ A.T
    covariances = np.tile(A @ A.T, (len(errors), 1, 1))
    assert_allclose(share_inside(errors, covariances), 0.9545, atol=0.005)


def test_a_direction_without_variance_is_not_asked_for():
    covariance = np.diag([1.0, 0.0, 1.0])
    assert share_inside(np.array([[0.1, 0.3, 0.1]]), covariance[None]) == 1.0


def test_angles_between_vectors_are_exact_for_small_ones():
    b = np.array([[np.cos(1e-9), np.sin(1e-9), 0.0]])
    assert_allclose(angles_between(X[None], b), [1e-9])


def touched_but(*gaps: tuple[float, float]):
    """A flap that is jerked by 30 mm at 5 s and not touched in some intervals, [s]."""
    touching = np.ones(len(TIMES), bool)
    for start, end in gaps:
        touching &= (start > TIMES) | (end <= TIMES)
    unknown = np.full((len(TIMES), 3), np.nan)
    return TrueFlap(
        times=TIMES,
        theta=np.where(TIMES < 5.0, 0.5, 0.5 + 0.03 / 0.08),
        k_W=unknown,
        p_WK=np.tile([0.5, 0.0, 0.4], (len(TIMES), 1)),
        n_W=unknown,
        touching=touching,
        p_WC=np.where(touching[:, None], [0.5, 0.0, 0.32], np.nan),
        p_SC=unknown,
        Sy_W=unknown,
        force=np.where(touching, 0.5, 0.0),
        edge_force=np.zeros(len(TIMES)),
        p_WE=unknown,
        flipping=np.ones(len(TIMES), bool),
    )


def test_a_contact_that_came_back_is_timed_from_the_jerk() -> None:
    found = recovery(touched_but((5.2, 8.0)), JERK)
    assert found is not None
    assert found["contact_lost"]
    assert found["displacement"] == pytest.approx(0.03)
    assert found["reestablished_after"] == pytest.approx(3.01, abs=0.04)


def test_a_short_touch_is_no_contact() -> None:
    found = recovery(touched_but((5.2, 8.0), (8.3, 11.0)), JERK)
    assert found is not None
    assert found["reestablished_after"] == pytest.approx(6.01, abs=0.04)


def test_a_contact_that_never_came_back_has_no_time() -> None:
    truth = touched_but((5.2, 30.0))
    assert np.isnan(recovery(truth, JERK)["reestablished_after"])
    assert summarise_recoveries(truth, [JERK])["contact_reestablished"] is False


def test_a_contact_that_was_kept_was_not_lost() -> None:
    found = recovery(touched_but(), JERK)
    assert found is not None
    assert not found["contact_lost"]
    assert found["reestablished_after"] == 0.0


def test_a_finger_that_retreats_has_not_lost_the_contact() -> None:
    truth = replace(touched_but((15.0, 30.0)), retreated_at=15.0)
    found = recovery(truth, JERK)
    assert found is not None
    assert not found["contact_lost"]
    lost = replace(touched_but((5.2, 14.5), (15.0, 30.0)), retreated_at=15.0)
    assert np.isnan(recovery(lost, JERK)["reestablished_after"])
    assert recovery(truth, FlapJerk(start=16.0, end=16.3)) is None


def test_an_episode_that_ends_before_the_jerk_shows_nothing() -> None:
    late = FlapJerk(start=100.0, end=100.3)
    assert recovery(touched_but(), late) is None
    assert summarise_recoveries(touched_but(), [late])["contact_reestablished"] is False
    assert summarise_recoveries(touched_but(), []) == {}


def test_a_flap_that_went_back_was_not_turned() -> None:
    there_and_back = np.interp(TIMES, [TIMES[0], TIMES.mean(), TIMES[-1]], [0.0, 1.9, 0.1])
    episode = true_flap(theta=there_and_back, flipping=np.ones(len(TIMES), bool))
    assert measure_servoing(episode, 0.5).turned == pytest.approx(0.1)
