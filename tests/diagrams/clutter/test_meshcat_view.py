"""What the 3D page shows of an object's pose: what is measured, believed and planned."""

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose
from pydrake.common.value import AbstractValue
from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator

from crossmodal.diagrams.clutter.meshcat_view import MeshcatView, describe_belief
from crossmodal.diagrams.drawing.meshcat import start_meshcat
from crossmodal.diagrams.run.record import TaskStatus
from crossmodal.systems.active.occupancy_grid import OccupancyGrid
from crossmodal.systems.declutter.declutter_graph import DeclutterConfig, declutter_graph
from crossmodal.systems.port_values import (
    NO_TRIES,
    UNKNOWN_POSE,
    ObjectPose,
    PoseMeasurement,
    TouchRequest,
    ViewRequest,
)
from tests.systems.declutter.scenes import image, rectangle

BOX = trimesh.creation.box(extents=[0.06, 0.1, 0.2])
MIDDLE = np.array([0.0, 0.0, 0.1])


class Shown:
    """A view whose ports are given by hand, tick by tick."""

    def __init__(self, meshcat: Meshcat | Mock, clears: bool = False) -> None:
        mesh = (np.asarray(BOX.vertices) + MIDDLE, np.asarray(BOX.faces))
        self.view = MeshcatView(meshcat, ["density", "quaternion"], "box", mesh, None, clears)
        self.simulator = Simulator(self.view)
        self.time = -0.05

    def tick(self, **values: object) -> None:
        context = self.simulator.get_mutable_context()
        for name, value in values.items():
            self.view.GetInputPort(name).FixValue(context, AbstractValue.Make(value))
        self.time += 0.1
        self.simulator.AdvanceTo(self.time)


def belief(number: int, sigma: float = 2e-3) -> ObjectPose:
    X = np.eye(4)
    X[:3, 3] = [0.5, 0.0, 0.1]
    samples = np.tile(X, (20, 1, 1))
    samples[:, 0, 3] += np.linspace(-0.01, 0.01, 20)
    covariance = np.diag(np.repeat([0.01, sigma], 3) ** 2)
    return replace(
        UNKNOWN_POSE,
        known=True,
        number=number,
        X=X,
        covariance=covariance,
        samples=samples,
        middle=MIDDLE,
    )


def view_request(number: int) -> ViewRequest:
    candidates = np.tile(np.eye(4), (5, 1, 1))
    candidates[:, 0, 3] = np.arange(5)
    return ViewRequest(
        number=number, X_WC=candidates[3], candidates=candidates, gains=np.arange(5.0)
    )


def touch_request(number: int) -> TouchRequest:
    start, direction = np.array([0.4, 0.0, 0.1]), np.array([1.0, 0.0, 0.0])
    return TouchRequest(
        number=number,
        start=start,
        direction=direction,
        reach=0.1,
        expected=0.07,
        candidates=np.array([[start, direction], [start, -direction]]),
        gains=np.array([2.0, 1.0]),
    )


def measured(kind: str, number: int, count: int) -> PoseMeasurement:
    return PoseMeasurement(kind=kind, number=number, points=np.zeros((count, 3)) + 0.1)


def grid() -> OccupancyGrid:
    log_odds = np.full((4, 4, 4), -1.0)
    log_odds[1, 2, 3] = 2.0
    return OccupancyGrid(log_odds=log_odds, corner=np.array([0.1, 0.2, 0.3]), cell=0.01)


@pytest.fixture(scope="module")
def meshcat() -> Meshcat:
    return start_meshcat()


def test_all_that_is_known_is_drawn(meshcat: Meshcat) -> None:
    shown = Shown(meshcat)
    shown.tick(view_latest=view_request(1), grid_latest=grid())
    assert meshcat.HasPath("/perception/views/candidates/1")
    assert meshcat.HasPath("/perception/views/grid/1")
    assert not meshcat.HasPath("/perception/measured")
    shown.tick(
        pose_measurement=measured("view", 1, 7000),
        view_latest=view_request(2),
        density_object_pose_latest=belief(1),
        task_status=TaskStatus(phase="looks"),
    )
    assert meshcat.HasPath("/perception/measured/view_1")
    assert meshcat.HasPath("/perception/views/candidates/2")
    shown.tick(touch_latest=touch_request(1), pose_measurement=measured("touch", 2, 2))
    assert meshcat.HasPath("/perception/touches/candidates/1")
    assert meshcat.HasPath("/perception/measured/touch_2")
    for name in ("density", "quaternion"):
        assert meshcat.HasPath(f"/perception/{name}/pose")
    assert meshcat.HasPath("/perception/text/1")


def calls(meshcat: Mock, kind: str, path: str) -> list[tuple]:
    """Arguments of the calls whose path begins so, after the view was made."""
    found = [call.args for call in getattr(meshcat, kind).call_args_list]
    return [args for args in found if args[0].startswith(f"/perception/{path}")]


