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
from crossmodal.systems.port_values import UNKNOWN_POSE, ObjectPose, TouchRequest
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
    assert asked(planner, context, belief(model, 4)).done


def test_what_no_approach_can_reach_ends_it_and_says_why(model: TargetModel) -> None:
    config = TouchPlannerConfig(after_views=0, touch=TouchConfig(clearance=1.0))
    planner = TouchPlanner(model, config, 0.0, 0.1)
    request = asked(planner, planner.CreateDefaultContext(), belief(model, 0))
    assert (request.done, request.why) == (True, "no approach is clear")
    planner = TouchPlanner(model, TouchPlannerConfig(after_views=0), 0.0, 0.1)
    aside = belief(model, 0)
    samples = aside.samples.copy()
    samples[:, :3, 3] += 1.0  # No approach to the reported pose passes there.
    request = asked(planner, planner.CreateDefaultContext(), replace(aside, samples=samples))
    assert (request.done, request.why) == (True, "no approach meets the object")


def test_an_unknown_criterion_is_refused(model: TargetModel) -> None:
    with pytest.raises(ValueError, match="criterion = 'best', but it must be one of random"):
        TouchPlanner(model, TouchPlannerConfig(criterion="best"), 0.0, 0.1)
