"""The system through its ports, in a context and in a diagram with a loop."""

import re
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.common.value import AbstractValue
from pydrake.common.yaml import yaml_load_typed
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem

from maths import se3
from maths.consistency import chi_square_bounds
from maths.gaussian import nees
from systems.kinematics.joint_filters import JointFiltersConfig
from systems.kinematics.joint_graph import merge_bodies
from systems.kinematics.joint_pairs import possible_pairs, relative_pose
from systems.kinematics.kinematic_model import KinematicModel, KinematicModelConfig
from systems.kinematics.measurement_errors import MeasurementErrorsConfig
from systems.port_values import (
    HEALTHY,
    HELD_BODY,
    BodyMotion,
    BodyMotions,
    BodyPredictions,
    HeldBody,
    JointBeliefs,
    JointType,
    MotionBelief,
    PoseBelief,
    StreamHealth,
)

REFERENCE_ERROR = np.diag(np.repeat([2.5e-3, 3.6e-5], 3))
COVARIANCE = np.diag(np.repeat([1e-5, 1e-6, 1e-4, 1e-4], 3))


def _body(body_id: int, x: float, V: float = 0.0, seed: int | None = None) -> BodyMotion:
    """A body that has slid along W's x axis by `x` [m], at `V` [m/s]."""
    reference = np.eye(4)
    reference[:3, 3] = [1.0, 0.1 * body_id, 0.5]
    X = reference.copy()
    X[0, 3] += x
    if seed is not None:
        noise = np.random.default_rng(seed).normal(size=6)
        X = X @ se3.exp(np.sqrt(np.diag(COVARIANCE)[:6]) * noise)
    body = BodyMotion(
        body_id=body_id,
        motion=MotionBelief(X=X, V=np.array([0.0, 0.0, 0.0, V, 0.0, 0.0]), covariance=COVARIANCE),
        X_WB_reference=reference,
        feature_ids=np.zeros(0, np.int64),
        p_BF=np.zeros((0, 3)),
        p_BF_covariance=np.zeros((0, 0)),
    )
    if body_id != HELD_BODY:
        return body
    return HeldBody(**vars(body), seen=None, seen_offset_covariance=np.zeros((6, 6)))


def test_what_the_eye_takes_for_the_held_body_is_none() -> None:
    held = _body(HELD_BODY, 0.1)
    seen = BodyMotion(**{name: getattr(held, name) for name in BodyMotion.__dataclass_fields__})
    assert merge_bodies([BodyMotions(bodies=[seen])]) == ({}, {})
    bodies, _ = merge_bodies([BodyMotions(bodies=[seen]), BodyMotions(bodies=[held])])
    assert bodies == {1: held}


class Driver:
    """Ticks a model by hand."""

    def __init__(self, model: KinematicModel) -> None:
        self.model = model
        self.simulator = Simulator(model)
        self.context: Context = self.simulator.get_mutable_context()
        self.context.SetTime(-0.5 / 15.0)

    def set(self, *bodies: BodyMotion, port: int = 0) -> None:
        self.model.get_input_port(port).FixValue(
            self.context, AbstractValue.Make(BodyMotions(bodies=list(bodies)))
        )

    def tick(self) -> None:
        """From between two ticks to between the next two."""
        self.simulator.AdvanceTo(self.context.get_time() + 1.0 / 15.0)

    def joints(self, role: str = "latest") -> JointBeliefs:
        joints: JointBeliefs = self.model.GetOutputPort(f"joints_{role}").Eval(self.context)
        return joints

    def health(self) -> StreamHealth:
        health: StreamHealth = self.model.GetOutputPort("health_latest").Eval(self.context)
        return health

    def pairs(self) -> list[tuple[int, int]]:
        return [(j.parent_id, j.child_id) for j in self.joints().joints]


