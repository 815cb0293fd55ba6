"""The joint filters on simulated motions: type, errors, and how honest their covariances are."""

import copy
import subprocess
import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.common.yaml import yaml_load_typed
from synthetic_motion import Scene, at_rest, filter_states, simulate, stop_and_go, to_and_fro

from crossmodal.maths import se3
from crossmodal.maths.consistency import is_consistent
from crossmodal.maths.vectors import normal_basis
from crossmodal.systems.kinematics.joint_filters import (
    JointFilters,
    JointFiltersConfig,
    JointFiltersState,
)
from crossmodal.systems.kinematics.measurement_errors import (
    MeasurementErrorsConfig,
    white_equivalent,
)
from crossmodal.systems.port_values import JointModelBelief, JointType

PRISMATIC, REVOLUTE = JointType.PRISMATIC, JointType.REVOLUTE
SCREW = JointType.SCREW
RIGID, DISCONNECTED = JointType.RIGID, JointType.DISCONNECTED


def _correlated(**errors: float) -> JointFiltersConfig:
    return JointFiltersConfig(errors=MeasurementErrorsConfig(**errors))


def _angle(model: JointModelBelief, axis: np.ndarray) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(model.axis_P, axis)), model.axis_P @ axis))


def _consistency(scene: Scene, seeds: range, config: JointFiltersConfig | None = None) -> tuple:
    """Shares of NEES inside their 95 % bounds: configuration, axis, axis point, prediction."""
    inside = []
    for seed in seeds:
        run = simulate(scene, seed)
        filters, states = filter_states(scene, run, config)
        for k in range(15, len(states) - 1, 5):
            m = filters.belief(states[k]).models[scene.joint]
            B = normal_basis(m.axis_P)
            row = [
                is_consistent(m.configuration[:1] - run.q[k], m.configuration_covariance[:1, :1]),
                is_consistent(B @ run.axis, B @ m.axis_covariance @ B.T),
            ]
            if scene.joint == REVOLUTE:
                # The true axis, where it passes the plane through the estimate, normal to it.
                d = run.point - m.p_PA
                d -= run.axis * (d @ m.axis_P) / (run.axis @ m.axis_P)
                row.append(is_consistent(B @ d, B @ m.p_PA_covariance @ B.T))
            predicted = filters.predict(states[k], scene.joint, 1.0 / 15.0)
            e = se3.log(se3.inverse(predicted.X) @ run.X_PB[k + 1])
            row.append(is_consistent(e, predicted.covariance))
            inside.append(row)
    return tuple(np.mean(inside, axis=0))


@pytest.mark.parametrize(
    "scene",
    [
        Scene(joint=PRISMATIC, translation=1e-3, rotation=0.3),
        Scene(joint=PRISMATIC, translation=1e-2, rotation=3.0),
        Scene(joint=REVOLUTE, translation=1e-3, rotation=0.3),
        Scene(joint=REVOLUTE, radius=0.15, translation=1e-2, rotation=3.0),
        Scene(joint=REVOLUTE, radius=1.3, seconds=15.0),
        Scene(joint=REVOLUTE, radius=0.0),  # Pure rotation.
        Scene(joint=PRISMATIC, distance=30.0),
        Scene(joint=REVOLUTE, distance=30.0),
        Scene(joint=PRISMATIC, motion=stop_and_go),
        Scene(joint=REVOLUTE, motion=to_and_fro),
        Scene(joint=RIGID, motion=at_rest),
        Scene(joint=RIGID, motion=at_rest, translation=1e-2, rotation=3.0),
    ],
)
def test_the_type_is_right_at_the_end_and_nearly_always_certain(scene: Scene) -> None:
    for seed in range(3):
        filters, states = filter_states(scene, simulate(scene, seed))
        belief = filters.belief(states[-1])
        assert belief.type == scene.joint
        p = belief.probabilities
        # A hinge that was seen for a short while may have a pitch of millimetres per radian, and
        # a slide whose rotation is seen to a degree or three may turn about an axis far away.
        besides = {RIGID: (), PRISMATIC: (REVOLUTE, SCREW), REVOLUTE: (SCREW,)}[scene.joint]
        assert p[scene.joint] > 0.45
        likely = p[scene.joint] + sum(p[other] for other in besides)
        assert likely > {RIGID: 0.8, PRISMATIC: 0.99, REVOLUTE: 0.99}[scene.joint]
        assert_allclose(sum(belief.probabilities.values()), 1.0)


