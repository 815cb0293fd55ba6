"""What vision has seen of a body's joint before the hand held it is not forgotten."""

from dataclasses import replace

import numpy as np
import pytest
from kinematic_driver import COVARIANCE, REFERENCE_ERROR, Driver
from numpy.testing import assert_allclose

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.systems.kinematics.joint_filters import JointFilters, JointFiltersConfig
from crossmodal.systems.kinematics.kinematic_model import KinematicModel, KinematicModelConfig
from crossmodal.systems.kinematics.measurement_errors import MeasurementErrorsConfig
from crossmodal.systems.port_values import (
    HELD_BODY,
    STATIC_BODY,
    BodyMotion,
    BodyPredictions,
    HeldBody,
    JointBelief,
    JointType,
    MotionBelief,
    PoseBelief,
)

_PERIOD = 1.0 / 15.0
_SPEED = 0.02  # [m/s]
_CLOSED = 20  # Tick at which the hand has closed.
_SEEN = 2
_HINGE = np.array([1.0, 0.6, 0.5])
_CLOSE_BY, _FAR = np.array([1.0, 0.1, 0.5]), np.array([1.6, 0.1, 0.5])


def _model() -> KinematicModel:
    """With errors that are not white, as those of landmarks are."""
    filters = JointFiltersConfig(errors=MeasurementErrorsConfig(declared_time=5.0))
    return KinematicModel(KinematicModelConfig(filters=filters))


def _moved(joint: JointType, way: float) -> Array:
    """X_WW' (4, 4) of a body that has gone `way` [m] along its path."""
    if joint == JointType.PRISMATIC:
        return np.asarray(se3.exp(np.array([0.0, 0.0, 0.0, way, 0.0, 0.0])))
    X_WA = np.eye(4)
    X_WA[:3, 3] = _HINGE
    twist = np.array([0.0, 0.0, way / 0.4, 0.0, 0.0, 0.0])
    return np.asarray(X_WA @ se3.exp(twist) @ se3.inverse(X_WA))


def _at(p: Array) -> Array:
    X = np.eye(4)
    X[:3, 3] = p
    return X


def _seen(joint: JointType, k: int, number: int = _SEEN, p: Array = _CLOSE_BY) -> BodyMotion:
    """A body that vision has followed since it began to move, at tick 0, with one frame's noise."""
    noise = np.random.default_rng([number, k]).normal(size=6) * np.sqrt(np.diag(COVARIANCE)[:6])
    X = _moved(joint, _SPEED * k * _PERIOD) @ _at(p) @ se3.exp(noise)
    return BodyMotion(
        body_id=number,
        motion=MotionBelief(X=X, V=np.zeros(6), covariance=COVARIANCE),
        X_WB_reference=_at(p),
        feature_ids=np.arange(2),
        p_BF=np.array([[0.1, 0.0, 0.0], [-0.1, 0.0, 0.0]]),
        p_BF_covariance=np.zeros((6, 6)),
        reference_age=(k + 1) * _PERIOD,
    )


_GRIP = _at(_CLOSE_BY + np.array([0.05, -0.08, 0.02]))


def _held(joint: JointType, k: int, *, is_seen: bool = False) -> HeldBody:
    """The body in the hand, which goes on along the path from where the hand has closed."""
    start = _moved(joint, _SPEED * _CLOSED * _PERIOD) @ _GRIP
    X_WB_reference = _at(start[:3, 3])
    X = (
        _moved(joint, _SPEED * k * _PERIOD)
        @ se3.inverse(_moved(joint, _SPEED * _CLOSED * _PERIOD))
        @ X_WB_reference
    )
    noise = np.random.default_rng([HELD_BODY, k]).normal(size=6)
    X = X @ se3.exp(noise * np.sqrt(np.diag(COVARIANCE)[:6]) * (k > _CLOSED))
    return HeldBody(
        body_id=HELD_BODY,
        motion=MotionBelief(X=X, V=np.zeros(6), covariance=COVARIANCE),
        X_WB_reference=X_WB_reference,
        correlated_covariance=np.zeros((6, 6)) if is_seen else REFERENCE_ERROR,
        seen=PoseBelief(X=X, covariance=COVARIANCE[:6, :6]) if is_seen else None,
    )


