"""The direction of the pull: as taught, then along the perceived joint."""

from collections.abc import Sequence

import numpy as np
import pytest
from known_arm import Q, arm_model
from numpy.testing import assert_allclose
from pydrake.systems.analysis import Simulator

from crossmodal.controllers.interaction.phases import Phase
from crossmodal.controllers.interaction.pull_direction import PullDirection, PullDirectionConfig
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array

BACK = np.array([0.0, 0.0, -1.0])


def pull_towards(tangent_E: np.ndarray, q: float = 0.1, **config: float) -> np.ndarray:
    """The pull after 2 s of exploring a joint along which the hand goes by `tangent_E`."""
    state = arm_model().Evaluate(np.concatenate([Q, np.zeros(7)]))
    system = PullDirection(PullDirectionConfig(along="joint", **config), arm_model(), BACK)
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    screw_W = se3.adjoint(state.X_WE) @ np.concatenate([np.zeros(3), tangent_E])
    for name, value in (
        ("joint_state_measured", np.concatenate([Q, np.zeros(7)])),
        ("joint_remembered", np.concatenate([np.zeros(6), [q, 0.0]])),
        ("end_effector_screw_remembered", screw_W),
        ("phase", [float(Phase.EXPLORE)]),
    ):
        system.GetInputPort(name).FixValue(context, value)
    simulator.AdvanceTo(2.0)
    return np.asarray(system.get_output_port().Eval(context))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_pull_turns_to_the_joint_whatever_sign_its_configuration_has(sign: float) -> None:
    tangent = np.array([0.0, 0.6, -0.8])
    assert_allclose(pull_towards(sign * 0.3 * tangent, q=sign), tangent, atol=1e-3)


def test_the_pull_stays_as_taught_while_the_joint_is_unknown_hardly_moved_or_absurd() -> None:
    tangent = np.array([0.0, 0.6, -0.8])
    assert_allclose(pull_towards(np.full(3, np.nan), q=np.nan), BACK)
    assert_allclose(pull_towards(tangent, q=0.02), BACK)
    assert_allclose(pull_towards(np.array([0.0, 0.8, -0.6]), limit=50.0), BACK)


def test_the_pull_turns_within_its_time() -> None:
    tangent = np.array([0.0, 0.6, -0.8])
    angle = np.arctan2(tangent[1], -tangent[2])
    (y, z) = pull_towards(tangent, time=2.0)[1:]
    assert_allclose(np.arctan2(y, -z) / angle, 1.0 - np.exp(-1.0), atol=0.05)


def pulls_in_world(along: str, postures: Sequence[Array]) -> list[Array]:
    """The pull (3,) in the world after the hand has closed, and at each posture while exploring."""
    system = PullDirection(PullDirectionConfig(along=along), arm_model(), BACK)
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    system.GetInputPort("joint_remembered").FixValue(context, np.full(8, np.nan))
    system.GetInputPort("end_effector_screw_remembered").FixValue(context, np.full(6, np.nan))
    pulls = []
    for k, q in enumerate([postures[0], *postures]):
        state = np.concatenate([q, np.zeros(7)])
        system.GetInputPort("joint_state_measured").FixValue(context, state)
        system.GetInputPort("phase").FixValue(context, [float(Phase.EXPLORE if k else Phase.CLOSE)])
        simulator.AdvanceTo(context.get_time() + 0.1)
        pull_E = np.asarray(system.GetOutputPort("pull_direction").Eval(context))
        pulls.append(arm_model().Evaluate(state).X_WE[:3, :3] @ pull_E)
    return pulls


def test_the_pull_keeps_its_direction_in_the_hand_or_in_the_world() -> None:
    turned = Q + np.array([0, 0, 0, 0, 0, 0, 0.5])  # About an axis through E.
    before, _, after = pulls_in_world("path", [Q, turned])
    assert_allclose(before, after, atol=1e-12)
    turned = Q + np.array([0.0, 0, 0, 0, 0.3, 0.2, 0.0])
    R_before, R_after = (
        arm_model().Evaluate(np.concatenate([q, np.zeros(7)])).X_WE[:3, :3] for q in (Q, turned)
    )
    before, _, after = pulls_in_world("hand", [Q, turned])
    assert_allclose(R_after.T @ after, R_before.T @ before, atol=1e-12)


def test_the_pull_follows_the_path_that_the_hand_is_led_on() -> None:
    angles = np.linspace(0.0, 0.6, 121)  # The first joint swings the hand on a circle.
    postures = [Q + angle * np.eye(7)[0] for angle in angles]
    pulls = pulls_in_world("path", postures)
    X_WE = [arm_model().Evaluate(np.concatenate([q, np.zeros(7)])).X_WE for q in postures[-2:]]
    tangent = X_WE[1][:3, 3] - X_WE[0][:3, 3]
    radius = np.linalg.norm(tangent) / (angles[1] - angles[0])
    angle = np.arccos(pulls[-1] @ tangent / np.linalg.norm(tangent))
    # A string of length l behind a circle of radius r lags by asin(l / 2 r) to asin(l / r).
    assert np.arcsin(0.015 / radius) - 1e-3 <= angle <= np.arcsin(0.03 / radius) + 1e-3


def test_impossible_values_are_refused_by_name() -> None:
    for field, value in (("limit", 120.0), ("start", np.nan), ("time", 0.0), ("along", "x")):
        with pytest.raises(ValueError, match=f"PullDirection: {field} = "):
            PullDirection(PullDirectionConfig(**{field: value}), arm_model(), BACK)
