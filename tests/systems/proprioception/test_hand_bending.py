"""The bending networks on a synthetic hand, and the filter around them through its ports."""

from pathlib import Path

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.math import RollPitchYaw
from synthetic_hand import PRELOAD, bending_path, interaction, reading

from crossmodal.diagrams.crossmodal.training.hand_bending_training import (
    relative_to_first,
    train,
)
from crossmodal.maths import se3
from crossmodal.systems.port_values import EndEffectorBelief, PoseBelief, SampleWindow
from crossmodal.systems.proprioception.bending_network import (
    BendingNetwork,
    bending_jacobian,
    load_network,
    predict_bending,
    predict_deviation,
    save_network,
)
from crossmodal.systems.proprioception.hand_bending import (
    HandBending,
    HandBendingConfig,
    hand_weight,
)

CONFIG = HandBendingConfig()
ACTIVE_TICK = 20


@pytest.fixture(scope="module")
def interactions() -> list[tuple[np.ndarray, np.ndarray]]:
    pytest.importorskip("torch", reason="only training needs PyTorch, the extra `train`")
    rng = np.random.default_rng(0)
    return [interaction(120, rng) for _ in range(10)]


@pytest.fixture(scope="module")
def trained(
    interactions: list[tuple[np.ndarray, np.ndarray]],
) -> tuple[BendingNetwork, dict[str, object]]:
    pytest.importorskip("torch")
    return train(interactions, seed=0, steps=800)


def end_effector(X: np.ndarray) -> EndEffectorBelief:
    return EndEffectorBelief(
        X=X, V=np.zeros(6), covariance=1e-8 * np.eye(12), bias_jacobian=np.zeros((6, 0))
    )


def run(
    network: BendingNetwork, bending: np.ndarray, seed: int, bias: np.ndarray
) -> list[PoseBelief]:
    """Beliefs of every tick: free hand, then grasp from `ACTIVE_TICK` on along `bending` (T, 6)."""
    rng = np.random.default_rng(seed)
    system = HandBending(CONFIG, network)
    context = system.CreateDefaultContext()
    preload = PRELOAD * rng.uniform(0.8, 1.2, 6)
    beliefs = []
    for tick in range(ACTIVE_TICK + len(bending)):
        active = tick >= ACTIVE_TICK
        if active:
            samples = reading(np.tile(bending[tick - ACTIVE_TICK], (7, 1)), preload, rng)
        else:
            samples = np.hstack([rng.normal(0, 0.005, (7, 6)), rng.normal(6e4, 50, (7, 4))])
        R_WE = RollPitchYaw(0.0, 1.57 + 0.01 * tick, 0.2).ToRotationMatrix().matrix()
        X_WE = np.eye(4)
        X_WE[:3, :3] = R_WE
        samples[:, :6] += bias + hand_weight(R_WE, CONFIG.hand.mass, CONFIG.hand.p_S_com)
        context.SetTime(tick * CONFIG.period)
        times = context.get_time() - np.arange(6, -1, -1) / 100
        values = {
            "wrench_window": SampleWindow(times=times, values=samples[:, :6]),
            "pressure_window": SampleWindow(times=times, values=samples[:, 6:]),
            "end_effector_estimated": end_effector(X_WE),
        }
        for name, value in values.items():
            system.GetInputPort(name).FixValue(context, AbstractValue.Make(value))
        system.GetInputPort("interaction_active").FixValue(context, float(active))
        beliefs.append(system.GetOutputPort("hand_bending_estimated").Eval(context))
        system.ExecuteForcedEvents(context)
    return beliefs


def error(belief: PoseBelief, bending: np.ndarray) -> np.ndarray:
    return se3.log(se3.inverse(belief.X) @ se3.exp(bending))


def test_networks_beat_no_bending_on_unseen_interactions(trained: tuple) -> None:
    card = trained[1]
    assert card["unseen"]["rotation_rms_deg"] < 0.25 * card["no_bending"]["rotation_rms_deg"]
    assert card["unseen"]["translation_rms_mm"] < 0.4 * card["no_bending"]["translation_rms_mm"]
    assert 0.9 < card["unseen_within_2_sigma"] < 0.99


