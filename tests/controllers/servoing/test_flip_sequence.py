"""The phases of a flip, their conditions, and what is done in each."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator

from crossmodal.controllers.arm.kinematics import ArmModel
from crossmodal.controllers.servoing.contact_search import turned_about, twist_towards
from crossmodal.controllers.servoing.flip_config import FlipSequenceConfig
from crossmodal.controllers.servoing.flip_decisions import (
    FIRST,
    FlipPhase,
    FlipState,
    Sensed,
    next_flip_state,
    own_turn,
)
from crossmodal.controllers.servoing.flip_sequence import (
    FlipSequence,
    approach_twist,
    feed_forward,
    tactile_projector,
    visual_projector,
)
from crossmodal.maths import se3
from crossmodal.plants.robots.arm_with_hand import make_arm_with_load
from crossmodal.plants.robots.lwr import LWR_WITH_FINGERTIP
from crossmodal.systems.port_values import NO_CONTACT, HingeBelief, TactileContact

CONFIG = FlipSequenceConfig()
HINGE = HingeBelief(
    known=True, k_W=np.array([0.0, -1.0, 0.0]), p_WK=np.zeros(3), covariance=np.eye(6)
)
X_START = np.eye(4)
X_START[:3, :3] = np.column_stack([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
X_START[:3, 3] = [0.0, 0.0, -0.095]


def touching(force: float = 0.5, x: float = 0.0) -> TactileContact:
    n = np.array([x, np.sqrt(1.0 - x**2), 0.0]) if abs(x) < 1.0 else np.zeros(3)
    return TactileContact(
        touching=True,
        p_SC=np.array([x, 0.01, 0.0]),
        covariance=np.eye(3),
        n_S=n,
        f_S=force * n,
    )


class Episode:
    """Runs the decisions, remembering time and pose."""

    def __init__(self) -> None:
        self.state: FlipState = FIRST
        self.time = 0.0
        self.X_WS = X_START.copy()

    def go(  # type: ignore[no-untyped-def]
        self,
        seconds,
        contact=NO_CONTACT,
        theta=np.nan,
        hinge=None,
        step=None,
        distrust="",
        misalignment=0.0,
    ):
        for _ in range(round(seconds / CONFIG.period)):
            self.time += CONFIG.period
            if step is not None:
                self.X_WS = self.X_WS @ se3.exp(CONFIG.period * np.asarray(step, float))
            now = Sensed(
                time=self.time,
                X_WS=self.X_WS,
                contact=contact,
                theta=theta,
                hinge=hinge,
                distrust=distrust,
                misalignment=misalignment,
            )
            self.state = next_flip_state(self.state, now, CONFIG)
        return self

    def flipping(self) -> "Episode":
        return self.go(1.0).go(0.5, touching())


def test_the_phases_follow_each_other() -> None:
    episode = Episode().go(1.0)
    assert episode.state.phase == FlipPhase.PRE_CONTACT
    episode.go(0.01, touching())
    assert episode.state.phase == FlipPhase.ESTABLISH_CONTACT
    episode.go(CONFIG.settle_time + 0.03, touching())
    assert episode.state.phase == FlipPhase.FLIP
    episode.go(0.1, touching(), theta=CONFIG.angle - 0.01)
    assert episode.state.phase == FlipPhase.FLIP
    episode.go(0.02, touching(), theta=CONFIG.angle + 0.01)
    assert episode.state.phase == FlipPhase.RETREAT


def test_the_finger_approaches_once_it_is_turned_to_the_flap_as_it_is_seen() -> None:
    episode = Episode().go(1.0, misalignment=2.0 * CONFIG.arrival_angle)
    assert_allclose(approach_twist(episode.state, False, CONFIG), 0.0)
    assert_allclose(visual_projector(episode.state.phase, CONFIG), 1.0)
    episode.go(0.01, misalignment=0.5 * CONFIG.arrival_angle)
    assert approach_twist(episode.state, False, CONFIG)[4] == CONFIG.approach_speed
    episode.go(CONFIG.search_time, misalignment=2.0 * CONFIG.arrival_angle)
    assert episode.state.phase == FlipPhase.FAILED
    assert "as it is seen" in episode.state.why


def turned() -> Episode:
    return Episode().flipping().go(0.02, touching(), theta=CONFIG.angle + 0.01)


def test_once_the_flap_is_turned_the_finger_backs_off_and_is_done() -> None:
    episode = turned()
    V = approach_twist(episode.state, True, CONFIG)
    assert np.linalg.norm(V) == pytest.approx(CONFIG.retreat_speed)
    assert_allclose(np.cross(V[3:], CONFIG.retreat), 0.0, atol=1e-12)
    assert V[4] < 0.0
    assert_allclose(tactile_projector(episode.state.phase, CONFIG), 0.0)
    time = np.linalg.norm(CONFIG.retreat) / CONFIG.retreat_speed
    episode.go(time - 0.05, step=V)
    assert episode.state.phase == FlipPhase.RETREAT
    episode.go(0.1, step=V)
    assert episode.state.phase == FlipPhase.DONE
    assert_allclose(approach_twist(episode.state, False, CONFIG), 0.0)


def test_the_retreat_counts_from_where_the_flap_was_last_touched() -> None:
    episode = turned()
    V = approach_twist(episode.state, True, CONFIG)
    time = np.linalg.norm(CONFIG.retreat) / CONFIG.retreat_speed
    episode.go(0.5, touching(), step=V).go(time - 0.05, step=V)
    assert episode.state.phase == FlipPhase.RETREAT
    assert episode.go(0.1, step=V).state.phase == FlipPhase.DONE


def test_the_retreat_needs_no_touch_that_can_be_trusted() -> None:
    episode = turned()
    V = approach_twist(episode.state, True, CONFIG)
    time = np.linalg.norm(CONFIG.retreat) / CONFIG.retreat_speed
    episode.go(time + 0.05, step=V, distrust="dead taxels: 0, 3")
    assert episode.state.phase == FlipPhase.DONE


def test_a_finger_that_does_not_get_away_has_failed_and_says_so() -> None:
    episode = turned().go(10.0, touching())
    assert episode.state.phase == FlipPhase.FAILED
    assert "does not get away" in episode.state.why


def test_a_contact_that_does_not_settle_is_taken_after_a_while() -> None:
    episode = Episode().go(0.1).go(CONFIG.establish_time - 0.1, touching(force=0.2))
    assert episode.state.phase == FlipPhase.ESTABLISH_CONTACT
    assert episode.go(0.2, touching(force=0.2)).state.phase == FlipPhase.FLIP


def test_without_an_angle_the_fingers_own_turn_counts() -> None:
    episode = Episode().flipping()
    rate = np.array([0.0, 0.0, 0.5, 0.0, 0.0, 0.0])
    episode.go(CONFIG.angle / 0.5 - 0.1, touching(), step=rate)
    assert episode.state.phase == FlipPhase.FLIP
    assert episode.go(0.2, touching(), step=rate).state.phase == FlipPhase.RETREAT


def test_the_flip_ends_when_the_way_is_used_up() -> None:
    episode = Episode().flipping()
    episode.go(CONFIG.displacement / 0.1 + 0.1, touching(), theta=0.1, step=[0, 0, 0, 0.1, 0, 0])
    assert episode.state.phase == FlipPhase.RETREAT


def test_noise_of_the_pose_is_no_way() -> None:
    episode, rng = Episode().flipping(), np.random.default_rng(0)
    for _ in range(500):
        episode.X_WS = X_START @ se3.exp(rng.normal(0.0, 1e-3, 6))
        episode.go(0.01, touching())
    assert abs(episode.state.displacement) < 0.01
    assert abs(episode.state.turned) < 0.02


def test_a_flip_that_takes_too_long_has_failed_and_says_so() -> None:
    planned = CONFIG.displacement / CONFIG.feed_speed
    episode = Episode().flipping().go(3.0 * planned + 0.1, touching())
    assert episode.state.phase == FlipPhase.FAILED
    assert "too long" in episode.state.why


def test_nothing_to_touch_is_told() -> None:
    episode = Episode().go(2.0, step=[0, 0, 0, 0, 0.05, 0])
    assert episode.state.phase == FlipPhase.FAILED
    assert episode.state.why == "nothing was touched"


def test_a_lost_contact_stops_the_feed_and_is_sought_along_its_last_normal() -> None:
    episode = Episode().flipping()
    episode.go(0.1, touching(x=0.3))
    assert feed_forward(episode.state, episode.time, CONFIG) > 0.0
    episode.go(CONFIG.lost_time + 0.02)
    assert episode.state.phase == FlipPhase.ESTABLISH_CONTACT
    assert feed_forward(episode.state, episode.time, CONFIG) == 0.0
    V = approach_twist(episode.state, False, CONFIG)
    assert_allclose(V, [0, 0, 0, 0.3 * CONFIG.search_speed, V[4], 0])
    assert V[4] > 0.0
    episode.go(CONFIG.settle_time + 0.03, touching())
    assert episode.state.phase == FlipPhase.FLIP
    assert episode.state.losses == 1


def test_a_flap_that_is_swung_to_the_goal_without_the_finger_is_not_done() -> None:
    episode = Episode().flipping().go(0.02, theta=CONFIG.angle + 0.1)
    assert episode.state.phase == FlipPhase.FLIP


def test_a_short_gap_is_no_loss() -> None:
    episode = Episode().flipping().go(CONFIG.lost_time - 0.02)
    assert episode.state.phase == FlipPhase.FLIP
    assert_allclose(approach_twist(episode.state, False, CONFIG), 0.0)


def test_a_contact_that_is_not_found_again_is_lost_for_good() -> None:
    episode = Episode().flipping().go(2.0, step=[0, 0, 0, 0, 0.05, 0])
    assert episode.state.phase == FlipPhase.FAILED
    assert "the edge is not found again" in episode.state.why
    assert_allclose(tactile_projector(episode.state.phase, CONFIG), 0.0)


def test_a_search_that_goes_nowhere_ends() -> None:
    episode = Episode().flipping().go(CONFIG.search_time + 0.5)
    assert episode.state.phase == FlipPhase.FAILED


def test_an_edge_that_is_seen_to_have_gone_is_followed_to_before_it() -> None:
    """The finger waits before the turned edge and then approaches it along its own y."""
    episode = Episode().go(1.0).go(0.8, touching(), theta=0.2, hinge=HINGE)
    X_felt = episode.X_WS.copy()
    episode.go(CONFIG.lost_time + 0.03, theta=0.55, hinge=HINGE)
    for _ in range(1500):
        goal = episode.state.X_WS_goal
        if goal is None:
            break
        V = approach_twist(episode.state, False, CONFIG)
        assert np.linalg.norm(V[3:]) <= CONFIG.follow_speed + 1e-9
        episode.go(0.01, theta=0.55, hinge=HINGE, step=V)
    X_edge = turned_about(HINGE, 0.35, X_felt)
    assert_allclose(
        episode.X_WS[:3, 3], X_edge[:3, 3] - CONFIG.clearance * X_edge[:3, 1], atol=3e-3
    )
    assert episode.state.phase == FlipPhase.ESTABLISH_CONTACT
    V = approach_twist(episode.state, False, CONFIG)
    assert_allclose(V, [0, 0, 0, 0, CONFIG.search_speed, 0])


def test_a_finger_that_cannot_trust_its_touch_stands_still_and_goes_on_once_it_can() -> None:
    episode = Episode().flipping().go(2.0, distrust="dead taxels")
    assert episode.state.phase == FlipPhase.ESTABLISH_CONTACT
    assert_allclose(approach_twist(episode.state, False, CONFIG), 0.0)
    assert feed_forward(episode.state, episode.time, CONFIG) == 0.0
    episode.go(CONFIG.settle_time + 0.03, touching())
    assert episode.state.phase == FlipPhase.FLIP
    assert episode.state.losses == 0


@pytest.mark.parametrize("first", ["approach", "flip"])
def test_touch_that_stays_away_is_told_in_one_line(first: str) -> None:
    episode = Episode() if first == "approach" else Episode().flipping()
    episode.go(CONFIG.search_time + 0.5, distrust="dead taxels: 0, 3")
    assert episode.state.phase == FlipPhase.FAILED
    assert episode.state.why == "touch cannot be trusted: dead taxels: 0, 3"


def test_an_edge_that_is_not_where_it_should_be_is_sought_on_both_sides_and_given_up() -> None:
    """Steps of the same length on the arc, further out each time, always from outside."""
    episode = Episode().go(1.0).go(0.8, touching(), theta=0.2, hinge=HINGE)
    places, probe = [], 0
    for _ in range(8000):
        V = approach_twist(episode.state, False, CONFIG)
        episode.go(0.01, theta=0.2, hinge=HINGE, step=V)
        assert np.linalg.norm(episode.X_WS[:3, 3]) > 0.095 - CONFIG.probe_depth - 0.004
        if episode.state.probe > probe:
            probe = episode.state.probe
            places.append(own_turn(X_START, episode.X_WS) * 0.095 / CONFIG.probe_step)
        if episode.state.phase == FlipPhase.FAILED:
            break
    assert_allclose(places, [0, 1, -1, 2, -2, 3, -3], atol=0.2)
    assert "the edge is not found again" in episode.state.why


def test_the_turn_about_the_hinge_keeps_its_distance_and_goes_with_the_flap() -> None:
    turned = turned_about(HINGE, 0.5, X_START)
    assert np.linalg.norm(turned[:3, 3]) == pytest.approx(0.095)
    assert turned[0, 3] > 0.0
    assert own_turn(X_START, turned) == pytest.approx(0.5)


def test_the_twist_leads_to_the_goal() -> None:
    X, goal = X_START.copy(), X_START @ se3.exp(np.array([0.3, -0.1, 0.2, 0.03, 0.02, -0.01]))
    for _ in range(600):
        X = X @ se3.exp(0.01 * twist_towards(X, goal, 0.03, 0.5))
    assert_allclose(X, goal, atol=1e-4)


def test_the_feed_rises_from_zero() -> None:
    state = replace(FIRST, phase=FlipPhase.FLIP, since=1.0)
    assert feed_forward(state, 1.0, CONFIG) == 0.0
    assert feed_forward(state, 1.0 + 0.5 * CONFIG.ramp_time, CONFIG) == pytest.approx(
        0.5 * CONFIG.feed_speed
    )
    assert feed_forward(state, 60.0, CONFIG) == CONFIG.feed_speed


def test_touch_slides_along_x_in_the_flip_alone_and_never_rolls_about_z() -> None:
    establish = tactile_projector(FlipPhase.ESTABLISH_CONTACT, CONFIG)
    flip = tactile_projector(FlipPhase.FLIP, CONFIG)
    assert_allclose(establish, [1, 0, 0, 0, 1, 0])
    assert_allclose(flip, [1, 0, 0, 1, 1, 0])


def test_ports_say_what_the_state_does() -> None:
    arm = ArmModel(make_arm_with_load(LWR_WITH_FINGERTIP, RigidTransform()))
    system = FlipSequence(CONFIG, arm)
    context = system.CreateDefaultContext()
    q = np.array([-0.22, -0.63, -0.39, 1.6, 1.4, 1.01, -0.83])
    system.GetInputPort("joint_state_measured").FixValue(context, np.concatenate([q, 0 * q]))
    contact = system.GetInputPort("contact_latest")

    def out(name: str):  # type: ignore[no-untyped-def]
        return system.GetOutputPort(name).Eval(context)

    contact.FixValue(context, AbstractValue.Make(NO_CONTACT))
    assert_allclose(out("approach_twist_desired"), [0, 0, 0, 0, CONFIG.approach_speed, 0])
    contact.FixValue(context, AbstractValue.Make(touching()))
    assert_allclose(out("approach_twist_desired"), 0.0)
    simulator = Simulator(system, context)
    simulator.Initialize()
    simulator.AdvanceTo(CONFIG.settle_time + 0.1)
    assert out("phase")[0] == FlipPhase.FLIP
    assert out("feed_forward")[0] > 0.0
    assert_allclose(out("visual_projector"), CONFIG.visual_flip)
    assert out("failure") == ""