def test_a_joint_that_is_not_measured_any_more_is_claimed_ever_less_surely() -> None:
    config = KinematicModelConfig()
    driver = Driver(KinematicModel(config))
    _slide(driver, 2)
    model = driver.joints().joints[0].models[JointType.PRISMATIC]
    q, rate = model.configuration
    driver.set()
    variances = [model.configuration_covariance[0, 0]]
    for k in range(1, 11):
        driver.tick()
        later = driver.joints().joints[0].models[JointType.PRISMATIC]
        assert later.configuration[0] == pytest.approx(q + 0.5 * rate * k / 15.0)
        assert later.configuration_covariance[0, 0] > (0.5 * rate * k / 15.0) ** 2
        variances.append(later.configuration_covariance[0, 0])
    assert np.all(np.diff(variances) > 0.0)
    least = 0.5 * config.filters.unmeasured_process_noise * (10.0 / 15.0) ** 3 / 3.0
    assert variances[-1] > least
    assert_allclose(later.axis_covariance, model.axis_covariance)
    driver.set(_body(2, 0.02 * 4.0, 0.02))
    driver.tick()
    again = driver.joints().joints[0].models[JointType.PRISMATIC]
    assert again.configuration_covariance[0, 0] < 0.1 * variances[-1]


@pytest.mark.parametrize("joint", [JointType.PRISMATIC, JointType.REVOLUTE])
def test_a_body_that_is_seen_when_it_moves_already_is_as_far_as_it_was_carried(
    joint: JointType,
) -> None:
    """The hand carries it for 0.9 s; its error of 2 mm stays when features are back."""
    errors = MeasurementErrorsConfig(
        correlated_rotation=3e-3, correlated_translation=3e-4, declared_time=5.0
    )
    model = KinematicModel(KinematicModelConfig(filters=JointFiltersConfig(errors=errors)))
    driver, lit = Driver(model), 14
    X_WA = np.eye(4)
    X_WA[:3, 3] = [0.5, 0.35, 0.0]  # The hinge, beside the handle.
    twist, speed = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0]), 0.018
    if joint == JointType.REVOLUTE:
        twist, speed = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]), 0.018 / 0.35
    rng = np.random.default_rng(0)
    for k in range(1, 31):
        body, seen = _body(HELD_BODY, 0.0), k > lit
        way = speed * (k - 1) / 15.0
        moved = X_WA @ se3.exp(way * twist) @ se3.inverse(X_WA) @ body.X_WB_reference
        share, since = min(k / lit, 1.0), (k - lit * seen) / 15.0
        carried = np.diag(np.repeat([0.02 * share, 2.3e-3 * share], 3) ** 2)
        noise = np.repeat([1e-3, 2e-4], 3)
        settling = np.repeat([5e-3, 6e-4] if seen else [0.05, 6e-3], 3) * np.exp(-0.5 * since)
        error = np.array([0.0, 0.0, 0.0, 2e-3, 0.0, 0.0])
        body.motion.X = moved @ se3.exp(share * error) @ se3.exp(noise * rng.normal(size=6))
        body.motion.covariance = COVARIANCE.copy()
        body.motion.covariance[:6, :6] = carried + np.diag(noise**2)
        body.correlated_covariance = np.diag(settling**2) + (0.0 if seen else 1.0) * carried
        body.reset_count = int(seen)
        body.offset_covariance = float(seen) * carried
        driver.set(body)
        driver.tick()
    belief = driver.joints().joints[0].models[joint]
    std = np.sqrt(belief.configuration_covariance[0, 0])
    assert driver.joints().joints[0].probabilities[JointType.RIGID] < 0.01
    assert abs(abs(belief.configuration[0]) - way) < 2.0 * std
    assert std < (3e-3 if joint == JointType.PRISMATIC else 0.05)


def _slide(driver: Driver, body_id: int, ticks: int = 45) -> None:
    for k in range(1, ticks + 1):
        driver.set(_body(body_id, 0.02 * k / 15.0, 0.02, seed=k))
        driver.tick()


