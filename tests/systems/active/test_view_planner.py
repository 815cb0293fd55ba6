"""The planner of views through its ports."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context

from crossmodal.systems.active.view_planner import (
    NO_GRID,
    ViewPlanner,
    ViewPlannerConfig,
    hemisphere,
)
from crossmodal.systems.port_values import (
    NO_MEASUREMENT,
    NO_PRIOR,
    NO_VIEW,
    UNKNOWN_POSE,
    PoseMeasurement,
    PosePrior,
    ViewRequest,
)
from crossmodal.systems.pose.target_model import TargetModel, make_target

CENTRE = np.array([0.5, 0.0, 0.1])


@pytest.fixture(scope="module")
def model() -> TargetModel:
    mesh = trimesh.creation.box(extents=[0.06, 0.1, 0.2])
    return make_target(mesh.vertices, mesh.faces)


def start(
    model: TargetModel,
    can_look: Callable[[ViewRequest], bool] = lambda request: True,
    **config: object,
) -> tuple[ViewPlanner, Context]:
    settings = replace(ViewPlannerConfig(count=3), **config)
    planner = ViewPlanner(model, settings, 0.1, can_look=can_look)
    context = planner.CreateDefaultContext()
    X = np.eye(4)
    X[:3, 3] = CENTRE
    guess = PosePrior(X=X, rotation_sigma=0.2, translation_sigma=0.02)
    planner.GetInputPort("pose_guess").FixValue(context, AbstractValue.Make(guess))
    tick(planner, context, NO_MEASUREMENT)
    return planner, context


def tick(planner: ViewPlanner, context: Context, measured: PoseMeasurement) -> ViewRequest:
    port = planner.GetInputPort("pose_measurement")
    port.FixValue(context, AbstractValue.Make(measured))
    planner.ExecuteForcedEvents(context)
    request: ViewRequest = planner.GetOutputPort("view_latest").Eval(context)
    return request


def taken(request: ViewRequest) -> PoseMeasurement:
    """A view of a wall through the object's middle that faces the camera."""
    X = request.X_WC
    u, v = np.meshgrid(np.linspace(-0.25, 0.25, 50), np.linspace(-0.25, 0.25, 50))
    d = np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)])
    wall = np.linalg.norm(d[:, :2], axis=1) < 0.15
    points = X[:3, 3] + 0.55 * d[wall] @ X[:3, :3].T
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    return PoseMeasurement(
        kind="view",
        number=request.number,
        points=points,
        sigma=np.full(len(points), 1e-3),
        facing=np.zeros_like(points),
        eye=X[:3, 3],
        passed=d[~wall] @ X[:3, :3].T,
    )


def test_it_looks_at_the_object_from_all_sides() -> None:
    views = hemisphere(CENTRE, ViewPlannerConfig())
    assert len(views) == 96
    for X in views:
        assert_allclose(X[:3, :3] @ X[:3, :3].T, np.eye(3), atol=1e-12)
        assert_allclose(X[:3, 3] + 0.55 * X[:3, 2], CENTRE, atol=1e-12)
        assert abs(X[2, 0]) < 1e-9  # Its x is level.
        assert X[2, 1] < 0.0  # Its y points down.


def test_the_second_view_is_from_another_side(model: TargetModel) -> None:
    planner, context = start(model)
    first: ViewRequest = planner.GetOutputPort("view_latest").Eval(context)
    assert first.number == 1
    second = tick(planner, context, taken(first))
    assert second.number == 2
    assert second.gain == pytest.approx(second.gains.max())
    assert first.X_WC[:2, 2] @ second.X_WC[:2, 2] < 1e-9  # A quarter turn away, at least.
    assert tick(planner, context, taken(first)) is second  # Nothing new has come.
    third = tick(planner, context, taken(second))
    assert third.number == 3
    assert tick(planner, context, taken(third)) is third


def test_before_the_object_is_looked_for_no_view_is_wanted(model: TargetModel) -> None:
    planner = ViewPlanner(model, ViewPlannerConfig(count=3), 0.1)
    context = planner.CreateDefaultContext()
    planner.GetInputPort("pose_guess").FixValue(context, AbstractValue.Make(NO_PRIOR))
    assert tick(planner, context, NO_MEASUREMENT) is NO_VIEW