def _joint_of_held(driver: Driver, parent: int = STATIC_BODY) -> JointBelief:
    return next(
        j for j in driver.joints().joints if (j.parent_id, j.child_id) == (parent, HELD_BODY)
    )


def _after_closing(
    joint: JointType, *others: tuple[int, Array], of_held: JointType | None = None
) -> Driver:
    """A driver that has just ticked at the closing of the hand."""
    driver = Driver(_model())
    for k in range(1, _CLOSED + 1):
        bodies = [_seen(joint, k), *(_seen(joint, k, number, p) for number, p in others)]
        if k == _CLOSED:
            bodies.append(_held(of_held or joint, k))
        driver.set(*bodies)
        driver.tick()
    return driver


def test_a_seen_body_that_was_forgotten_while_the_held_one_was_doubted() -> None:
    joint = JointType.PRISMATIC
    driver = _after_closing(joint)
    for k in range(_CLOSED + 1, _CLOSED + 60):
        driver.set(replace(_held(joint, k), is_seen=False))
        driver.tick()
    driver.set(_held(joint, _CLOSED + 60, is_seen=True))
    driver.tick()
    assert [j.child_id for j in driver.joints().joints] == [HELD_BODY]


@pytest.mark.parametrize("are_known", [True, False])
def test_the_landmarks_of_the_seen_body_say_where_it_is_in_the_held_one(are_known: bool) -> None:
    """The pose of the tick at which the hand has closed is 3 mm off; the landmarks are not."""
    joint, error = JointType.PRISMATIC, 3e-3
    driver = Driver(_model())
    for k in range(1, _CLOSED + 1):
        body = _seen(joint, k)
        if k == _CLOSED:
            body.motion.X[0, 3] += error
        driver.set(body, *([_held(joint, k)] if k == _CLOSED else []))
        driver.tick()
    rest = _at(_held(joint, _CLOSED).X_WB_reference[:3, 3] - [_SPEED * _CLOSED * _PERIOD, 0.0, 0.0])
    ids = _seen(joint, 1).feature_ids + (0 if are_known else 2)
    off = []
    for k in range(_CLOSED + 1, _CLOSED + 90):
        held = _held(joint, k, is_seen=True)
        driver.set(replace(held, feature_ids=ids, seen_reference=rest))
        driver.tick()
        q = abs(_joint_of_held(driver).models[joint].configuration[0])
        off.append(q - _SPEED * k * _PERIOD)
    assert (np.abs(off[-10:]) < 0.2 * error).all() == are_known


@pytest.mark.parametrize("joint", [JointType.PRISMATIC, JointType.REVOLUTE])
def test_the_held_body_goes_on_with_the_joint_that_was_seen(joint: JointType) -> None:
    driver = _after_closing(joint)
    radius = 1.0 if joint == JointType.PRISMATIC else 0.4
    before = next(j for j in driver.joints().joints if j.child_id == _SEEN)
    belief = _joint_of_held(driver)
    assert belief.probabilities == before.probabilities
    assert_allclose(belief.models[joint].axis_P, before.models[joint].axis_P)
    model = belief.models[joint]
    std = np.sqrt(model.configuration_covariance[0, 0])
    nudged = _SPEED * _CLOSED * _PERIOD / radius
    for q in (model.configuration[0], model.grasp_configuration):
        assert abs(abs(q) - nudged) < 2.0 * std < 3e-3 / radius
    assert belief.reference_age == pytest.approx(_CLOSED * _PERIOD + _PERIOD)
    with_seen = _joint_of_held(driver, _SEEN)
    assert all(model.grasp_configuration == 0.0 for model in with_seen.models.values())
    for k in range(_CLOSED + 1, _CLOSED + 60):
        # After a second, vision has been told that its body is the one in the hand.
        is_known = k > _CLOSED + 15
        seen = [] if is_known else [_seen(joint, k)]
        driver.set(*seen, _held(joint, k, is_seen=is_known))
        driver.tick()
        belief = _joint_of_held(driver)
        model = belief.models[joint]
        way = _SPEED * k * _PERIOD / radius
        std = np.sqrt(model.configuration_covariance[0, 0])
        assert abs(abs(model.configuration[0]) - way) < 3.0 * std
        assert abs(abs(model.grasp_configuration) - nudged) < 2e-3 / radius
        assert std < 3e-3 / radius
    assert belief.type == joint
    assert belief.updates == _CLOSED + 59
    assert [j.child_id for j in driver.joints().joints] == [HELD_BODY]


