"""Signs of the sensor's Jacobian on the ellipsoid in closed form, projector and PID."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.common.value import AbstractValue

from crossmodal.controllers.servoing.tactile_servoing import (
    Pid,
    TactileServoing,
    TactileServoingConfig,
    feature_errors,
    inverted_sensor_jacobian,
)
from crossmodal.maths import se3
from crossmodal.systems.port_values import NO_CONTACT, TactileContact

AXES = np.array([0.010, 0.010, 0.015])
STIFFNESS = 1000.0  # [N/m]
CONFIG = TactileServoingConfig()
J = inverted_sensor_jacobian(AXES)
STEP = 1e-6


def surface_point(n_S: np.ndarray) -> np.ndarray:
    """Where the ellipsoid's outward normal is `n_S`."""
    return AXES**2 * n_S / np.linalg.norm(AXES * n_S)


def on_plane(X_WS: np.ndarray, n_W: np.ndarray, d: float) -> TactileContact:
    """The contact with a soft wall n_W . x = d in front of the fingertip."""
    n_S = X_WS[:3, :3].T @ n_W
    p_SC = surface_point(n_S)
    depth = n_W @ (X_WS[:3, 3] + X_WS[:3, :3] @ p_SC) - d
    return TactileContact(
        touching=True,
        p_SC=p_SC,
        covariance=np.eye(3),
        n_S=n_S,
        f_S=STIFFNESS * depth * n_S,
    )


def moved(V_WS_S: np.ndarray) -> np.ndarray:
    return np.asarray(se3.exp(STEP * V_WS_S))


def touching(x: float = 0.0, z: float = 0.0, force: float = 0.5, angle: float = np.nan):  # type: ignore[no-untyped-def]
    p = np.array([x, 0.0, z])
    p[1] = AXES[1] * np.sqrt(1.0 - np.sum((p / AXES) ** 2))
    n = p / AXES**2
    n /= np.linalg.norm(n)
    return TactileContact(
        touching=True, p_SC=p, covariance=np.eye(3), n_S=n, f_S=force * n, edge_angle=angle
    )


def tick(system, context) -> None:  # type: ignore[no-untyped-def]
    context.SetDiscreteState(system.EvalUniquePeriodicDiscreteUpdate(context))


