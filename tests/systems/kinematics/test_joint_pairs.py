"""Which pairs of bodies have joints, and what a pair takes over from another one."""

import numpy as np
import pytest
from kinematic_driver import COVARIANCE, REFERENCE_ERROR, Driver, sliding_body
from numpy.testing import assert_allclose

from crossmodal.maths import se3
from crossmodal.systems.kinematics.joint_pairs import possible_pairs, relative_pose
from crossmodal.systems.kinematics.kinematic_model import KinematicModel, KinematicModelConfig
from crossmodal.systems.port_values import (
    BodyMotion,
    JointType,
    PoseBelief,
)


def test_two_bodies_too_far_apart_for_a_pair_are_no_pair() -> None:
    driver = Driver(KinematicModel(KinematicModelConfig()))
    driver.set(sliding_body(2, 9e5), sliding_body(3, -9e5))
    driver.tick()
    assert driver.pairs() == [(0, 2), (0, 3)]


def test_pairs_come_with_bodies_and_go_some_time_after_them() -> None:
    driver = Driver(KinematicModel(KinematicModelConfig(patience=0.2)))
    driver.set(sliding_body(2, 0.0), sliding_body(5, 0.0))
    driver.tick()
    assert driver.pairs() == [(0, 2), (0, 5), (5, 2)]
    driver.set(sliding_body(5, 0.0))
    for _ in range(3):
        driver.tick()
    assert driver.pairs() == [(0, 2), (0, 5), (5, 2)]
    driver.tick()
    assert driver.pairs() == [(0, 5)]
    driver.set(sliding_body(2, 0.0), sliding_body(5, 0.0))
    driver.tick()
    assert [j.updates for j in driver.joints().joints] == [1, 6, 1]


def test_pairs_of_moving_bodies_take_turns_and_none_is_left_out() -> None:
    assert possible_pairs([4, 1, 3], []) == [(0, 1), (0, 3), (0, 4), (3, 1), (4, 1), (4, 3)]
    assert possible_pairs([3], [7]) == [(0, 3), (7, 3)]
    driver = Driver(KinematicModel(KinematicModelConfig(max_pairs=6)))
    driver.set(*(sliding_body(i, 0.0) for i in (2, 3, 4, 5)))
    driver.tick()
    pairs = [(0, 2), (0, 3), (0, 4), (0, 5), (3, 2), (4, 2), (4, 3), (5, 2), (5, 3), (5, 4)]
    assert driver.pairs() == pairs
    before = _updates(driver)
    for tick in range(1, 4):
        driver.tick()
        after = _updates(driver)
        assert sum(after.values()) == sum(before.values()) + 6
        assert all(after[0, i] == tick + 1 for i in (2, 3, 4, 5))
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
            driver.set(*(sliding_body(i, q, seed=1000 * i + k) for i, q in moves.items()))
            driver.tick()
        types.append({(j.parent_id, j.child_id): j.type for j in driver.joints().joints})
    assert types[0] == types[1]
    assert types[0][3, 2] == JointType.RIGID
    assert types[0][4, 3] == JointType.PRISMATIC


def test_two_bodies_that_move_as_one_are_rigidly_connected() -> None:
    driver = Driver(KinematicModel(KinematicModelConfig()))
    for k in range(1, 61):
        x = 0.02 * k / 15.0
        driver.set(sliding_body(2, x, 0.02, seed=k), sliding_body(3, x, 0.02, seed=1000 + k))
        driver.tick()
    types = {(j.parent_id, j.child_id): j.type for j in driver.joints().joints}
    assert types == {
        (0, 2): JointType.PRISMATIC,
        (0, 3): JointType.PRISMATIC,
        (3, 2): JointType.RIGID,
    }


def _lid(k: int, seed: int) -> tuple[BodyMotion, BodyMotion]:
    """A lid (1) that turns by 0.1 rad/s for 60 ticks; its box (2) slides from tick 45 on."""
    box, lid = sliding_body(2, 0.01 * max(0, k - 45) / 15.0, seed=seed), sliding_body(1, 0.0)
    X_BoxLid = se3.inverse(box.X_WB_reference) @ lid.X_WB_reference
    hinge = np.array([0.0, 0.1 * min(k, 60) / 15.0, 0.0, 0.0, 0.0, 0.0])
    X_HingeLid = np.eye(4)
    X_HingeLid[:3, 3] = [0.15, 0.0, 0.0]
    turned = se3.inverse(X_HingeLid) @ se3.exp(hinge) @ X_HingeLid
    slid = sliding_body(2, 0.01 * max(0, k - 45) / 15.0).motion.X
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
    assert joint.updates == 44 + 90 - 54


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
        box = sliding_body(2, 0.0, seed=k)
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


def test_a_parent_that_moved_when_it_was_lost_is_not_taken_to_rest() -> None:
    driver = Driver(KinematicModel(KinematicModelConfig()))
    for k in range(1, 80):
        lid, box = _lid(k, seed=k)
        box.motion.V[3] = 0.1  # Ten times its deviation.
        driver.set(*([lid, box] if k >= 55 else [lid]))
        driver.tick()
    updates = next(j for j in driver.joints().joints if j.parent_id == 2).updates
    for k in range(80, 90):
        driver.set(_lid(k, seed=k)[0])
        driver.tick()
    assert next(j for j in driver.joints().joints if j.parent_id == 2).updates == updates


def test_the_bodies_that_the_joints_know_are_handed_on_for_as_long_as_the_joints() -> None:
    driver = Driver(KinematicModel(KinematicModelConfig(patience=0.2)))
    driver.set(sliding_body(2, 0.1), sliding_body(5, 0.0))
    driver.tick()
    driver.set(sliding_body(5, 0.0))
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