@pytest.mark.parametrize("joint", [PRISMATIC, REVOLUTE])
def test_what_is_seen_well_is_certain(joint: JointType) -> None:
    scene = Scene(joint=joint, translation=1e-4, rotation=0.03)
    for seed in range(3):
        filters, states = filter_states(scene, simulate(scene, seed))
        assert filters.probabilities(states[-1])[joint] > 0.9


def test_a_body_is_rigid_until_it_moves_and_settles_soon_after() -> None:
    scene = Scene(joint=PRISMATIC, motion=lambda t: 0.02 * np.clip(t - 4.0, 0.0, None), seconds=8.0)
    filters, states = filter_states(scene, simulate(scene, 0))
    types = [filters.belief(s).type for s in states]
    assert types[:60] == [RIGID] * 60
    assert types[90:] == [PRISMATIC] * 31


@pytest.mark.parametrize("turn", [False, True])
def test_a_steep_screw_is_one_and_a_body_that_leaves_its_axis_is_disconnected(turn: bool) -> None:
    """A screw of .2 m/rad, and a motion that changes its axis after being prismatic for long."""
    filters = JointFilters(JointFiltersConfig())
    rng, X, R = np.random.default_rng(0), np.eye(4), np.diag(np.repeat([3e-4, 9e-6], 3))
    state = filters.start(X, R, 0.0)
    for k in range(1, 180):
        V = np.array([0.0, 0.0, 0.1, 0.0, 0.0, 0.02])
        if turn:
            V = np.array([0, 0, 0, 0.02, 0, 0]) if k < 90 else np.array([0, 0.1, 0, 0, 0.02, 0])
        X = X @ se3.exp(V / 15.0)
        measured = X @ se3.exp(np.sqrt(np.diag(R)) * rng.normal(size=6))
        state = filters.update(state, measured, R, k / 15.0)
        if turn and k == 89:
            assert filters.belief(state).type == PRISMATIC
    belief = filters.belief(state)
    assert belief.type == (DISCONNECTED if turn else SCREW)
    if not turn:
        assert abs(belief.model.pitch - 0.2) < 3.0 * np.sqrt(belief.model.pitch_variance)
        assert belief.model.pitch_variance < 0.01**2


@pytest.mark.parametrize("joint", [PRISMATIC, REVOLUTE])
@pytest.mark.parametrize("noise", [(1e-3, 0.3), (1e-2, 3.0)])
def test_covariances_are_honest(joint: JointType, noise: tuple[float, float]) -> None:
    scene = Scene(joint=joint, translation=noise[0], rotation=noise[1], motion=stop_and_go)
    assert min(_consistency(scene, range(6))) > 0.8


def test_correlated_noise_needs_its_correlation_time_to_be_judged_honestly() -> None:
    scene = Scene(joint=REVOLUTE, seconds=15.0, correlation_time=2.0)
    q, axis, point, predicted = _consistency(scene, range(4))
    assert min(q, axis, point, predicted) < 0.7
    shares = _consistency(scene, range(4), _correlated(correlation_time=2.0))
    assert min(shares) > 0.8


@pytest.mark.parametrize("joint", [PRISMATIC, REVOLUTE])
def test_the_configuration_never_reports_less_than_a_correlated_error(
    joint: JointType,
) -> None:
    scene = Scene(joint=joint, radius=0.0, motion=at_rest, translation=1e-4, rotation=1e-2)
    run, filters = simulate(scene, 0), JointFilters(_correlated(declared_time=2.0))
    lasting = 0.01**2 * np.eye(6)
    state = filters.start(run.measured[0], scene.covariance, float(run.times[0]))
    for X, t in zip(run.measured[1:], run.times[1:], strict=True):
        state = filters.update(state, X, scene.covariance + lasting, float(t), lasting)
    m = filters.belief(state).models[joint]
    assert np.sqrt(m.configuration_covariance[0, 0]) > 0.0095


@pytest.mark.parametrize("joint", [PRISMATIC, REVOLUTE])
def test_errors_end_well_below_one_frame_s_noise(joint: JointType) -> None:
    scene = Scene(joint=joint, seconds=15.0)
    lever = 1.0 if joint == PRISMATIC else scene.radius
    errors = []
    for seed in range(9):
        run = simulate(scene, seed)
        filters, states = filter_states(scene, run)
        m = filters.belief(states[-1]).models[joint]
        errors.append([lever * abs(m.configuration[0] - run.q[-1]), _angle(m, run.axis)])
    error, angle = np.sqrt(np.mean(np.square(errors), axis=0))
    assert error < 0.6 * scene.translation
    assert angle < np.deg2rad(0.6)


