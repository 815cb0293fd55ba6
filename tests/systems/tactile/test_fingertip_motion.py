"""Where fingertip and contact are, against known motions with noise and calibration errors."""

from dataclasses import replace
from functools import cache

import numpy as np
from numpy.testing import assert_allclose
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable

from crossmodal.diagrams.run.calibration import pose_covariance
from crossmodal.maths import se3
from crossmodal.plants.robots.arm_with_hand import make_arm_with_load
from crossmodal.plants.robots.lwr import LWR_WITH_FINGERTIP
from crossmodal.systems.arm_pose import ArmPose
from crossmodal.systems.port_values import NO_CONTACT, FingertipContact, SampleWindow
from crossmodal.systems.tactile.fingertip_motion import (
    FingertipMotion,
    FingertipMotionConfig,
    health_of,
    new_samples,
    with_velocity,
)
from crossmodal.systems.tactile.taxel_layout import fingertip_layout
from crossmodal.systems.tactile.taxel_monitor import next_taxel_state, unread_taxels

Q = np.array([-0.22, -0.63, -0.39, 1.6, 1.4, 1.01, -0.83])
CONFIG = FingertipMotionConfig()
LAYOUT = fingertip_layout()
PRESSED = np.where(np.isin(np.arange(12), [0, 3, 8, 11]), 0.13, 0.0)
BASE = pose_covariance(np.deg2rad(0.3), 0.003)
P_SC = np.array([0.0, 0.01, 0.0])


@cache
def arm() -> MultibodyPlant:
    return make_arm_with_load(LWR_WITH_FINGERTIP, RigidTransform())


def pose(q: np.ndarray) -> np.ndarray:
    context = arm().CreateDefaultContext()
    arm().SetPositions(context, q)
    return arm().GetFrameByName("end_effector").CalcPoseInWorld(context).GetAsMatrix4()


def steady_rates(speed: float) -> np.ndarray:
    """Joint rates (7,) for a motion of the fingertip along its x."""
    context = arm().CreateDefaultContext()
    arm().SetPositions(context, Q)
    frame = arm().GetFrameByName("end_effector")
    J = arm().CalcJacobianSpatialVelocity(
        context, JacobianWrtVariable.kV, frame, np.zeros(3), arm().world_frame(), frame
    )
    return np.linalg.pinv(J) @ [0, 0, 0, speed, 0, 0]


def run(seed: int, speed: float = 0.007, ticks: int = 30, forces=PRESSED):  # type: ignore[no-untyped-def]
    """Beliefs and true contact points of every tick, at a base that is off by an error."""
    rng = np.random.default_rng(seed)
    system = FingertipMotion(CONFIG, ArmPose(arm(), BASE, np.zeros(7)), LAYOUT)
    context = system.CreateDefaultContext()
    rates = steady_rates(speed)
    error = se3.exp(np.linalg.cholesky(BASE) @ rng.normal(size=6))
    beliefs: list[FingertipContact] = []
    truth = []
    for tick in range(1, ticks):
        now = tick * CONFIG.period
        times = np.arange(13)[::-1] * -0.005 + now
        q = Q + np.outer(times, rates) + rng.normal(0.0, CONFIG.noise.angle, (13, 7))
        v = rates + rng.normal(0.0, CONFIG.noise.rate, (13, 7))
        joints = SampleWindow(times=times, values=np.hstack([q, v]))
        taxel_times = np.arange(7)[::-1] * -0.01 + now
        noise = (forces > 0.0) * rng.normal(0.0, CONFIG.noise.taxel, (7, 12))
        taxels = SampleWindow(times=taxel_times, values=forces + noise)
        context.SetTime(now)
        for name, window in (("finger_joint_state_window", joints), ("taxel_window", taxels)):
            system.GetInputPort(name).FixValue(context, AbstractValue.Make(window))
        beliefs.append(system.GetOutputPort("fingertip_contact_estimated").Eval(context))
        truth.append((error @ pose(Q + now * rates) @ np.append(P_SC, 1.0))[:3])
        system.ExecuteForcedEvents(context)
    return beliefs, np.array(truth)