def test_the_pose_is_that_of_the_belief_and_is_drawn_when_it_changes() -> None:
    meshcat = Mock()
    shown = Shown(meshcat)
    shown.tick(density_object_pose_latest=UNKNOWN_POSE)
    assert not calls(meshcat, "SetTransform", "density")
    shown.tick(density_object_pose_latest=belief(0))
    shown.tick(density_object_pose_latest=belief(0))
    (pose,) = calls(meshcat, "SetTransform", "density/pose")
    assert_allclose(pose[1].translation(), [0.5, 0.0, 0.0], atol=1e-12)  # Of the mesh's frame.
    (ball,) = calls(meshcat, "SetProperty", "density/middle/ball")
    assert_allclose(ball[2], 3 * [2e-3 * np.sqrt(7.815)], rtol=1e-3)
    samples = calls(meshcat, "SetTransform", "density/samples")
    assert_allclose([call[1].translation()[0] for call in (samples[0], samples[-1])], [0.49, 0.51])
    shown.tick(density_object_pose_latest=belief(1, 1e-3))
    assert len(calls(meshcat, "SetTransform", "density/pose")) == 2


def test_the_most_promising_candidate_is_coloured_most() -> None:
    meshcat = Mock()
    shown = Shown(meshcat)
    shown.tick(view_latest=view_request(1))
    ((_, vertices, _, colors),) = (
        call.args for call in meshcat.SetTriangleColorMesh.call_args_list
    )
    assert vertices.shape == colors.shape == (3, 5 * 5)
    greys = np.ptp(colors, axis=0)[::5]
    assert (np.diff(greys) > 0.0).all()
    (chosen,) = calls(meshcat, "SetTransform", "views/chosen")
    assert_allclose(chosen[1].translation(), [3.0, 0.0, 0.0])


def test_what_is_over_vanishes() -> None:
    meshcat = Mock()
    shown = Shown(meshcat)
    shown.tick(view_latest=view_request(1), grid_latest=grid())
    ((_, vertices, *_),) = calls(meshcat, "SetTriangleMesh", "views/grid")
    assert_allclose(vertices.mean(axis=1), [0.115, 0.225, 0.335])
    shown.tick(touch_latest=touch_request(1))
    for path in ("views/candidates/1", "views/chosen", "views/grid/1"):
        assert calls(meshcat, "SetProperty", path)[-1][1:3] == ("visible", False)
    (expected,) = calls(meshcat, "SetTransform", "touches/chosen/expected")
    assert_allclose(expected[1].translation(), [0.47, 0.0, 0.1])
    assert calls(meshcat, "SetProperty", "touches/chosen")[-1][2] is True
    shown.tick(touch_latest=TouchRequest(number=1, done=True, why="all touches are done"))
    for path in ("touches/candidates/1", "touches/chosen"):
        assert calls(meshcat, "SetProperty", path)[-1][1:3] == ("visible", False)


def test_without_any_touch_views_are_over_once_none_follows() -> None:
    meshcat = Mock()
    shown = Shown(meshcat)
    shown.tick(view_latest=view_request(1), grid_latest=grid(), touch_latest=TouchRequest())
    assert calls(meshcat, "SetTriangleMesh", "views/grid")
    shown.tick(touch_latest=TouchRequest(done=True))
    assert calls(meshcat, "SetProperty", "views/chosen")[-1][1:3] == ("visible", False)


def test_the_graph_stands_above_its_objects_until_a_pose_is_believed() -> None:
    meshcat = Mock()
    shown = Shown(meshcat, clears=True)
    scene = image(
        *(rectangle(k, name, (0.5, 0.06 * k)) for k, name in enumerate(("box", "can", "sponge")))
    )
    graph = declutter_graph(scene, "box", {}, NO_TRIES, DeclutterConfig())
    shown.tick(declutter_graph=graph)
    balls = [call for call in calls(meshcat, "SetTransform", "graph/1") if "ball" in call[0]]
    assert_allclose([call[1].translation()[1] for call in balls], [0.0, 0.06, 0.12])
    drawn = calls(meshcat, "SetObject", "graph/1")
    radii = {call[0].split("/")[-2]: call[1].radius() for call in drawn if "ball" in call[0]}
    assert max(radii, key=lambda number: radii[number]) == str(graph.next)
    edges = [call for call in drawn if "edge" in call[0]]
    assert [call[1].length() for call in edges] == pytest.approx([0.06, 0.12])
    shown.tick(density_object_pose_latest=belief(0))
    assert calls(meshcat, "SetProperty", "graph/1")[-1][1:3] == ("visible", False)


def test_the_text_says_what_is_reported() -> None:
    assert describe_belief(1, 0, UNKNOWN_POSE) == "1 view, 0 touches"
    assert describe_belief(2, 1, belief(3)) == "2 views, 1 touch: σ up to 2.0 mm, 0.6°"
