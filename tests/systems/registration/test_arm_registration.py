"""A camera and two arms of boxes against each other, from rendered depth."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.sensors import ImageDepth32F

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.systems.depth_camera import DepthCamera
from crossmodal.systems.port_values import (
    DisplacementBelief,
    SampleWindow,
    StampedImage,
    displacement_at,
)
from crossmodal.systems.registration.arm_registration import ArmRegistration, ArmRegistrationConfig
from crossmodal.systems.registration.registration_solver import (
    CalibratedArm,
    distortion,
    match_weights,
)
from crossmodal.systems.registration.robot_view import ArmChain, RobotView
from tests.systems.registration.arm_of_boxes import (
    BASES,
    HEIGHT,
    INTRINSICS,
    RENDERED,
    WIDTH,
    X_WC,
    Q,
    build,
)

ARMS = {name: ArmChain(f"{name}_arm", ["first", "second"], f"{name}_hand", "tip") for name in BASES}


def believed_view() -> RobotView:
    return RobotView(build({}), RENDERED, X_WC, ARMS, reduction=2)


def seen_depth(moved: dict[str, RigidTransform], camera: RigidTransform, scale: float) -> Array:
    """What the camera measures (h, w), 0 where there is nothing."""
    view = RobotView(build(moved, hands=0.03), RENDERED, X_WC @ camera, ARMS, reduction=1)
    depth = view.Render(Q).depth
    return np.where(np.isfinite(depth), scale * depth, 0.0)


def make_system(**changes: float) -> ArmRegistration:
    spread = np.diag(np.repeat([np.deg2rad(0.5), 0.005], 3) ** 2)
    base = np.diag(np.repeat([np.deg2rad(0.3), 0.003], 3) ** 2)
    camera = DepthCamera(
        intrinsics=INTRINSICS, X_WC=X_WC.GetAsMatrix4(), pose_covariance=spread,
        depth_scale_std=0.005, focal_length_std=0.005, latency_std=0.02,
    )  # fmt: skip
    arms = {
        name: CalibratedArm(
            X_WBase=RigidTransform(p).GetAsMatrix4(), base_covariance=base,
            joint_offset_std=np.full(2, 1e-4),
        )
        for name, p in BASES.items()
    }  # fmt: skip
    config = ArmRegistrationConfig(correlation=1, bend=2e-3, **changes)
    return ArmRegistration(config, believed_view(), camera, arms)


def window(q: Array, rate: float = 0.0) -> SampleWindow:
    return SampleWindow(
        times=np.zeros(1), values=np.concatenate([q, np.full(len(q), rate)])[None, :]
    )


def registered(
    system: ArmRegistration, images: list[Array], rate: float = 0.0
) -> DisplacementBelief:
    context = system.CreateDefaultContext()
    for name, q in Q.items():
        port = system.GetInputPort(f"{name}_joint_state_window")
        port.FixValue(context, AbstractValue.Make(window(q, rate)))
    for index, depth in enumerate(images):
        image = ImageDepth32F(WIDTH, HEIGHT)
        image.mutable_data[:, :, 0] = depth
        value = AbstractValue.Make(StampedImage(time=0.0, image=image))
        system.GetInputPort("depth_measured").FixValue(context, value)
        context.SetTime(2.0 * index)
        system.ExecuteForcedEvents(context, publish=False)
    belief = system.GetOutputPort("displacements_latest").Eval(context)
    assert isinstance(belief, DisplacementBelief)
    return belief


def _relative(belief: DisplacementBelief, name: str, p_W: Array) -> tuple[Array, Array]:
    """How much farther the camera's point is displaced than the arm's, and its covariance."""
    mean, P = belief.of("camera", name)
    J = displacement_at(p_W, belief.p_WQ) @ np.hstack([np.eye(6), -np.eye(6)])
    return J @ mean, J @ P @ J.T


MOVED = {
    "left": RigidTransform(se3.exp(np.array([0.003, -0.004, 0.002, 0.004, -0.003, 0.002]))),
    "right": RigidTransform(se3.exp(np.array([-0.002, 0.003, 0.004, -0.003, 0.004, -0.004]))),
}
CAMERA = RigidTransform(se3.exp(np.array([0.006, -0.008, 0.004, 0.005, -0.004, 0.006])))


@pytest.fixture(scope="module")
def images() -> list[Array]:
    ideal, rng = seen_depth(MOVED, CAMERA, 1.004), np.random.default_rng(3)
    return [
        np.where(ideal > 0.0, ideal + 0.001 * rng.normal(size=ideal.shape), 0.0) for _ in "1234"
    ]


def test_displaced_arms_are_found_to_a_millimetre_by_a_displaced_camera(
    images: list[Array],
) -> None:
    belief = registered(make_system(), images)
    view = believed_view()
    for name, joints in view.Pose(Q).items():
        p_WBelieved = joints.p_WE
        X_WBase = RigidTransform(BASES[name])
        p_WTrue = X_WBase @ MOVED[name] @ X_WBase.inverse() @ p_WBelieved
        p_C = 1.004 * ((X_WC @ CAMERA).inverse() @ p_WTrue)
        true = X_WC @ p_C - p_WBelieved
        assert np.linalg.norm(true) > 0.008
        found, P = _relative(belief, name, p_WBelieved)
        assert np.linalg.norm(found - true) < 0.0015
        assert (found - true) @ np.linalg.solve(P, found - true) < 16.3  # 99.9 % of 3.


def test_without_an_image_the_declared_calibration_is_what_is_known() -> None:
    belief = registered(make_system(), [np.zeros((HEIGHT, WIDTH))])
    assert_allclose(belief.mean, 0.0)
    p_WE = believed_view().Pose(Q)["left"].p_WE
    assert_allclose(belief.p_WQ, p_WE)
    # Of the base: 3 mm and 0.3 deg about it; two joints of 0.1 mrad add next to nothing.
    arm = belief.of("left")[1]
    r = p_WE - BASES["left"]
    across = np.dot(r, r) * np.eye(3) - np.outer(r, r)
    expected = 0.003**2 * np.eye(3) + np.deg2rad(0.3) ** 2 * across
    assert_allclose(arm[3:, 3:], expected, atol=2e-8)


def test_what_moves_is_not_compared(images: list[Array]) -> None:
    assert_allclose(registered(make_system(), images[:1], rate=0.5).mean, 0.0)
    assert np.linalg.norm(registered(make_system(), images[:1], rate=0.01).mean) > 0.003


def test_more_images_lessen_the_noise_but_not_the_links_tolerance(images: list[Array]) -> None:
    def claimed(count: int, surface: float) -> float:
        belief = registered(make_system(surface=surface), images[:1] * count)
        return float(np.trace(_relative(belief, "left", belief.p_WQ)[1]))

    assert claimed(4, 1e-6) < 0.6 * claimed(1, 1e-6)
    assert claimed(4, 2e-3) > 0.9 * claimed(1, 2e-3)


def test_a_body_counts_as_one_observation_however_many_points_it_has() -> None:
    for count in (1, 10, 1000):
        body = np.repeat([0, 1], [count, 3])
        w = match_weights(body, np.zeros(count + 3), 1e-9, 1, 2e-3, 1.0)
        assert w[body == 0].sum() == pytest.approx(1.0 / 2e-3**2)
        assert w[body == 1].sum() == pytest.approx(1.0 / 2e-3**2)


def test_scale_moves_along_the_ray_and_the_focal_length_away_from_the_axis() -> None:
    p_C = np.array([0.2, -0.1, 0.9])
    p_W = X_WC @ p_C
    J = distortion(X_WC.GetAsMatrix4(), p_W)
    assert_allclose(J[:, 0], p_W - X_WC.translation())
    assert_allclose(X_WC.rotation().matrix().T @ J[:, 1], [0.2, -0.1, 0.0], atol=1e-12)


def test_a_displacement_about_another_point_is_the_same_one() -> None:
    rng = np.random.default_rng(0)
    A = rng.normal(size=(12, 12))
    belief = DisplacementBelief(
        names=("camera", "left"), p_WQ=rng.normal(size=3), mean=rng.normal(size=12),
        covariance=A @ A.T,
    )  # fmt: skip
    other, p_W = belief.about(rng.normal(size=3)), rng.normal(size=3)
    for one, two in zip(_relative(belief, "left", p_W), _relative(other, "left", p_W), strict=True):
        assert_allclose(one, two, atol=1e-9)


def test_a_hands_fingers_are_not_the_arms() -> None:
    view = believed_view()
    for name in ARMS:
        assert view.bodies(name).sum() == 4  # Post, two links and palm, not the finger.
        carried = view.carried(name)[view.bodies(name)]
        assert carried.sum(axis=1).tolist() == [0, 1, 2, 2]


def test_it_reads_each_arm() -> None:
    system = make_system()
    inputs = [system.get_input_port(i).get_name() for i in range(system.num_input_ports())]
    outputs = [system.get_output_port(i).get_name() for i in range(system.num_output_ports())]
    assert inputs == ["depth_measured", *(f"{name}_joint_state_window" for name in ARMS)]
    assert outputs == ["displacements_estimated", "displacements_latest"]
