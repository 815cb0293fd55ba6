from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.systems.framework import Context

from crossmodal.systems.grasping.grasp_planner import (
    GraspPlanner,
    GraspPlannerConfig,
    find_all_grasps,
    grasp_pose,
    load_grasp_network,
)
from crossmodal.systems.onnx_network import OnnxNetwork
from crossmodal.systems.port_values import Grasps, ObjectMasks
from tests.documented_ports import documented_ports
from tests.systems.grasping.images import CAMERA, Block, above, image_of

CONFIG = GraspPlannerConfig()
TABLE, ANGLE = 0.1, 0.5
BOX = Block(middle=(0.03, -0.02), size=(0.15, 0.05, 0.06), angle=ANGLE)


def beside(across: float, height: float) -> Block:
    """A wall along the box, so far from its side."""
    away = 0.5 * BOX.size[1] + across + 0.01
    middle = (BOX.middle[0] - away * np.sin(ANGLE), BOX.middle[1] + away * np.cos(ANGLE))
    return Block(middle=middle, size=(0.3, 0.02, height), angle=ANGLE)


def masks_of(blocks: Sequence[Block], number: int = 1, tilt: float = 0.0) -> ObjectMasks:
    X_WC = above(0.7, tilt)
    depth, objects = image_of(blocks, X_WC, TABLE)
    return ObjectMasks(
        number=number, objects=objects, depth=depth, intrinsics=CAMERA, X_WC=X_WC, table=TABLE
    )


@pytest.fixture(scope="module")
def network() -> OnnxNetwork:
    return load_grasp_network(CONFIG)


@pytest.fixture
def planner() -> GraspPlanner:
    return GraspPlanner(CONFIG, 0.1)


def grasps_at(planner: GraspPlanner, context: Context, masks: ObjectMasks) -> Grasps:
    """After a tick."""
    planner.get_input_port().FixValue(context, masks)
    planner.ExecuteForcedEvents(context)
    grasps: Grasps = planner.get_output_port().Eval(context)
    return grasps


@pytest.mark.parametrize("tilt", [0.0, 0.3])
def test_a_box_is_grasped_across_at_its_middle(network: OnnxNetwork, tilt: float) -> None:
    best = find_all_grasps(masks_of([BOX], tilt=tilt), network, CONFIG).grasps[0][0]
    R, p = best.X_WE[:3, :3], best.X_WE[:3, 3]
    assert_allclose(R @ R.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(R) == pytest.approx(1.0)
    assert_allclose(R[:, 2], [0.0, 0.0, -1.0])
    assert abs(R[:, 0] @ [-np.sin(ANGLE), np.cos(ANGLE), 0.0]) > np.cos(np.deg2rad(12.0))
    assert_allclose(p[:2], BOX.middle, atol=0.02)
    assert p[2] == pytest.approx(TABLE + 0.015, abs=1e-6)
    assert BOX.size[1] + 0.005 < best.width < BOX.size[1] + 0.03
    assert best.quality > 0.3


def test_a_high_wall_beside_it_is_in_the_way_and_a_low_one_is_stayed_above(
    network: OnnxNetwork,
) -> None:
    high, low = (masks_of([BOX, beside(0.01, height)]) for height in (0.06, 0.02))
    assert find_all_grasps(high, network, CONFIG).grasps[0] == ()
    best = find_all_grasps(low, network, CONFIG).grasps[0][0]
    assert best.X_WE[2, 3] == pytest.approx(TABLE + 0.02 + CONFIG.clearance, abs=1e-6)


def test_a_thin_bar_is_grasped_on_a_table_whose_heights_are_noisy(network: OnnxNetwork) -> None:
    bar = Block(middle=(0.0, 0.0), size=(0.13, 0.018, 0.018))
    masks = masks_of([bar])
    noise = np.random.default_rng(0).normal(0.0, 0.002, masks.depth.shape)
    best = find_all_grasps(replace(masks, depth=masks.depth + noise), network, CONFIG).grasps[0][0]
    assert best.X_WE[2, 3] == pytest.approx(TABLE + 0.001, abs=1e-6)
    assert abs(best.X_WE[1, 0]) > np.cos(np.deg2rad(12.0))


def test_what_is_too_wide_cannot_be_grasped(network: OnnxNetwork) -> None:
    plate = Block(middle=(0.0, 0.0), size=(0.25, 0.25, 0.06))
    assert find_all_grasps(masks_of([plate]), network, CONFIG).grasps[0] == ()


def test_a_grasp_points_down_with_its_opening_along_x() -> None:
    X_WE = grasp_pose(np.array([0.1, 0.2, np.pi / 2, 0.05, 0.03]), 0.5)
    assert_allclose(X_WE @ [0.01, 0.0, 0.0, 1.0], [0.1, 0.21, 0.53, 1.0])
    assert_allclose(X_WE @ [0.0, 0.0, 0.01, 1.0], [0.1, 0.2, 0.52, 1.0])
    assert np.linalg.det(X_WE[:3, :3]) == pytest.approx(1.0)


def test_each_new_image_has_its_grasps_and_an_old_one_is_left_alone(planner: GraspPlanner) -> None:
    context = planner.CreateDefaultContext()
    first = grasps_at(planner, context, masks_of([BOX]))
    assert first.number == 1
    assert first.best(0) > 0.0
    other = masks_of([replace(BOX, middle=(0.0, 0.0))])
    assert grasps_at(planner, context, other) is first
    second = grasps_at(planner, context, replace(other, number=2))
    assert second.number == 2
    assert_allclose(second.grasps[0][0].X_WE[:2, 3], 0.0, atol=0.02)


def test_before_the_first_image_there_are_no_grasps(planner: GraspPlanner) -> None:
    context = planner.CreateDefaultContext()
    assert grasps_at(planner, context, ObjectMasks()).grasps == {}


def test_documented_ports_are_the_declared_ones(planner: GraspPlanner) -> None:
    inputs = [planner.get_input_port(i).get_name() for i in range(planner.num_input_ports())]
    outputs = [planner.get_output_port(i).get_name() for i in range(planner.num_output_ports())]
    assert documented_ports(GraspPlanner.__doc__, "input") == inputs
    assert documented_ports(GraspPlanner.__doc__, "output") == outputs


def test_impossible_values_and_missing_weights_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="least_quality"):
        GraspPlanner(GraspPlannerConfig(least_quality=0.0), 0.1)
    with pytest.raises(FileNotFoundError, match=r"none\.onnx"):
        GraspPlanner(GraspPlannerConfig(weights=str(tmp_path / "none.onnx")), 0.1)
