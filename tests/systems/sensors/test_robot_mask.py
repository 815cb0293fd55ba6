from dataclasses import replace

import cv2
import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.geometry import (
    Box,
    ClippingRange,
    ColorRenderCamera,
    DepthRange,
    DepthRenderCamera,
    MakeRenderEngineVtk,
    RenderCameraCore,
    RenderEngineVtkParams,
)
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import FixedOffsetFrame, RevoluteJoint, SpatialInertia
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import CameraInfo, ImageDepth32F, RgbdSensor

from crossmodal.systems.sensors.robot_mask import (
    MaskedRobot,
    RobotMask,
    RobotMaskConfig,
    RobotPosture,
    enlarge,
    nearest_surface,
    reduced_intrinsics,
)

INTRINSICS = CameraInfo(320, 240, 288.0, 288.0, 159.5, 119.5)
ROBOT = MaskedRobot(
    arm="DefaultModelInstance",
    arm_joints=["arm"],
    hand="DefaultModelInstance",
    hand_posture={"knuckle": (0.0, 1.2)},
)
X_WC = RigidTransform(RollPitchYaw(-np.pi / 2.0, 0.0, 0.0), [0.2, -1.0, 0.0])


def build_robot(plant):
    """A link that turns about the world's y, and a finger at its end."""
    color = np.ones(4)
    inertia = SpatialInertia.SolidCubeWithDensity(1.0, 0.1)
    link = plant.AddRigidBody("link", inertia)
    finger = plant.AddRigidBody("finger", inertia)
    X_BG = RigidTransform([0.15, 0.0, 0.0])
    plant.RegisterVisualGeometry(link, X_BG, Box(0.3, 0.06, 0.06), "link", color)
    plant.RegisterVisualGeometry(
        finger, RigidTransform([0.05, 0, 0]), Box(0.1, 0.03, 0.03), "finger", color
    )
    y, world = np.array([0.0, 1.0, 0.0]), plant.world_frame()
    plant.AddJoint(RevoluteJoint("arm", world, link.body_frame(), y))
    tip = RigidTransform([0.3, 0.0, 0.0])
    plant.AddJoint(
        RevoluteJoint(
            "knuckle", _frame(plant, link, tip), finger.body_frame(), np.array([0.0, 1.0, 0.0])
        )
    )


def _frame(plant, body, X_BF):
    return plant.AddFrame(FixedOffsetFrame("tip", body.body_frame(), X_BF))


def robot_mask(config, q, closure):
    mask = RobotMask(config, build_robot, INTRINSICS, X_WC, {"robot": ROBOT})
    context = mask.CreateDefaultContext()
    mask.GetInputPort("joint_state_measured").FixValue(context, [q, 0.0])
    mask.GetInputPort("closure_commanded").FixValue(context, [closure])
    return mask.GetOutputPort("robot_mask").Eval(context).data[:, :, 0].copy()


