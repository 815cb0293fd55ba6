from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation
from synthetic_episode import body_motion, joint_belief, synthetic_episode

from crossmodal.diagrams.joints.joint_metrics import (
    axis_angle_error,
    axis_distance_error,
    axis_nees,
    axis_sign,
    drawn_std,
    error_at,
    inside_claim,
    joint_episode,
    joint_in_world,
    joint_series,
    last_seen,
    motion_start,
    moving_at,
    rms_while_moving,
    select_joint,
    turning_point,
    type_settled_at,
)
from crossmodal.diagrams.joints.joint_truth import Truth
from crossmodal.diagrams.run.record import Tick
from crossmodal.maths.consistency import share_inside
from crossmodal.systems.port_values import (
    HELD_BODY,
    BodyMotions,
    JointBelief,
    JointBeliefs,
    JointType,
)

RNG = np.random.default_rng(5)
AXIS = np.array([0.6, 0.0, 0.8])


def truth_of(q: np.ndarray, joint_type: JointType = JointType.PRISMATIC) -> Truth:
    return Truth(
        name="slide",
        type=joint_type,
        axis_W=AXIS,
        point_W=np.array([1.0, 2.0, 3.0]),
        times=np.arange(len(q), dtype=float),
        configuration=q,
        X_WB=np.tile(np.eye(4), (len(q), 1, 1)),
        grasp_time=1.0,
    )


def tick_of(time: float, joints: JointBeliefs, bodies: BodyMotions | None = None) -> Tick:
    bodies = BodyMotions() if bodies is None else bodies
    return Tick(time=time, values={"joints_latest": joints, "body_motions_latest": bodies})


def tick(time: float, *joints: JointBelief) -> Tick:
    return tick_of(time, JointBeliefs(joints=list(joints)))


@pytest.mark.parametrize("angle", [0.0, 1e-8, 0.1, 1.0, np.pi / 2])
def test_axis_angle_error_is_the_angle_of_a_rotation_and_ignores_the_sign(angle: float) -> None:
    side = np.array([0.0, 1.0, 0.0])
    axis = Rotation.from_rotvec(angle * side).apply(AXIS)
    assert_allclose(axis_angle_error(axis, AXIS), angle, atol=1e-12)
    assert_allclose(axis_angle_error(-axis, AXIS), angle, atol=1e-12)


def test_axis_distance_error_ignores_the_way_along_the_axis() -> None:
    side = np.array([0.0, 1.0, 0.0])
    point = np.array([1.0, 2.0, 3.0])
    moved = point + 0.7 * AXIS + 0.03 * side
    assert_allclose(axis_distance_error(moved, point, AXIS), 0.03)


def test_axis_nees_of_an_isotropic_covariance_is_the_squared_angle_over_the_variance() -> None:
    axis = Rotation.from_rotvec([0.0, 0.3, 0.0]).apply(AXIS)
    covariance = 0.1**2 * (np.eye(3) - np.outer(axis, axis))
    assert_allclose(axis_nees(axis, covariance, AXIS), 9.0)


def test_axis_nees_has_two_degrees_of_freedom() -> None:
    u, v = np.array([0.0, 1.0, 0.0]), np.cross(AXIS, [0.0, 1.0, 0.0])
    covariance = 0.02**2 * np.outer(u, u) + 0.005**2 * np.outer(v, v)
    values = []
    for a, b in RNG.normal(size=(4000, 2)):
        error = 0.02 * a * u + 0.005 * b * v
        truth = Rotation.from_rotvec(np.cross(AXIS, error)).apply(AXIS)
        values.append(axis_nees(AXIS, covariance, truth))
    assert_allclose(np.mean(values), 2.0, atol=0.12)
    assert_allclose(share_inside(np.array(values), 2), 0.95, atol=0.015)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_flipping_axis_and_configuration_together_changes_nothing(sign: float) -> None:
    truth = truth_of(np.array([0.01, 0.01, 0.06]))
    joint = joint_belief(JointType.PRISMATIC, sign * AXIS, sign * 0.052, 0.002, 0.01)
    series = joint_series([tick(2.0, joint)], truth)
    assert axis_sign(sign * AXIS, AXIS) == sign
    assert_allclose(series.configuration, [0.052])
    assert_allclose(series.error, [0.002])
    assert_allclose(series.axis_error, [0.0], atol=1e-12)
    assert_allclose(series.configuration_nees, [1.0])
    assert_allclose(series.axis_nees, [0.0], atol=1e-12)