def test_the_first_frame_is_as_uncertain_as_its_covariance_says() -> None:
    """With an exact reference its noise stays in q; with a noisy one the filter sees through it."""
    scene = Scene(joint=PRISMATIC, translation=1e-2, rotation=1.0)
    run = simulate(scene, 1)
    run.measured[0] = run.X_PB[0].copy()
    run.measured[0, :3, 3] -= 0.03 * run.axis  # Three standard deviations along the axis.
    filters = JointFilters(JointFiltersConfig())
    errors = []
    for scale in (1.0, 0.0):
        state = filters.start(run.measured[0], scale * scene.covariance, 0.0)
        for t, X in zip(run.times[1:], run.measured[1:], strict=True):
            state = filters.update(state, X, scene.covariance, float(t))
        m = filters.belief(state).models[PRISMATIC]
        errors.append(m.configuration[0] - run.q[-1])
    assert abs(errors[0]) < 0.012
    assert_allclose(errors[1], 0.03, atol=0.01)


def test_q_grows_positive_in_the_direction_first_moved_and_keeps_its_sign() -> None:
    for joint in (PRISMATIC, REVOLUTE):
        scene = Scene(
            joint=joint, motion=lambda t: 0.08 * np.sin(2.0 * np.pi * t / 12.0), seconds=12.0
        )
        for seed in range(4):
            run = simulate(scene, seed)
            filters, states = filter_states(scene, run)
            for k in (45, 135, 170):
                m = filters.belief(states[k]).models[joint]
                assert m.axis_P @ run.axis > 0.95
                assert np.sign(m.configuration[0]) == np.sign(run.q[k])


def test_an_episode_of_minutes_keeps_learning_in_bounded_memory() -> None:
    scene = Scene(joint=REVOLUTE, motion=to_and_fro, seconds=100.0)
    run = simulate(scene, 3)
    filters, states = filter_states(scene, run)
    early, late = (filters.belief(states[k]).models[REVOLUTE] for k in (300, -1))
    assert states[-1].keyframes.size[0] <= JointFiltersConfig().memory
    assert states[-1].models.prior_information[1].any()  # Keyframes have been marginalised.
    assert late.axis_covariance.trace() < 0.4 * early.axis_covariance.trace()
    assert _angle(late, run.axis) < 3.0 * np.sqrt(late.axis_covariance.trace())
    assert filters.belief(states[-1]).type == REVOLUTE


def test_poses_are_predicted_by_every_type_with_positive_definite_covariances() -> None:
    scene = Scene(joint=REVOLUTE)
    run = simulate(scene, 0)
    filters, states = filter_states(scene, run)
    for state in (states[0], states[1], states[-1]):
        for joint in JointType:
            predicted = filters.predict(state, joint, 1.0 / 15.0)
            assert np.linalg.eigvalsh(predicted.covariance).min() > 0.0
            assert_allclose(predicted.covariance, predicted.covariance.T)
    errors = {
        joint: np.linalg.norm(
            se3.log(se3.inverse(filters.predict(states[-2], joint, 1.0 / 15.0).X) @ run.X_PB[-1])
        )
        for joint in JointType
    }
    assert min(errors, key=lambda joint: errors[joint]) == REVOLUTE


def test_covariances_stay_positive_throughout() -> None:
    for joint in (PRISMATIC, REVOLUTE):
        scene = Scene(joint=joint, seconds=6.0)
        filters, states = filter_states(scene, simulate(scene, 5))
        for state in states[1:]:
            m = filters.belief(state).models[joint]
            assert np.linalg.eigvalsh(m.configuration_covariance).min() > 0.0
            values = np.linalg.eigvalsh(m.axis_covariance)
            assert values[1] > 0.0
            assert_allclose(values[0], 0.0, atol=1e-9)
            assert_allclose(m.axis_covariance @ m.axis_P, 0.0, atol=1e-9)


def test_the_axis_of_a_body_at_rest_may_be_any() -> None:
    scene = Scene(joint=PRISMATIC, motion=at_rest)
    filters, states = filter_states(scene, simulate(scene, 0))
    for joint in (PRISMATIC, REVOLUTE):
        covariance = filters.belief(states[-1]).models[joint].axis_covariance
        assert np.sqrt(covariance.trace()) > 1.0


def test_an_update_changes_nothing_of_the_state_before_and_repeats_exactly() -> None:
    scene = Scene(joint=PRISMATIC)
    run = simulate(scene, 0)
    filters, states = filter_states(scene, run)

    def content(state: JointFiltersState) -> list[np.ndarray]:
        return [x.copy() for x in (*state.models, *state.keyframes)]

    before = content(states[-2])
    again = filters.update(states[-2], run.measured[-1], scene.covariance, float(run.times[-1]))
    for x, y in zip(before, content(states[-2]), strict=True):
        assert_allclose(x, y, atol=0.0)
    for x, y in zip(content(again), content(states[-1]), strict=True):
        assert_allclose(x, y, atol=0.0)
    assert copy.deepcopy(again) is again


