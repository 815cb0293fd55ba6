"""The system through its ports, in a context and in a diagram with a loop."""

from dataclasses import replace

import numpy as np
import pytest
from kinematic_driver import COVARIANCE, REFERENCE_ERROR, Driver, slide, sliding_body
from numpy.testing import assert_allclose
from pydrake.common.value import AbstractValue
from pydrake.common.yaml import yaml_load_typed
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem

from crossmodal.maths import se3
from crossmodal.maths.consistency import chi_square_bounds
from crossmodal.maths.gaussian import nees
from crossmodal.systems.kinematics.calibration_errors import SensorCalibration
from crossmodal.systems.kinematics.joint_filters import JointFiltersConfig
from crossmodal.systems.kinematics.joint_graph import merge_bodies
from crossmodal.systems.kinematics.kinematic_model import KinematicModel, KinematicModelConfig
from crossmodal.systems.kinematics.measurement_errors import MeasurementErrorsConfig
from crossmodal.systems.port_values import (
    HEALTHY,
    HELD_BODY,
    BodyMotion,
    BodyMotions,
    BodyPredictions,
    JointType,
)


def test_what_the_eye_takes_for_the_held_body_is_none() -> None:
    held = sliding_body(HELD_BODY, 0.1)
    seen = BodyMotion(**{name: getattr(held, name) for name in BodyMotion.__dataclass_fields__})
    assert merge_bodies([BodyMotions(bodies=[seen])]) == ({}, {})
    bodies, _ = merge_bodies([BodyMotions(bodies=[seen]), BodyMotions(bodies=[held])])
    assert bodies == {1: held}


def test_a_joint_that_is_not_measured_any_more_is_reported_ever_less_surely() -> None:
    config = KinematicModelConfig()
    driver = Driver(KinematicModel(config))
    slide(driver, 2)
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
    driver.set(sliding_body(2, 0.02 * 4.0, 0.02))
    driver.tick()
    again = driver.joints().joints[0].models[JointType.PRISMATIC]
    assert again.configuration_covariance[0, 0] < 0.1 * variances[-1]


@pytest.mark.parametrize(("body_id", "rotation"), [(2, 0.02), (HELD_BODY, 0.03)])
def test_an_axis_is_known_as_well_as_the_camera_or_else_the_arm(
    body_id: int, rotation: float
) -> None:
    camera, arm = (
        SensorCalibration(X_WF=np.eye(4), covariance=np.diag(np.repeat([std**2, 0.0], 3)))
        for std in (0.02, 0.03)
    )
    found = []
    for model in (
        KinematicModel(KinematicModelConfig()),
        KinematicModel(KinematicModelConfig(), camera=camera, arm=arm),
    ):
        driver = Driver(model)
        slide(driver, body_id)
        found.append(driver.joints().joints[0].models[JointType.PRISMATIC].axis_covariance)
    assert np.trace(found[1] - found[0]) == pytest.approx(2.0 * rotation**2)


@pytest.mark.parametrize("joint", [JointType.PRISMATIC, JointType.REVOLUTE])
def test_a_body_that_is_seen_when_it_moves_already_is_as_far_as_it_was_carried(
    joint: JointType,
) -> None:
    """The hand carries it for 0.9 s; its error of 2 mm stays when features are back."""
    filters = JointFiltersConfig(errors=MeasurementErrorsConfig(declared_time=5.0))
    model = KinematicModel(KinematicModelConfig(filters=filters))
    driver, lit = Driver(model), 14
    X_WA = np.eye(4)
    X_WA[:3, 3] = [0.5, 0.35, 0.0]  # The hinge, beside the handle.
    twist, speed = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0]), 0.018
    if joint == JointType.REVOLUTE:
        twist, speed = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]), 0.018 / 0.35
    rng = np.random.default_rng(0)
    for k in range(1, 31):
        body, seen = sliding_body(HELD_BODY, 0.0), k > lit
        displacement = speed * (k - 1) / 15.0
        moved = X_WA @ se3.exp(displacement * twist) @ se3.inverse(X_WA) @ body.X_WB_reference
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
    assert abs(abs(belief.configuration[0]) - displacement) < 2.0 * std
    assert std < (3e-3 if joint == JointType.PRISMATIC else 0.05)


def test_a_body_that_the_hand_seemed_to_have_lost_counts_from_where_the_hand_closed() -> None:
    """For two seconds it measures nothing, longer than the model's patience."""
    driver = Driver(KinematicModel(KinematicModelConfig()))
    for k in range(91):
        body = sliding_body(HELD_BODY, 0.002 * max(k - 15, 0), 0.03, seed=k)
        body.is_seen = not 30 <= k < 60
        driver.set(body)
        driver.tick()
    joint = driver.joints().joints[0]
    assert joint.updates == 60
    assert joint.reference_age == pytest.approx(90 / 15)
    model = joint.models[JointType.PRISMATIC]
    assert abs(model.configuration[0]) == pytest.approx(0.15, abs=2e-3)


def test_an_error_that_all_ticks_share_is_not_averaged_away() -> None:
    """The landmarks of a held body are 2 mm off along its way from its second tick on."""
    constant = np.diag(np.repeat([1e-6, 4e-6], 3))
    driver = Driver(KinematicModel(KinematicModelConfig()))
    for k in range(46):
        body = sliding_body(HELD_BODY, 0.002 * k + 0.002 * (k > 0), seed=k)
        body.correlated_covariance = (k == 0) * REFERENCE_ERROR
        body.motion.covariance = COVARIANCE.copy()
        body.offset_covariance = (k > 0) * constant
        body.motion.covariance[:6, :6] += body.offset_covariance
        driver.set(body)
        driver.tick()
    model = driver.joints().joints[0].models[JointType.PRISMATIC]
    assert abs(model.configuration[0]) == pytest.approx(0.092, abs=5e-4)
    assert 2e-3 < np.sqrt(model.configuration_covariance[0, 0]) < 2.5e-3