def test_documented_ports_are_the_declared_ones() -> None:
    model = KinematicModel(KinematicModelConfig(), inputs=2)
    text = KinematicModel.__doc__ or ""
    found = re.search(r"input_ports:\n(.*?)output_ports:\n(.*?)\n\n", text, re.S)
    assert found is not None
    inputs = [model.get_input_port(i).get_name() for i in range(model.num_input_ports())]
    outputs = [model.get_output_port(i).get_name() for i in range(model.num_output_ports())]
    assert re.findall(r"- (\w+)", found.group(1)) == inputs
    assert re.findall(r"- (\w+)", found.group(2)) == outputs
    assert all(f"`{port}`" in text for port in inputs + outputs)


def test_a_sliding_body_becomes_a_prismatic_joint_of_the_environment() -> None:
    driver = Driver(KinematicModel(KinematicModelConfig()))
    _slide(driver, 3)
    (joint,) = driver.joints().joints
    assert (joint.parent_id, joint.child_id, joint.updates) == (0, 3, 45)
    assert joint.type == JointType.PRISMATIC
    assert_allclose(joint.model.axis_P, [1.0, 0.0, 0.0], atol=0.05)
    assert_allclose(joint.model.configuration, [0.06, 0.02], atol=5e-3)


def test_the_estimate_reacts_in_the_same_tick_and_the_latest_only_after_it() -> None:
    driver = Driver(KinematicModel(KinematicModelConfig()))
    driver.set(_body(2, 0.0))
    assert driver.joints().joints == []
    assert driver.joints("estimated").joints[0].child_id == 2
    estimated = driver.joints("estimated").joints[0]
    driver.tick()
    latest = driver.joints().joints[0]
    assert latest.probabilities == estimated.probabilities
    assert latest.updates == 1


def test_predictions_and_latest_depend_on_the_state_alone() -> None:
    model = KinematicModel(KinematicModelConfig(), inputs=2)
    for i in range(2):
        through = [
            model.HasDirectFeedthrough(i, model.GetOutputPort(name).get_index())
            for name in (
                "joints_estimated",
                "joints_latest",
                "body_motions_latest",
                "bodies_predicted",
                "health_latest",
            )
        ]
        assert through == [True, False, False, False, False]


def test_a_later_port_overrides_a_body_and_an_unconnected_one_is_empty() -> None:
    driver = Driver(KinematicModel(KinematicModelConfig(), inputs=3))
    driver.set(_body(1, 0.0), _body(2, 0.0), port=0)
    driver.set(_body(2, 0.3), port=1)
    driver.tick()
    predictions = driver.model.GetOutputPort("bodies_predicted").Eval(driver.context).predictions
    x = {p.body_id: p.pose.X[0, 3] for p in reversed(predictions) if " on " not in p.source}
    assert_allclose(x[2], 1.3, atol=0.05)
    assert_allclose(x[1], 1.0, atol=0.05)


def _broken(body: BodyMotion, **changes: object) -> BodyMotion:
    motion = {name: changes.pop(name) for name in ("X", "covariance") if name in changes}
    return replace(body, motion=replace(body.motion, **motion), **changes)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"X": np.full((4, 4), np.nan)}, "pose not finite"),
        ({"X": np.diag([1.0, 1.0, -1.0, 1.0])}, "no rotation"),
        ({"covariance": np.full((12, 12), np.nan)}, "covariance not finite"),
        ({"covariance": -COVARIANCE}, "covariance not positive semi-definite"),
        ({"covariance": COVARIANCE + np.eye(12, k=1)}, "covariance not symmetric"),
        ({"offset_covariance": 2.0 * COVARIANCE[:6, :6]}, "covariance not positive semi-definite"),
        ({"X_WB_reference": np.zeros((4, 4))}, "no rotation"),
    ],
)
def test_a_body_that_cannot_be_true_is_left_out_with_a_count_and_a_reason(
    changes: dict[str, object], reason: str
) -> None:
    driver = Driver(KinematicModel(KinematicModelConfig()))
    driver.set(_broken(_body(2, 0.0), **changes))
    driver.tick()
    assert driver.joints().joints == []
    _slide(driver, 2)
    before = driver.joints().joints[0]
    assert driver.health() == HEALTHY
    for ticks in (1, 2):
        driver.set(_broken(_body(2, 0.1), **changes), _body(3, 0.0))
        driver.tick()
        assert driver.health().fault == f"body 2: {reason}"
        assert_allclose(driver.health().age, ticks / 15.0)
        joint = driver.joints().joints[0]
        assert joint.skipped == {reason: ticks}
        assert (joint.updates, joint.probabilities) == (before.updates, before.probabilities)
    driver.set(_body(2, 0.062))
    driver.tick()
    joint = driver.joints().joints[0]
    assert driver.health() == HEALTHY
    assert (joint.updates, joint.type, joint.skipped) == (46, JointType.PRISMATIC, {reason: 2})


