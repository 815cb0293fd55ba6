"""Objects that are grasped and pushed in the simulated station, and where they truly end."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from numpy.testing import assert_allclose
from object_scene import ObjectScene
from pydrake.math import RigidTransform

from crossmodal.controllers.arm.motion_planner import box_vertices
from crossmodal.controllers.primitives.arm_task import TransitConfig
from crossmodal.controllers.primitives.move_object_config import GripConfig, MoveObjectConfig
from crossmodal.maths.arrays import Array
from crossmodal.models.gripper_taxels import TRAVEL
from crossmodal.systems.port_values import ActionRequest, DeclutterAction, Grasp, Push

CAN, BOX = RigidTransform([0.6, -0.1, 0.0]), RigidTransform([0.6, 0.03, 0.0])
BOXED = box_vertices(np.array([0.16, 0.11, 0.06]), RigidTransform([0.6, 0.03, 0.03]))
X_GRASP = np.eye(4)
X_GRASP[:3, :3] = np.diag([1.0, -1.0, -1.0])
X_GRASP[:3, 3] = [0.6, -0.1, 0.04]
GRASP = ActionRequest(
    number=1,
    action=DeclutterAction.GRASP,
    grasps=(Grasp(X_WE=X_GRASP, width=0.086, quality=0.9),),
    places=np.array([[0.68, -0.2]]),
    passed=np.zeros(1),
    top=0.115,
    obstacles=(BOXED,),
)
PUSH = ActionRequest(
    number=1,
    pushes=(
        Push(
            point=np.array([0.567, -0.1]),
            direction=np.array([1.0, 0.0]),
            length=0.1,
            reach=0.03,
            height=0.03,
            place=np.array([0.548, -0.1]),
            finger=shapely.box(0.534, -0.1135, 0.562, -0.0865),
        ),
    ),
    top=0.115,
    obstacles=(BOXED,),
)
# With opened fingers, of which the front one stands as near to the can as the closed ones above.
OPENED = replace(
    PUSH,
    pushes=(
        replace(PUSH.pushes[0], place=np.array([0.562 - 0.014 - TRAVEL, -0.1]), opening=TRAVEL),
    ),
)
SIDES = np.array([[0.633, -0.1], [0.567, -0.1]])  # Of the can, along x.
QUICK = TransitConfig(speed=1.0, joint_speed=1.0, rest_time=0.1)


def upright(X_WO: RigidTransform) -> float:
    """Angle between an object's z and the vertical, [deg]."""
    return float(np.rad2deg(np.arccos(min(X_WO.rotation().matrix()[2, 2], 1.0))))


@pytest.mark.parametrize(
    ("wanted", "grip", "outcome", "moved", "met"),
    [
        (GRASP, GripConfig(), "placed", (0.08, -0.1), SIDES + np.array([0.08, -0.1])),
        (PUSH, GripConfig(), "pushed", (0.1, 0.0), SIDES[1:] + np.array([0.1, 0.0])),
        (OPENED, GripConfig(), "pushed", (0.1, 0.0), SIDES[1:] + np.array([0.1, 0.0])),
        # Twice 2 N at a friction of .53 do not bear its 3.4 N, and it is not held more tightly.
        (GRASP, GripConfig(force=2.0, load=2.0), "slipped", (0.0, 0.0), SIDES[:0]),
    ],
    ids=["grasp", "push", "opened push", "slip"],
)
def test_a_can_is_moved_upright_and_a_box_beside_it_is_not(
    wanted: ActionRequest,
    grip: GripConfig,
    outcome: str,
    moved: tuple[float, float],
    met: Array,
) -> None:
    config = MoveObjectConfig(transit=QUICK, grip=grip, lift=0.08)
    scene = ObjectScene({"can": CAN, "black_box": BOX}, wanted, config)
    end = scene.run(longest=30.0)
    assert end.outcome == outcome
    motion = (scene.pose("can").translation() - CAN.translation())[:2]
    assert motion == pytest.approx(moved, abs=4e-3)
    assert_allclose(end.contacts[:, :2], met, atol=3e-3)
    assert (end.contacts[:, 2] == 0.0).all()
    assert upright(scene.pose("can")) < 1.0
    box = scene.pose("black_box").translation() - BOX.translation()
    assert np.linalg.norm(box) < 1e-3


@pytest.mark.parametrize("error", [-0.006, 0.004], ids=["higher", "lower"])
def test_a_pen_is_grasped_although_the_table_is_not_where_it_is_thought(error: float) -> None:
    """The table is met above the end of the way down, or the fingers end above the table."""
    X_WE, marker = np.eye(4), RigidTransform([0.6, -0.1, 0.0])  # It lies along x.
    X_WE[:3, :3] = np.column_stack([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    X_WE[:3, 3] = [0.6, -0.1, 0.001 + error]
    wanted = replace(
        GRASP,
        grasps=(Grasp(X_WE=X_WE, width=0.04, quality=0.9),),
        top=0.018 + error,
        landing=0.01,
        obstacles=(),
    )
    scene = ObjectScene({"marker": marker}, wanted, MoveObjectConfig(transit=QUICK, lift=0.08))
    assert scene.run(longest=30.0).outcome == "placed"
    motion = (scene.pose("marker").translation() - marker.translation())[:2]
    assert motion == pytest.approx((0.08, -0.1), abs=0.01)
