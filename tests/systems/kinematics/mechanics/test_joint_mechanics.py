"""Friction, end stops and detents from forces that are made up."""

import numpy as np
import pytest
from pydrake.common.value import Value

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.consistency import chi_square_bounds, normalised_squared_error
from crossmodal.systems.kinematics.joint_screws import (
    HandForce,
    hand_screw_covariance,
    screw_belief,
    speed_at,
)
from crossmodal.systems.kinematics.mechanics.joint_mechanics import (
    HeldJointMechanics,
    JointMechanicsFilter,
    hand_force,
    watch_free_hand,
)
from crossmodal.systems.kinematics.mechanics.joint_mechanics_config import JointMechanicsConfig
from crossmodal.systems.kinematics.mechanics.joint_mechanics_filters import JointMechanicsFilters
from crossmodal.systems.port_values import (
    HELD_BODY,
    EndEffectorBelief,
    HandLoad,
    JointBelief,
    JointBeliefs,
    JointMechanicsBelief,
    JointModelBelief,
    JointType,
)

DT = 1.0 / 15.0
SLIDE, HINGE, SCREW = JointType.PRISMATIC, JointType.REVOLUTE, JointType.SCREW
PITCH = 0.02  # [m/rad]
HAND = np.array([0.4, 0.1, 0.2])
X_PE = np.block([[np.eye(3), HAND[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]])
EVEN = JointMechanicsConfig(unevenness=0.0)
FRICTION, DAMPING = 6.0, 12.0


def model_of(joint_type: JointType, q: float, v: float) -> JointModelBelief:
    axis = np.array([1.0, 0.0, 0.0]) if joint_type == SLIDE else np.array([0.0, 0.0, 1.0])
    across = np.eye(3) - np.outer(axis, axis)
    return JointModelBelief(
        log_evidence=0.0,
        axis_P=axis,
        axis_covariance=1e-6 * across,
        p_PA=np.array([0.0, 0.1, 0.0]),
        p_PA_covariance=1e-8 * across,
        configuration=np.array([q, v]),
        configuration_covariance=np.diag([1e-7, 1e-7]),
        pitch_mixture=np.array([[1.0, PITCH if joint_type == SCREW else np.nan, 1e-8]]),
    )


def belief_of(joint_type: JointType, q: float, v: float, updates: int) -> JointBelief:
    return JointBelief(
        parent_id=0,
        child_id=HELD_BODY,
        probabilities={joint_type: 1.0},
        models={joint_type: model_of(joint_type, q, v)},
        updates=updates,
    )


def push_along(joint_type: JointType, tau: float) -> Array:
    """A force (6,) at Po with that generalised force, and one across the joint's motion."""
    p = HAND
    # The hinge's lever is 0.4 m, along x; a screw takes the force along its axis, too.
    f = {
        SLIDE: np.array([tau, 1.5, -2.0]),
        HINGE: np.array([3.0, tau / 0.4, -2.0]),
        SCREW: np.array([3.0, (tau + 2.0 * PITCH) / 0.4, -2.0]),
    }[joint_type]
    return np.concatenate([np.cross(p, f), f])


def perceived(
    joint_type: JointType, v: Array, tau: Array, config: JointMechanicsConfig | None = None
) -> JointMechanicsBelief:
    filters = JointMechanicsFilters(config or JointMechanicsConfig())
    state, q = filters.start(), 0.0
    for k, (rate, push) in enumerate(zip(v, tau, strict=True)):
        q += rate * DT
        force = HandForce(F_P=push_along(joint_type, push), X_PE=X_PE)
        state = filters.update(state, belief_of(joint_type, q, rate, k), force)
    return filters.belief(state).models[joint_type]


def to_and_fro(rng: np.random.Generator, ticks: int = 240) -> Array:
    """Speeds of both signs and of several sizes, none of them low."""
    sizes = np.repeat(rng.uniform(0.03, 0.3, 8), ticks // 8)
    return sizes * np.repeat([1.0, -1.0] * 4, ticks // 8)


def correlated(rng: np.random.Generator, ticks: int, sigma: float, rho: float) -> Array:
    e = np.zeros(ticks)
    e[0] = sigma * rng.standard_normal()
    for k in range(1, ticks):
        e[k] = rho * e[k - 1] + sigma * np.sqrt(1 - rho**2) * rng.standard_normal()
    return e


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_virtual_work_of_a_force_is_its_moment_about_a_hinge(side: float) -> None:
    S, _ = screw_belief(HINGE, model_of(HINGE, 0.0, 0.0))
    f = np.array([0.0, 5.0 * side, 0.0])
    np.testing.assert_allclose(S @ np.concatenate([np.cross(HAND, f), f]), 0.4 * 5.0 * side)
    assert speed_at(S, HAND) == pytest.approx(0.4)


def test_a_slide_takes_the_force_along_it_wherever_that_acts() -> None:
    S, _ = screw_belief(SLIDE, model_of(SLIDE, 0.0, 0.0))
    f = np.array([-2.0, 7.0, 1.0])
    for p in (HAND, -HAND, np.zeros(3)):
        assert S @ np.concatenate([np.cross(p, f), f]) == pytest.approx(-2.0)


def test_a_screw_takes_its_pitch_of_the_force_along_its_axis() -> None:
    S, _ = screw_belief(SCREW, model_of(SCREW, 0.0, 0.0))
    f = np.array([0.0, 5.0, 3.0])
    expected = 0.4 * 5.0 + PITCH * 3.0
    np.testing.assert_allclose(S @ np.concatenate([np.cross(HAND, f), f]), expected)
    assert speed_at(S, HAND) == pytest.approx(np.hypot(0.4, PITCH))


@pytest.mark.parametrize("joint_type", [HINGE, SCREW])
def test_the_screws_covariance_is_that_of_axis_point_and_pitch(joint_type: JointType) -> None:
    model, rng = model_of(joint_type, 0.0, 0.0), np.random.default_rng(0)
    _, covariance = screw_belief(joint_type, model)
    da = 1e-3 * rng.standard_normal((20000, 3)) * [1, 1, 0]
    dp = 1e-4 * rng.standard_normal((20000, 3)) * [1, 1, 0]
    h = (PITCH + 1e-4 * rng.standard_normal((20000, 1))) * (joint_type == SCREW)
    a = model.axis_P + da
    S = np.hstack([a, np.cross(model.p_PA + dp, a) + h * a])
    np.testing.assert_allclose(np.cov(S.T), covariance, atol=3e-8)


def test_the_hand_presses_as_much_as_it_is_pressed_but_for_the_sensors_zero() -> None:
    state = HeldJointMechanics(zero=np.zeros(6), zero_variance=np.ones(6))
    bias = np.array([0.01, 0.02, 0.03, 0.4, -0.5, 0.6])
    for k in range(60):
        reading = bias if k > 5 else bias + 6.0  # The arm starts.
        state = watch_free_hand(state, HandLoad(F_S=reading, pressures=np.zeros(4)))
    X = se3.exp(np.array([0.3, -0.2, 0.9, 0.5, 0.1, 0.2]))
    hand = EndEffectorBelief(
        X=X, V=np.zeros(6), covariance=np.eye(12), bias_jacobian=1e-6 * np.eye(6)
    )
    F_E = np.array([0.1, 0.2, 0.3, 1.0, 2.0, 3.0])
    load = HandLoad(F_S=F_E + bias, pressures=np.zeros(4))
    force = hand_force(load, state, hand, np.eye(4))
    f_W = -X[:3, :3] @ F_E[3:]
    moment = -X[:3, :3] @ F_E[:3] + np.cross(X[:3, 3], f_W)
    np.testing.assert_allclose(force.F_P, np.concatenate([moment, f_W]), atol=1e-12)


def test_a_hand_that_is_elsewhere_sees_another_screw() -> None:
    X = se3.exp(np.array([0.3, -0.2, 0.9, 0.5, 0.1, 0.2]))
    F_E, S = np.array([0.1, 0.2, 0.3, 1.0, 2.0, 3.0]), np.array([0.0, 0.6, 0.8, 0.1, -0.3, 0.2])

    def work(X_PE: Array) -> float:
        return float(S @ se3.adjoint(se3.inverse(X_PE)).T @ F_E)

    for i in range(6):
        moved = 1e-6 * np.eye(6)[:, i : i + 1]
        F_P = se3.adjoint(se3.inverse(X)).T @ F_E
        covariance = hand_screw_covariance(S, HandForce(F_P=F_P, X_PE=X, pose_jacobian=moved))
        change = work(X @ se3.exp(moved[:, 0])) - work(X)
        np.testing.assert_allclose(F_P @ covariance @ F_P, change**2, rtol=1e-3, atol=1e-18)


@pytest.mark.parametrize("joint_type", [SLIDE, HINGE, SCREW])
@pytest.mark.parametrize("rho", [0.0, 0.9])
def test_friction_is_as_wrong_as_is_reported(joint_type: JointType, rho: float) -> None:
    values = []
    lever = 1.0 if joint_type == SLIDE else 0.4
    truth = np.array([FRICTION * lever, DAMPING * lever**2])
    for seed in range(50):
        rng = np.random.default_rng(seed)
        v = to_and_fro(rng) / lever
        noise = correlated(rng, len(v), 0.3 * lever, rho)
        tau = truth[0] * np.sign(v) + truth[1] * v + noise
        found = perceived(joint_type, v, tau, EVEN)
        values.append(normalised_squared_error(found.friction - truth, found.friction_covariance))
    low, high = chi_square_bounds(100, 0.99)
    assert low <= sum(values) <= high


@pytest.mark.parametrize("to_and_fro_too", [False, True])
def test_friction_is_known_no_better_than_axis_zero_and_way_allow(to_and_fro_too: bool) -> None:
    """Forces of a sensor that is off, on an axis that is, of a joint that runs unevenly."""
    values, sigmas = [], []
    truth = np.array([FRICTION, DAMPING])
    for seed in range(60):
        rng = np.random.default_rng(seed)
        v = to_and_fro(rng) if to_and_fro_too else np.full(240, 0.02)
        q = np.cumsum(v) * DT
        phase = rng.uniform(0.0, 2.0 * np.pi)
        uneven = 1.0 + 0.05 * np.sqrt(2.0) * np.sin(2.0 * np.pi * q / 0.3 + phase)
        tau = FRICTION * uneven * np.sign(v) + DAMPING * v
        tau += correlated(rng, 240, 0.2, 0.95)
        off, zero = 0.05 * rng.standard_normal(2), 0.3 * rng.standard_normal(3)
        filters, state = JointMechanicsFilters(JointMechanicsConfig()), None
        for k in range(240):
            joint = belief_of(SLIDE, q[k], v[k], k)
            across = np.diag([0.0, 0.05**2, 0.05**2])
            # The true axis is x; the believed one is off, and so is the force across it seen along.
            axis = np.array([1.0, *off])
            joint.models[SLIDE].axis_P[:] = axis / np.linalg.norm(axis)
            joint.models[SLIDE].axis_covariance[:] = across
            f = np.array([tau[k], 3.0 * np.sign(v[k]), -2.0 * np.sign(v[k])]) + zero
            force = HandForce(
                F_P=np.concatenate([np.cross(HAND, f), f]),
                X_PE=X_PE,
                zero_covariance=np.diag([0.0, 0.0, 0.0, 0.09, 0.09, 0.09]),
                down_P=np.zeros(3),
            )
            state = filters.update(state or filters.start(), joint, force)
        found = filters.belief(state).models[SLIDE]
        values.append(normalised_squared_error(found.friction - truth, found.friction_covariance))
        sigmas.append(np.sqrt(found.friction_covariance[0, 0]))
    assert sum(values) <= chi_square_bounds(120, 0.99)[1]
    # And yet much better than before the joint moved.
    assert np.mean(sigmas) < 0.06 * JointMechanicsConfig().friction


def test_nothing_is_reported_of_a_joint_that_did_not_move() -> None:
    config = JointMechanicsConfig()
    found = perceived(SLIDE, np.zeros(60), np.full(60, 3.0))
    assert found.samples == 0
    np.testing.assert_allclose(
        np.sqrt(np.diag(found.friction_covariance)), [config.friction, config.damping]
    )
    assert found.upper.probability < 0.5


def test_one_speed_leaves_friction_and_damping_apart() -> None:
    v = np.full(120, 0.05)
    found = perceived(SLIDE, v, FRICTION + DAMPING * v + 0.01 * np.sin(np.arange(120.0)))
    resistance = found.friction @ [1.0, 0.05]
    assert resistance == pytest.approx(FRICTION + DAMPING * 0.05, abs=0.5)
    assert found.friction_covariance[1, 1] > 10.0**2


def rest_after_motion(pushes: Array, rng: np.random.Generator) -> JointMechanicsBelief:
    v = np.concatenate([np.full(90, 0.08), np.zeros(len(pushes))])
    tau = np.concatenate([FRICTION + DAMPING * v[:90], pushes])
    return perceived(SLIDE, v, tau + correlated(rng, len(v), 0.2, 0.5))


def test_an_end_stop_takes_more_than_friction() -> None:
    q = 90 * 0.08 * DT
    for seed in range(5):
        found = rest_after_motion(np.linspace(5.0, 25.0, 40), np.random.default_rng(seed))
        assert found.upper.probability > 0.95
        assert abs(found.upper.position - q) < 3.0 * np.sqrt(found.upper.variance)
        assert found.lower.probability < 0.5


def test_a_hand_that_bends_at_a_stop_moves_no_joint() -> None:
    """It seems to creep on, ever less surely, while the arm pulls harder."""
    filters = JointMechanicsFilters(JointMechanicsConfig())
    state, q, k = filters.start(), 0.0, 0

    def tick(v: float, push: float, q_std: float) -> None:
        nonlocal state, q, k
        q, k = q + v * DT, k + 1
        joint = belief_of(SLIDE, q, v, k)
        joint.models[SLIDE].configuration_covariance[0, 0] = q_std**2
        force = HandForce(F_P=push_along(SLIDE, push), X_PE=X_PE)
        state = filters.update(state, joint, force)

    for _ in range(90):
        tick(0.08, FRICTION + 0.08 * DAMPING, 0.003)
    stop = q
    for _ in range(8):
        tick(0.001, 12.0, 0.003)
    for share in np.linspace(0.0, 1.0, 40):
        tick(0.01, 12.0 + 60.0 * share, 0.003 + 0.012 * share)
    found = filters.belief(state).models[SLIDE]
    assert found.friction[0] < 1.5 * FRICTION
    assert found.upper.probability > 0.99
    assert abs(found.upper.position - stop) < 2.0 * np.sqrt(found.upper.variance)


def test_an_arm_that_stops_is_no_end_stop() -> None:
    for seed in range(5):
        found = rest_after_motion(np.linspace(6.0, 2.0, 40), np.random.default_rng(seed))
        assert found.upper.probability < 0.5
        assert found.upper.bound == pytest.approx(90 * 0.08 * DT, abs=1e-6)


def test_a_stop_that_gives_way_was_none() -> None:
    v = np.concatenate([np.full(90, 0.08), np.zeros(40), np.full(60, 0.08)])
    tau = np.where(v > 0.0, FRICTION + DAMPING * v, 20.0)
    assert perceived(SLIDE, v, tau).upper.probability < 0.01


def test_a_detent_takes_force_before_the_joint_moves() -> None:
    rise = np.linspace(0.0, 18.0, 45)
    v = np.concatenate([np.zeros(45), np.full(90, 0.08)])
    moving = np.full(90, FRICTION + DAMPING * 0.08)
    held = perceived(SLIDE, v, np.concatenate([rise, moving]))
    assert held.detent.probability > 0.99
    assert abs(held.detent.position) < 1e-3
    assert abs(held.detent.force - 12.0) < 2.0 * np.sqrt(held.detent.force_variance)
    free = perceived(SLIDE, v, np.concatenate([np.linspace(0.0, FRICTION, 45), moving]))
    assert free.detent.probability < 0.5


def test_a_detent_is_sensed_before_the_joint_s_axis_is_known() -> None:
    """Until it moves the axis is believed to be across the push."""
    rise = np.linspace(0.0, 18.0, 45)
    filters = JointMechanicsFilters(JointMechanicsConfig())
    state, q = filters.start(), 0.0
    for k in range(135):
        rate, push = (0.0, rise[k]) if k < 45 else (0.08, FRICTION + DAMPING * 0.08)
        q += rate * DT
        joint = belief_of(SLIDE, q, rate, k)
        if k < 46:
            joint.models[SLIDE].axis_P[:] = [0.0, 0.0, 1.0]
        force = HandForce(F_P=push_along(SLIDE, push), X_PE=X_PE)
        state = filters.update(state, joint, force)
    found = filters.belief(state).models[SLIDE].detent
    assert found.probability > 0.99
    assert abs(found.force - 12.0) < 2.0 * np.sqrt(found.force_variance)


def test_a_lid_that_is_heavy_while_it_lies_has_no_detent() -> None:
    """The moment of its weight is 4 N m while it lies and falls as it opens by 80 deg."""
    angle = np.concatenate([np.zeros(45), np.linspace(0.0, 1.4, 150)])
    tau = np.concatenate([np.linspace(0.0, 4.4, 45), 4.0 * np.cos(angle[45:]) + 0.4])
    filters = JointMechanicsFilters(JointMechanicsConfig())
    state = filters.start()
    for k in range(len(angle)):
        rate = 0.0 if k < 45 else 0.14
        down = np.array([0.0, -1.0, 0.0])
        force = HandForce(F_P=push_along(HINGE, tau[k]), X_PE=X_PE, down_P=down)
        state = filters.update(state, belief_of(HINGE, angle[k], rate, k), force)
    assert filters.belief(state).models[HINGE].detent.probability < 0.5


def test_a_rest_after_a_detent_has_let_go_is_none() -> None:
    """The joint leaps by what the hand was bent by, and stands for a moment: there it is free.

    So short a leap has no rate that is sure.
    """
    q = np.concatenate(
        [np.zeros(30), [0.02, 0.04], np.full(8, 0.045), 0.045 + 0.005 * np.arange(90)]
    )
    v = np.concatenate([np.zeros(30), [0.2, 0.2], np.zeros(8), np.full(90, 0.08)])
    rise, stands = np.linspace(0.0, 25.0, 30), np.linspace(0.0, FRICTION, 8)
    tau = np.concatenate([rise, [12.0, 1.0], stands, np.full(90, FRICTION + DAMPING * 0.08)])
    filters = JointMechanicsFilters(JointMechanicsConfig())
    state = filters.start()
    for k in range(len(q)):
        joint = belief_of(SLIDE, q[k], v[k], k)
        covariance = joint.models[SLIDE].configuration_covariance
        covariance[0, 0] = 1e-6 if k < 32 else 1e-7
        covariance[1, 1] = 0.1**2 if 30 <= k < 32 else 1e-7
        force = HandForce(F_P=push_along(SLIDE, tau[k]), X_PE=X_PE)
        state = filters.update(state, joint, force)
    found = filters.belief(state).models[SLIDE].detent
    assert found.probability > 0.99
    assert abs(found.position) < 1e-3
    assert abs(found.force - 19.0) < 2.0 * np.sqrt(found.force_variance)


def test_a_detent_that_a_bending_hand_seems_to_have_left_is_as_strong_as_the_hardest_push() -> None:
    """The joint is believed to move while the push still grows."""
    bends = 0.015 * np.arange(1, 7) * DT
    q = np.concatenate([np.zeros(30), bends, bends[-1] + 0.005 * np.arange(1, 91)])
    v = np.concatenate([np.zeros(30), np.full(6, 0.015), np.full(90, 0.08)])
    tau = np.concatenate([np.linspace(0.0, 24.0, 36), np.full(90, FRICTION + DAMPING * 0.08)])
    filters = JointMechanicsFilters(JointMechanicsConfig())
    state = filters.start()
    for k in range(len(q)):
        joint = belief_of(SLIDE, q[k], v[k], k)
        force = HandForce(F_P=push_along(SLIDE, tau[k]), X_PE=X_PE)
        state = filters.update(state, joint, force)
    found = filters.belief(state).models[SLIDE].detent
    assert found.probability > 0.99
    assert abs(found.force - 18.0) < 2.0 * np.sqrt(found.force_variance)
    assert found.force_variance < 3.0**2


def test_an_axis_that_turns_over_is_the_same_joint() -> None:
    filters = JointMechanicsFilters(JointMechanicsConfig())
    beliefs = []
    for sign in (1.0, -1.0):
        state, q = filters.start(), 0.0
        for k in range(90):
            q += 0.08 * DT
            turned = sign if k > 40 else 1.0
            joint = belief_of(SLIDE, turned * q, turned * 0.08, k)
            joint.models[SLIDE].axis_P[:] *= turned
            force = HandForce(F_P=push_along(SLIDE, 7.0), X_PE=X_PE)
            state = filters.update(state, joint, force)
        beliefs.append(filters.belief(state).models[SLIDE])
    plain, turned = beliefs
    np.testing.assert_allclose(turned.friction, plain.friction)
    assert turned.lower.bound == pytest.approx(-plain.upper.bound)


def test_a_tick_through_the_ports() -> None:
    system = JointMechanicsFilter(JointMechanicsConfig())
    context = system.CreateDefaultContext()
    hand = EndEffectorBelief(
        X=np.eye(4), V=np.zeros(6), covariance=np.eye(12), bias_jacobian=np.zeros((6, 6))
    )
    load = HandLoad(F_S=np.array([0.0, 0.0, 0.0, -7.0, 0.0, 0.0]), pressures=np.full(4, 1e5))
    for name, value in (
        ("joints_estimated", JointBeliefs(joints=[belief_of(SLIDE, 0.1, 0.08, 5)])),
        ("hand_load_estimated", load),
        ("end_effector_estimated", hand),
    ):
        system.GetInputPort(name).FixValue(context, Value[object](value))
    system.GetInputPort("interaction_active").FixValue(context, np.ones(1))
    estimated = system.GetOutputPort("joint_mechanics_estimated").Eval(context)
    assert estimated.joints[0].models[SLIDE].force == pytest.approx(7.0)
    assert not system.GetOutputPort("joint_mechanics_latest").Eval(context).joints
    system.ExecuteForcedEvents(context)
    latest = system.GetOutputPort("joint_mechanics_latest").Eval(context)
    assert latest.joints[0].models[SLIDE].force == pytest.approx(7.0)


@pytest.mark.parametrize(
    "at_speed",
    [
        lambda v: np.tanh(v / 0.01),
        lambda v: 1.0 + 0.4 * np.exp(-v / 0.008),
        lambda v: np.ones_like(v),
    ],
    ids=["less while slow", "more while slow", "the same"],
)
def test_friction_that_is_another_one_while_the_joint_is_slow(at_speed) -> None:
    """Coulomb friction is claimed as it is at speed, although most samples are slow."""
    errors = []
    for seed in range(8):
        for friction in (3.0, 12.0, 24.0):
            rng = np.random.default_rng(seed)
            v = np.interp(np.arange(200), np.linspace(0, 200, 8), rng.uniform(0.006, 0.02, 8))
            tau = friction * at_speed(v) + 5.0 * v + correlated(rng, 200, 0.3, 0.9)
            belief = perceived(SLIDE, v, tau)
            std = np.sqrt(belief.friction_covariance[0, 0])
            assert std < 0.6 * friction
            errors.append((belief.friction[0] - friction) / std)
    assert np.sqrt(np.mean(np.square(errors))) < 1.0