def test_a_broken_source_does_not_override_a_good_one() -> None:
    driver = Driver(KinematicModel(KinematicModelConfig(), inputs=2))
    driver.set(_body(2, 0.0), port=0)
    driver.set(_broken(_body(2, 0.0), X=np.full((4, 4), np.nan)), port=1)
    driver.tick()
    assert [joint.updates for joint in driver.joints().joints] == [1]
    assert driver.health().fault == "body 2: pose not finite"
    assert driver.health().age == 0.0


def test_two_bodies_too_far_apart_for_a_pair_are_no_pair() -> None:
    driver = Driver(KinematicModel(KinematicModelConfig()))
    driver.set(_body(2, 9e5), _body(3, -9e5))
    driver.tick()
    assert driver.pairs() == [(0, 2), (0, 3)]


def test_pairs_come_with_bodies_and_go_some_time_after_them() -> None:
    driver = Driver(KinematicModel(KinematicModelConfig(patience=0.2)))
    driver.set(_body(2, 0.0), _body(5, 0.0))
    driver.tick()
    assert driver.pairs() == [(0, 2), (0, 5), (5, 2)]
    driver.set(_body(5, 0.0))
    for _ in range(3):
        driver.tick()
    assert driver.pairs() == [(0, 2), (0, 5), (5, 2)]
    driver.tick()
    assert driver.pairs() == [(0, 5)]
    driver.set(_body(2, 0.0), _body(5, 0.0))
    driver.tick()
    assert [j.updates for j in driver.joints().joints] == [1, 6, 1]


def test_pairs_of_moving_bodies_take_turns_and_none_is_left_out() -> None:
    assert possible_pairs([4, 1, 3], []) == [(0, 1), (0, 3), (0, 4), (3, 1), (4, 1), (4, 3)]
    assert possible_pairs([3], [7]) == [(0, 3), (7, 3)]
    driver = Driver(KinematicModel(KinematicModelConfig(max_pairs=6)))
    driver.set(*(_body(i, 0.0) for i in (1, 2, 3, 4)))
    driver.tick()
    pairs = [(0, 1), (0, 2), (0, 3), (0, 4), (2, 1), (3, 1), (3, 2), (4, 1), (4, 2), (4, 3)]
    assert driver.pairs() == pairs
    before = _updates(driver)
    for tick in range(1, 4):
        driver.tick()
        after = _updates(driver)
        assert sum(after.values()) == sum(before.values()) + 6
        assert all(after[0, i] == tick + 1 for i in (1, 2, 3, 4))
        if tick == 1:  # The nearest first.
            turned = [pair for pair in pairs if pair[0] and after[pair] > before[pair]]
            assert [parent - child for parent, child in turned] == [1, 1]
        before = after
    assert {n for (parent, _), n in before.items() if parent} == {2}


def _updates(driver: Driver) -> dict[tuple[int, int], int]:
    return {(j.parent_id, j.child_id): j.updates for j in driver.joints().joints}


