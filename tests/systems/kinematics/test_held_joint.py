"""What control reads of the joint in the hand."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.common.value import AbstractValue

from crossmodal.maths import se3
from crossmodal.systems.kinematics.held_joint import (
    HeldJoint,
    HeldJointConfig,
    choose_joint,
    end_effector_screw,
)
from crossmodal.systems.kinematics.joint_screws import screw
from crossmodal.systems.port_values import (
    HELD_BODY,
    STATIC_BODY,
    BodyMotion,
    BodyMotions,
    JointBelief,
    JointBeliefs,
    JointFit,
    JointModelBelief,
    JointType,
    MotionBelief,
)
from crossmodal.systems.proprioception.bent_hand import free_rotation

CONFIG = HeldJointConfig()


def joint(
    kind: JointType,
    q: float,
    parent: int = STATIC_BODY,
    child: int = HELD_BODY,
    probability: float = 0.99,
    axis_std: float = 0.01,
    updates: int = 10,
    explained: float = 0.0,
) -> JointBelief:
    model = JointModelBelief(
        log_evidence=7.0 + explained,
        axis_P=np.array([0.0, 0.0, 1.0]),
        axis_covariance=np.diag([axis_std**2, axis_std**2, 0.0]) / 2,
        p_PA=np.array([0.3, 0.1, 0.0]),
        p_PA_covariance=np.zeros((3, 3)),
        configuration=np.array([q, 0.0]),
        configuration_covariance=np.eye(2) * 1e-6,
    )
    rest = (1.0 - probability) / (len(JointType) - 1)
    probabilities = {other: probability if other == kind else rest for other in JointType}
    return JointBelief(
        parent_id=parent,
        child_id=child,
        probabilities=probabilities,
        models=dict.fromkeys(JointType, replace(model, log_evidence=7.0)) | {kind: model},
        updates=updates,
    )


def read(joints: list[JointBelief], bodies: list[BodyMotion] | None = None) -> np.ndarray:
    system = HeldJoint(CONFIG)
    context = system.CreateDefaultContext()
    system.GetInputPort("joints_latest").FixValue(
        context, AbstractValue.Make(JointBeliefs(joints=joints))
    )
    system.GetInputPort("body_motions_latest").FixValue(
        context, AbstractValue.Make(BodyMotions(bodies=bodies or []))
    )
    assert np.isnan(system.GetOutputPort("grasp_failure_latest").Eval(context)[0])
    result = np.asarray(system.GetOutputPort("joint_latest").Eval(context)).copy()
    screw = system.GetOutputPort("end_effector_screw_latest").Eval(context)
    assert_allclose(screw, result[:6])
    return result


def test_the_screw_moves_points_as_the_joint_does() -> None:
    q = 0.6
    S_W = read([joint(JointType.REVOLUTE, q)])[:6]
    on_axis = np.array([0.3, 0.1, 0.7, 1.0])
    assert_allclose(se3.exp(S_W * q) @ on_axis, on_axis, atol=1e-12)
    moved = se3.exp(S_W * q) @ np.array([1.3, 0.1, 0.0, 1.0])
    assert_allclose(moved[:2], [0.3 + np.cos(q), 0.1 + np.sin(q)], atol=1e-12)
    assert_allclose(read([joint(JointType.PRISMATIC, q)]), [0, 0, 0, 0, 0, 1, q, 0.0])


@pytest.mark.parametrize(
    "unlikely",
    [
        joint(JointType.PRISMATIC, 0.1, probability=0.45),
        joint(JointType.PRISMATIC, 0.1, axis_std=0.8),
        joint(JointType.RIGID, 0.1),
    ],
)
def test_nothing_is_said_of_a_joint_that_is_not_likely(unlikely: JointBelief) -> None:
    assert np.all(np.isnan(read([unlikely])))


def test_a_joint_likelier_than_all_others_together_is_acted_on() -> None:
    """A slide sensed by the hand alone may leave a far hinge possible up to its goal."""
    assert_allclose(read([joint(JointType.PRISMATIC, 0.1, probability=0.6)])[6], 0.1)


def test_the_body_in_the_hand_comes_first_and_its_joint_to_the_environment() -> None:
    seen = joint(JointType.PRISMATIC, 0.1, child=2, updates=100)
    held = joint(JointType.PRISMATIC, 0.2)
    between = joint(JointType.PRISMATIC, 0.3, parent=2, child=3, updates=100)
    beside = joint(JointType.PRISMATIC, 0.2, parent=2, updates=100)

    def chosen(*joints: JointBelief, body_is_known: bool = True) -> JointBelief | None:
        return choose_joint(JointBeliefs(joints=list(joints)), CONFIG, body_is_known)

    assert chosen(seen, between, beside, held) is held
    assert chosen(seen, between, beside) is beside
    assert chosen(seen, between) is None
    assert chosen(seen, between, body_is_known=False) is seen


@pytest.mark.parametrize(
    ("chi_square", "more", "parent"),
    [
        (1.1, 300.0, STATIC_BODY),
        (np.nan, 300.0, STATIC_BODY),
        (1.3, -1.0, STATIC_BODY),
        (1.3, 1.0, 2),
    ],
)
def test_a_joint_to_another_body_counts_where_none_with_the_environment_fits(
    chi_square: float, more: float, parent: int
) -> None:
    """However much more it explains: a body that wanders is explained by its pair, too."""
    fit = JointFit(
        reduced_chi_square=chi_square,
        bounds=(0.8, 1.2),
        degrees=200,
        outlier_share=0.0,
        noise_scale=(1.0, 1.0),
        noise_correlation=0.0,
        path_floor=0.0,
    )
    held = replace(joint(JointType.REVOLUTE, 0.2, explained=200.0), fit=fit)
    on_box = joint(JointType.REVOLUTE, 0.2, parent=2, explained=200.0 + more)
    found = choose_joint(JointBeliefs(joints=[held, on_box]), CONFIG, body_is_known=True)
    assert found is not None
    assert found.parent_id == parent


def test_a_joint_of_a_moving_parent_goes_with_it() -> None:
    X_WP = se3.exp(np.array([0.2, 0.1, 0.4, 0.5, -0.3, 0.2]))
    motion = MotionBelief(X=X_WP, V=np.zeros(6), covariance=np.eye(12))
    none = np.zeros((0, 3))
    parent = BodyMotion(
        body_id=2,
        motion=motion,
        X_WB_reference=np.eye(4),
        feature_ids=np.zeros(0, dtype=np.int64),
        p_BF=none,
        p_BF_covariance=np.zeros((0, 0)),
    )
    S_W = read([joint(JointType.REVOLUTE, 0.1, parent=2)], [parent])[:6]
    on_axis = X_WP @ np.array([0.3, 0.1, -0.4, 1.0])
    assert_allclose(se3.exp(S_W * 0.5) @ on_axis, on_axis, atol=1e-12)
    assert np.all(np.isnan(read([joint(JointType.REVOLUTE, 0.1, parent=2)])))


def test_a_hand_that_turns_on_the_bar_need_not_turn_with_the_door() -> None:
    """The bar is parallel to the hinge: its point moves on the circle, the hand keeps its pose."""
    X_WE = se3.exp(np.array([0.1, 0.2, 0.0, 0.8, 0.1, 0.5]))
    X_EH = se3.exp(np.array([0.05, 0.0, 0.02, 0.0, 0.01, 0.0]))
    X_HW = se3.inverse(X_WE @ X_EH)
    hinge = np.array([0.0, 0, 1, *np.cross([0.3, 0.1, 0.0], [0.0, 0, 1])])
    point_H = np.array([0.0, 0.0, 0.03])
    free = free_rotation(X_HW[:3, :3] @ hinge[:3], point_H)
    V_W = end_effector_screw(hinge, X_WE, X_EH, free)
    point_W = (X_WE @ X_EH @ np.append(point_H, 1.0))[:3]
    assert_allclose(V_W[:3], 0.0, atol=1e-12)
    assert_allclose(V_W[3:], hinge[3:] + np.cross(hinge[:3], point_W), atol=1e-12)
    assert_allclose(end_effector_screw(hinge, X_WE, X_EH, np.zeros((6, 6))), hinge, atol=1e-12)


def test_a_screw_climbs_by_its_pitch_along_the_axis() -> None:
    belief = joint(JointType.REVOLUTE, 0.1)
    known = np.array([[1.0, 0.05, 0.0]])
    model = replace(belief.models[JointType.REVOLUTE], pitch_mixture=known)
    hinge, climbing = screw(JointType.REVOLUTE, model), screw(JointType.SCREW, model)
    assert_allclose(climbing - hinge, [0.0, 0.0, 0.0, *(0.05 * model.axis_P)], atol=1e-15)