def test_the_true_opening_counts_from_the_grasp() -> None:
    truth = truth_of(np.array([0.0, 0.01, 0.03, 0.06]))
    assert_allclose(truth.opening(), [-0.01, 0.0, 0.02, 0.05])
    truth = replace(truth, grasp_time=float("nan"))
    assert len(truth.opening()) == 4


def test_after_a_lost_grasp_the_estimate_counts_from_the_next_one() -> None:
    truth = truth_of(np.array([0.0, 0.0, 0.05, 0.06, 0.10]))
    truth = replace(truth, regrasp_times=[3.0])
    first = joint_belief(JointType.PRISMATIC, AXIS, 0.052, 0.002, 0.01)
    second = joint_belief(JointType.PRISMATIC, AXIS, 0.041, 0.002, 0.01)
    series = joint_series([tick(2.0, first), tick(4.0, second)], truth)
    assert_allclose(series.error, [0.002, 0.001])
    assert_allclose(series.configuration, [0.052, 0.101])


def test_a_rigid_belief_means_no_opening_and_a_wrong_moving_type_has_no_error() -> None:
    truth = truth_of(np.array([0.0, 0.0, 0.05]))
    rigid = joint_belief(JointType.RIGID, AXIS, 0.3, 0.1, 0.1)
    wrong = joint_belief(JointType.REVOLUTE, AXIS, 0.3, 0.1, 0.1)
    series = joint_series([tick(2.0, rigid), tick(2.0, wrong), tick(2.0)], truth)
    assert_allclose(series.configuration, [0.0, 0.3, np.nan])
    assert_allclose(series.error, [-0.05, np.nan, np.nan])
    assert list(series.type_is_right) == [False, False, False]
    others = 0.03 / (len(JointType) - 1)
    assert_allclose(series.probability_true_type, [others, others, np.nan])


def test_a_rigid_claim_is_as_uncertain_as_the_other_types_of_the_unit_make_it() -> None:
    truth = truth_of(np.array([0.0, 0.0, 0.05]))
    rigid = joint_belief(JointType.RIGID, AXIS, 0.3, 0.1, 0.1, probability=0.6)
    moving = joint_belief(JointType.PRISMATIC, AXIS, 0.3, 0.1, 0.1)
    series = joint_series([tick(2.0, rigid), tick(2.0, moving), tick(2.0)], truth)
    assert_allclose(np.isnan(series.configuration_std), [True, False, True])
    # Of the types that slide, rigid has 0.6 and prismatic 0.1.
    assert_allclose(drawn_std(series, truth), [np.sqrt((0.3**2 + 0.1**2) / 7.0), 0.1, np.nan])
    door = truth_of(np.array([0.0, 0.0, 0.05]), JointType.REVOLUTE)
    # A hinge and a screw have 0.1 each.
    expected = np.sqrt((0.3**2 + 0.1**2) / 4.0)
    assert_allclose(drawn_std(joint_series([tick(2.0, rigid)], door), door), [expected])


def test_the_distance_of_a_revolute_axis_is_from_its_point() -> None:
    truth = truth_of(np.array([0.0, 0.0, 0.05]), JointType.REVOLUTE)
    point = truth.point_W + np.array([0.0, 0.02, 0.0]) + AXIS
    joint = joint_belief(JointType.REVOLUTE, AXIS, 0.05, 0.1, 0.1, point=point)
    assert_allclose(joint_series([tick(2.0, joint)], truth).distance_error, [0.02])


def test_the_held_body_is_chosen_before_the_one_seen_for_longest() -> None:
    held = joint_belief(JointType.PRISMATIC, AXIS, 0.0, 0.1, 0.1, child_id=1)
    first = joint_belief(JointType.PRISMATIC, AXIS, 0.0, 0.1, 0.1, child_id=2)
    second = joint_belief(JointType.PRISMATIC, AXIS, 0.0, 0.1, 0.1, child_id=3)
    between = joint_belief(JointType.PRISMATIC, AXIS, 0.0, 0.1, 0.1, child_id=4)
    between.parent_id, between.updates, second.updates, first.updates = 2, 99, 30, 20
    assert select_joint(JointBeliefs(joints=[first, held, second])) is held
    assert select_joint(JointBeliefs(joints=[first, second, between])) is second
    assert select_joint(JointBeliefs(joints=[between])) is None


