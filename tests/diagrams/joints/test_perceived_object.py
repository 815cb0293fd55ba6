"""The object is what the filters believe and moves as they saw it, without any truth."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from synthetic_episode import synthetic_episode

from benchmarks.exported_models import deviations, perceived_over_time, score
from crossmodal.diagrams.crossmodal.application import APPLICATION
from crossmodal.diagrams.joints.joint_truth import truth_of_ticks
from crossmodal.diagrams.joints.perceived_object import ROOT, perceived_object
from crossmodal.diagrams.run.record import EpisodeRecord, Tick
from crossmodal.maths import se3
from crossmodal.systems.object_models.articulated_object import ArticulatedObject
from crossmodal.systems.port_values import (
    HELD_BODY,
    BodyMotion,
    BodyMotions,
    DetentBelief,
    JointBelief,
    JointBeliefs,
    JointMechanics,
    JointMechanicsBelief,
    JointMechanicsBeliefs,
    JointType,
    LimitBelief,
)


def _last(record: EpisodeRecord, estimator: str = "crossmodal") -> ArticulatedObject:
    last = perceived_over_time(APPLICATION, record.estimators[estimator].ticks)[-1]
    assert last is not None
    return last


def _values(record: EpisodeRecord) -> tuple[Tick, JointBelief, BodyMotion]:
    """The last tick of the cross-modal estimator, its joint and its body."""
    tick = record.estimators["crossmodal"].ticks[-1]
    (joint,) = tick.values["joints_latest"].joints
    body = tick.values["body_motions_latest"].find(joint.child_id)
    assert body is not None
    return tick, joint, body


@pytest.mark.parametrize("kind", [JointType.PRISMATIC, JointType.REVOLUTE, JointType.SCREW])
@pytest.mark.parametrize("opens_to", [1.0, -1.0])
def test_the_object_moves_as_it_was_perceived(kind: JointType, opens_to: float) -> None:
    record = synthetic_episode(kind, opens_to=opens_to)
    ticks = record.estimators["crossmodal"].ticks
    each = perceived_over_time(APPLICATION, ticks)
    off = np.array(list(deviations(ticks, each)))
    assert len(off) > 100
    assert off[:, 0].max() < 0.03  # [rad]; of the episode's errors of axis and configuration.
    assert off[:, 1].max() < 0.012  # [m]
    (joint,) = _last(record).joints
    assert joint.type == kind
    assert joint.upper >= joint.q > 0.0 >= joint.lower
    assert score(_last(record), truth_of_ticks(record.station)) < 0.1


def test_a_joint_that_does_not_move_is_as_far_from_the_truth_as_can_be() -> None:
    record = synthetic_episode()
    found = _last(record)
    found.joints[0].type = "rigid"
    assert score(found, truth_of_ticks(record.station)) == pytest.approx(1.0)


def test_a_body_that_is_not_seen_leaves_its_path_where_it_was() -> None:
    record = synthetic_episode(JointType.REVOLUTE)
    tick, _, body = _values(record)
    before = _last(record)
    lost = replace(body, is_seen=False, motion=replace(body.motion, X=body.motion.X + 0.01))
    values = {**tick.values, "body_motions_latest": BodyMotions(bodies=[lost])}
    after = perceived_object(before, Tick(time=tick.time + 0.1, values=values))
    assert after is not None
    assert_allclose(after.joints[0].X_PB_zero, before.joints[0].X_PB_zero)
    assert_allclose(after.bodies[0].X_WB, before.joints[0].pose(before.joints[0].q), atol=1e-9)


def test_what_was_known_stays_when_nothing_is() -> None:
    record = synthetic_episode()
    before = _last(record)
    assert perceived_object(before, Tick(time=99.0, values={})) is before
    assert perceived_object(None, Tick(time=0.0, values={})) is None


def test_a_body_that_is_loose_is_joined_to_the_one_that_carries_it() -> None:
    tick, joint, lid = _values(synthetic_episode(JointType.REVOLUTE))
    X_WBox = se3.exp(np.array([0.0, 0.0, 0.3, 0.2, 0.1, 0.0]))
    box = replace(lid, body_id=2, motion=replace(lid.motion, X=X_WBox))
    loose = dict.fromkeys(JointType, 0.01) | {JointType.DISCONNECTED: 0.96}
    sliding = dict.fromkeys(JointType, 0.01) | {JointType.PRISMATIC: 0.96}
    beliefs = [
        replace(joint, probabilities=loose),
        replace(joint, child_id=2, probabilities=sliding),
        replace(joint, parent_id=2),
    ]
    values = {
        "joints_latest": JointBeliefs(joints=beliefs),
        "body_motions_latest": BodyMotions(bodies=[lid, box]),
    }
    found = perceived_object(None, Tick(time=tick.time, values=values))
    assert found is not None
    assert [(one.parent, one.child, one.type) for one in found.joints] == [
        (ROOT, "body_2", "prismatic"),
        ("body_2", "held_body", "revolute"),
    ]
    X_BoxLid = found.joints[1].pose(found.joints[1].q)
    assert_allclose(X_WBox @ X_BoxLid, lid.motion.X, atol=1e-9)


def _felt(joint: JointBelief, lower: LimitBelief, upper: LimitBelief) -> JointMechanicsBeliefs:
    belief = JointMechanicsBelief(
        friction=np.array([4.0, 7.0]),
        friction_covariance=np.diag([0.25, 9.0]),
        noise=0.3,
        samples=40,
        mean_speed=0.02,
        lower=lower,
        upper=upper,
        detent=DetentBelief(),
        force=5.0,
    )
    models = {JointType.PRISMATIC: belief}
    return JointMechanicsBeliefs(
        joints=[JointMechanics(parent_id=joint.parent_id, child_id=HELD_BODY, models=models)]
    )


def _limit(position: float, bound: float, probability: float) -> LimitBelief:
    return LimitBelief(
        probability=probability,
        position=position,
        variance=1e-6,
        bound=bound,
        bound_variance=4e-6,
    )


def test_friction_and_end_stops_are_those_that_were_felt() -> None:
    tick, joint, _ = _values(synthetic_episode())
    q = float(joint.model.configuration[0])
    felt = _felt(joint, _limit(math.nan, -0.01, 0.1), _limit(q + 0.02, q, 0.99))
    values = {**tick.values, "joint_mechanics_latest": felt}
    found = perceived_object(None, Tick(time=tick.time, values=values))
    assert found is not None
    (slide,) = found.joints
    assert (slide.lower, slide.lower_is_stop) == (-0.01, False)
    assert (slide.upper, slide.upper_is_stop) == (q + 0.02, True)
    assert (slide.lower_deviation, slide.upper_deviation) == pytest.approx((2e-3, 1e-3))
    assert (slide.friction, slide.friction_deviation) == (4.0, 0.5)
    assert (slide.damping, slide.damping_deviation) == (7.0, 3.0)


def test_a_joint_that_goes_to_the_other_side_is_turned_with_its_end_stops() -> None:
    tick, joint, _ = _values(synthetic_episode(opens_to=-1.0))
    q = float(joint.model.configuration[0])
    assert q < 0.0
    felt = _felt(joint, _limit(q - 0.02, q, 0.99), _limit(math.nan, 0.01, 0.1))
    values = {**tick.values, "joint_mechanics_latest": felt}
    found = perceived_object(None, Tick(time=tick.time, values=values))
    assert found is not None
    (slide,) = found.joints
    assert (slide.q, slide.upper, slide.lower) == pytest.approx((-q, 0.02 - q, -0.01))
    assert (slide.lower_is_stop, slide.upper_is_stop) == (False, True)
    assert_allclose(slide.axis_P, -joint.model.axis_P)


def test_a_shape_is_the_extent_of_the_landmarks() -> None:
    tick, _, body = _values(synthetic_episode())
    corners = np.array([[-0.1, 0.0, 0.2], [0.3, -0.2, 0.2]])
    seen = replace(body, p_BF=corners)
    values = {**tick.values, "body_motions_latest": BodyMotions(bodies=[seen])}
    found = perceived_object(None, Tick(time=tick.time, values=values))
    assert found is not None
    assert_allclose([found.bodies[0].low, found.bodies[0].high], [[-0.1, -0.2, 0.2], [0.3, 0, 0.2]])
    dark = replace(body, p_BF=np.zeros((0, 3)))
    values = {**tick.values, "body_motions_latest": BodyMotions(bodies=[dark])}
    after = perceived_object(found, Tick(time=tick.time + 0.1, values=values))
    assert after is not None
    assert_allclose(after.bodies[0].high, found.bodies[0].high)
