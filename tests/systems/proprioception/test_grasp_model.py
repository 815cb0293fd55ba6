"""The grasp's type and line on simulated hands, and its derivatives by finite differences."""

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from simulated_grasp import Episode, Scene, pull, run, swing

from crossmodal.maths import se3
from crossmodal.maths.vectors import normal_basis
from crossmodal.systems.port_values import NO_SLIP, BodyMotions, GraspBelief, GraspType, SlipBelief
from crossmodal.systems.proprioception.bent_hand import BentHand
from crossmodal.systems.proprioception.grasp_filters import (
    GraspFilter,
    correct_filter,
    grasp_displacement,
    predict_filter,
    start_filter,
)
from crossmodal.systems.proprioception.grasp_model import GraspModel, initial_grasp
from crossmodal.systems.proprioception.grasp_model_config import GraspModelConfig
from crossmodal.systems.proprioception.hand_config import HandConfig
from crossmodal.systems.shared_settings import with_shared

CONFIG = GraspModelConfig()
SCENES = {
    GraspType.PERFECT: Scene(displacement=pull(), duration=5.0),
    GraspType.REVOLUTE: Scene(
        displacement=pull(),
        coordinates=lambda t: (0.6 * (1 - np.cos(0.5 * t)), 0.0),
        duration=5.0,
    ),
    GraspType.CYLINDRICAL: Scene(
        displacement=pull(),
        coordinates=lambda t: (0.5 * (1 - np.cos(0.5 * t)), 0.04 * np.sin(0.6 * t)),
        duration=5.0,
    ),
    GraspType.FAILED: Scene(
        displacement=lambda t: pull()(min(t, 2.0)),
        coordinates=lambda t: (0.0, 0.0) if t < 2.0 else None,
        hand_alone=pull(),
        duration=6.0,
    ),
}


@pytest.mark.parametrize("kind", list(SCENES))
def test_vision_tells_the_type_of_grasp(kind: GraspType) -> None:
    for seed in range(6):
        assert run(SCENES[kind], seed, vision=True)[-1].grasp.type == kind


@pytest.mark.parametrize("kind", [GraspType.REVOLUTE, GraspType.CYLINDRICAL])
def test_a_loose_grasp_is_never_beyond_doubt(kind: GraspType) -> None:
    """What is seen of the grip now says little about how it will be held later."""
    belief = run(SCENES[kind], 0, vision=True)[-1].grasp
    assert belief.type == kind
    held = 1.0 - belief.probabilities[GraspType.FAILED]
    assert belief.probabilities[GraspType.PERFECT] / held >= CONFIG.lodging


def test_a_flap_that_turns_in_the_hand_is_a_revolute_grasp() -> None:
    scene = Scene(
        displacement=swing(), coordinates=lambda t: (-0.9 * 0.02 * t / 0.35, 0.0), duration=5.0
    )
    for seed in range(4):
        assert run(scene, seed, vision=True)[-1].grasp.type == GraspType.REVOLUTE


@pytest.mark.parametrize("kind", list(SCENES))
def test_without_vision_the_prior_is_reaffirmed(kind: GraspType) -> None:
    prior = initial_grasp(CONFIG)
    for tick in run(SCENES[kind], 0, vision=False)[::10]:
        assert tick.grasp.probabilities == pytest.approx(prior.probabilities)
        np.testing.assert_array_equal(tick.grasp.axis_H, prior.axis_H)


def test_darkness_adds_no_confidence() -> None:
    scene = Scene(
        displacement=pull(),
        coordinates=SCENES[GraspType.REVOLUTE].coordinates,
        dark_from=4.0,
        duration=6.0,
    )
    ticks = run(scene, 0, vision=True)
    first_dark = int(4.0 * 15) + 1
    before = ticks[first_dark].grasp.probabilities
    assert ticks[-1].grasp.probabilities == pytest.approx(before)
    np.testing.assert_allclose(ticks[-1].grasp.axis_H, ticks[first_dark].grasp.axis_H)
    known = np.trace(ticks[first_dark].grasp.line_covariance)
    assert np.trace(ticks[-1].grasp.line_covariance) > known


