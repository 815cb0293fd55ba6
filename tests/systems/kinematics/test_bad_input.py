"""Measurements that cannot be true: skipped with a count and a reason, the belief as before."""

import copy
from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose
from synthetic_motion import Run, Scene, simulate

from crossmodal.maths import se3
from crossmodal.systems.kinematics.joint_filters import (
    JointFilters,
    JointFiltersConfig,
    JointFiltersState,
    _turn_variance,
)
from crossmodal.systems.kinematics.pose_checks import SkipReason, covariance_fault, pose_fault
from crossmodal.systems.port_values import JointType

SCENE = Scene(joint=JointType.REVOLUTE, seconds=6.0)
BAD_AT = 40
Measurement = tuple[np.ndarray, np.ndarray, float]


def _set(array: np.ndarray, index: tuple[int, int], value: float) -> np.ndarray:
    changed = array.copy()
    changed[index] = value
    return changed


def _run(
    run: Run, spoil: Callable[[np.ndarray, np.ndarray, float], Measurement] | None = None
) -> tuple[JointFilters, JointFiltersState]:
    """All measurements, one of them spoilt beforehand and sent once more as it should be."""
    filters = JointFilters(JointFiltersConfig())
    state = filters.start(run.measured[0], SCENE.covariance, 0.0)
    for k in range(1, len(run.times)):
        good = (run.measured[k], SCENE.covariance, float(run.times[k]))
        if k == BAD_AT and spoil is not None:
            state = filters.update(state, *spoil(*good))
        state = filters.update(state, *good)
    return filters, state


SPOILT: dict[SkipReason, list[Callable[[np.ndarray, np.ndarray, float], Measurement]]] = {
    SkipReason.POSE_NOT_FINITE: [
        lambda X, P, t: (_set(X, (0, 3), np.nan), P, t),
        lambda X, P, t: (_set(X, (1, 1), np.inf), P, t),
    ],
    SkipReason.POSE_TOO_FAR: [lambda X, P, t: (_set(X, (0, 3), 1e200), P, t)],
    SkipReason.NO_ROTATION: [
        lambda X, P, t: (X @ np.diag([1.0, 1.0, -1.0, 1.0]), P, t),
        lambda X, P, t: (X @ np.diag([1.1, 1.1, 1.1, 1.0]), P, t),
        lambda X, P, t: (np.zeros((4, 4)), P, t),
    ],
    SkipReason.COVARIANCE_NOT_FINITE: [
        lambda X, P, t: (X, P * np.nan, t),
        lambda X, P, t: (X, _set(P, (1, 0), np.inf), t),
    ],
    SkipReason.COVARIANCE_NOT_SYMMETRIC: [lambda X, P, t: (X, _set(P, (0, 1), 1e-5), t)],
    SkipReason.COVARIANCE_INDEFINITE: [
        lambda X, P, t: (X, -P, t),
        lambda X, P, t: (X, P @ (np.eye(6) + 2.0 * np.eye(6)[[1, 0, 2, 3, 4, 5]]), t),
    ],
    SkipReason.TIME_NOT_FINITE: [lambda X, P, t: (X, P, np.nan), lambda X, P, t: (X, P, np.inf)],
    SkipReason.TIME_BACKWARDS: [
        lambda X, P, t: (X, P, t - 0.17),
        lambda X, P, t: (X, P, t - 3600.0),
    ],
    SkipReason.TIME_AHEAD: [
        lambda X, P, t: (X, P, t + 60.0),
        lambda X, P, t: (X, P, t + 3600.0),
        lambda X, P, t: (X, P, 1e18),
    ],
    SkipReason.REPEATED: [lambda X, P, t: (X, P, t)],
}


@pytest.mark.parametrize(
    ("reason", "spoil"), [(reason, spoil) for reason, all_ in SPOILT.items() for spoil in all_]
)
def test_one_bad_measurement_is_counted_and_changes_nothing(
    reason: SkipReason, spoil: Callable[[np.ndarray, np.ndarray, float], Measurement]
) -> None:
    run = simulate(SCENE, 0)
    filters, clean = _run(run)
    _, state = _run(run, spoil)
    assert dict(clean.skipped) == {}
    assert dict(state.skipped) == {reason: 1}
    for x, y in zip(clean.models, state.models, strict=True):
        assert_allclose(x, y, atol=0.0)
    belief = filters.belief(state)
    assert belief.type == JointType.REVOLUTE
    assert belief.skipped == {str(reason): 1}
    assert_allclose(sum(belief.probabilities.values()), 1.0)


def test_the_state_before_is_not_changed_by_a_skipped_one() -> None:
    filters, state = _run(simulate(SCENE, 0))
    after = filters.update(state, np.full((4, 4), np.nan), SCENE.covariance, 99.0)
    assert dict(state.skipped) == {}
    assert after.time == state.time
    assert copy.deepcopy(after) is after