def test_training_repeats_from_its_seed(interactions: list) -> None:
    pytest.importorskip("torch")
    few = [(u[::4], y[::4]) for u, y in interactions[:4]]
    first, second = train(few, seed=3, steps=50)[0], train(few, seed=3, steps=50)[0]
    for (W, b), (W_again, b_again) in zip(first.pose_layers, second.pose_layers, strict=True):
        np.testing.assert_array_equal(W, W_again)
        np.testing.assert_array_equal(b, b_again)


def test_labels_become_relative_to_the_first() -> None:
    rng = np.random.default_rng(2)
    start, motion = se3.exp(rng.normal(size=6)), 0.1 * rng.normal(size=(4, 6))
    motion[0] = 0.0
    labels = np.array([se3.log(start @ se3.exp(xi)) for xi in motion])
    np.testing.assert_allclose(relative_to_first(labels), motion, atol=1e-9)


def test_saved_networks_are_read_back(trained: tuple, tmp_path: Path) -> None:
    network = trained[0]
    save_network(tmp_path / "weights.npz", network)
    again = load_network(tmp_path / "weights.npz")
    u = np.random.default_rng(1).normal(size=(5, 10)) * network.input_scale + network.input_mean
    np.testing.assert_array_equal(
        predict_bending(network, u, u[0]), predict_bending(again, u, u[0])
    )
    np.testing.assert_array_equal(
        predict_deviation(network, u, u[0]), predict_deviation(again, u, u[0])
    )


def test_missing_weights_are_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"no weights at .*nowhere\.npz"):
        load_network(tmp_path / "nowhere.npz")


def test_network_jacobian_matches_finite_differences(trained: tuple) -> None:
    network = trained[0]
    u, zero = network.input_mean + 0.3 * network.input_scale, np.zeros(10)
    steps = 1e-5 * network.input_scale
    columns = [
        (predict_bending(network, u + d, zero) - predict_bending(network, u - d, zero))
        / (2 * d.sum())
        for d in np.diag(steps)
    ]
    J = bending_jacobian(network, u, zero)
    np.testing.assert_allclose(
        J * network.input_scale, np.array(columns).T * network.input_scale, rtol=1e-5, atol=1e-9
    )


def test_deviation_grows_outside_the_training_range(trained: tuple) -> None:
    network = trained[0]
    edge = network.input_mean + network.input_high * network.input_scale
    beyond = edge + 5.0 * network.input_scale
    zero = np.zeros(10)
    at_edge = predict_deviation(network, edge, zero)
    assert np.all(predict_deviation(network, beyond, zero) > 10 * at_edge)


def test_hand_is_not_bent_before_and_at_the_grasp(trained: tuple) -> None:
    path = bending_path(30, np.random.default_rng(4))
    beliefs = run(trained[0], path, 0, np.zeros(6))
    for belief in beliefs[: ACTIVE_TICK + 1]:
        np.testing.assert_array_equal(belief.X, np.eye(4))
        assert np.all(np.diag(belief.covariance) < 1e-10)
    assert np.linalg.norm(beliefs[-1].X - np.eye(4)) > 1e-3


def test_errors_agree_with_covariance_on_unseen_interactions(trained: tuple) -> None:
    values, translations, bent = [], [], []
    for seed in range(30):
        rng = np.random.default_rng(100 + seed)
        path = bending_path(60, rng)
        bias = rng.normal(size=6) * ([0.02] * 3 + [0.3] * 3)
        beliefs = run(trained[0], path, seed, bias)
        for tick in (15, 35, 59):
            e = error(beliefs[ACTIVE_TICK + tick], path[tick])
            P = beliefs[ACTIVE_TICK + tick].covariance
            values.append(e @ np.linalg.solve(P, e))
            translations.append(np.linalg.norm(e[3:]))
            bent.append(np.linalg.norm(path[tick][3:]))
    assert 2.0 < np.mean(values) < 10.0
    assert np.mean(np.array(values) < 12.6) > 0.75
    assert np.median(translations) < 0.3 * np.median(bent)


