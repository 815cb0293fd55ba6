"""The planner of touches through its ports."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context

from crossmodal.systems.active.touch_planner import TouchPlanner, TouchPlannerConfig
from crossmodal.systems.active.touch_planning import TouchConfig
from crossmodal.systems.port_values import UNKNOWN_POSE, ObjectPose, TouchRequest, ViewRequest
from crossmodal.systems.pose.target_model import TargetModel, make_target


@pytest.fixture(scope="module")
def model() -> TargetModel:
    mesh = trimesh.creation.box(extents=[0.06, 0.1, 0.2])
    return make_target(mesh.vertices, mesh.faces)


def belief(model: TargetModel, number: int, height: float = 0.1) -> ObjectPose:
    rng = np.random.default_rng(number)
    X = np.eye(4)
    X[:3, 3] = [0.5, 0.0, height]
    covariance = np.diag(np.repeat([1e-2, 2e-3], 3) ** 2)
    samples = np.tile(X, (64, 1, 1))
    samples[:, :3, 3] += 2e-3 * rng.normal(size=(64, 3))
    covariance = np.diag(np.repeat([1e-2, 2e-3], 3) ** 2)
    return replace(
        UNKNOWN_POSE,
        known=True,
        number=number,
        X=X,
        covariance=covariance,
        joint=covariance,
        samples=samples,
        middle=model.middle,
    )


def asked(planner: TouchPlanner, context: Context, pose: ObjectPose) -> TouchRequest:
    planner.GetInputPort("object_pose").FixValue(context, AbstractValue.Make(pose))
    request: TouchRequest = planner.GetOutputPort("touch_estimated").Eval(context)
    planner.ExecuteForcedEvents(context)
    return request


def test_touches_follow_measurements_until_all_are_done(model: TargetModel) -> None:
    config = TouchPlannerConfig(after_views=1, random_touches=1, chosen_touches=1)
    planner = TouchPlanner(model, config, 0.0, 0.1)
    context = planner.CreateDefaultContext()
    assert asked(planner, context, UNKNOWN_POSE).number == 0
    assert asked(planner, context, belief(model, 0)).number == 0  # The view has not come.
    first = asked(planner, context, belief(model, 1))
    assert (first.number, first.done) == (1, False)
    assert first.hit > 0.8
    assert asked(planner, context, belief(model, 1)) is first
    assert planner.GetOutputPort("touch_latest").Eval(context) is first
    second = asked(planner, context, belief(model, 2))
    assert second.number == 2
    assert second.candidates.shape == (len(second.gains), 2, 3)
    assert second.gain == second.gains.max()
    chosen = second.candidates[int(second.gains.argmax())]
    assert_allclose(chosen, [second.start, second.direction])
    last = asked(planner, context, belief(model, 3))
    assert (last.done, last.why) == (True, "all touches are done")
    # The arm has to find home around the object.
    assert_allclose(last.box_edges, first.box_edges, rtol=0.5)
    assert asked(planner, context, belief(model, 4)).done


def test_what_no_approach_can_reach_ends_it_and_says_why(model: TargetModel) -> None:
    config = TouchPlannerConfig(after_views=0, touch=TouchConfig(clearance=1.0))
    planner = TouchPlanner(model, config, 0.0, 0.1)
    request = asked(planner, planner.CreateDefaultContext(), belief(model, 0))
    assert (request.done, request.why) == (True, "no approach is clear")
    planner = TouchPlanner(model, TouchPlannerConfig(after_views=0), 0.0, 0.1)
    # No approach to where it is likeliest meets it at any of the poses that were drawn.
    torn = belief(model, 0)
    torn.samples[:, :2, 3] += 0.5
    request = asked(planner, planner.CreateDefaultContext(), torn)
    assert (request.done, request.why) == (True, "no approach meets the object")


def test_the_best_touch_that_the_robot_can_make_is_wanted(model: TargetModel) -> None:
    offered: list[TouchRequest] = []

    def can_touch(request: TouchRequest) -> bool:
        offered.append(request)
        return len(offered) == 4

    config = TouchPlannerConfig(after_views=1)
    planner = TouchPlanner(model, config, 0.0, 0.1, can_touch=can_touch)
    request = asked(planner, planner.CreateDefaultContext(), belief(model, 1))
    assert request is offered[3]
    assert (request.number, request.done) == (1, False)
    gains = [one.gain for one in offered]
    assert gains == sorted(gains, reverse=True)
    assert gains[0] > gains[3]
    willing = TouchPlanner(model, config, 0.0, 0.1)
    best = asked(willing, willing.CreateDefaultContext(), belief(model, 1))
    assert best.gain == gains[0]


def test_a_robot_that_can_make_no_touch_is_done(model: TargetModel) -> None:
    offered: list[TouchRequest] = []

    def can_touch(request: TouchRequest) -> bool:
        offered.append(request)
        return False

    config = TouchPlannerConfig(after_views=1, asked=7)
    planner = TouchPlanner(model, config, 0.0, 0.1, can_touch=can_touch)
    request = asked(planner, planner.CreateDefaultContext(), belief(model, 1))
    assert (request.number, request.done, request.why) == (0, True, "no feasible touch")
    assert len(offered) == 7
    # They are no neighbours: where the arm cannot get to, there are hundreds of alike ones.
    apart = [
        np.linalg.norm(one.start - other.start) + np.linalg.norm(one.direction - other.direction)
        for number, one in enumerate(offered)
        for other in offered[:number]
    ]
    assert min(apart) > 0.03


def test_a_touch_goes_through_the_box_that_holds_the_object(model: TargetModel) -> None:
    planner = TouchPlanner(model, TouchPlannerConfig(after_views=1), 0.0, 0.1)
    pose = belief(model, 1)
    request = asked(planner, planner.CreateDefaultContext(), pose)
    R, t = request.X_WB[:3, :3], request.X_WB[:3, 3]
    for X in pose.samples:
        p_B = (model.hull @ X[:3, :3].T + X[:3, 3] - t) @ R
        assert np.all(np.abs(p_B) <= 0.5 * request.box_edges + 1e-9)
    assert np.all(request.box_edges < model.hull.max(axis=0) * 2.0 + 0.02)
    start = (request.start - t) @ R
    assert np.any(np.abs(start) > 0.5 * request.box_edges)
    end = (request.start + request.expected * request.direction - t) @ R
    assert np.all(np.abs(end) <= 0.5 * request.box_edges + 5e-3)
    assert request.expected + 0.02 < request.reach < request.expected + 0.05


def test_an_arm_that_is_wrongly_calibrated_learns_more_by_a_touch(model: TargetModel) -> None:
    """Where the object is for the arm is less certain than where it is in W."""
    pose = belief(model, 1)
    joint = np.eye(9)
    joint[:6, :6] = pose.joint
    errors = np.random.default_rng(0).normal(size=(len(pose.samples), 3))
    pose = replace(pose, joint=joint, calibration=errors)
    displaced = np.vstack([np.zeros((3, 3)), 5e-3 * np.eye(3)])
    config = TouchPlannerConfig(after_views=1)
    gains = []
    for known in (None, displaced):
        planner = TouchPlanner(model, config, 0.0, 0.1, displaced=known)
        gains.append(asked(planner, planner.CreateDefaultContext(), pose).gain)
    assert gains[1] > 2.0 * gains[0]


def test_an_unknown_criterion_is_refused(model: TargetModel) -> None:
    with pytest.raises(ValueError, match="criterion = 'best', but it must be one of random"):
        TouchPlanner(model, TouchPlannerConfig(criterion="best"), 0.0, 0.1)


def test_touches_end_when_the_pose_has_settled(model: TargetModel) -> None:
    config = TouchPlannerConfig(
        after_views=3, chosen_touches=5, settled_translation=2e-3, settled_rotation=2.0
    )
    planner = TouchPlanner(model, config, 0.0, 0.1)
    context = planner.CreateDefaultContext()
    view = planner.GetInputPort("view_latest")
    view.FixValue(context, AbstractValue.Make(ViewRequest(number=1)))
    assert asked(planner, context, belief(model, 1)).number == 0
    # The views have ended early.
    view.FixValue(context, AbstractValue.Make(ViewRequest(number=1, done=True)))
    assert asked(planner, context, belief(model, 1)).number == 1
    assert asked(planner, context, moved(belief(model, 2), 3e-3)).number == 2
    last = asked(planner, context, moved(belief(model, 3), 4e-3))
    assert (last.number, last.done, last.why) == (2, True, "the pose has settled")


def moved(pose: ObjectPose, step: float) -> ObjectPose:
    X = pose.X.copy()
    X[0, 3] += step
    return replace(pose, X=X)