def test_a_robot_gets_the_best_view_that_it_can_look_from(model: TargetModel) -> None:
    offered: list[ViewRequest] = []

    def can_look(request: ViewRequest) -> bool:
        offered.append(request)
        return len(offered) == 3

    planner, context = start(model, can_look)
    first: ViewRequest = planner.GetOutputPort("view_latest").Eval(context)
    assert first is offered[2]
    offered.clear()
    second = tick(planner, context, taken(first))
    assert second is offered[2]
    gains = [request.gain for request in offered]
    assert gains == sorted(second.gains, reverse=True)[:3]


def test_a_robot_is_told_what_not_to_hit(model: TargetModel) -> None:
    planner, context = start(model)
    view: ViewRequest = planner.GetOutputPort("view_latest").Eval(context)
    assert_allclose(view.X_WB[:3, 3], CENTRE)
    # Twice what is not known of the place, around the object's sphere.
    assert_allclose(view.box_edges, 2.0 * (model.radius + 0.04), atol=0.02)


def test_without_a_view_that_it_can_look_from_the_best_one_is_wanted(model: TargetModel) -> None:
    planner, context = start(model, lambda request: False)
    first: ViewRequest = planner.GetOutputPort("view_latest").Eval(context)
    assert first.number == 1
    second = tick(planner, context, taken(first))
    best = second.candidates[np.argmax(second.gains)]
    assert_allclose(second.X_WC, best)


def test_the_grid_can_be_read(model: TargetModel) -> None:
    planner, context = start(model)
    fresh = planner.CreateDefaultContext()
    assert planner.GetOutputPort("grid_latest").Eval(fresh) is NO_GRID
    request: ViewRequest = planner.GetOutputPort("view_latest").Eval(context)
    empty = planner.GetOutputPort("grid_latest").Eval(context)
    assert not empty.log_odds.any()
    assert_allclose(empty.cell * np.array(empty.log_odds.shape), request.box_edges)
    tick(planner, context, taken(request))
    seen = planner.GetOutputPort("grid_latest").Eval(context)
    assert (seen.log_odds > 0.0).any()
    tick(planner, context, taken(request))  # Nothing new has come.
    assert planner.GetOutputPort("grid_latest").Eval(context) is seen


def test_later_views_are_around_where_the_object_is_believed_to_be(model: TargetModel) -> None:
    """It is 8 cm beside the first guess."""
    planner, context = start(model, distance=0.4)
    first = planner.GetOutputPort("view_latest").Eval(context)
    found = CENTRE + np.array([0.08, 0.0, 0.0])
    X = np.eye(4)
    X[:3, 3] = found
    belief = replace(UNKNOWN_POSE, known=True, number=1, X=X, samples=np.array([X, X]))
    planner.GetInputPort("object_pose").FixValue(context, AbstractValue.Make(belief))
    request = tick(planner, context, taken(first))
    assert request.number == 2
    assert_allclose(request.X_WB[:3, 3], found)
    assert_allclose(request.box_edges, [0.06, 0.1, 0.2])
    assert (first.box_edges > request.box_edges).all()
    eye, axis = request.X_WC[:3, 3], request.X_WC[:3, 2]
    assert_allclose(eye + 0.4 * axis, found, atol=1e-9)


def test_views_end_when_the_pose_has_settled(model: TargetModel) -> None:
    """The next view waits until the last one is in the belief."""
    planner, context = start(model, settled_translation=5e-3, settled_rotation=2.0)
    first: ViewRequest = planner.GetOutputPort("view_latest").Eval(context)
    pose = planner.GetInputPort("object_pose")

    def believed(number: int, x: float) -> None:
        X = np.eye(4)
        X[0, 3] = x
        belief = replace(UNKNOWN_POSE, known=True, X=X, number=number)
        pose.FixValue(context, AbstractValue.Make(belief))

    believed(0, 0.0)
    assert tick(planner, context, taken(first)) is first
    believed(1, 0.02)
    second = tick(planner, context, taken(first))
    assert (second.number, second.done) == (2, False)
    believed(2, 0.024)
    last = tick(planner, context, taken(second))
    assert (last.number, last.done) == (2, True)


def test_a_static_camera_stays(model: TargetModel) -> None:
    planner, context = start(model, criterion="same")
    first: ViewRequest = planner.GetOutputPort("view_latest").Eval(context)
    second = tick(planner, context, taken(first))
    assert second.number == 2
    assert_allclose(second.X_WC, first.X_WC)


def test_an_unknown_criterion_is_refused(model: TargetModel) -> None:
    with pytest.raises(ValueError, match="criterion = 'best', but it must be one of entropy"):
        start(model, criterion="best")
