"""What a wrong camera does to joints of bodies that it sees, against what is said of it."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.systems.kinematics.calibration_errors import (
    PERFECT,
    SensorCalibration,
    with_calibration,
)
from crossmodal.systems.port_values import JointBelief, JointModelBelief, JointType

DEVIATIONS = {"scale": 0.005, "focal_length": 0.01}
POSE = np.repeat([0.01, 0.005], 3)
X_WC = se3.looking_at(np.array([-0.2, 0.4, 1.4]), np.array([0.8, -0.3, 0.9]), np.array([0, 0, 1.0]))


def _joint(kind: JointType, model: JointModelBelief) -> JointBelief:
    return JointBelief(
        parent_id=0, child_id=2, probabilities={kind: 1.0}, models={kind: model}, updates=9
    )


def _seen(p_WF: Array, xi: Array, scale: float, focal: float) -> Array:
    """Where points (N, 3) seem to be to whoever has another camera in mind."""
    p_C = (p_WF - X_WC[:3, 3]) @ X_WC[:3, :3] * (1.0 + scale)
    X_WC_believed = X_WC @ se3.exp(xi)
    p_C = p_C * [1.0 + focal, 1.0 + focal, 1.0]
    return np.asarray(p_C @ X_WC_believed[:3, :3].T + X_WC_believed[:3, 3])


def _motion(before: Array, after: Array) -> tuple[Array, Array]:
    """Rotation vector (3,) and translation (3,) of the rigid motion between seen points."""
    turn, _ = Rotation.align_vectors(after - after.mean(axis=0), before - before.mean(axis=0))
    return turn.as_rotvec(), after.mean(axis=0) - turn.apply(before.mean(axis=0))


@pytest.mark.parametrize("kind", [JointType.PRISMATIC, JointType.REVOLUTE])
def test_joints_of_a_wrong_camera_err_as_is_said(kind: JointType) -> None:
    rng = np.random.default_rng(0)
    axis_nees, q_nees, point_nees = [], [], []
    for _ in range(500):
        a = Rotation.random(random_state=rng).apply([0.0, 0.0, 1.0])
        # A leaf, one of whose edges lies along the axis, in any direction.
        u = np.cross(a, rng.normal(size=3))
        u /= np.linalg.norm(u)
        p_WA = np.array([0.8, -0.3, 0.9]) + 0.1 * rng.normal(size=3)
        leaf = rng.uniform([0.1, -0.2], [0.4, 0.2], size=(40, 2))
        before = p_WA + leaf @ np.array([u, a])
        q = 0.3 if kind == JointType.PRISMATIC else rng.uniform(0.2, 1.5)
        if kind == JointType.PRISMATIC:
            after = before + q * a
        else:
            after = p_WA + Rotation.from_rotvec(q * a).apply(before - p_WA)
        errors = (POSE * rng.normal(size=6), *(s * rng.normal() for s in DEVIATIONS.values()))
        turn, shift = _motion(_seen(before, *errors), _seen(after, *errors))
        if kind == JointType.PRISMATIC:
            turn = shift
        angle = float(np.linalg.norm(turn))
        axis = turn / angle
        seen_p = _seen(p_WA[None], *errors)[0]
        model = JointModelBelief(
            log_evidence=0.0,
            axis_P=axis,
            axis_covariance=np.zeros((3, 3)),
            p_PA=seen_p,
            p_PA_covariance=np.zeros((3, 3)),
            configuration=np.array([angle, 0.0]),
            configuration_covariance=np.zeros((2, 2)),
        )
        sensor = SensorCalibration(X_WF=X_WC, covariance=np.diag(POSE**2), **DEVIATIONS)
        found = with_calibration(_joint(kind, model), sensor, np.eye(4)).models[kind]
        off = a - axis * (a @ axis)
        axis_nees.append(off @ np.linalg.pinv(found.axis_covariance, rcond=1e-9) @ off / 2.0)
        q_nees.append((angle - q) ** 2 / found.configuration_covariance[0, 0])
        off = p_WA - seen_p
        point_nees.append(off @ np.linalg.solve(found.p_PA_covariance, off) / 3.0)
    assert np.mean(axis_nees) == pytest.approx(1.0, abs=0.15)
    assert np.mean(q_nees) == pytest.approx(1.0, abs=0.3)
    if kind == JointType.REVOLUTE:
        assert np.mean(point_nees) == pytest.approx(1.0, abs=0.15)


def test_what_is_late_is_off_by_how_far_it_went_meanwhile_and_a_perfect_sensor_adds_nothing() -> (
    None
):
    model = JointModelBelief(
        log_evidence=0.0,
        axis_P=np.array([1.0, 0.0, 0.0]),
        axis_covariance=np.zeros((3, 3)),
        configuration=np.array([0.1, 0.5]),
        configuration_covariance=np.diag([1e-6, 1e-4]),
    )
    joint = _joint(JointType.PRISMATIC, model)
    late = SensorCalibration(X_WF=X_WC, covariance=np.zeros((6, 6)), latency=0.02)
    found = with_calibration(joint, late, np.eye(4)).model
    assert found.configuration_covariance[0, 0] == pytest.approx(1e-6 + 0.01**2)
    same = with_calibration(joint, PERFECT, np.eye(4)).model
    assert_allclose(same.configuration_covariance, model.configuration_covariance)
    assert_allclose(same.axis_covariance, model.axis_covariance)


def test_a_turned_camera_turns_the_axis_in_its_parents_frame_too() -> None:
    model = JointModelBelief(
        log_evidence=0.0,
        axis_P=np.array([1.0, 0.0, 0.0]),
        axis_covariance=np.zeros((3, 3)),
        configuration=np.array([0.1, 0.0]),
        configuration_covariance=np.zeros((2, 2)),
    )
    joint = _joint(JointType.PRISMATIC, model)
    about_z = np.zeros((6, 6))
    about_z[2, 2] = 1e-4
    sensor = SensorCalibration(X_WF=np.eye(4), covariance=about_z)
    # Its x is the world's z, about which the camera may be turned.
    X_WP = se3.exp(np.array([0.0, -np.pi / 2.0, 0.0, 0.0, 0.0, 0.0]))
    assert_allclose(X_WP[:3, 0], [0.0, 0.0, 1.0], atol=1e-12)
    assert_allclose(with_calibration(joint, sensor, X_WP).model.axis_covariance, 0.0, atol=1e-15)
    turned = with_calibration(joint, sensor, np.eye(4)).model.axis_covariance
    assert_allclose(turned, np.diag([0.0, 1e-4, 0.0]), atol=1e-15)