@pytest.mark.parametrize("follows", [True, False])
def test_a_body_that_is_not_seen_measures_nothing(follows: bool) -> None:
    """While it is predicted, its joint goes on, ever less surely; then it is the hand's."""
    joint = JointType.PRISMATIC
    driver = _after_closing(joint)
    updates = _joint_of_held(driver).updates
    for k in range(_CLOSED + 1, _CLOSED + 31):
        unseen = replace(_seen(joint, k), is_seen=False)
        driver.set(*([unseen] if follows else []), _held(joint, k))
        driver.tick()
    joints = {j.child_id: j for j in driver.joints().joints if j.parent_id == STATIC_BODY}
    assert set(joints) == ({HELD_BODY, _SEEN} if follows else {HELD_BODY})
    assert joints[HELD_BODY].updates == updates + 30 * (not follows)
    std = np.sqrt(joints[HELD_BODY].models[joint].configuration_covariance[0, 0])
    assert (std > 0.01) == follows


def test_a_body_that_does_not_go_with_the_hand_is_another_one() -> None:
    """It has been nudged only, and rests while the hand goes on with what it holds."""
    driver = _after_closing(JointType.PRISMATIC, of_held=JointType.REVOLUTE)
    for k in range(_CLOSED + 1, _CLOSED + 30):
        resting = replace(_seen(JointType.PRISMATIC, _CLOSED), reference_age=k * _PERIOD)
        driver.set(resting, _held(JointType.REVOLUTE, k, is_seen=True))
        driver.tick()
    belief = _joint_of_held(driver)
    assert belief.updates < 29
    assert belief.type == JointType.REVOLUTE
    # That with the nudged one has been followed since features have shown that they differ.
    nudged = _joint_of_held(driver, _SEEN)
    assert nudged.updates == belief.updates
    assert all(model.grasp_configuration == 0.0 for model in nudged.models.values())


def test_the_nearest_body_is_held_and_none_that_rested_long_ago() -> None:
    joint = JointType.PRISMATIC
    driver = _after_closing(joint, (3, _FAR))
    assert {(j.parent_id, j.child_id) for j in driver.joints().joints} >= {(0, 1), (3, 1)}
    # With the other one, too, it goes on with what was seen.
    assert _joint_of_held(driver, 3).updates == _CLOSED

    late = Driver(_model())
    for k in range(1, _CLOSED + 1):
        body = replace(_seen(joint, k), reference_age=10.0 + k * _PERIOD)
        late.set(body, *([_held(joint, k)] if k == _CLOSED else []))
        late.tick()
    assert _joint_of_held(late).updates == 0


def test_predictions_are_of_the_held_body_s_own_frame() -> None:
    joint = JointType.REVOLUTE
    driver = _after_closing(joint)
    for k in range(_CLOSED + 1, _CLOSED + 30):
        driver.set(_seen(joint, k), _held(joint, k))
        driver.tick()
    predictions: BodyPredictions = driver.model.GetOutputPort("bodies_predicted").Eval(
        driver.context
    )
    first = next(p for p in predictions.predictions if p.body_id == HELD_BODY)
    error = se3.log(se3.inverse(first.pose.X) @ _held(joint, k + 1).motion.X)
    assert_allclose(error, 0.0, atol=0.02)
    assert_allclose(error[3:], 0.0, atol=5e-3)


