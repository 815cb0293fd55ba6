"""Which motions are planned for an action, in the scene of two arms."""

import numpy as np
import pytest
import shapely
from known_scene import CAMERA_AWAY, touch_arm, touch_planner
from numpy.testing import assert_allclose
from pydrake.math import RigidTransform, RotationMatrix

from crossmodal.controllers.arm.motion_planner import box_vertices
from crossmodal.controllers.primitives.action_plan import ActionPlan, ActionPlanner
from crossmodal.controllers.primitives.move_object_config import ActionPhase, MoveObjectConfig
from crossmodal.maths.arrays import Array
from crossmodal.models.gripper_taxels import PALM_ABOVE
from crossmodal.plants.robots.ur5 import UR5_HOME
from crossmodal.systems.port_values import ActionRequest, DeclutterAction, Grasp, Push

AT, LENGTH = np.array([0.6, 0.0]), 0.1
BOTTLE = box_vertices(np.array([0.06, 0.06, 0.3]), RigidTransform([0.6, -0.075, 0.15]))


@pytest.fixture(scope="module")
def planner() -> ActionPlanner:
    return ActionPlanner(touch_planner(), "gripper", MoveObjectConfig())


def planned(
    planner: ActionPlanner, obstacles: tuple[Array, ...], top: float = 0.1
) -> ActionPlan | None:
    push = Push(
        point=AT,
        direction=np.array([1.0, 0.0]),
        length=LENGTH,
        reach=0.03,
        height=0.02,
        place=AT - [0.02, 0.0],
        finger=shapely.box(0.0, 0.0, 1.0, 1.0),
    )
    request = ActionRequest(number=1, object=1, pushes=(push,), top=top, obstacles=obstacles)
    return planner.plan(request, UR5_HOME, [UR5_HOME], CAMERA_AWAY)


def test_a_push_comes_straight_down_where_it_can(planner: ActionPlanner) -> None:
    plan = planned(planner, ())
    assert plan is not None
    assert_allclose(plan.X_WE[:3, 2], [0.0, 0.0, -1.0], atol=1e-9)
    assert_allclose(plan.X_WE[:3, 3], [*(AT - [0.02, 0.0]), 0.02])


def test_beside_a_bottle_the_hand_leans_away_from_it(planner: ActionPlanner) -> None:
    plan = planned(planner, (BOTTLE,))
    assert plan is not None
    z = plan.X_WE[:3, 2]
    # From above it comes down towards the bottle, and the pushing face stays across the way.
    assert_allclose(z, [0.0, -np.sin(np.deg2rad(20.0)), -np.cos(np.deg2rad(20.0))], atol=1e-9)
    assert_allclose(np.abs(plan.X_WE[:3, 0]), [1.0, 0.0, 0.0], atol=1e-9)
    # The lower edge of the finger is where the whole finger would have been.
    assert plan.X_WE[2, 3] == pytest.approx(0.02 + 0.0135 * np.sin(np.deg2rad(20.0)))


def test_where_the_leaning_palm_would_meet_the_object_there_is_no_plan(
    planner: ActionPlanner,
) -> None:
    assert planned(planner, (BOTTLE,), top=0.13) is None


def grasped(
    planner: ActionPlanner, height: float, obstacles: tuple[Array, ...] = ()
) -> ActionPlan | None:
    """A grasp at a height in W [m]; the table is believed to be at zero."""
    X_WE = RigidTransform(RotationMatrix.MakeXRotation(np.pi), [*AT, height])
    grasp = Grasp(X_WE=X_WE.GetAsMatrix4(), width=0.05, quality=0.9)
    request = ActionRequest(
        number=1,
        action=DeclutterAction.GRASP,
        object=1,
        grasps=(grasp,),
        places=np.array([[0.6, 0.2]]),
        passed=np.zeros(1),
        top=0.03,
        obstacles=obstacles,
    )
    return planner.plan(request, UR5_HOME, [UR5_HOME], CAMERA_AWAY)


@pytest.mark.parametrize("height", [0.02, -0.01])
def test_what_is_grasped_is_put_down_where_the_table_may_be(
    planner: ActionPlanner, height: float
) -> None:
    """One that is lower than believed, too."""
    plan = grasped(planner, height)
    assert plan is not None
    ends = [
        touch_arm().Evaluate(np.append(leg.postures[-1], np.zeros(6))).X_WE[:3, 3]
        for leg in plan.legs
        if leg.postures is not None
    ]
    assert [leg.phase for leg in plan.legs if leg.postures is not None][-1] is ActionPhase.LOWER
    assert_allclose(ends[-1][:2], [0.6, 0.2], atol=2e-3)
    assert min(height, 0.0) - 2e-3 < ends[-1][2] < height + 2e-3
    assert ends[2][2] - height == pytest.approx(MoveObjectConfig().lift, abs=0.01)


def test_beside_something_high_it_is_lifted_above_that(planner: ActionPlanner) -> None:
    wall = box_vertices(np.array([0.06, 0.06, 0.25]), RigidTransform([0.69, 0.0, 0.125]))
    plan = grasped(planner, 0.02, (wall,))
    assert plan is not None
    lift = next(leg for leg in plan.legs if leg.phase is ActionPhase.LIFT)
    assert lift.postures is not None
    X_WE = touch_arm().Evaluate(np.append(lift.postures[-1], np.zeros(6))).X_WE
    assert 0.02 + MoveObjectConfig().lift < 0.25 - PALM_ABOVE < X_WE[2, 3] < 0.2
