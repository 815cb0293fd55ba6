"""Which motions are planned for an action, in the scene of two arms."""

import numpy as np
import pytest
import shapely
from known_scene import CAMERA_AWAY, touch_planner
from numpy.testing import assert_allclose
from pydrake.math import RigidTransform

from crossmodal.controllers.arm.motion_planner import box_vertices
from crossmodal.controllers.primitives.action_plan import ActionPlan, ActionPlanner
from crossmodal.controllers.primitives.move_object_config import MoveObjectConfig
from crossmodal.maths.arrays import Array
from crossmodal.plants.robots.ur5 import UR5_HOME
from crossmodal.systems.port_values import ActionRequest, Push

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
