"""The joint filters with correlated errors: drifts, bodies seen late, grips that settle."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from synthetic_motion import Run, Scene, simulate

from crossmodal.maths import se3
from crossmodal.maths.consistency import is_consistent
from crossmodal.maths.vectors import normal_basis
from crossmodal.systems.kinematics.joint_filters import JointFilters, JointFiltersConfig
from crossmodal.systems.kinematics.measurement_errors import MeasurementErrorsConfig
from crossmodal.systems.port_values import JointModelBelief, JointType

PRISMATIC, REVOLUTE, SCREW = JointType.PRISMATIC, JointType.REVOLUTE, JointType.SCREW


def _correlated(**errors: float) -> JointFiltersConfig:
    return JointFiltersConfig(errors=MeasurementErrorsConfig(**errors))


def _angle(model: JointModelBelief, axis: np.ndarray) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(model.axis_P, axis)), model.axis_P @ axis))


def _slide_then_drift(config: JointFiltersConfig, *, declared: bool) -> tuple:
    """A slide seen well for 4 s, then sensed for 6 s with a correlated error that grows.

    Returns:
        Probability of a prismatic joint and the angle of its axis to the true one, [rad].
    """
    rng = np.random.default_rng(0)
    filters = JointFilters(config)
    state = filters.start(np.eye(4), 1e-12 * np.eye(6), -1.0)
    sigma = np.repeat([1e-3, 2e-4], 3)
    for k in range(1, 150):
        time, unseen = k / 15, max(0.0, k / 15 - 4.0)
        X = se3.exp(np.array([0.0, 0.0, 0.0, 0.02 * time, 0.0, 0.0]))
        drift = np.array([0.0, 0.0, 8e-3, 0.0, 2e-3, 0.0]) * unseen
        correlated = np.diag(np.repeat([4e-3, 1e-3], 3) * unseen) ** 2
        X = X @ se3.exp(drift) @ se3.exp(sigma * rng.normal(size=6))
        covariance = np.diag(sigma**2) + correlated
        state = filters.update(state, X, covariance, time, correlated if declared else None)
    belief = filters.belief(state)
    slide = belief.models[PRISMATIC]
    return belief.probabilities[PRISMATIC], _angle(slide, np.array([1.0, 0.0, 0.0]))


def test_a_correlated_error_does_not_bend_a_slide_that_was_seen_well() -> None:
    config = _correlated(declared_time=5.0)
    right, angle = _slide_then_drift(config, declared=True)
    assert right > 0.99
    assert angle < np.deg2rad(0.3)
    _, off = _slide_then_drift(config, declared=False)
    assert off > 2.0 * angle


@pytest.mark.parametrize("declared", [True, False])
def test_a_body_that_stops_is_not_believed_to_go_on_for_a_correlated_error(declared: bool) -> None:
    """A slide sensed by the hand alone: off by a constant millimetre, and by little that is new."""
    config = _correlated(declared_time=5.0)
    rng = np.random.default_rng(0)
    filters = JointFilters(config)
    state = filters.start(np.eye(4), 1e-12 * np.eye(6), -1.0)
    new = np.diag(np.repeat([1e-4, 5e-5], 3) ** 2)
    errors = []
    for k in range(1, 150):
        time = k / 15
        displacement = 0.02 * min(time, 8.0)
        off = np.array([0.0, 0.0, 0.0, 1e-3 * min(time, 1.0), 0.0, 0.0])
        X = se3.exp(
            np.array([0.0, 0.0, 0.0, displacement, 0.0, 0.0])
            + off
            + rng.multivariate_normal(np.zeros(6), new)
        )
        correlated = np.diag(np.repeat([0.05, 4e-3], 3) * min(time, 1.0)) ** 2
        state = filters.update(state, X, new + correlated, time, correlated if declared else None)
        slide = filters.belief(state).models[PRISMATIC]
        errors.append(slide.configuration[0] - displacement)
    pulled, stopped = np.array(errors[60:118]), np.array(errors[121:])
    assert_allclose(pulled, 1e-3, atol=5e-4 if declared else 1e-3)
    assert (np.abs(stopped - 1e-3).max() < 1e-3) == declared
    assert not declared or np.sqrt(slide.configuration_covariance[0, 0]) > 3e-3


def _seen_late(joint: JointType, seed: int) -> tuple[JointFilters, list, Run, int]:
    """Half of a motion is sensed, with an error that grows; it is constant from when it is seen."""
    scene = Scene(joint=joint, translation=1e-2, rotation=3.0)
    fine = 0.05**2 * scene.covariance
    run = simulate(scene, seed)
    rng = np.random.default_rng((seed, 1))
    half = len(run.times) // 2
    error = rng.multivariate_normal(np.zeros(6), scene.covariance)
    config = _correlated(declared_time=5.0)
    filters = JointFilters(config)
    states = [filters.start(run.X_PB[0], 1e-12 * np.eye(6), 0.0)]
    for k in range(1, len(run.times)):
        time, share = float(run.times[k]), min(k / half, 1.0)
        X = run.X_PB[k] @ se3.exp(share * error)
        X = X @ se3.exp(rng.multivariate_normal(np.zeros(6), fine))
        if k < half:
            sensed = share**2 * scene.covariance
            states.append(filters.update(states[-1], X, fine + sensed, time, sensed))
            continue
        state = states[-1]
        if k == half:
            state = filters.rebase(state, time, scene.covariance, np.zeros((6, 6)))
        states.append(filters.update(state, X, fine, time))
    return filters, states, run, half


@pytest.mark.parametrize("joint", [PRISMATIC, REVOLUTE])
def test_a_constant_error_leaves_what_is_known_of_axis_and_type(joint: JointType) -> None:
    filters, states, _, half = _seen_late(joint, 0)
    state = states[half - 1]
    kept = filters.rebase(state, state.time, 1e-12 * np.eye(6), np.zeros((6, 6)))
    old, new = filters.belief(states[half - 1]), filters.belief(states[half])
    assert new.type == old.type == joint
    assert abs(new.probabilities[SCREW] - old.probabilities[SCREW]) < 0.1
    angle = np.arccos(min(1.0, abs(float(new.models[joint].axis_P @ old.models[joint].axis_P))))
    assert angle < 2.0 * np.sqrt(np.trace(old.models[joint].axis_covariance))
    assert np.trace(new.models[joint].axis_covariance) < np.trace(old.models[joint].axis_covariance)
    assert_allclose(kept.models.marginal_evidence.max(), 0.0)
    assert kept.keyframes.size[0] == 1


@pytest.mark.parametrize("joint", [PRISMATIC, REVOLUTE])
def test_what_is_seen_late_is_as_wrong_as_it_says(joint: JointType) -> None:
    inside, errors = [], []
    for seed in range(20):
        filters, states, run, half = _seen_late(joint, seed)
        model = filters.belief(states[-1]).models[joint]
        error = model.configuration[:1] - run.q[-1]
        B = normal_basis(model.axis_P)
        inside.append(
            [
                is_consistent(error, model.configuration_covariance[:1, :1]),
                is_consistent(B @ run.axis, B @ model.axis_covariance @ B.T),
            ]
        )
        errors.append(
            [_angle(filters.belief(states[half]).models[joint], run.axis), _angle(model, run.axis)]
        )
        assert filters.belief(states[-1]).type == joint
    q_inside, axis_inside = np.mean(inside, axis=0)
    assert 0.8 <= q_inside <= 1.0
    assert 0.8 <= axis_inside <= 1.0
    start, end = np.median(errors, axis=0)
    assert end < 0.2 * start


def test_the_evidence_of_a_wrong_axis_far_away_does_not_jump() -> None:
    """To and fro on a straight path, sensed by a hand that can turn: hardly a revolute joint."""
    filters = JointFilters(_correlated(declared_time=5.0))
    lasting = np.diag(np.repeat([0.05, 6e-3], 3) ** 2)
    rng, evidence = np.random.default_rng(0), []
    state = filters.start(np.eye(4), 1e-12 * np.eye(6), -1.0)
    for k in range(450):
        y = 0.02 * (15.0 - abs(k / 15 - 15.0))
        X = se3.exp(np.array([0.0, 0.0, 0.0, 0.0, y, 0.0]) + 1e-4 * rng.normal(size=6))
        shift = 1e-3 + 0.02 * y
        deviation = np.array([0.02, 0.02, 0.02 + 1.5 * y, shift, shift, shift])
        state = filters.update(state, X, np.diag(deviation**2) + lasting, k / 15, lasting)
        evidence.append(state.models.log_evidence[1])
    assert np.abs(np.diff(evidence))[150:].max() < 2.0


def test_a_grip_that_settles_after_the_reference_does_not_bend_the_path() -> None:
    """Its error lies across the path; with it allowed for, q still counts from the reference."""
    filters = JointFilters(JointFiltersConfig())
    reference_error = np.diag(np.repeat([0.05**2, 6e-3**2], 3))
    R, rng, angles = 1e-6 * np.eye(6), np.random.default_rng(0), []
    for allowed in (reference_error, None):
        state = filters.start(np.eye(4), 1e-12 * np.eye(6), -1.0 / 15.0, reference_error=allowed)
        for k in range(150):
            y, fades = 0.02 * k / 15, 1.0 - np.exp(-k / 15)
            xi = np.array([0.0, 0.0, 0.03, 5e-3, 0.0, 0.0]) * fades
            X = se3.exp(np.array([0.0, 0.0, 0.0, 0.0, y, 0.0])) @ se3.exp(xi)
            X = X @ se3.exp(1e-3 * rng.normal(size=6))
            correlated = reference_error * np.exp(-2.0 * k / 15)
            state = filters.update(
                state, X, R + (correlated if allowed is not None else 0.0), k / 15
            )
        belief = filters.belief(state)
        angles.append(_angle(belief.models[PRISMATIC], np.array([0.0, 1.0, 0.0])))
        if allowed is not None:
            assert belief.type == PRISMATIC
            assert_allclose(belief.model.configuration[0], y, atol=2e-3)
    assert angles[0] < 0.5 * angles[1]


@pytest.mark.parametrize("joint", [PRISMATIC, REVOLUTE])
def test_a_reference_that_came_late_leaves_the_configuration_as_uncertain_as_the_delay(
    joint: JointType,
) -> None:
    scene, delay = Scene(joint=joint, seconds=4.0), 0.5
    run = simulate(scene, 3)
    stds = []
    for late in (0.0, delay):
        filters = JointFilters(JointFiltersConfig())
        state = filters.start(run.measured[0], scene.covariance, 0.0, delay=late)
        for t, X in zip(run.times[1:], run.measured[1:], strict=True):
            state = filters.update(state, X, scene.covariance, float(t))
        model = filters.belief(state).models[joint]
        stds.append(np.sqrt(model.configuration_covariance[0, 0]))
    lever = 1.0 if joint == PRISMATIC else filters.config.radius
    assert_allclose(stds[1] ** 2 - stds[0] ** 2, (delay * filters.config.speed / lever) ** 2)


def test_after_a_constant_error_the_reference_is_as_noisy_as_the_stream_was() -> None:
    """The noise is four times as large as reported, which the filters have found out."""
    scene = Scene(joint=REVOLUTE, seconds=8.0)
    run, filters = simulate(scene, 0), JointFilters(JointFiltersConfig())
    reported = scene.covariance / 16.0
    state = filters.start(run.measured[0], reported, 0.0)
    for t, X in zip(run.times[1:], run.measured[1:], strict=True):
        state = filters.update(state, X, reported, float(t))
    assert 3.0 < state.scale.min() < state.scale.max() < 5.0
    rebased = filters.rebase(state, state.time, 1e-12 * np.eye(6), np.zeros((6, 6)))
    found = np.sqrt(np.diagonal(rebased.keyframes.R[0]) / np.diagonal(reported))
    assert_allclose(found, state.scale, rtol=1e-6)
    # The step across the jump is none of the noise's.
    after = filters.update(
        rebased, run.measured[-1] @ se3.exp(np.full(6, 0.05)), reported, state.time + 1.0
    )
    assert_allclose(after.noise.variance, state.noise.variance)
    assert filters.belief(rebased).models[REVOLUTE].configuration_covariance[1, 1] > 0.0


@pytest.mark.parametrize("time", [float("nan"), 0.5])
def test_a_constant_error_comes_at_no_impossible_time(time: float) -> None:
    filters = JointFilters(JointFiltersConfig())
    state = filters.start(np.eye(4), 1e-6 * np.eye(6), 1.0)
    with pytest.raises(ValueError, match="rebase: time"):
        filters.rebase(state, time, 1e-12 * np.eye(6), np.zeros((6, 6)))