def settled(kinds: list[JointType | None], start: int = 2) -> float | None:
    """Settled time of a sequence of likeliest types; the object has moved 5 mm from `start` on."""
    q = np.where(np.arange(len(kinds)) >= start, 0.006, 0.0)
    truth = truth_of(q)
    ticks = [
        tick(float(k))
        if kind is None
        else tick(float(k), joint_belief(kind, AXIS, 0.0, 0.01, 0.01))
        for k, kind in enumerate(kinds)
    ]
    series = joint_series(ticks, truth)
    assert motion_start(truth) == start
    return type_settled_at(series, truth)


def test_the_type_is_settled_after_its_last_error() -> None:
    right, wrong = JointType.PRISMATIC, JointType.RIGID
    assert settled([wrong, wrong, wrong, right, right]) == 1.0
    assert settled([wrong, wrong, right, wrong, right]) == 2.0
    assert settled([right, right, right, right, right]) == 0.0
    assert settled([right, right, right, right, wrong]) is None
    assert settled([None, None, None, None, None]) is None
    assert settled([wrong, wrong, None, right, right]) == 1.0
    assert settled([wrong, right, None, right, right]) == 1.0
    assert settled([wrong, wrong, right, right, None]) == 0.0


def test_a_still_object_has_no_motion_and_settles_no_type() -> None:
    truth = truth_of(np.full(5, 0.2))
    ticks = [tick(float(k), joint_belief(JointType.PRISMATIC, AXIS, 0, 1, 1)) for k in range(5)]
    assert motion_start(truth) is None
    assert type_settled_at(joint_series(ticks, truth), truth) is None
    assert not np.any(moving_at(truth.times, truth))


def test_consistency_is_judged_while_the_object_moves_only() -> None:
    truth = truth_of(np.array([0.0, 0.0, 0.02, 0.04, 0.06, 0.06, 0.06]))
    assert list(moving_at(truth.times, truth)) == [False, False, True, True, True, False, False]


def test_a_modality_that_loses_its_joint_is_last_seen_before() -> None:
    series = joint_episode(synthetic_episode()).series["vision"]
    last = last_seen(series)
    assert last is not None
    assert_allclose(series.times[last], 9.4666, atol=1e-3)
    assert np.isnan(series.error[last + 1])


def test_a_joint_between_moving_bodies_is_compared_where_its_parent_was_at_the_reference() -> None:
    R_WP = Rotation.from_euler("xyz", [0.3, -0.2, 0.5]).as_matrix()
    X_WP_0, X_WP = np.eye(4), np.eye(4)
    X_WP_0[:3, :3], X_WP_0[:3, 3] = R_WP, [0.4, -0.1, 0.7]
    X_WP[:3, :3], X_WP[:3, 3] = Rotation.from_rotvec([0, 0, 0.2]).as_matrix(), [0.5, 0.0, 0.7]
    truth = truth_of(np.array([0.0, 0.0, 0.3, 0.6]), JointType.REVOLUTE)
    truth = replace(truth, parent_moves=True)
    p_PA = R_WP.T @ (truth.point_W + 0.2 * AXIS - X_WP_0[:3, 3])
    lid = replace(
        joint_belief(JointType.REVOLUTE, R_WP.T @ AXIS, 0.6, 0.01, 0.01, point=p_PA),
        parent_id=HELD_BODY,
        child_id=2,
    )
    to_the_room = joint_belief(JointType.REVOLUTE, AXIS, 0.9, 0.01, 0.01)
    beliefs = JointBeliefs(joints=[to_the_room, lid])
    bodies = BodyMotions(bodies=[body_motion(HELD_BODY, X_WP, X_WP_0, np.zeros(0))])
    series = joint_series([tick_of(3.0, beliefs, bodies)], truth)
    assert_allclose(series.axis_error, 0.0, atol=1e-9)
    assert_allclose(series.distance_error, 0.0, atol=1e-9)
    assert_allclose(series.error, 0.0, atol=1e-9)
    drawn = joint_in_world(beliefs, bodies, parent_moves=True)
    assert drawn is not None
    assert_allclose(drawn.model.axis_P, X_WP[:3, :3] @ R_WP.T @ AXIS, atol=1e-12)
    assert select_joint(JointBeliefs(joints=[to_the_room]), parent_moves=True) is None