def test_pairs_that_take_turns_find_the_same_joints() -> None:
    types = []
    for max_pairs in (1, 36):
        driver = Driver(KinematicModel(KinematicModelConfig(max_pairs=max_pairs)))
        for k in range(1, 91):
            x = 0.02 * k / 15.0
            moves = {2: x, 3: x, 4: 0.0}
            driver.set(*(_body(i, q, seed=1000 * i + k) for i, q in moves.items()))
            driver.tick()
        types.append({(j.parent_id, j.child_id): j.type for j in driver.joints().joints})
    assert types[0] == types[1]
    assert types[0][3, 2] == JointType.RIGID
    assert types[0][4, 3] == JointType.PRISMATIC


def test_two_bodies_that_move_as_one_are_rigidly_connected() -> None:
    driver = Driver(KinematicModel(KinematicModelConfig()))
    for k in range(1, 61):
        x = 0.02 * k / 15.0
        driver.set(_body(2, x, 0.02, seed=k), _body(3, x, 0.02, seed=1000 + k))
        driver.tick()
    types = {(j.parent_id, j.child_id): j.type for j in driver.joints().joints}
    assert types == {
        (0, 2): JointType.PRISMATIC,
        (0, 3): JointType.PRISMATIC,
        (3, 2): JointType.RIGID,
    }


def test_the_prediction_is_for_the_next_tick_and_honest() -> None:
    driver = Driver(KinematicModel(KinematicModelConfig()))
    _slide(driver, 2)
    predictions = driver.model.GetOutputPort("bodies_predicted").Eval(driver.context).predictions
    assert predictions[0].source == "prismatic"
    expected = _body(2, 0.02 * 46 / 15.0).motion.X
    e = se3.log(se3.inverse(predictions[0].pose.X) @ expected)
    covariance = predictions[0].pose.covariance
    assert nees(e, covariance) < chi_square_bounds(6, 0.998)[1]
    assert np.linalg.norm(e[3:]) < 1.5e-3


def test_a_moving_parent_carries_its_child_s_prediction() -> None:
    driver = Driver(KinematicModel(KinematicModelConfig()))
    for k in range(1, 61):
        x = 0.02 * k / 15.0
        driver.set(_body(2, x, 0.02, seed=k), _body(3, x, 0.02, seed=1000 + k))
        driver.tick()
    predictions = driver.model.GetOutputPort("bodies_predicted").Eval(driver.context).predictions
    rigid = [p for p in predictions if p.source == "rigid on 3"]
    assert len(rigid) == 1
    assert rigid[0].body_id == 2
    expected = _body(2, 0.02 * 61 / 15.0).motion.X
    assert_allclose(rigid[0].pose.X, expected, atol=0.01)
    assert np.linalg.eigvalsh(rigid[0].pose.covariance).min() > 0.0


def _lid(k: int, seed: int) -> tuple[BodyMotion, BodyMotion]:
    """A lid (1) that turns by 0.1 rad/s for 60 ticks; its box (2) slides from tick 45 on."""
    box, lid = _body(2, 0.01 * max(0, k - 45) / 15.0, seed=seed), _body(1, 0.0)
    X_BoxLid = se3.inverse(box.X_WB_reference) @ lid.X_WB_reference
    hinge = np.array([0.0, 0.1 * min(k, 60) / 15.0, 0.0, 0.0, 0.0, 0.0])
    X_HingeLid = np.eye(4)
    X_HingeLid[:3, 3] = [0.15, 0.0, 0.0]
    turned = se3.inverse(X_HingeLid) @ se3.exp(hinge) @ X_HingeLid
    slid = _body(2, 0.01 * max(0, k - 45) / 15.0).motion.X
    noise = np.random.default_rng(1000 + seed).normal(size=6)
    error = se3.exp(np.sqrt(np.diag(COVARIANCE)[:6]) * noise)
    lid.motion.X = slid @ X_BoxLid @ turned @ error
    box.reference_age = (k - 45) / 15.0
    return lid, box


