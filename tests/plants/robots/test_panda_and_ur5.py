"""The arms with a camera and with a gripper: kinematics, limits, drives, and their scene."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.geometry import GeometryId, QueryObject, SceneGraph
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import RigidBody
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder

from crossmodal.maths.arrays import Array
from crossmodal.plants.robots.arm_with_hand import ArmWithHand, add_robot, make_arm_with_load
from crossmodal.plants.robots.panda import ARM_JOINTS as PANDA_JOINTS
from crossmodal.plants.robots.panda import PANDA_HOME, PANDA_WITH_CAMERA
from crossmodal.plants.robots.ur5 import ARM_JOINTS as UR5_JOINTS
from crossmodal.plants.robots.ur5 import UR5_HOME, UR5_WITH_GRIPPER
from crossmodal.plants.scene import ManipulationScene, PlantConfig, add_manipulation_scene

H = 0.5 * np.pi
ROBOTS = (("camera_arm", "camera_hand"), ("touch_arm", "gripper"))


def panda_flange(q: Array) -> RigidTransform:
    """X_BaseFlange by the modified Denavit-Hartenberg parameters."""
    a = [0.0, 0.0, 0.0, 0.0825, -0.0825, 0.0, 0.088]
    alpha = [0.0, -H, H, H, -H, H, H]
    d = [0.333, 0.0, 0.316, 0.0, 0.384, 0.0, 0.0]
    X = RigidTransform()
    for a_i, alpha_i, d_i, angle in zip(a, alpha, d, q, strict=True):
        X = X @ RigidTransform(RotationMatrix.MakeXRotation(alpha_i), np.array([a_i, 0.0, 0.0]))
        X = X @ RigidTransform(RotationMatrix.MakeZRotation(angle), np.zeros(3))
        X = X @ RigidTransform([0.0, 0.0, d_i])
    return X @ RigidTransform([0.0, 0.0, 0.107])


def ur5_flange(q: Array) -> RigidTransform:
    """X_BaseFlange by the Denavit-Hartenberg parameters."""
    a = [0.0, -0.425, -0.39225, 0.0, 0.0, 0.0]
    alpha = [H, 0.0, 0.0, H, -H, 0.0]
    d = [0.089159, 0.0, 0.0, 0.10915, 0.09465, 0.0823]
    X = RigidTransform()
    for a_i, alpha_i, d_i, angle in zip(a, alpha, d, q, strict=True):
        X = X @ RigidTransform(RotationMatrix.MakeZRotation(angle), np.array([0.0, 0.0, d_i]))
        X = X @ RigidTransform(RotationMatrix.MakeXRotation(alpha_i), np.array([a_i, 0.0, 0.0]))
    return X


@dataclass
class Known:
    """What is known of a robot from its maker: limits are (lower, upper) and [rad], [N m]."""

    robot: ArmWithHand
    joints: list[str]
    lower: list[float]
    upper: list[float]
    speed: list[float]
    effort: list[float]


PANDA = Known(
    robot=PANDA_WITH_CAMERA,
    joints=PANDA_JOINTS,
    lower=[-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973],
    upper=[2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973],
    speed=[2.175] * 4 + [2.61] * 3,
    effort=[87.0] * 4 + [12.0] * 3,
)
_TURN = 2.0 * np.pi
UR5 = Known(
    robot=UR5_WITH_GRIPPER,
    joints=UR5_JOINTS,
    lower=[-_TURN, -_TURN, -np.pi, -_TURN, -_TURN, -_TURN],
    upper=[_TURN, _TURN, np.pi, _TURN, _TURN, _TURN],
    speed=[3.15] * 3 + [3.2] * 3,
    effort=[150.0] * 3 + [28.0] * 3,
)
EACH = pytest.mark.parametrize("known", [PANDA, UR5], ids=["panda", "ur5"])


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(
    ("known", "flange"), [(PANDA, panda_flange), (UR5, ur5_flange)], ids=["panda", "ur5"]
)
def test_the_flange_is_where_the_denavit_hartenberg_parameters_put_it(
    known: Known, flange: Callable[[Array], RigidTransform], seed: int
) -> None:
    arm = make_arm_with_load(known.robot, RigidTransform())
    q = np.random.default_rng(seed).uniform(known.lower, known.upper)
    context = arm.CreateDefaultContext()
    arm.SetPositions(context, q)
    found = arm.GetFrameByName("tool_plate").CalcPoseInWorld(context)
    assert_allclose(found.GetAsMatrix4(), flange(q).GetAsMatrix4(), atol=1e-9)


@EACH
def test_the_joints_have_the_maker_s_limits(known: Known) -> None:
    arm = make_arm_with_load(known.robot, RigidTransform())
    assert_allclose(arm.GetPositionLowerLimits(), known.lower, atol=1e-9)
    assert_allclose(arm.GetPositionUpperLimits(), known.upper, atol=1e-9)
    assert_allclose(arm.GetVelocityUpperLimits(), known.speed)
    assert_allclose(arm.GetEffortUpperLimits(), known.effort)
    assert [arm.GetJointByName(name).position_start() for name in known.joints] == list(
        range(arm.num_positions())
    )


@pytest.fixture
def scene() -> tuple[DiagramBuilder, ManipulationScene]:
    builder = DiagramBuilder()
    config = PlantConfig(scene="pose_scene.dmd.yaml", time_step=0.005)
    made = add_manipulation_scene(
        builder, config, {}, ROBOTS, weightless=[name for robot in ROBOTS for name in robot]
    )
    return builder, made


def at_home(scene: ManipulationScene, context: Context) -> None:
    scene.plant.SetPositions(context, scene.model("camera_arm"), PANDA_HOME)
    scene.plant.SetPositions(context, scene.model("touch_arm"), UR5_HOME)


def test_the_drives_follow_a_ramp_20_ms_late(
    scene: tuple[DiagramBuilder, ManipulationScene],
) -> None:
    builder, made = scene
    plant = made.plant
    simulator = Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    at_home(made, context)
    arms = [made.model("camera_arm"), made.model("touch_arm")]
    starts = [plant.GetPositions(context, arm) for arm in arms]
    gripper = made.model("gripper")
    plant.get_desired_state_input_port(gripper).FixValue(context, np.zeros(4))
    # A command is held for a step. Its speed grows within 0.2 s to 0.5 rad/s; every second joint
    # moves backwards.
    step, speed, growth = 0.005, 0.5, 0.2
    for k in range(round(0.7 / step)):
        time = k * step
        way = speed * (time - 0.5 * growth if time > growth else 0.5 * time**2 / growth)
        for arm, start in zip(arms, starts, strict=True):
            signs = (-1.0) ** np.arange(len(start))
            command = np.concatenate([start + signs * way, np.zeros(len(start))])
            plant.get_desired_state_input_port(arm).FixValue(context, command)
        simulator.AdvanceTo(time + step)
    for arm, start in zip(arms, starts, strict=True):
        signs = (-1.0) ** np.arange(len(start))
        late = (way - signs * (plant.GetPositions(context, arm) - start)) / speed
        assert_allclose(plant.GetVelocities(context, arm), speed * signs, atol=0.01)
        assert_allclose(late, 0.02, atol=1e-3)


def test_nothing_touches_at_home(scene: tuple[DiagramBuilder, ManipulationScene]) -> None:
    builder, made = scene
    builder.ExportOutput(made.scene_graph.get_query_output_port(), "query")
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    at_home(made, made.plant.GetMyMutableContextFromRoot(context))
    query: QueryObject = diagram.GetOutputPort("query").Eval(context)
    assert query.ComputePointPairPenetration() == []
    nearest = query.ComputeSignedDistancePairwiseClosestPoints(0.02)
    assert nearest == []


def test_the_homes_leave_the_middle_of_the_table_free_and_in_view(
    scene: tuple[DiagramBuilder, ManipulationScene],
) -> None:
    plant = scene[1].plant
    context = plant.CreateDefaultContext()
    at_home(scene[1], context)
    X_WC = plant.GetFrameByName("camera").CalcPoseInWorld(context)
    assert_allclose(X_WC.translation(), [0.5, 0.0, 0.5], atol=2e-3)
    assert_allclose(X_WC.rotation().col(2), [0.0, 0.0, -1.0], atol=1e-3)
    E = plant.GetFrameByName("end_effector", scene[1].model("gripper"))
    X_WE = E.CalcPoseInWorld(context)
    assert np.linalg.norm(X_WE.translation() - [0.5, 0.0, 0.1]) > 0.3
    assert X_WE.rotation().col(2)[2] < -0.9


@pytest.mark.parametrize(
    ("robot", "home"),
    [(PANDA_WITH_CAMERA, PANDA_HOME), (UR5_WITH_GRIPPER, UR5_HOME)],
    ids=["panda", "ur5"],
)
@pytest.mark.parametrize(("spread", "with_hand"), [(0.3, True), (0.8, False)])
def test_links_that_are_no_neighbours_are_clear_of_each_other(
    robot: ArmWithHand, home: Array, spread: float, with_hand: bool
) -> None:
    """Drake leaves neighbours out; the two fingers touch each other."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
    arm, hand = add_robot(plant, robot, RigidTransform())
    plant.Finalize()
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    models = [arm, hand] if with_hand else [arm]
    own = {index for model in models for index in plant.GetBodyIndices(model)}
    fingers = {frozenset({"left_finger", "right_finger"})}
    rng = np.random.default_rng(0)
    n = len(home)
    lower, upper = plant.GetPositionLowerLimits()[:n], plant.GetPositionUpperLimits()[:n]
    for _ in range(30):
        q = np.clip(home + rng.uniform(-spread, spread, n), lower, upper)
        plant.SetPositions(plant.GetMyMutableContextFromRoot(context), arm, q)
        query = scene_graph.get_query_output_port().Eval(scene_graph.GetMyContextFromRoot(context))
        for pair in query.ComputePointPairPenetration():
            bodies = [body_of(plant, scene_graph, shape) for shape in (pair.id_A, pair.id_B)]
            if all(body.index() in own for body in bodies):
                assert {frozenset(body.name() for body in bodies)} <= fingers


def body_of(plant: MultibodyPlant, scene_graph: SceneGraph, shape: GeometryId) -> RigidBody:
    return plant.GetBodyFromFrameId(scene_graph.model_inspector().GetFrameId(shape))


def test_the_camera_sees_nothing_of_the_hand() -> None:
    """No corner of its boxes is before the camera and within 60 deg of its axis."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
    _, hand = add_robot(plant, PANDA_WITH_CAMERA, RigidTransform())
    plant.Finalize()
    inspector = scene_graph.model_inspector()
    body = plant.GetBodyByName("mount", hand)
    X_CB = plant.GetFrameByName("camera").GetFixedPoseInBodyFrame().inverse()
    signs = np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3), axis=-1).reshape(-1, 3)
    for shape in plant.GetCollisionGeometriesForBody(body):
        corners = signs * inspector.GetShape(shape).size()
        p_CP = (X_CB @ inspector.GetPoseInFrame(shape) @ corners.T).T
        before = p_CP[p_CP[:, 2] > 1e-6]
        angle = np.arctan2(np.linalg.norm(before[:, :2], axis=1), before[:, 2])
        assert (angle > np.deg2rad(60.0)).all()