@pytest.mark.parametrize("joint", [JointType.PRISMATIC, JointType.REVOLUTE])
def test_any_pose_near_the_path_has_a_configuration(joint: JointType) -> None:
    filters = JointFilters(JointFiltersConfig())
    R, rng = COVARIANCE[:6, :6], np.random.default_rng(1)

    def pose(way: float) -> Array:
        noise = rng.normal(size=6) * np.sqrt(np.diag(R))
        return np.asarray(_moved(joint, way) @ _at(_CLOSE_BY) @ se3.exp(noise))

    state = filters.start(pose(0.0), R, 0.0)
    for k in range(1, 61):
        state = filters.update(state, pose(0.005 * k), R, 0.1 * k)
    model = filters.belief(state).models[joint]
    radius = 1.0 if joint == JointType.PRISMATIC else 0.4
    way = 0.12 / radius
    q = filters.configuration_at(state, joint, pose(0.12), R)
    assert q * np.sign(model.configuration[0]) == pytest.approx(way, abs=3e-3 / radius)
    # A measured pose is as near to the path as its noise, and counts as the belief does.
    now = filters.configuration_at(state, joint, pose(0.3), R)
    assert now == pytest.approx(model.configuration[0], abs=3e-3 / radius)


def test_a_pose_that_cannot_be_true_has_no_configuration() -> None:
    filters = JointFilters(JointFiltersConfig())
    state = filters.start(np.eye(4), 1e-6 * np.eye(6), 0.0)
    with pytest.raises(ValueError, match=r"JointFilters.configuration_at: .*"):
        filters.configuration_at(
            state, JointType.PRISMATIC, np.full((4, 4), np.nan), 1e-6 * np.eye(6)
        )


@pytest.mark.parametrize("resets", [0, 1])
def test_features_tell_at_once_that_a_body_moves_which_the_hand_took_to_rest(resets: int) -> None:
    """The hand pulls a drawer that sticks, nobody sees it; then it gives way, and features show it.

    Where the features were placed in the body by the hand meanwhile, they do not know from where.
    The same holds beside another body, which rests.
    """
    driver, beside = Driver(_model()), replace(_seen(JointType.PRISMATIC, 0), reference_age=10.0)
    for _ in range(40):
        driver.set(beside, _held(JointType.PRISMATIC, _CLOSED))
        driver.tick()
    for parent in (STATIC_BODY, _SEEN):
        assert _joint_of_held(driver, parent).probabilities[JointType.RIGID] > 0.4
    for k in range(3, 9):
        sighted = _held(JointType.PRISMATIC, _CLOSED + k, is_seen=True)
        sighted = replace(sighted, reset_count=resets, offset_covariance=resets * REFERENCE_ERROR)
        driver.set(beside, sighted)
        driver.tick()
        if k == 5 and not resets:
            assert _joint_of_held(driver).probabilities[JointType.RIGID] < 0.05
    for parent, off in ((STATIC_BODY, 1.5e-3), (_SEEN, 3e-3)):  # The latter is seen with noise.
        found = _joint_of_held(driver, parent)
        if resets:
            assert found.probabilities[JointType.RIGID] > 0.4
            continue
        assert found.probabilities[JointType.RIGID] < 0.05
        way = _SPEED * 8 * _PERIOD
        assert_allclose(found.model.configuration[0], way, atol=off)


def test_what_the_hand_had_nudged_before_it_closed_is_no_part_of_the_travel_since_then() -> None:
    """A closing hand pushes a box and its lid, which vision found second; then the lid goes on."""
    joint, box, lid, driver = JointType.PRISMATIC, 2, 3, Driver(_model())
    for k in range(1, _CLOSED + 61):
        # A second after it has closed, vision has been told that the lid is what the hand holds.
        is_known = k > _CLOSED + 15
        bodies: list[BodyMotion] = [_seen(joint, min(k, _CLOSED), box, _FAR)]
        if not is_known:
            bodies.append(_seen(joint, k, lid))
        if k >= _CLOSED:
            bodies.append(_held(joint, k, is_seen=is_known))
        driver.set(*bodies)
        driver.tick()
    model = _joint_of_held(driver, box).models[joint]
    since_then = abs(model.configuration[0] - model.grasp_configuration)
    assert since_then == pytest.approx(_SPEED * 60 * _PERIOD, abs=3e-3)