def test_a_stream_of_which_every_third_is_bad_ends_as_one_without_these() -> None:
    run = simulate(SCENE, 1)
    filters = JointFilters(JointFiltersConfig())
    state = filters.start(run.measured[0], SCENE.covariance, 0.0)
    spoilt = [spoil for all_ in SPOILT.values() for spoil in all_]
    bad = 0
    for k in range(1, len(run.times)):
        good = (run.measured[k], SCENE.covariance, float(run.times[k]))
        state = filters.update(state, *good)
        if k % 3 == 0:
            state = filters.update(state, *spoilt[bad % len(spoilt)](*good))
            bad += 1
    _, clean = _run(run)
    assert sum(state.skipped.values()) == bad
    assert filters.probabilities(state) == filters.probabilities(clean)


def test_two_sensors_that_measure_at_one_instant_both_count() -> None:
    run, rng = simulate(SCENE, 2), np.random.default_rng(3)
    filters = JointFilters(JointFiltersConfig())
    state = filters.start(run.measured[0], SCENE.covariance, 0.0)
    for k in range(1, len(run.times)):
        other = run.X_PB[k] @ se3.exp(np.sqrt(np.diag(SCENE.covariance)) * rng.normal(size=6))
        for X in (run.measured[k], other):
            state = filters.update(state, X, SCENE.covariance, float(run.times[k]))
    belief = filters.belief(state)
    assert belief.updates == 2 * (len(run.times) - 1)
    assert belief.skipped == {}
    assert belief.type == JointType.REVOLUTE
    error = belief.model.configuration[0] - run.q[-1]
    assert error**2 < 9.0 * belief.model.configuration_covariance[0, 0]


def _stamped(
    stamp: Callable[[float], float], seed: int, gap: tuple[float, float] = (np.inf, np.inf)
) -> tuple[JointFilters, JointFiltersState, Run]:
    """A door's poses with other times, and none of them in a gap [s]."""
    run, filters = simulate(SCENE, seed), JointFilters(JointFiltersConfig())
    state = filters.start(run.measured[0], SCENE.covariance, stamp(0.0))
    for time, X in zip(run.times[1:], run.measured[1:], strict=True):
        if not gap[0] < time < gap[1]:
            state = filters.update(state, X, SCENE.covariance, stamp(float(time)))
    return filters, state, run


@pytest.mark.parametrize("jump", [60.0, 8 * 3600.0, 86400.0, -3600.0, 1e9])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_clock_that_jumps_costs_one_measurement_and_no_false_claim(
    jump: float, seed: int
) -> None:
    filters, state, run = _stamped(lambda t: 1e5 + t + (jump if t > 3.0 else 0.0), seed)
    belief = filters.belief(state)
    assert sum(belief.skipped.values()) == 1
    assert belief.type == JointType.REVOLUTE
    error = float(belief.model.configuration[0] - run.q[-1])
    assert error**2 < 9.0 * belief.model.configuration_covariance[0, 0]
    assert abs((error + np.pi) % (2.0 * np.pi) - np.pi) < 0.02


@pytest.mark.parametrize("seed", [0, 1])
def test_a_clock_that_jumps_there_and_back_is_followed(seed: int) -> None:
    filters, state, run = _stamped(lambda t: t + (500.0 if 2.0 < t < 4.0 else 0.0), seed)
    belief = filters.belief(state)
    assert sum(belief.skipped.values()) == 2
    error = float(belief.model.configuration[0] - run.q[-1])
    assert abs((error + np.pi) % (2.0 * np.pi) - np.pi) < 0.02


def test_a_wrong_time_that_is_sent_twice_is_wrong() -> None:
    run, filters = simulate(SCENE, 0), JointFilters(JointFiltersConfig())
    state = filters.start(run.measured[0], SCENE.covariance, 0.0)
    for k in range(1, len(run.times)):
        if k == BAD_AT:
            for _ in range(2):
                state = filters.update(state, run.measured[k], SCENE.covariance, 1000.0)
        state = filters.update(state, run.measured[k], SCENE.covariance, float(run.times[k]))
    belief = filters.belief(state)
    assert belief.skipped == {str(SkipReason.TIME_AHEAD): 2}
    assert belief.model.configuration_covariance[0, 0] < 0.02**2


def test_a_single_time_far_ahead_is_wrong_after_a_gap_too() -> None:
    run, filters = simulate(SCENE, 0), JointFilters(JointFiltersConfig())
    state = filters.start(run.measured[0], SCENE.covariance, 0.0)
    times = run.times + np.where(run.times > 2.0, 8.0, 0.0)  # Hidden for 8 s.
    times[np.searchsorted(run.times, 4.0)] += 75.0
    for X, time in zip(run.measured[1:], times[1:], strict=True):
        state = filters.update(state, X, SCENE.covariance, float(time))
    assert filters.belief(state).skipped == {str(SkipReason.TIME_AHEAD): 1}


def test_after_long_without_a_pose_the_turns_are_not_known() -> None:
    filters, state, run = _stamped(lambda t: t + (300.0 if t > 3.0 else 0.0), 0)
    model = filters.belief(state).model
    assert model.configuration_covariance[0, 0] > (2.0 * np.pi) ** 2
    assert abs(model.configuration[0] - run.q[-1]) < 0.02  # The fewest turns.
    _, state, run = _stamped(lambda t: t, 0, gap=(2.0, 3.5))
    assert filters.belief(state).model.configuration_covariance[0, 0] < 0.02**2