def test_a_body_that_begins_to_move_takes_over_what_the_environment_knew() -> None:
    driver = Driver(KinematicModel(KinematicModelConfig()))
    for k in range(1, 91):
        lid, box = _lid(k, seed=k)
        driver.set(*([lid, box] if k >= 55 else [lid]))  # Seen to move only 10 ticks later.
        driver.tick()
    joint = next(j for j in driver.joints().joints if (j.parent_id, j.child_id) == (2, 1))
    assert joint.type == JointType.REVOLUTE
    assert abs(joint.model.configuration[0]) == pytest.approx(0.4, abs=0.02)
    axis_in_box = np.array([0.0, 1.0, 0.0])
    assert abs(joint.model.axis_P @ axis_in_box) > 0.99
    assert joint.updates == 45 + 90 - 54


def test_a_body_whose_rest_is_unknown_or_long_ago_takes_over_nothing() -> None:
    for age in (float("nan"), 10.0):
        driver = Driver(KinematicModel(KinematicModelConfig()))
        for k in range(1, 57):
            lid, box = _lid(k, seed=k)
            box.reference_age = age
            driver.set(*([lid, box] if k >= 55 else [lid]))
            driver.tick()
        joint = next(j for j in driver.joints().joints if (j.parent_id, j.child_id) == (2, 1))
        assert joint.updates == 2


def test_a_joint_starts_where_its_parent_is_when_the_child_is_grasped() -> None:
    driver = Driver(KinematicModel(KinematicModelConfig()))
    for k in range(1, 71):
        box = _body(2, 0.0, seed=k)
        box.motion.X[2, 3] += 0.02 * min(k, 20) / 20.0  # Lifted while the hand closes.
        lid, _ = _lid(max(k - 25, 0), seed=k)
        if k < 40:
            lid.correlated_covariance = REFERENCE_ERROR * np.exp((25 - k) / 15.0)
        box.reference_age = k / 15.0
        driver.set(*([lid, box] if k >= 25 else [box]))
        driver.tick()
    joint = next(j for j in driver.joints().joints if (j.parent_id, j.child_id) == (2, 1))
    assert joint.type == JointType.REVOLUTE
    assert abs(joint.model.configuration[0]) == pytest.approx(0.3, abs=0.02)


def test_a_joint_outlives_the_sight_of_its_parent_which_is_taken_to_rest() -> None:
    driver = Driver(KinematicModel(KinematicModelConfig()))
    for k in range(1, 101):
        lid, box = _lid(k, seed=k)
        driver.set(*([lid, box] if 55 <= k < 80 else [lid]))
        if k < 80:
            driver.tick()
    before = next(j for j in driver.joints().joints if j.parent_id == 2)
    lid, _ = _lid(79, seed=1)  # Both have stopped when the eye loses the box.
    for age in range(1, 60):
        driver.set(lid)
        driver.tick()
        joint = next((j for j in driver.joints().joints if j.parent_id == 2), None)
        assert (joint is not None) == (age <= 33 + 15)  # As long as it was followed, then patience.
        if joint is not None and age == 33:
            assert joint.type == JointType.REVOLUTE
            assert joint.model.configuration[0] == pytest.approx(
                before.model.configuration[0], abs=0.02
            )
            variance = [j.model.configuration_covariance[0, 0] for j in (joint, before)]
            assert variance[0] > 2.0 * variance[1]


def test_the_bodies_that_the_joints_know_are_handed_on_for_as_long_as_the_joints() -> None:
    driver = Driver(KinematicModel(KinematicModelConfig(patience=0.2)))
    driver.set(_body(2, 0.1), _body(5, 0.0))
    driver.tick()
    driver.set(_body(5, 0.0))
    for known in ([2, 5], [2, 5], [2, 5], [5]):
        driver.tick()
        bodies = driver.model.GetOutputPort("body_motions_latest").Eval(driver.context).bodies
        assert [body.body_id for body in bodies] == known