def line_error(scene: Scene, seed: int, grasp: GraspBelief) -> np.ndarray:
    """Error (6,) of axis and point, in the hand where proprioception puts it."""
    episode = Episode(scene, seed)
    _, bias_jacobian = episode._end_effector(0.0)
    offset = se3.exp(bias_jacobian @ episode.c)
    axis = offset[:3, :3] @ scene.axis
    point = offset[:3, :3] @ scene.point + offset[:3, 3] - grasp.p_HA
    return np.concatenate([axis - grasp.axis_H, point - grasp.axis_H * (grasp.axis_H @ point)])


def test_axis_is_learned_and_as_wrong_as_it_says() -> None:
    values, angles = [], []
    for seed in range(14):
        rng = np.random.default_rng(1000 + seed)
        axis = np.array([0.15 * rng.normal(), 1.0, 0.15 * rng.normal()])
        axis /= np.linalg.norm(axis)
        point = 0.012 * rng.normal(size=3)
        scene = Scene(
            displacement=pull(),
            coordinates=SCENES[GraspType.REVOLUTE].coordinates,
            axis=axis,
            point=point - axis * (axis @ point),
        )
        grasp = run(scene, seed, vision=True)[-1].grasp
        e = line_error(scene, seed, grasp)
        values.append(e @ np.linalg.pinv(grasp.line_covariance, rcond=1e-9) @ e)
        angles.append(np.rad2deg(np.linalg.norm(e[:3])))
    assert 1.5 < np.mean(values) < 8.0  # Four degrees of freedom.
    assert np.median(angles) < 5.0  # The hand is off by three degrees about each axis.


def test_displacement_derivative_matches_finite_differences() -> None:
    rng = np.random.default_rng(0)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    point, coordinates = rng.normal(size=3), np.array([0.7, 0.1])
    E, D = grasp_displacement(axis, point, coordinates)
    U = normal_basis(axis).T
    step = 1e-6
    for i in range(6):
        d = step * np.eye(6)[i]
        tilted = axis + U @ d[:2]
        moved, _ = grasp_displacement(
            tilted / np.linalg.norm(tilted), point + U @ d[2:4], coordinates + d[4:]
        )
        numeric = se3.log(moved @ se3.inverse(E)) / step
        np.testing.assert_allclose(D[:, i], numeric, atol=1e-5)


def corrected_in_a_turned_hand(R_GH: np.ndarray) -> tuple[GraspFilter, list[float]]:
    """A filter, and its log likelihoods, where all is expressed in a frame G instead of in H."""
    rng = np.random.default_rng(0)
    X_GH = np.eye(4)
    X_GH[:3, :3] = R_GH
    Ad = se3.adjoint(X_GH)
    axis, point = CONFIG.hand.grasping_axis
    turned = HandConfig(axis_H=R_GH @ axis, p_HA=R_GH @ point)
    config = with_shared(CONFIG, hand=turned)
    hand = BentHand(
        X_WH=np.eye(4), bias_jacobian=np.zeros((6, 1)), noise_square_root=2e-3 * np.eye(6)
    )
    tilted = np.array([0.05, 1.0, 0.05]) / np.linalg.norm([0.05, 1.0, 0.05])
    R = Ad @ np.diag(np.repeat([1e-5, 1e-6], 3)) @ Ad.T
    grasp = start_filter(GraspType.CYLINDRICAL, X_GH, hand.bias_jacobian, config)
    likelihoods = []
    for k in range(1, 40):
        E, _ = grasp_displacement(tilted, point, np.array([0.02 * k, 0.0005 * k]))
        z = X_GH @ E @ se3.exp(1e-3 * rng.standard_normal(6))
        grasp = predict_filter(grasp, config, 0.0)
        grasp, likelihood = correct_filter(grasp, z, R, hand, hand.noise_square_root, config)
        likelihoods.append(likelihood)
    return grasp, likelihoods


