"""The estimator through its ports, and how measurements become evidence."""

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context

from crossmodal.systems.port_values import NO_MEASUREMENT, NO_PRIOR, PoseMeasurement, PosePrior
from crossmodal.systems.pose.evidence import Evidence, Table
from crossmodal.systems.pose.pose_belief import SolverConfig
from crossmodal.systems.pose.pose_estimators import (
    PoseEstimator,
    motions_on_a_table,
    quaternion_filter,
    sampled_density,
    with_measurement,
)
from crossmodal.systems.pose.quaternion_filter import QuaternionFilterConfig
from crossmodal.systems.pose.target_model import TargetModel, make_target

X = np.eye(4)
X[:3, 3] = [0.5, 0.0, 0.1]


@pytest.fixture(scope="module")
def model() -> TargetModel:
    mesh = trimesh.creation.box(extents=[0.06, 0.1, 0.2])
    return make_target(mesh.vertices, mesh.faces)


def measured(model: TargetModel, number: int, count: int = 200) -> PoseMeasurement:
    rng = np.random.default_rng(number)
    rows = rng.choice(len(model.surface.points), count, replace=False)
    return PoseMeasurement(
        kind="view",
        number=number,
        points=model.surface.points[rows] + X[:3, 3] + 1e-3 * rng.normal(size=(count, 3)),
        sigma=np.full(count, 1e-3),
        facing=model.surface.normals[rows],
    )


def start(model: TargetModel, quaternion: bool) -> tuple[PoseEstimator, Context]:
    infer = (
        quaternion_filter(QuaternionFilterConfig())
        if quaternion
        else sampled_density(SolverConfig())
    )
    estimator = PoseEstimator(model, infer, None, 0.1)
    context = estimator.CreateDefaultContext()
    guess = X.copy()
    guess[:3, 3] += [0.02, -0.01, 0.01]
    prior = PosePrior(X=guess, rotation_sigma=0.1, translation_sigma=0.02)
    estimator.GetInputPort("pose_guess").FixValue(context, AbstractValue.Make(prior))
    measurement(estimator, context, NO_MEASUREMENT)
    return estimator, context


def measurement(estimator: PoseEstimator, context: Context, value: PoseMeasurement) -> None:
    port = estimator.GetInputPort("pose_measurement")
    port.FixValue(context, AbstractValue.Make(value))


@pytest.mark.parametrize("quaternion", [False, True])
def test_it_reacts_in_the_same_tick_and_remembers_from_the_next_on(
    model: TargetModel, quaternion: bool
) -> None:
    estimator, context = start(model, quaternion)
    estimated, latest = (
        estimator.GetOutputPort(f"object_pose_{name}") for name in ("estimated", "latest")
    )
    assert not latest.Eval(context).known
    assert estimated.Eval(context).number == 0
    estimator.ExecuteForcedEvents(context)
    measurement(estimator, context, measured(model, 1))
    assert latest.Eval(context).number == 0
    found = estimated.Eval(context)
    assert found.number == 1
    assert np.linalg.norm(found.X[:3, 3] - X[:3, 3]) < 3e-3
    estimator.ExecuteForcedEvents(context)
    assert latest.Eval(context).number == 1
    before = latest.Eval(context)
    estimator.ExecuteForcedEvents(context)
    assert latest.Eval(context) is before


def test_before_the_object_is_looked_for_nothing_is_believed(model: TargetModel) -> None:
    estimator, context = start(model, False)
    estimator.GetInputPort("pose_guess").FixValue(context, AbstractValue.Make(NO_PRIOR))
    measurement(estimator, context, measured(model, 1))
    assert not estimator.GetOutputPort("object_pose_estimated").Eval(context).known


def test_the_estimate_depends_on_its_inputs_and_the_latest_on_the_state_alone(
    model: TargetModel,
) -> None:
    estimator, _ = start(model, False)
    for index in range(2):
        through = [
            estimator.HasDirectFeedthrough(index, estimator.GetOutputPort(name).get_index())
            for name in ("object_pose_estimated", "object_pose_latest")
        ]
        assert through == [True, False]


def test_an_object_that_a_contact_moves_is_found_where_it_is_now(model: TargetModel) -> None:
    """It is seen, then slides by 3 mm as it is touched: the contacts know better."""
    slid = np.array([3e-3, 0.0, 0.0])
    prior = PosePrior(X=X, rotation_sigma=0.1, translation_sigma=0.02)
    off = []
    for moved in (0.0, 3e-3):
        table = Table(height=0.0, height_sigma=1e-3)
        estimator = PoseEstimator(model, sampled_density(SolverConfig()), table, 0.1, moved)
        context = estimator.CreateDefaultContext()
        estimator.GetInputPort("pose_guess").FixValue(context, AbstractValue.Make(prior))
        measurement(estimator, context, measured(model, 1))
        estimator.ExecuteForcedEvents(context)
        for number, side in enumerate((-1.0, 1.0), start=2):
            face = np.array([side, 0.0, 0.0])
            touch = PoseMeasurement(
                kind="touch",
                number=number,
                points=(X[:3, 3] + slid + 0.03 * face)[None],
                sigma=np.array([3e-4]),
                facing=face[None],
            )
            measurement(estimator, context, touch)
            estimator.ExecuteForcedEvents(context)
        belief = estimator.GetOutputPort("object_pose_latest").Eval(context)
        off.append(abs(belief.X[0, 3] - X[0, 3] - slid[0]))
    assert off[0] > 2e-3
    assert off[1] < 5e-4


def test_motions_on_a_table_are_slides_and_a_turn_about_the_middle(model: TargetModel) -> None:
    prior = PosePrior(X=X, rotation_sigma=0.1, translation_sigma=0.02)
    twists = motions_on_a_table(Table(), prior, model, 2e-3)
    assert_allclose(np.linalg.norm(twists[3:, 1:], axis=0), 2e-3)
    assert_allclose(twists[5], 0.0, atol=1e-12)
    assert_allclose(np.cross(twists[:3, 0], X[:3, 3]) + twists[3:, 0], 0.0, atol=1e-12)


def test_what_is_displaced_alike_is_one_group(model: TargetModel) -> None:
    def of(displaced: float, number: int) -> PoseMeasurement:
        value = measured(model, number, 5)
        A = np.full((6, 2), displaced)
        return PoseMeasurement(**{**vars(value), "displaced": A, "free": np.zeros((1, 2, 3))})

    evidence = Evidence()
    for number, displaced in enumerate((1.0, 2.0, 1.0)):
        evidence = with_measurement(evidence, of(displaced, number + 1))
    assert len(evidence.displaced) == 2
    assert evidence.group.tolist() == [0] * 5 + [1] * 5 + [0] * 5
    assert evidence.free_group.tolist() == [0, 1, 0]
    assert evidence.free.shape == (3, 2, 3)
    assert with_measurement(evidence, NO_MEASUREMENT) is evidence