def test_turns_are_as_uncertain_as_they_are_likely() -> None:
    """Beside the variance of an angle's rounding to whole turns, drawn by lot."""
    rng = np.random.default_rng(0)
    for sigma in (1.0, 2.0, 4.0, 6.0, 20.0):
        turns = 2.0 * np.pi * np.arange(-40, 41)
        p = np.exp(-0.5 * (turns / sigma) ** 2)
        drawn = rng.choice(turns, 400_000, p=p / p.sum())
        assert_allclose(_turn_variance(sigma**2), drawn.var(), rtol=0.06, atol=1e-3)


def test_poses_that_come_seldom_are_used() -> None:
    filters, state, _ = _stamped(lambda t: 300.0 * t, 0)
    assert sum(state.skipped.values()) == 1
    assert filters.belief(state).type == JointType.REVOLUTE


def test_irregular_stamps_and_gaps_are_fine() -> None:
    run, rng = simulate(SCENE, 4), np.random.default_rng(5)
    filters = JointFilters(JointFiltersConfig())
    state = filters.start(run.measured[0], SCENE.covariance, 0.0)
    for k in range(1, len(run.times)):
        if rng.random() < 0.4 or 1.5 < run.times[k] < 3.0:
            continue
        state = filters.update(state, run.measured[k], SCENE.covariance, float(run.times[k]))
    belief = filters.belief(state)
    assert belief.type == JointType.REVOLUTE
    assert belief.skipped == {}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((np.eye(3), np.eye(6), 1.0), r"X_PB.*\(4, 4\).*\(3, 3\)"),
        ((np.eye(4), np.ones(6), 1.0), r"covariance.*\(6, 6\).*\(6,\)"),
        ((np.eye(4), np.eye(6), 1.0, np.eye(3)), r"correlated.*\(6, 6\).*\(3, 3\)"),
        (([[1.0], [1.0, 2.0]], np.eye(6), 1.0), r"X_PB.*list"),
        ((np.eye(4) * 1j, np.eye(6), 1.0), r"X_PB.*complex"),
    ],
)
def test_a_wrong_shape_is_refused_with_the_argument_s_name(arguments: tuple, words: str) -> None:
    filters = JointFilters(JointFiltersConfig())
    state = filters.start(np.eye(4), 1e-6 * np.eye(6), 0.0)
    with pytest.raises(ValueError, match=words):
        filters.update(state, *arguments)


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ((np.full((4, 4), np.nan), np.eye(6), 0.0), SkipReason.POSE_NOT_FINITE),
        ((np.eye(4), -np.eye(6), 0.0), SkipReason.COVARIANCE_INDEFINITE),
        ((np.eye(4), np.eye(6), np.nan), SkipReason.TIME_NOT_FINITE),
    ],
)
def test_nothing_starts_at_a_bad_measurement(arguments: tuple, reason: SkipReason) -> None:
    with pytest.raises(ValueError, match=f"start: {reason}"):
        JointFilters(JointFiltersConfig()).start(*arguments)


def test_lists_and_single_precision_are_input_too() -> None:
    filters = JointFilters(JointFiltersConfig())
    state = filters.start(np.eye(4).tolist(), (1e-6 * np.eye(6)).tolist(), 0.0)
    state = filters.update(state, np.eye(4, dtype=np.float32), 1e-6 * np.eye(6), 0.1)
    assert filters.belief(state).skipped == {}


def test_singular_and_partly_infinite_covariances_are_legal() -> None:
    J = np.random.default_rng(0).normal(size=(6, 2))
    unknown = np.diag([np.inf, np.inf, np.inf, 1e-6, 1e-6, 1e-6])
    for P in (np.zeros((6, 6)), 1e-6 * J @ J.T, unknown):
        assert covariance_fault(P) is None
    assert covariance_fault(_set(unknown, (3, 3), -np.inf)) == SkipReason.COVARIANCE_NOT_FINITE
    assert pose_fault(se3.exp(np.arange(6.0))) is None


def test_no_number_that_a_pose_may_have_ends_in_a_belief_that_is_none() -> None:
    """Fuzz: any scale of pose, covariance and time step."""
    rng = np.random.default_rng(0)
    filters = JointFilters(JointFiltersConfig())
    for _ in range(6):
        state, t = filters.start(np.eye(4), 1e-6 * np.eye(6), 0.0), 0.0
        for _ in range(40):
            X = se3.exp(rng.normal(size=6) * 10.0 ** rng.uniform(-12, 5, size=6))
            P = np.diag(10.0 ** rng.uniform(-300, 300, size=6))
            t += 10.0 ** rng.uniform(-15, 6)
            state = filters.update(state, X, P, t)
            p = np.array(list(filters.belief(state).probabilities.values()))
            assert np.isfinite(p).all()
            assert_allclose(p.sum(), 1.0)