@pytest.mark.parametrize(("feature", "twist"), [(0, 2), (1, 0)])
def test_a_roll_by_the_jacobian_removes_the_offset_from_the_middle(feature, twist) -> None:  # type: ignore[no-untyped-def]
    """On a flat wall, the offset falls at the rate of the output."""
    start = on_plane(np.eye(4), np.array([0.0, 1.0, 0.0]), 0.0099)
    V = np.zeros(6)
    V[twist] = J[twist, feature] * 1e-3
    after = on_plane(moved(V), np.array([0.0, 1.0, 0.0]), 0.0099)
    places = [0, 2]
    change = (after.p_SC - start.p_SC)[places] / STEP
    expected = np.zeros(2)
    expected[feature] = -1e-3
    assert_allclose(change, expected, rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize(("feature", "twist"), [(0, 3), (1, 5)])
def test_a_slide_by_the_jacobian_removes_the_offset_of_a_point(feature, twist) -> None:  # type: ignore[no-untyped-def]
    p_W = np.array([1e-3, 0.0098, 2e-3])
    V = np.zeros(6)
    V[twist] = J[twist, feature] * 1e-3
    X = moved(V)
    change = (se3.inverse(X) @ np.append(p_W, 1.0))[:3] - p_W
    assert change[[0, 2]][feature] / STEP == pytest.approx(-1e-3, rel=1e-4)


@pytest.mark.parametrize(
    ("n_W", "feature", "twist"),
    [([0.0, 1.0, 0.0], 3, 4), ([0.6, 0.8, 0.0], 2, 3), ([0.0, 0.8, -0.6], 4, 5)],
)
def test_a_push_by_the_jacobian_removes_an_error_of_the_force(n_W, feature, twist) -> None:  # type: ignore[no-untyped-def]
    """A force on the finger that is too strong along an axis moves it back along that axis."""
    n = np.array(n_W)
    d = n @ surface_point(n) - 1e-3
    error = feature_errors(on_plane(np.eye(4), n, d), CONFIG, CONFIG.force)[feature]
    V = np.zeros(6)
    V[twist] = J[twist, feature] * error
    after = feature_errors(on_plane(moved(V), n, d), CONFIG, CONFIG.force)[feature]
    assert abs(error) > 0.1
    assert (after - error) / STEP == pytest.approx(-STIFFNESS * n[twist - 3] ** 2 * error, rel=0.01)


def test_a_turn_by_the_jacobian_removes_the_angle_of_an_edge() -> None:
    angle = 0.1
    along_W = np.array([np.sin(angle), 0.0, np.cos(angle)])
    V = np.zeros(6)
    V[1] = J[1, 5] * angle
    along_S = moved(V)[:3, :3].T @ along_W
    assert (np.arctan2(along_S[0], along_S[2]) - angle) / STEP == pytest.approx(-angle, rel=1e-4)


def test_rolls_are_about_the_contact() -> None:
    """The material point of the finger under the contact stands still, so that nothing slides."""
    system = TactileServoing(CONFIG, AXES)
    context = system.CreateDefaultContext()
    contact = touching(x=2e-3, z=-1e-3)
    system.GetInputPort("contact_latest").FixValue(context, AbstractValue.Make(contact))
    system.GetInputPort("tactile_projector").FixValue(context, [1, 0, 1, 0, 0, 0])
    V_WS_S = system.GetOutputPort("tactile_twist_desired").Eval(context)
    v_WC_S = V_WS_S[3:] + np.cross(V_WS_S[:3], contact.p_SC)
    assert np.linalg.norm(V_WS_S[:3]) > 0.1
    assert_allclose(v_WC_S, 0.0, atol=1e-12)


@pytest.mark.parametrize("component", range(6))
def test_the_projector_keeps_one_component_of_the_contacts_twist(component: int) -> None:
    system = TactileServoing(TactileServoingConfig(proportional=[1.0] * 6), AXES)
    context = system.CreateDefaultContext()
    contact = touching(x=2e-3, z=-1e-3, force=0.6, angle=0.1)
    system.GetInputPort("contact_latest").FixValue(context, AbstractValue.Make(contact))
    port = system.GetInputPort("tactile_projector")

    def twist_of_contact(projector: np.ndarray) -> np.ndarray:
        port.FixValue(context, projector)
        V = system.GetOutputPort("tactile_twist_desired").Eval(context)
        return np.concatenate([V[:3], V[3:] + np.cross(V[:3], contact.p_SC)])

    alone = twist_of_contact(np.eye(6)[component])
    assert_allclose(alone, np.eye(6)[component] * twist_of_contact(np.ones(6)), atol=1e-15)
    assert abs(alone[component]) > 0.0


def test_the_force_that_the_contact_should_have_can_be_set_from_outside() -> None:
    system = TactileServoing(CONFIG, AXES)
    context = system.CreateDefaultContext()
    contact = AbstractValue.Make(touching(force=CONFIG.force))
    system.GetInputPort("contact_latest").FixValue(context, contact)
    system.GetInputPort("tactile_projector").FixValue(context, np.ones(6))

    def along_the_normal() -> float:
        return float(system.GetOutputPort("tactile_twist_desired").Eval(context)[4])

    assert along_the_normal() == pytest.approx(0.0, abs=1e-12)
    system.GetInputPort("force_desired").FixValue(context, [CONFIG.force + 0.2])
    assert along_the_normal() > 1e-4  # It presses on.


def test_no_contact_gives_no_motion_and_no_memory() -> None:
    system = TactileServoing(CONFIG, AXES)
    context = system.CreateDefaultContext()
    port = system.GetInputPort("contact_latest")
    system.GetInputPort("tactile_projector").FixValue(context, np.ones(6))
    port.FixValue(context, AbstractValue.Make(touching(force=0.3)))
    tick(system, context)
    assert np.any(context.get_discrete_state_vector().value()[6:])
    port.FixValue(context, AbstractValue.Make(NO_CONTACT))
    tick(system, context)
    assert_allclose(system.GetOutputPort("tactile_twist_desired").Eval(context), 0.0)
    assert_allclose(context.get_discrete_state_vector().value()[6:], 0.0)


def pid(integral: float = 1.0, limit: float = 1.0) -> Pid:
    return Pid(
        proportional=np.array([0.5]),
        integral=np.array([integral]),
        derivative=np.array([0.2]),
        limit=np.array([limit]),
        period=0.1,
    )


def test_pid_is_the_sum_of_its_parts() -> None:
    u = pid(limit=10.0).output(np.array([0.4]), np.array([0.3]), np.array([0.7]))
    assert u[0] == pytest.approx(0.5 * 0.4 + 0.7 + 0.2 * 0.1 / 0.1)


def test_the_first_error_has_no_rate() -> None:
    u = pid(limit=10.0).output(np.array([0.4]), np.array([np.nan]), np.array([0.0]))
    assert u[0] == pytest.approx(0.2)


def test_the_integral_stands_still_beyond_the_limit_and_returns_at_once() -> None:
    controller, total, error = pid(), np.zeros(1), np.array([2.0])
    for _ in range(200):
        assert controller.output(error, error, total)[0] <= 1.0
        total = controller.integrate(error, error, total, able=True)
    assert total[0] <= 0.2
    back = -0.5 * np.ones(1)
    assert controller.output(back, back, total)[0] < 0.0


def test_the_integral_stands_still_while_the_arm_cannot_follow() -> None:
    total = pid().integrate(np.ones(1), np.ones(1), np.zeros(1), able=False)
    assert total[0] == 0.0


def test_impossible_gains_are_refused_with_their_name() -> None:
    with pytest.raises(ValueError, match="TactileServoing: proportional"):
        TactileServoing(TactileServoingConfig(proportional=[1.0]), AXES)