def test_a_grasp_does_not_depend_on_the_frame_that_it_is_expressed_in() -> None:
    """The basis of the errors of an axis jumps where another component becomes its smallest."""
    grasp, likelihoods = corrected_in_a_turned_hand(np.eye(3))
    for turn in ([0.3, -0.2, 0.9], [0.0, 1e-3, 0.0], [2.0, 0.5, -1.0]):
        R_GH = se3.exp(np.array([*turn, 0.0, 0.0, 0.0]))[:3, :3]
        turned, other = corrected_in_a_turned_hand(R_GH)
        np.testing.assert_allclose(other, likelihoods, atol=1e-6)
        np.testing.assert_allclose(turned.axis, R_GH @ grasp.axis, atol=1e-9)
        np.testing.assert_allclose(turned.point, R_GH @ grasp.point, atol=1e-9)


def test_a_hand_that_catches_the_body_again_holds_it_again() -> None:
    """It leaves the body for six seconds, grasps it elsewhere and pulls on."""

    def hand_alone(t: float) -> np.ndarray:
        return pull()(t)

    def displacement(t: float) -> np.ndarray:
        return pull()(min(t, 2.0) + max(t - 8.0, 0.0))

    scene = Scene(
        displacement=displacement,
        coordinates=lambda t: (0.0, 0.0) if t < 2.0 else None,
        hand_alone=hand_alone,
        duration=16.0,
    )
    ticks = run(scene, 0, vision=True)
    assert ticks[int(8.0 * 15)].grasp.type == GraspType.FAILED
    assert ticks[-1].grasp.type == GraspType.PERFECT


LOST = SlipBelief(log_odds=10.0, shift=0.05)


def test_a_grasp_that_load_and_pressures_say_is_lost_has_failed_in_the_dark() -> None:
    scene = Scene(displacement=pull(), duration=6.0)
    ticks = run(scene, 0, vision=False, slip=lambda t: LOST if t >= 3.0 else NO_SLIP)
    failed = np.array([tick.grasp.probabilities[GraspType.FAILED] for tick in ticks])
    onset = round(3.0 * 15)
    assert failed[:onset].max() < 0.05
    assert failed[onset:].min() > 0.9
    np.testing.assert_array_equal(ticks[-1].grasp.free_motion, np.eye(6))


def test_a_lost_grasp_stays_lost_when_the_pressures_are_as_before() -> None:
    def slip(t: float) -> SlipBelief:
        return LOST if 3.0 <= t < 4.0 else NO_SLIP

    ticks = run(Scene(displacement=pull(), duration=6.0), 0, vision=False, slip=slip)
    assert ticks[-1].grasp.type == GraspType.FAILED


def test_what_was_seen_long_ago_does_not_outweigh_what_is_felt_in_the_dark() -> None:
    scene = Scene(displacement=pull(), dark_from=6.0, duration=9.0)
    ticks = run(scene, 0, vision=True, slip=lambda t: LOST if t >= 7.0 else NO_SLIP)
    assert ticks[round(6.5 * 15)].grasp.type != GraspType.FAILED
    assert ticks[-1].grasp.type == GraspType.FAILED


def test_nothing_held_means_the_prior() -> None:
    system = GraspModel(CONFIG)
    context = system.CreateDefaultContext()
    end_effector, bending = Episode(SCENES[GraspType.PERFECT], 0).streams(0.0)
    values = {
        "end_effector_estimated": end_effector,
        "hand_bending_estimated": bending,
        "body_motions_estimated": BodyMotions(),
    }
    for name, value in values.items():
        system.GetInputPort(name).FixValue(context, AbstractValue.Make(value))
    system.GetInputPort("interaction_active").FixValue(context, 0.0)
    system.ExecuteForcedEvents(context)
    belief = system.GetOutputPort("grasp_latest").Eval(context)
    assert belief.type == GraspType.PERFECT
    np.testing.assert_array_equal(belief.free_motion, np.zeros((6, 6)))


def test_latest_does_not_depend_on_inputs() -> None:
    system = GraspModel(CONFIG)
    latest = system.GetOutputPort("grasp_latest").get_index()
    assert not any(system.HasDirectFeedthrough(i, latest) for i in range(4))


@pytest.mark.parametrize(
    ("field", "value"),
    [("prior_perfect", 0.9), ("memory", 0.0)],
)
def test_impossible_values_are_refused(field: str, value: object) -> None:
    config = GraspModelConfig()
    setattr(config, field, value)
    with pytest.raises(ValueError, match=f"GraspModel: {field}"):
        GraspModel(config)