def test_many_ticks_do_not_average_the_networks_error_away(trained: tuple) -> None:
    path = np.tile(bending_path(30, np.random.default_rng(4))[-1], (120, 1))
    path[:10] *= np.linspace(0, 1, 10)[:, None]
    network = trained[0]
    beliefs = run(network, path, 0, np.zeros(6))
    rng = np.random.default_rng(0)
    bent, free = (reading(b, PRELOAD, rng, noise=0.0) for b in (path[-1], 0.0 * path[-1]))
    deviation = predict_deviation(network, bent, free)
    sigma = np.sqrt(np.diag(beliefs[-1].covariance))
    assert np.all(sigma > 0.4 * deviation)


def test_what_is_left_of_a_taken_out_offset_makes_the_bending_less_certain(trained: tuple) -> None:
    beliefs = []
    for common in (0.0, 0.5):
        system = HandBending(CONFIG, trained[0])
        context = system.CreateDefaultContext()
        windows = (
            SampleWindow(
                times=np.zeros(1), values=np.ones((1, 6)), variances=np.full(6, common**2)
            ),
            SampleWindow(times=np.zeros(1), values=np.full((1, 4), 6e4)),
            end_effector(np.eye(4)),
        )
        names = ("wrench_window", "pressure_window", "end_effector_estimated")
        for name, value in zip(names, windows, strict=True):
            system.GetInputPort(name).FixValue(context, AbstractValue.Make(value))
        system.GetInputPort("interaction_active").FixValue(context, 1.0)
        for _ in range(5):
            system.ExecuteForcedEvents(context)
        beliefs.append(system.GetOutputPort("hand_bending_latest").Eval(context))
    usual, wide = (np.diag(belief.covariance) for belief in beliefs)
    assert np.all(wide > 1.05 * usual)


def test_creep_makes_turning_about_the_bar_less_certain_with_time(trained: tuple) -> None:
    path = np.tile(0.3 * bending_path(30, np.random.default_rng(4))[-1], (120, 1))
    path[:10] *= np.linspace(0, 1, 10)[:, None]
    beliefs = run(trained[0], path, 0, np.zeros(6))
    early, late = (beliefs[ACTIVE_TICK + tick].covariance for tick in (15, 119))
    grown = np.sqrt(np.diag(late - early).clip(min=0.0))
    assert grown[1] > 0.6 * CONFIG.creep * np.sqrt(104 * CONFIG.period)
    assert grown[1] > 3.0 * max(grown[0], grown[2])


def test_weight_has_its_lever_about_the_sensor() -> None:
    F = hand_weight(np.eye(3), 2.0, np.array([0.1, 0.0, 0.0]))
    np.testing.assert_allclose(F, [0, 2 * 9.81 * 0.1, 0, 0, 0, -2 * 9.81])


def test_ending_the_interaction_forgets_the_bending(trained: tuple) -> None:
    system = HandBending(CONFIG, trained[0])
    context = system.CreateDefaultContext()
    window = SampleWindow(times=np.zeros(1), values=np.ones((1, 6)))
    pressure = SampleWindow(times=np.zeros(1), values=np.full((1, 4), 6e4))
    names = ("wrench_window", "pressure_window", "end_effector_estimated")
    for name, value in zip(names, (window, pressure, end_effector(np.eye(4))), strict=True):
        system.GetInputPort(name).FixValue(context, AbstractValue.Make(value))
    for active in (0.0, 1.0, 1.0, 0.0):
        system.GetInputPort("interaction_active").FixValue(context, active)
        system.ExecuteForcedEvents(context)
    belief = system.GetOutputPort("hand_bending_latest").Eval(context)
    np.testing.assert_array_equal(belief.X, np.eye(4))


def test_latest_does_not_depend_on_inputs(trained: tuple) -> None:
    system = HandBending(CONFIG, trained[0])
    latest = system.GetOutputPort("hand_bending_latest").get_index()
    assert not any(system.HasDirectFeedthrough(i, latest) for i in range(4))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("rotation_floor", 0.0),
        ("creep", -1.0),
    ],
)
def test_impossible_values_are_refused(trained: tuple, field: str, value: object) -> None:
    config = HandBendingConfig()
    setattr(config, field, value)
    with pytest.raises(ValueError, match=f"HandBending: {field}"):
        HandBending(config, trained[0])


def test_perception_does_not_import_torch() -> None:
    root = Path(__file__).parents[3]
    for room in ("systems", "controllers", "plants", "maths"):
        assert all("torch" not in path.read_text() for path in (root / room).rglob("*.py")), room