WITHOUT_DRAKE = """
import sys
sys.modules["pydrake"] = None  # Any import of it fails.
import numpy as np
from crossmodal.systems.kinematics.joint_filters import __doc__ as text
from crossmodal import JointFilters, JointFiltersConfig
rng, covariance, time = np.random.default_rng(0), 1e-6 * np.eye(6), 0.0
X_PB = np.eye(4)
measurements = []
for k in range(1, 30):
    X = np.eye(4)
    X[:3, 3] = [0.01 * k, 0.0, 0.0] + 1e-3 * rng.normal(size=3)
    measurements.append((X, covariance, k / 15.0))
exec("\\n".join(line[4:] for line in text.splitlines() if line.startswith("    ")))
"""


def test_the_module_s_example_runs_without_drake() -> None:
    command = [sys.executable, "-c", WITHOUT_DRAKE]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    assert printed[0] == "prismatic"
    assert float(printed[1]) > 0.99
    assert_allclose(float(printed[2].strip("[")), 0.29, atol=2e-3)


def test_fields_that_a_type_lacks_are_nan() -> None:
    belief = JointFilters(JointFiltersConfig()).belief(
        JointFilters(JointFiltersConfig()).start(np.eye(4), 1e-6 * np.eye(6), 0.0)
    )
    assert np.isnan(belief.models[PRISMATIC].p_PA).all()
    assert not np.isnan(belief.models[REVOLUTE].p_PA).any()
    assert np.isnan(belief.models[REVOLUTE].pitch)
    assert belief.models[SCREW].pitch == 0.0
    for joint in (RIGID, DISCONNECTED):
        assert np.isnan(belief.models[joint].axis_P).all()
        assert np.isnan(belief.models[joint].configuration).all()


def test_correlated_errors_count_as_much_as_their_average_is_worth() -> None:
    """The variance of an average over long is that of white noise with the same covariance."""
    config = MeasurementErrorsConfig(correlation_time=0.5)
    dt, n = 1.0 / 15.0, 4000
    r = np.exp(-dt / 0.5)
    lags = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    variance = np.mean(r**lags)
    R = white_equivalent(np.eye(6), dt, config, np.zeros((6, 6)))
    assert_allclose(R, np.eye(6) * variance * n, rtol=0.01, atol=1e-9)


@pytest.mark.parametrize(
    ("field", "value", "unit"),
    [
        ("speed", 0.0, "m/s"),
        ("radius", -0.3, "m"),
        ("axis_distance", float("nan"), "m"),
        ("type_priors.rigid", 0.0, "> 0"),
        ("errors.correlation_time", -1.0, "s"),
        ("errors.declared_time", float("inf"), "s"),
        ("process_noise", [], "m^2/s^3"),
        ("process_noise", [1e-5, 0.0], "m^2/s^3"),
        ("memory", 11, "keyframes"),
    ],
)
def test_impossible_values_are_refused_by_name(field: str, value: object, unit: str) -> None:
    config = JointFiltersConfig()
    group, _, name = field.rpartition(".")
    setattr(getattr(config, group) if group else config, name, value)
    with pytest.raises(ValueError, match=rf"^Owner: {field} = .*, need") as error:
        JointFilters(config, owner="Owner")
    assert unit in str(error.value)
    assert repr(value) in str(error.value)


def test_the_config_is_read_from_yaml() -> None:
    config = yaml_load_typed(
        schema=JointFiltersConfig, data="{memory: 40, process_noise: [1.0e-5]}"
    )
    assert config.memory == 40
    assert config.process_noise == [1e-5]
    with pytest.raises(RuntimeError, match="memori"):
        yaml_load_typed(schema=JointFiltersConfig, data="{memori: 40}")


def test_what_follows_from_other_numbers_is_no_number_of_its_own() -> None:
    config = JointFiltersConfig()
    assert config.jump_noise == 30.0
    assert config.unmeasured_process_noise == 3e-3
    assert config.coarseness == 0.05
    assert config.far_axes
    assert not JointFiltersConfig(errors=MeasurementErrorsConfig(declared_time=1.0)).far_axes
    off = JointFilters(config)._priors.outliers
    assert_allclose(np.sqrt(off[1:]), [1.0] * 3 + [0.3] * 3)