@pytest.mark.parametrize("q", [0.6, -0.6])
def test_of_two_bodies_that_are_only_seen_either_may_be_the_parent(q: float) -> None:
    truth = truth_of(np.array([0.0, 0.0, 0.3, 0.6]), JointType.REVOLUTE)
    truth = replace(truth, parent_moves=True)
    lid = joint_belief(JointType.REVOLUTE, AXIS, q, 0.01, 0.01, point=truth.point_W)
    bodies = BodyMotions(bodies=[body_motion(3, np.eye(4), np.eye(4), np.zeros(0))])

    def error(child_id: int) -> float:
        joint = replace(lid, parent_id=3, child_id=child_id)
        tick = tick_of(3.0, JointBeliefs(joints=[joint]), bodies)
        return float(joint_series([tick], truth).error[0])

    assert_allclose(error(child_id=2), 0.0, atol=1e-9)
    assert_allclose(error(child_id=HELD_BODY), q - 0.6, atol=1e-9)


@pytest.mark.parametrize("q", [0.58, -0.58])
def test_where_the_true_axis_is_not_known_only_the_configuration_is_scored(q: float) -> None:
    unknown = np.full(3, np.nan)
    truth = truth_of(np.array([0.0, 0.0, 0.3, 0.6]), JointType.REVOLUTE)
    truth = replace(truth, axis_W=unknown, point_W=unknown, X_WB=np.full((4, 4, 4), np.nan))
    series = joint_series([tick(3.0, joint_belief(JointType.REVOLUTE, AXIS, q, 0.01, 0.01))], truth)
    assert_allclose(series.error, -0.02, atol=1e-9)
    assert_allclose(series.configuration_nees, 4.0)
    assert np.isnan([*series.axis_error, *series.axis_nees, *series.distance_error]).all()


def test_a_tick_without_beliefs_is_one_without_a_joint() -> None:
    truth = truth_of(np.array([0.0, 0.0, 0.05]))
    series = joint_series([Tick(time=2.0, values={})], truth)
    assert series.joints == [None]
    assert np.isnan(series.configuration[0])


def test_the_turning_point_is_the_farthest_before_a_time() -> None:
    truth = truth_of(np.array([0.0, 0.0, -0.3, 0.1, 0.5]))
    assert turning_point(truth) == 4
    assert turning_point(truth, latest=3.5) == 2
    assert turning_point(truth, latest=-1.0) is None
    assert turning_point(truth_of(np.zeros(0))) is None


def test_the_error_at_a_time_is_that_of_the_nearest_tick() -> None:
    truth = truth_of(np.array([0.0, 0.0, 0.05, 0.10]))
    ticks = [
        tick(2.0, joint_belief(JointType.PRISMATIC, AXIS, 0.052, 0.002, 0.01)),
        tick(3.0, joint_belief(JointType.PRISMATIC, AXIS, 0.103, 0.002, 0.01)),
    ]
    series = joint_series(ticks, truth)
    assert_allclose(error_at(series, 2.4), [0.002, 0.0], atol=1e-9)
    assert_allclose(error_at(series, 9.0)[0], 0.003, atol=1e-9)
    assert np.all(np.isnan(error_at(joint_series([], truth), 2.0)))


def test_an_estimator_that_loses_the_joint_on_the_way_has_no_finite_error_of_moving() -> None:
    truth = truth_of(np.array([0.0, 0.0, 0.02, 0.04, 0.06, 0.06]))

    def moving(*seen: float) -> float:
        ticks = [
            tick(t, joint_belief(JointType.PRISMATIC, AXIS, 0.02 * (t - 1.0) + 0.003, 0.1, 0.1))
            if t in seen
            else tick(t)
            for t in (2.0, 3.0, 4.0)
        ]
        return rms_while_moving(joint_series(ticks, truth), truth)

    assert_allclose(moving(2.0, 3.0, 4.0), 0.003, atol=1e-9)
    assert_allclose(moving(2.0, 4.0), 0.003, atol=1e-9)
    assert moving(2.0) == np.inf
    still = truth_of(np.full(5, 0.2))
    assert np.isnan(rms_while_moving(joint_series([tick(2.0)], still), still))


@pytest.mark.parametrize(("deviations", "inside"), [(1.9, True), (2.1, False)])
def test_two_sigma_are_claimed(deviations: float, inside: bool) -> None:
    truth = truth_of(np.array([0.0, 0.0, 0.05]))
    joint = joint_belief(JointType.PRISMATIC, AXIS, 0.05 + deviations * 0.002, 0.002, 0.01)
    rigid = joint_belief(JointType.RIGID, AXIS, 0.0, 0.1, 0.1)
    series = joint_series([tick(2.0, joint), tick(2.0, rigid)], truth)
    assert inside_claim(series, 0) == (inside, True)
    assert inside_claim(series, 1) == (None, None)