def nees(error: np.ndarray, covariance: np.ndarray) -> float:
    return float(error @ np.linalg.solve(covariance + 1e-14 * np.eye(3), error))


def test_the_contact_points_errors_are_as_large_as_claimed() -> None:
    """The base's error counts in the whole covariance, displacements are as sure as the white."""
    whole, white = [], []
    for seed in range(40):
        beliefs, truth = run(seed, ticks=8)
        whole.append(nees(beliefs[-1].p_WC - truth[-1], beliefs[-1].p_WC_covariance))
        moved = (beliefs[-1].p_WC - beliefs[-2].p_WC) - (truth[-1] - truth[-2])
        both = beliefs[-1].p_WC_white_covariance + beliefs[-2].p_WC_white_covariance
        white.append(nees(moved, both))
    assert 1.0 < np.mean(whole) < 4.5
    assert 1.8 < np.mean(white) < 4.2


def test_the_velocity_of_what_is_touched_is_as_good_as_claimed() -> None:
    scores = []
    for seed in range(30):
        beliefs, truth = run(seed)
        v_true = (truth[-1] - truth[-2]) / CONFIG.period
        scores.append(nees(beliefs[-1].v_WC - v_true, beliefs[-1].v_WC_covariance))
        assert np.linalg.norm(beliefs[-1].v_WC - v_true) < 3e-3
    assert 1.8 < np.mean(scores) < 4.2


def test_a_contact_that_the_taxels_find_elsewhere_has_not_moved() -> None:
    """A first light touch presses one taxel, the next one four: the pad has not moved."""
    beliefs, _ = run(0, speed=0.0, ticks=6)
    light, _ = run(0, speed=0.0, ticks=3, forces=np.where(np.arange(12) == 0, 0.11, 0.0))
    jumped = np.linalg.norm(beliefs[-1].p_WC - light[-1].p_WC)
    assert jumped > 1e-3
    belief = with_velocity(beliefs[-1], light[-1], CONFIG)
    assert np.linalg.norm(belief.v_WC) * CONFIG.period < 0.1 * jumped


def test_a_contact_that_begins_moves_nobody_knows_how() -> None:
    beliefs, _ = run(0, ticks=3)
    apart = replace(beliefs[0], contact=NO_CONTACT)
    belief = with_velocity(beliefs[1], apart, CONFIG)
    assert_allclose(belief.v_WC, 0.0)
    assert_allclose(belief.v_WC_covariance, CONFIG.first_velocity**2 * np.eye(3))


def test_without_contact_the_pose_alone_is_known() -> None:
    beliefs, _ = run(0, ticks=5, forces=np.zeros(12))
    assert not beliefs[-1].contact.touching
    assert np.all(np.isfinite(beliefs[-1].X_WS))
    assert np.all(np.isnan(beliefs[-1].p_WC))


def test_without_samples_nothing_is_known() -> None:
    system = FingertipMotion(CONFIG, ArmPose(arm(), BASE, np.zeros(7)), LAYOUT)
    context = system.CreateDefaultContext()
    for name, size in (("finger_joint_state_window", 14), ("taxel_window", 12)):
        none = SampleWindow(times=np.zeros(0), values=np.zeros((0, size)))
        system.GetInputPort(name).FixValue(context, AbstractValue.Make(none))
    belief = system.GetOutputPort("fingertip_contact_estimated").Eval(context)
    assert np.all(np.isnan(belief.X_WS))


def test_taxels_that_fall_silent_or_repeat_themselves_are_told() -> None:
    taxels = next_taxel_state(unread_taxels(LAYOUT), 1.0, PRESSED, LAYOUT, CONFIG.features)
    assert health_of(taxels, 1.1, 0.15).fault == ""
    silent = health_of(taxels, 1.3, 0.15)
    assert silent.fault == "no samples"
    assert abs(silent.age - 0.3) < 1e-9
    window = SampleWindow(times=np.array([0.9, 1.0, 1.01, 9.0]), values=np.zeros((4, 12)))
    assert_allclose(new_samples(window, taxels.time, 1.02, CONFIG.newest).times, [1.01])