def true_silhouette(q, knuckle):
    """Where a camera of full size sees the robot at its true joints."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
    build_robot(plant)
    plant.Finalize()
    scene_graph.AddRenderer("full", MakeRenderEngineVtk(RenderEngineVtkParams()))
    core = RenderCameraCore("full", INTRINSICS, ClippingRange(0.05, 5.0), RigidTransform())
    sensor = builder.AddSystem(
        RgbdSensor(
            scene_graph.world_frame_id(),
            X_WC,
            ColorRenderCamera(core, False),
            DepthRenderCamera(core, DepthRange(0.1, 4.0)),
        )
    )
    builder.Connect(scene_graph.get_query_output_port(), sensor.query_object_input_port())
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    plant.SetPositions(plant.GetMyMutableContextFromRoot(context), [q, knuckle])
    depth = sensor.depth_image_32F_output_port().Eval(sensor.GetMyContextFromRoot(context)).data
    return np.isfinite(depth[:, :, 0])


@pytest.mark.parametrize(("q", "closure"), [(0.0, 0.0), (0.5, 1.0), (-0.8, 0.4)])
def test_the_mask_covers_the_robot_that_the_camera_sees_and_little_else(q, closure):
    seen = true_silhouette(q, 1.2 * closure)
    config = RobotMaskConfig(margin=0.005, reduction=2)
    masked = robot_mask(config, q, closure) == 255
    assert masked[seen].all()
    assert masked.sum() < 2.2 * seen.sum()


@pytest.mark.parametrize("reduction", [1, 2, 4])
def test_without_a_margin_the_mask_is_the_silhouette_and_one_pixel_around_it(reduction):
    seen = true_silhouette(0.3, 0.0)
    masked = robot_mask(RobotMaskConfig(margin=0.0, reduction=reduction), 0.3, 0.0) == 255
    assert masked[seen].all()
    border = 2 * reduction + 1
    wider = cv2.dilate(seen.astype(np.uint8), np.ones((2 * border + 1, 2 * border + 1)))
    assert not masked[wider == 0].any()


def test_the_margin_covers_a_robot_whose_joint_is_measured_with_an_offset():
    seen = true_silhouette(0.3, 0.6)
    without, with_margin = RobotMaskConfig(margin=0.0), RobotMaskConfig(margin=0.03)
    assert not (robot_mask(without, 0.38, 0.5) == 255)[seen].all()
    assert (robot_mask(with_margin, 0.38, 0.5) == 255)[seen].all()


def test_the_mask_moves_with_the_measured_joint_and_the_commanded_closure():
    config = RobotMaskConfig()
    open_hand = robot_mask(config, 0.0, 0.0)
    assert (robot_mask(config, 0.0, 1.0) != open_hand).any()
    assert (robot_mask(config, 0.4, 0.0) != open_hand).any()


def test_fingers_with_encoders_are_masked_where_they_are_measured():
    measured = replace(ROBOT, hand_posture={}, hand_joints=["knuckle"])
    config = RobotMaskConfig(margin=0.005, reduction=2)
    mask = RobotMask(config, build_robot, INTRINSICS, X_WC, {"robot": measured})
    context = mask.CreateDefaultContext()
    for knuckle in (0.0, 0.9, -0.6):
        mask.GetInputPort("joint_state_measured").FixValue(context, [0.2, 0.0])
        mask.GetInputPort("hand_positions_measured").FixValue(context, [knuckle])
        masked = mask.GetOutputPort("robot_mask").Eval(context).data[:, :, 0] == 255
        seen = true_silhouette(0.2, knuckle)
        assert masked[seen].all()
        assert masked.sum() < 2.2 * seen.sum()


def test_only_a_hand_with_encoders_has_a_port_for_them():
    soft = RobotMask(RobotMaskConfig(), build_robot, INTRINSICS, X_WC, {"robot": ROBOT})
    assert not soft.HasInputPort("hand_positions_measured")


def test_a_camera_on_a_link_sees_the_same_of_that_link_wherever_it_is():
    """A camera that looks at the link from the side, and does not turn with the finger."""
    X_LC = RigidTransform(RollPitchYaw(-np.pi / 2.0, 0.0, 0.0), [0.15, -1.0, 0.0])
    config, base = RobotMaskConfig(), "DefaultModelInstance::link"
    mask = RobotMask(config, build_robot, INTRINSICS, X_LC, {"robot": ROBOT}, base)
    context = mask.CreateDefaultContext()
    images = []
    for q, closure in ((0.0, 0.0), (0.7, 0.0), (0.7, 1.0)):
        mask.GetInputPort("joint_state_measured").FixValue(context, [q, 0.0])
        mask.GetInputPort("closure_commanded").FixValue(context, [closure])
        images.append(mask.get_output_port().Eval(context).data.copy())
    assert images[0].any()
    np.testing.assert_array_equal(images[0], images[1])
    assert (images[1] != images[2]).any()


def test_several_robots_have_ports_of_their_own_and_move_by_them():
    def build_two(plant):
        for name in ("left", "right"):
            instance = plant.AddModelInstance(name)
            inertia = SpatialInertia.SolidCubeWithDensity(1.0, 0.1)
            link = plant.AddRigidBody("link", instance, inertia)
            plant.AddJoint(
                RevoluteJoint("arm", plant.world_frame(), link.body_frame(), np.array([0, 1.0, 0]))
            )

    robots = {name: MaskedRobot(arm=name, arm_joints=["arm"]) for name in ("left", "right")}
    mask = RobotMask(RobotMaskConfig(), build_two, INTRINSICS, X_WC, robots)
    context = mask.CreateDefaultContext()
    for name, q in (("left", 0.3), ("right", -0.4)):
        mask.GetInputPort(f"{name}_joint_state_measured").FixValue(context, [q, 0.0])
    posture = mask.GetSubsystemByName("posture")
    positions = posture.get_output_port().Eval(posture.GetMyContextFromRoot(context))
    np.testing.assert_allclose(positions, [0.3, -0.4])


def masked(depth, focal, margin):
    """Which pixels are masked where nothing is measured."""
    return nearest_surface(depth, focal, margin) < np.inf


def test_what_stands_before_the_robot_is_not_masked():
    config = RobotMaskConfig(margin=0.02, reduction=2)
    mask = RobotMask(config, build_robot, INTRINSICS, X_WC, {"robot": ROBOT})
    context = mask.CreateDefaultContext()
    mask.GetInputPort("joint_state_measured").FixValue(context, [0.0, 0.0])
    whole = mask.GetOutputPort("robot_mask").Eval(context).data[:, :, 0].copy()
    image = ImageDepth32F(INTRINSICS.width(), INTRINSICS.height())
    image.mutable_data[:] = 0.97  # The robot's surface.
    image.mutable_data[:, :150] = 0.9
    image.mutable_data[:, :20] = 0.0  # No return.
    mask.GetInputPort("depth_measured").FixValue(context, AbstractValue.Make(image))
    after = mask.GetOutputPort("robot_mask").Eval(context).data[:, :, 0]
    assert (whole[:, 20:150] > 0).any()
    assert not after[:, 20:150].any()
    np.testing.assert_array_equal(after[:, 150:], whole[:, 150:])
    np.testing.assert_array_equal(after[:, :20], whole[:, :20])


def test_the_margin_is_a_disc_of_its_size_in_pixels():
    depth = np.full((41, 41), np.inf, dtype=np.float32)
    depth[20, 20] = 2.0
    mask = masked(depth, focal=200.0, margin=0.1)
    v, u = np.nonzero(mask)
    radius = np.hypot(v - 20, u - 20).max()
    np.testing.assert_allclose(radius, 11.0, atol=0.5)
    np.testing.assert_allclose(len(v), np.pi * 11.0**2, rtol=0.1)


def test_a_far_part_of_the_robot_has_a_smaller_margin_in_pixels_than_a_near_one():
    depth = np.full((41, 101), np.inf, dtype=np.float32)
    depth[20, 20], depth[20, 75] = 2.0, 1.0
    mask = masked(depth, focal=200.0, margin=0.1)
    assert (mask[20, :50] > 0).sum() == 2 * 11 + 1
    assert (mask[20, 50:] > 0).sum() == 2 * 21 + 1


def test_nothing_seen_is_an_empty_mask():
    depth = np.full((8, 8), np.inf, dtype=np.float32)
    assert not masked(depth, focal=100.0, margin=0.1).any()


def test_something_too_near_for_a_depth_is_still_the_robot():
    depth = np.full((8, 8), np.inf, dtype=np.float32)
    depth[2, 3] = 0.0
    mask = masked(depth, focal=100.0, margin=0.0)
    assert mask[2, 3]
    assert mask.sum() == 9


def test_a_pixel_of_the_small_mask_is_a_block_of_the_large_one():
    mask = np.array([[0, 255], [255, 0]], dtype=np.uint8)
    enlarged = enlarge(mask, 3)
    np.testing.assert_array_equal(enlarged, np.kron(mask, np.ones((3, 3), dtype=np.uint8)))


def test_reduced_intrinsics_see_a_ray_in_the_block_that_holds_it():
    reduced = reduced_intrinsics(INTRINSICS, 4)
    ray = np.array([0.13, -0.2])
    u = INTRINSICS.focal_x() * ray[0] + INTRINSICS.center_x()
    u_reduced = reduced.focal_x() * ray[0] + reduced.center_x()
    np.testing.assert_allclose(4.0 * (u_reduced + 0.5) - 0.5, u)


def test_the_posture_goes_linearly_with_the_closure_and_takes_the_arm_from_the_encoders():
    q_open, q_closed = np.array([9.0, 0.1, 9.0]), np.array([9.0, 1.1, 9.0])
    arm, hand = {"robot": np.array([0, 2])}, {"robot": np.array([1])}
    model = RobotPosture(arm, hand, q_open, q_closed)
    context = model.CreateDefaultContext()
    model.GetInputPort("joint_state_measured").FixValue(context, [1.0, 2.0, 30.0, 40.0])
    output = model.get_output_port()
    np.testing.assert_allclose(output.Eval(context), [1.0, 0.1, 2.0])
    for closure, angle in ((0.25, 0.35), (1.0, 1.1), (1.7, 1.1), (-3.0, 0.1)):
        model.GetInputPort("closure_commanded").FixValue(context, [closure])
        np.testing.assert_allclose(output.Eval(context), [1.0, angle, 2.0])


@pytest.mark.parametrize(
    ("field", "value"), [("reduction", 7), ("reduction", 0), ("margin", -0.1), ("range_max", 0.1)]
)
def test_impossible_values_are_refused_by_name(field, value):
    config = RobotMaskConfig(**{field: value})
    with pytest.raises(ValueError, match=f"RobotMask: {field}"):
        robot_mask(config, 0.0, 0.0)
