"""The sequence with a goal that is perceived: return, lost grasps, what ends it."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from crossmodal.controllers.interaction.grasp_decisions import (
    Goal,
    Perceived,
    SequenceState,
    next_state,
    tried_pose,
)
from crossmodal.controllers.interaction.grasp_sequence import (
    approach_motion,
    exploration_gains,
    release_motion,
)
from crossmodal.controllers.interaction.grasp_sequence_config import GraspSequenceConfig
from crossmodal.controllers.interaction.phases import Phase
from crossmodal.maths import se3

CONFIG = GraspSequenceConfig()
GOAL = Goal(configuration=0.2, return_to_start=True)
SLIDE = np.array([0.0, 0, 0, -1, 0, 0])
HELD = np.array([6.0e4, 6.0e4, 6.0e4, 8.0e4])
BACK = np.array([0.02, -0.01, 0.03, 0.01, 0.02, -0.1])
X_GRASP = se3.exp(np.array([0.1, 0.2, 0.3, 0.6, 0.0, 0.8]))


def moved(q: float) -> np.ndarray:
    return np.asarray(se3.exp(SLIDE * q) @ X_GRASP)


def off_the_handle(distance: float) -> np.ndarray:
    X_WE = moved(0.1)
    X_WE[:3, 3] += [-distance, 0.0, 0.0]
    return X_WE


def perceived(time: float, q: float | None, **others: object) -> Perceived:
    joint = np.full(8, np.nan) if q is None else np.append(SLIDE, [q, 0.0])
    now = Perceived(
        time=time,
        X_WE=moved(q or 0.0),
        pressure=HELD,
        pull=np.nan,
        joint=joint,
        hand_rate=1.0,
        failure=0.0,
        plan_time_left=np.inf,
    )
    return replace(now, **others)  # type: ignore[arg-type]


def exploring() -> SequenceState:
    return SequenceState(
        phase=Phase.EXPLORE,
        since=0.0,
        X_WE_start=X_GRASP,
        X_WE_grasp=X_GRASP,
        q_grasp=0.0,
        X_WE_held=X_GRASP,
        pressure_held=HELD,
        task=Phase.EXPLORE,
        attempts=0,
        lost=False,
        stuck=False,
        doubted_since=np.inf,
    )


def step(state: SequenceState, now: Perceived, goal: Goal = GOAL) -> SequenceState:
    return next_state(state, now, goal, CONFIG)


def test_exploration_goes_on_until_the_perceived_joint_reaches_the_goal() -> None:
    assert step(exploring(), perceived(1.0, 0.19)).phase == Phase.EXPLORE
    assert step(exploring(), perceived(1.0, 0.2)).phase == Phase.RETURN
    assert step(exploring(), perceived(1.0, -0.2)).phase == Phase.RETURN
    assert step(exploring(), perceived(1.0, 0.2), Goal(configuration=0.2)).phase == Phase.STOP


def test_the_hand_is_stopped_as_much_earlier_as_the_joint_is_fast() -> None:
    joint = np.append(SLIDE, [0.199, 0.02])
    assert step(exploring(), perceived(1.0, 0.199, joint=joint)).phase == Phase.RETURN
    joint = np.append(SLIDE, [0.199, -0.02])
    assert step(exploring(), perceived(1.0, 0.199, joint=joint)).phase == Phase.EXPLORE


def test_the_return_ends_at_the_start_and_not_before_the_plan_does() -> None:
    state = replace(exploring(), phase=Phase.RETURN, task=Phase.RETURN)
    assert step(state, perceived(9.0, 0.001, plan_time_left=0.5)).phase == Phase.RETURN
    assert step(state, perceived(9.0, 0.01, plan_time_left=-0.5)).phase == Phase.RETURN
    assert step(state, perceived(9.0, 0.001, plan_time_left=-0.5)).phase == Phase.STOP
    late = -CONFIG.return_patience
    assert step(state, perceived(9.0, 0.01, plan_time_left=late)).phase == Phase.STOP


def test_a_passing_doubt_does_not_end_a_grasp() -> None:
    doubt = {"failure": 0.9, "X_WE": off_the_handle(0.08)}
    state = step(exploring(), perceived(1.0, 0.1, **doubt))
    state = step(state, perceived(1.2, 0.1))
    state = step(state, perceived(1.3 + CONFIG.doubt_time, 0.1, **doubt))
    assert state.phase == Phase.EXPLORE


def test_one_sign_of_a_lost_grasp_is_not_enough() -> None:
    for sign in ({"failure": 0.9}, {"X_WE": off_the_handle(0.08)}):
        state = step(exploring(), perceived(1.0, 0.1, **sign))
        assert step(state, perceived(2.1, 0.1, **sign)).phase == Phase.EXPLORE


@pytest.mark.parametrize("failure", [0.9, np.nan])
def test_a_lost_grasp_is_tried_again_where_the_joint_has_left_the_handle(failure: float) -> None:
    doubt = {"failure": failure, "X_WE": off_the_handle(0.08)}
    doubt["plan_time_left"] = 1.0
    state = replace(exploring(), phase=Phase.RETURN, task=Phase.RETURN)
    state = step(state, perceived(0.0, 0.1, **doubt))
    state = step(state, perceived(0.1 + CONFIG.doubt_time, 0.1, **doubt))
    assert state.phase == Phase.RETURN, "what was begun is finished first"
    doubt["plan_time_left"] = -0.01
    state = step(state, perceived(1.1 + CONFIG.doubt_time, 0.1, **doubt))
    assert state.phase == Phase.RELEASE
    assert state.lost
    assert_allclose(state.X_WE_grasp, moved(0.1))
    time = 10.0
    for phase in (Phase.APPROACH, Phase.CLOSE, Phase.RETURN):
        state = step(state, perceived(time, 0.1))
        assert state.phase == phase
        assert state.lost == (phase != Phase.RETURN)
        time += 10.0
    state = replace(state, attempts=CONFIG.retries)
    state = step(state, perceived(time, 0.1, **doubt))
    state = step(state, perceived(time + 1.1, 0.1, **doubt))
    assert (state.phase, state.lost) == (Phase.STOP, True)


def test_a_joint_that_is_only_remembered_says_nothing_of_the_hand() -> None:
    joint = np.append(SLIDE, [0.1, np.nan])
    doubt = {"failure": 0.9, "X_WE": off_the_handle(0.08), "joint": joint}
    state = step(exploring(), perceived(1.0, 0.1, **doubt))
    assert step(state, perceived(2.1, 0.1, **doubt)).phase == Phase.EXPLORE


def test_a_hand_far_from_the_handle_gives_up() -> None:
    doubt = {"failure": 0.9, "X_WE": off_the_handle(CONFIG.retry_distance + 0.01)}
    state = step(exploring(), perceived(1.0, 0.1, **doubt))
    state = step(state, perceived(2.1, 0.1, **doubt))
    assert (state.phase, state.lost) == (Phase.STOP, True)


def test_an_empty_hand_has_lost_its_grasp_whatever_is_perceived() -> None:
    assert step(exploring(), perceived(1.0, 0.1, pressure=0.7 * HELD)).phase == Phase.RELEASE
    state = step(exploring(), perceived(1.0, None, pressure=0.7 * HELD), Goal())
    assert (state.phase, state.lost) == (Phase.STOP, True)
    one_finger_off = HELD * [0.7, 0.7, 0.95, 0.7]
    for pressure in (one_finger_off, np.full(4, np.nan)):
        state = step(exploring(), perceived(1.0, 0.1, pressure=pressure), Goal())
        assert state.phase == Phase.EXPLORE


def test_a_hand_whose_fingers_curl_while_the_arm_has_to_pull_is_not_empty() -> None:
    for pull, phase in ((8.0, Phase.EXPLORE), (0.5, Phase.STOP), (np.nan, Phase.STOP)):
        now = perceived(1.0, None, pressure=0.5 * HELD, pull=pull)
        assert step(exploring(), now, Goal()).phase == phase


def test_the_pressure_of_the_grasp_is_that_at_which_the_hand_has_closed() -> None:
    state = replace(exploring(), phase=Phase.CLOSE, pressure_held=np.zeros(4))
    state = step(state, perceived(CONFIG.close_time, 0.0, pressure=0.9 * HELD))
    assert state.phase == Phase.EXPLORE
    assert_allclose(state.pressure_held, 0.9 * HELD)


def test_a_joint_that_is_never_perceived_counts_as_a_lost_grasp() -> None:
    state = step(exploring(), perceived(CONFIG.explore_time_limit, None))
    assert (state.phase, state.lost) == (Phase.RELEASE, True)


def test_without_a_goal_other_grasps_are_tried_where_the_handle_was() -> None:
    config = replace(CONFIG, other_grasps=True)
    empty = {"pressure": 0.5 * HELD, "X_WE": off_the_handle(0.05)}
    assert step(exploring(), perceived(1.0, None, **empty), Goal()).phase == Phase.STOP
    state, poses = exploring(), list[np.ndarray]()
    for _ in range(config.retries):
        state = next_state(state, perceived(1.0, None, **empty), Goal(), config)
        assert (state.phase, state.lost) == (Phase.RELEASE, True)
        poses.append(se3.inverse(X_GRASP) @ tried_pose(state, config))
        state = replace(state, phase=Phase.EXPLORE)
    closer, turned = poses
    assert_allclose(se3.log(closer), [0, 0, 0, 0, 0, config.closer], atol=1e-12)
    assert_allclose(turned[:3, :3] @ [1, 0, 0], [0, 1, 0], atol=1e-12)
    assert next_state(state, perceived(1.0, None, **empty), Goal(), config).phase == Phase.STOP


def test_a_hand_that_holds_on_and_moves_nothing_stops_and_says_so() -> None:
    config = replace(CONFIG, stuck_time=5.0)
    for time, distance, stuck in ((4.9, 0.0, False), (5.0, 0.0, True), (5.0, 0.04, False)):
        now = perceived(time, None, X_WE=moved(distance))
        state = next_state(exploring(), now, Goal(), config)
        assert (state.stuck, state.phase == Phase.STOP, state.lost) == (stuck, stuck, False)


def test_without_a_goal_nothing_perceived_matters() -> None:
    state = step(exploring(), perceived(1.0, 0.4, failure=1.0, X_WE=X_GRASP), Goal())
    assert vars(state) == vars(exploring())  # Of the same arrays, which == cannot compare.


def test_the_release_leads_from_the_hand_to_the_next_approach() -> None:
    X_next = moved(0.1)
    for s, X in ((0.0, X_GRASP), (1 / 3, X_GRASP), (1.0, X_next)):
        assert_allclose(release_motion(X_GRASP, X_next, BACK, s).X_WE, X, atol=1e-9)
    back = se3.inverse(X_GRASP) @ release_motion(X_GRASP, X_next, BACK, 2 / 3).X_WE
    assert_allclose(back, se3.exp(BACK), atol=1e-9)


def test_the_approach_leads_along_the_taught_way() -> None:
    assert_allclose(approach_motion(X_GRASP, BACK, 0.0, 2.0).X_WE, X_GRASP @ se3.exp(BACK))
    assert_allclose(approach_motion(X_GRASP, BACK, 1.0, 2.0).X_WE, X_GRASP, atol=1e-12)
    before, now, after = (approach_motion(X_GRASP, BACK, 0.3 + h, 2.0) for h in (-1e-6, 0.0, 1e-6))
    moved_by = se3.log(se3.inverse(before.X_WE) @ after.X_WE)
    assert_allclose(now.V_WE_E, moved_by / (2e-6 * 2.0), atol=1e-6)
    assert_allclose(now.A_WE_E, (after.V_WE_E - before.V_WE_E) / (2e-6 * 2.0), atol=1e-6)


def test_exploration_is_compliant_but_in_the_pulling_direction() -> None:
    compliant = exploration_gains(CONFIG, np.array([0.0, 0.0, -3.0]))
    assert_allclose(np.diag(compliant.stiffness), [0.1] * 5 + [400.0])
    assert_allclose(np.diag(compliant.damping), [1.0] * 5 + [200.0])
    assert_allclose(compliant.mass, np.eye(6))


def test_a_hand_that_has_stopped_is_braked_where_it_is_compliant() -> None:
    stopped = exploration_gains(CONFIG, np.array([0.0, 0.0, -3.0]), has_stopped=True)
    assert_allclose(np.diag(stopped.stiffness), [0.1] * 5 + [400.0])
    assert_allclose(np.diag(stopped.damping), [1.0] * 3 + [80.0] * 2 + [200.0])