def test_the_covariance_of_a_relative_pose_is_that_of_samples() -> None:
    rng = np.random.default_rng(0)
    A, B = 1e-2 * rng.normal(size=(2, 6, 6))
    parent = PoseBelief(X=se3.exp(rng.normal(size=6)), covariance=A @ A.T)
    child = PoseBelief(X=se3.exp(rng.normal(size=6)), covariance=B @ B.T)
    relative = relative_pose(parent, child)
    samples = np.array(
        [
            se3.log(
                se3.inverse(relative.X)
                @ se3.inverse(parent.X @ se3.exp(A @ rng.normal(size=6)))
                @ child.X
                @ se3.exp(B @ rng.normal(size=6))
            )
            for _ in range(20000)
        ]
    )
    scale = np.sqrt(np.diag(relative.covariance))
    assert_allclose(
        np.cov(samples.T) / np.outer(scale, scale),
        relative.covariance / np.outer(scale, scale),
        atol=0.06,
    )


class _Bodies(LeafSystem):
    """Stands for the body level: moves on by itself, reads the predictions in its update."""

    def __init__(self) -> None:
        super().__init__()
        self._predicted = self.DeclareAbstractInputPort(
            "joint_predictions", AbstractValue.Make(BodyPredictions())
        )
        self.seen: list[tuple[float, int]] = []
        self.DeclareAbstractOutputPort(
            "body_motions_estimated", lambda: AbstractValue.Make(BodyMotions()), self._calc
        )

    def _calc(self, context: Context, output: AbstractValue) -> None:
        predictions = self._predicted.Eval(context).predictions
        self.seen.append((context.get_time(), len(predictions)))
        tick = round(context.get_time() * 15.0)
        output.set_value(BodyMotions(bodies=[_body(2, 0.02 * tick / 15.0, seed=tick)]))


def test_the_loop_with_the_body_level_builds_and_each_predicts_the_other_s_next_tick() -> None:
    builder = DiagramBuilder()
    bodies, model = (
        builder.AddSystem(_Bodies()),
        builder.AddSystem(KinematicModel(KinematicModelConfig())),
    )
    builder.Connect(bodies.get_output_port(0), model.GetInputPort("body_motions"))
    builder.Connect(model.GetOutputPort("bodies_predicted"), bodies.get_input_port(0))
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(0.99 * 45 / 15.0)
    assert len(bodies.seen) == 45  # Once per tick.
    assert bodies.seen[0][1] == 0
    assert all(count > 0 for _, count in bodies.seen[1:])
    context = model.GetMyContextFromRoot(simulator.get_context())
    (joint,) = model.GetOutputPort("joints_latest").Eval(context).joints
    assert joint.updates == 45
    assert joint.type == JointType.PRISMATIC


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("period", 0.0),
        ("period", float("nan")),
        ("reference_age", -1.0),
        ("patience", -0.1),
        ("transfer_window", 0.0),
        ("rest_rotation", 0.0),
        ("rest_translation", float("inf")),
        ("max_pairs", 0),
        ("least_probability", 1.5),
    ],
)
def test_impossible_values_are_refused_by_name(field: str, value: float) -> None:
    with pytest.raises(ValueError, match=rf"^KinematicModel: {field} = .*, need"):
        KinematicModel(KinematicModelConfig(**{field: value}))


def test_filter_settings_are_checked_in_the_system_s_name() -> None:
    with pytest.raises(ValueError, match=r"^KinematicModel: filters.speed = -1.0 m/s, need"):
        KinematicModel(KinematicModelConfig(filters=JointFiltersConfig(speed=-1.0)))
    with pytest.raises(ValueError, match=r"^KinematicModel: inputs = 0, need"):
        KinematicModel(KinematicModelConfig(), inputs=0)


def test_the_config_is_read_from_yaml_with_the_filters_in_it() -> None:
    config = yaml_load_typed(
        schema=KinematicModelConfig,
        data="{period: 0.1, filters: {errors: {correlation_time: 2.0}}}",
    )
    assert (config.period, config.filters.errors.correlation_time) == (0.1, 2.0)