def test_a_sliding_body_becomes_a_prismatic_joint_of_the_environment() -> None:
    driver = Driver(KinematicModel(KinematicModelConfig()))
    slide(driver, 3)
    (joint,) = driver.joints().joints
    assert (joint.parent_id, joint.child_id, joint.updates) == (0, 3, 45)
    assert joint.type == JointType.PRISMATIC
    assert_allclose(joint.model.axis_P, [1.0, 0.0, 0.0], atol=0.05)
    assert_allclose(joint.model.configuration, [0.06, 0.02], atol=5e-3)


def test_the_estimate_reacts_in_the_same_tick_and_the_latest_only_after_it() -> None:
    driver = Driver(KinematicModel(KinematicModelConfig()))
    driver.set(sliding_body(2, 0.0))
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
    driver.set(sliding_body(1, 0.0), sliding_body(2, 0.0), port=0)
    driver.set(sliding_body(2, 0.3), port=1)
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
    driver.set(_broken(sliding_body(2, 0.0), **changes))
    driver.tick()
    assert driver.joints().joints == []
    slide(driver, 2)
    before = driver.joints().joints[0]
    assert driver.health() == HEALTHY
    for ticks in (1, 2):
        driver.set(_broken(sliding_body(2, 0.1), **changes), sliding_body(3, 0.0))
        driver.tick()
        assert driver.health().fault == f"body 2: {reason}"
        assert_allclose(driver.health().age, ticks / 15.0)
        joint = driver.joints().joints[0]
        assert joint.skipped == {reason: ticks}
        assert (joint.updates, joint.probabilities) == (before.updates, before.probabilities)
    driver.set(sliding_body(2, 0.062))
    driver.tick()
    joint = driver.joints().joints[0]
    assert driver.health() == HEALTHY
    assert (joint.updates, joint.type, joint.skipped) == (46, JointType.PRISMATIC, {reason: 2})


def test_a_parent_whose_rotation_is_unknown_says_nothing_and_harms_none() -> None:
    driver = Driver(KinematicModel(KinematicModelConfig()))
    unknown = COVARIANCE.copy()
    unknown[:3, :3] = np.diag([np.inf] * 3)
    for k in range(45):
        driver.set(
            sliding_body(2, 0.002 * k, seed=k), _broken(sliding_body(3, 0.0), covariance=unknown)
        )
        driver.tick()
    joints = {(j.parent_id, j.child_id): j for j in driver.joints().joints}
    assert joints[0, 2].type == JointType.PRISMATIC
    assert max(joints[3, 2].probabilities.values()) < 0.7


def test_a_broken_source_does_not_override_a_good_one() -> None:
    driver = Driver(KinematicModel(KinematicModelConfig(), inputs=2))
    driver.set(sliding_body(2, 0.0), port=0)
    driver.set(_broken(sliding_body(2, 0.0), X=np.full((4, 4), np.nan)), port=1)
    driver.tick()
    assert [joint.updates for joint in driver.joints().joints] == [1]
    assert driver.health().fault == "body 2: pose not finite"
    assert driver.health().age == 0.0


def test_the_prediction_is_for_the_next_tick_and_honest() -> None:
    driver = Driver(KinematicModel(KinematicModelConfig()))
    slide(driver, 2)
    predictions = driver.model.GetOutputPort("bodies_predicted").Eval(driver.context).predictions
    assert predictions[0].source == "prismatic"
    expected = sliding_body(2, 0.02 * 46 / 15.0).motion.X
    e = se3.log(se3.inverse(predictions[0].pose.X) @ expected)
    covariance = predictions[0].pose.covariance
    assert nees(e, covariance) < chi_square_bounds(6, 0.998)[1]
    assert np.linalg.norm(e[3:]) < 1.5e-3


def test_a_moving_parent_carries_its_child_s_prediction() -> None:
    driver = Driver(KinematicModel(KinematicModelConfig()))
    for k in range(1, 61):
        x = 0.02 * k / 15.0
        driver.set(sliding_body(2, x, 0.02, seed=k), sliding_body(3, x, 0.02, seed=1000 + k))
        driver.tick()
    predictions = driver.model.GetOutputPort("bodies_predicted").Eval(driver.context).predictions
    rigid = [p for p in predictions if p.source == "rigid on 3"]
    assert len(rigid) == 1
    assert rigid[0].body_id == 2
    expected = sliding_body(2, 0.02 * 61 / 15.0).motion.X
    assert_allclose(rigid[0].pose.X, expected, atol=0.01)
    assert np.linalg.eigvalsh(rigid[0].pose.covariance).min() > 0.0


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
        output.set_value(BodyMotions(bodies=[sliding_body(2, 0.02 * tick / 15.0, seed=tick)]))


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
        ("reference_age", -1.0),
        ("patience", -0.1),
        ("transfer_window", 0.0),
        ("rest_walk", 0.0),
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
        data="{patience: 0.1, filters: {errors: {correlation_time: 2.0}}}",
    )
    assert (config.patience, config.filters.errors.correlation_time) == (0.1, 2.0)
