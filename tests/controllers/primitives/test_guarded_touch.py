"""Guarded touches through their ports, with an ideal arm and what presses the taxels by hand."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from known_scene import pose_at, touch_arm, touch_planner
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator

from crossmodal.controllers.arm.motion_planner import MotionPlanner
from crossmodal.controllers.primitives.arm_task import TransitConfig
from crossmodal.controllers.primitives.guarded_touch import (
    GuardedTouch,
    GuardedTouchConfig,
    TouchEnd,
    TouchPhase,
)
from crossmodal.maths.arrays import Array
from crossmodal.plants.robots.panda import PANDA_AWAY
from crossmodal.plants.robots.ur5 import UR5_HOME
from crossmodal.systems.port_values import NO_TOUCH, TouchRequest

PERIOD, SPEED, TOP = 0.02, 0.05, 0.1
CONFIG = GuardedTouchConfig(
    period=PERIOD,
    speed=SPEED,
    confirmations=2,
    transit=TransitConfig(speed=1.0, joint_speed=1.0, rest_time=0.1),
)
NOISE = 1e-6  # Of a taxel, [N].
OFFSETS = np.array([[0.3, -0.2, 0.1], [0.0, 0.5, 0.0]])
# What touches at full speed has gone farther by then than where it was pressed first, [m].
OVERSHOOT = SPEED * PERIOD * (CONFIG.confirmations + 1)
BOX = np.eye(4)
BOX[:3, 3] = [0.55, 0.1, 0.5 * TOP]
WANTED = TouchRequest(
    number=1,
    start=np.array([0.55, 0.1, 0.17]),
    direction=np.array([0.0, 0.0, -1.0]),
    reach=0.1,
    expected=0.07,
    box_edges=np.array([0.06, 0.06, TOP]),
    X_WB=BOX,
)
# The forces on two taxels (2, 3), [N], by where the gripper is and how long the phase lasts.
Pressing = Callable[[Array, str, float], Array]


def nothing(X_WE: Array, phase: str, since: float) -> Array:
    return np.zeros((2, 3))


def an_object(X_WE: Array, phase: str, since: float) -> Array:
    """Its top presses the second taxel, more the deeper it is, so that one is 0.5 N at most."""
    depth = TOP - X_WE[2, 3]
    return np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -min(500.0 * max(depth, 0.0), 0.5)]])


@pytest.fixture(scope="module")
def planner() -> MotionPlanner:
    return touch_planner()


class Trial:
    """A guarded touch whose arm is always where it is commanded to be."""

    def __init__(self, planner: MotionPlanner, pressing: Pressing = nothing) -> None:
        others = {"camera_arm": 7}
        self.system = GuardedTouch(CONFIG, touch_arm(), planner, UR5_HOME, others, 2, np.array([1]))
        self.silent = np.zeros(2, bool)
        self.simulator = Simulator(self.system)
        self.context = self.simulator.get_mutable_context()
        self.pressing, self.since = pressing, 0.0
        self.phases, self.q = [""], UR5_HOME
        self.fix("camera_arm_joint_state_measured", np.append(PANDA_AWAY, np.zeros(7)))
        self.ask(NO_TOUCH)
        self.clear(True)
        self.measure()

    def fix(self, port: str, value: Any) -> None:
        self.system.GetInputPort(port).FixValue(self.context, value)

    def ask(self, wanted: TouchRequest) -> None:
        self.fix("touch_latest", AbstractValue.Make(wanted))

    def clear(self, is_clear: bool) -> None:
        self.fix("is_clear", [float(is_clear)])

    def read(self, port: str) -> Any:
        return self.system.GetOutputPort(port).Eval(self.context)

    def measure(self) -> None:
        time, phase = self.context.get_time(), self.read("phase")
        if phase != self.phases[-1]:
            self.phases.append(phase)
            self.since = time
        self.q = np.array(self.read("joint_position_commanded"))
        X_WE = pose_at(touch_arm(), self.q)
        # No taxel that works says twice the same.
        noise = NOISE * (-1.0) ** round(time / PERIOD)
        forces = OFFSETS + noise + self.pressing(X_WE, phase, time - self.since)
        forces[self.silent] = 0.0
        self.fix("joint_state_measured", np.append(self.q, np.zeros(6)))
        self.fix("taxel_measured", forces.ravel())

    def go_on(self, duration: float) -> None:
        for _ in range(round(duration / PERIOD)):
            self.simulator.AdvanceTo(self.context.get_time() + PERIOD)
            self.measure()

    def until(self, phase: TouchPhase, longest: float = 20.0) -> TouchEnd:
        for _ in range(round(longest / PERIOD)):
            self.go_on(PERIOD)
            if self.read("phase") == phase:
                end: TouchEnd = self.read("touch_end")
                return end
        raise AssertionError(f"{self.phases} without '{phase}'")


def test_a_touch_is_made_phase_by_phase(planner: MotionPlanner) -> None:
    trial = Trial(planner, an_object)
    trial.go_on(0.2)
    assert trial.phases == [""]
    trial.ask(WANTED)
    end = trial.until(TouchPhase.RETREAT)
    assert (end.number, end.outcome) == (1, "contact")
    X_start, X_end = (pose_at(touch_arm(), q) for q in (end.q_start, end.q_end))
    assert_allclose(X_start[:3, 3], WANTED.start, atol=3e-4)
    assert_allclose(X_start[:3, 2], WANTED.direction, atol=2e-3)
    assert TOP - OVERSHOOT < X_end[2, 3] < TOP
    assert_allclose(X_end[:2, 3], WANTED.start[:2], atol=1e-3)
    # The offsets are taken out.
    assert_allclose(end.forces, an_object(X_end, "", 0.0), atol=3.0 * NOISE)
    assert np.linalg.norm(end.forces[1]) > CONFIG.threshold
    assert trial.until(TouchPhase.WAIT) is end
    assert_allclose(pose_at(touch_arm(), trial.q)[:3, 3], WANTED.start, atol=1e-3)
    names = [str(phase) for phase in TouchPhase]
    assert trial.phases == [*names[:5], names[0]]
    trial.go_on(0.5)  # The same request is not a new touch.
    assert trial.read("phase") == ""
    assert trial.read("is_done")[0] == 0.0
    trial.ask(replace(WANTED, done=True))
    trial.until(TouchPhase.HOME)
    assert trial.read("is_done")[0] == 0.0
    trial.until(TouchPhase.WAIT)
    assert_array_equal(trial.q, UR5_HOME)
    assert trial.read("is_done")[0] == 1.0


def test_the_approach_goes_at_its_speed(planner: MotionPlanner) -> None:
    trial = Trial(planner)
    trial.ask(WANTED)
    trial.until(TouchPhase.APPROACH)
    trial.go_on(0.1)
    z = pose_at(touch_arm(), trial.q)[2, 3]
    trial.go_on(1.0)
    assert pose_at(touch_arm(), trial.q)[2, 3] == pytest.approx(z - SPEED, abs=1e-3)


@pytest.mark.parametrize(("lasts", "outcome"), [(0.9, "miss"), (1.9, "contact")])
def test_a_force_counts_when_it_is_confirmed(
    planner: MotionPlanner, lasts: float, outcome: str
) -> None:
    """A force for one decision is none, a force for two in a row is a contact; offsets are not."""

    def for_a_while(X_WE: Array, phase: str, since: float) -> Array:
        begin = 0.5
        pressed = phase == TouchPhase.APPROACH and begin <= since < begin + lasts * PERIOD
        return np.array([[float(pressed), 0.0, 0.0], [0.0, 0.0, 0.0]])

    trial = Trial(planner, for_a_while)
    trial.ask(WANTED)
    end = trial.until(TouchPhase.RETREAT)
    assert (end.number, end.outcome) == (1, outcome)
    far = SPEED * 0.5 if outcome == "contact" else WANTED.reach
    z = pose_at(touch_arm(), end.q_end)[2, 3]
    assert z == pytest.approx(WANTED.start[2] - far, abs=1.5 * OVERSHOOT)
    if outcome == "miss":
        assert_allclose(end.forces, np.zeros((2, 3)), atol=3.0 * NOISE)


def test_less_than_the_threshold_is_no_contact(planner: MotionPlanner) -> None:
    weak = CONFIG.threshold * np.array([[0.0, 0.0, 0.0], [0.6, 0.0, -0.7]])
    trial = Trial(planner, lambda X_WE, phase, since: weak * (phase == TouchPhase.APPROACH))
    trial.ask(WANTED)
    assert trial.until(TouchPhase.RETREAT).outcome == "miss"


def test_what_is_met_on_the_way_is_a_contact_from_which_it_goes_back(
    planner: MotionPlanner,
) -> None:
    def on_the_way(X_WE: Array, phase: str, since: float) -> Array:
        return np.full((2, 3), 0.5 * (phase == TouchPhase.TRANSIT and since > 0.25))

    trial = Trial(planner, on_the_way)
    trial.ask(WANTED)
    end = trial.until(TouchPhase.RETREAT)
    assert (end.number, end.outcome) == (1, "contact")
    assert_array_equal(end.q_start, end.q_end)
    assert not np.allclose(end.q_end, UR5_HOME, atol=1e-3)
    assert TouchPhase.APPROACH not in trial.phases
    trial.until(TouchPhase.WAIT)
    assert_array_equal(trial.q, UR5_HOME)


@pytest.mark.parametrize(
    "change",
    [
        {"start": np.array([-0.6, 0.1, 0.3])},
        # The table ends the approach before the object can have been met.
        {"start": np.array([0.55, 0.1, 0.12]), "reach": 0.3, "expected": 0.2},
        # The box that holds the object is no place to begin.
        {"start": np.array([0.55, 0.1, 0.08])},
    ],
    ids=["far", "table", "inside"],
)
def test_what_cannot_be_touched_is_reported_and_the_next_one_is_made(
    planner: MotionPlanner, change: dict[str, Any]
) -> None:
    trial = Trial(planner, an_object)
    trial.ask(replace(WANTED, **change))
    trial.go_on(2.0 * PERIOD)
    end: TouchEnd = trial.read("touch_end")
    assert (end.number, end.outcome) == (1, "unreachable")
    assert_array_equal(trial.q, UR5_HOME)
    assert trial.phases == [""]
    trial.ask(replace(WANTED, number=2))
    end = trial.until(TouchPhase.RETREAT)
    assert (end.number, end.outcome) == (2, "contact")


def test_where_no_way_leads_to_one_posture_another_one_is_taken(
    planner: MotionPlanner, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Array] = []
    path = planner.path

    def without_the_first(q_start: Array, q_goal: Array, rng: np.random.Generator) -> Any:
        asked.append(q_goal)
        return None if len(asked) == 1 else path(q_start, q_goal, rng)

    monkeypatch.setattr(planner, "path", without_the_first)
    trial = Trial(planner, an_object)
    trial.ask(WANTED)
    trial.go_on(15.0)
    assert trial.read("touch_end").outcome == "contact"
    assert np.abs(asked[1] - asked[0]).max() > 0.1


def test_it_waits_until_the_other_arm_is_out_of_the_way(planner: MotionPlanner) -> None:
    trial = Trial(planner)
    trial.clear(False)
    trial.ask(WANTED)
    trial.go_on(1.0)
    assert trial.phases == [""]
    assert trial.read("touch_end").number == 0
    trial.clear(True)
    trial.go_on(2.0 * PERIOD)
    assert trial.read("phase") == TouchPhase.TARE


def test_at_home_it_is_done_as_soon_as_no_touch_is_wanted(planner: MotionPlanner) -> None:
    trial = Trial(planner)
    trial.go_on(0.1)
    assert trial.read("is_done")[0] == 0.0
    trial.ask(replace(NO_TOUCH, done=True, why="no feasible touch"))
    trial.go_on(0.1)
    assert trial.read("is_done")[0] == 1.0
    assert trial.phases == [""]


def test_without_taxels_at_the_end_no_touch_is_made(planner: MotionPlanner) -> None:
    trial = Trial(planner, an_object)
    trial.silent[1] = True
    trial.measure()
    trial.ask(WANTED)
    trial.go_on(2.0)
    assert "taxels 1 at the fingers' end always say the same" in trial.read("failure")
    assert trial.phases == ["", TouchPhase.TARE, ""]
    assert trial.read("is_done")[0] == 1.0
    assert_array_equal(trial.q, UR5_HOME)


def test_a_silent_taxel_elsewhere_is_left_out(planner: MotionPlanner) -> None:
    trial = Trial(planner, an_object)
    trial.silent[0] = True
    trial.measure()
    trial.ask(WANTED)
    trial.until(TouchPhase.APPROACH)
    trial.silent[0] = False  # What it says now is not believed: it would be a contact.
    end = trial.until(TouchPhase.RETREAT)
    assert end.outcome == "contact"
    assert_array_equal(end.forces[0], np.zeros(3))
    assert TOP - OVERSHOOT < pose_at(touch_arm(), end.q_end)[2, 3] < TOP


def test_an_arm_that_the_next_box_encloses_goes_back_the_way_it_came(
    planner: MotionPlanner,
) -> None:
    """The belief grows after a miss; from inside its box no path would be free."""
    trial = Trial(planner)
    trial.ask(WANTED)
    assert trial.until(TouchPhase.RETREAT).outcome == "miss"
    trial.until(TouchPhase.WAIT)
    large = np.array([0.2, 0.2, 0.26])  # It holds the gripper's end, which is 0.17 m high.
    again = replace(
        WANTED,
        number=2,
        start=np.array([0.55, 0.1, 0.36]),
        reach=0.3,
        expected=0.26,
        box_edges=large,
    )
    trial.ask(again)
    end = trial.until(TouchPhase.APPROACH, longest=40.0)
    assert end.number == 1
    end = trial.until(TouchPhase.RETREAT)
    assert (end.number, end.outcome) == (2, "miss")


def test_out_of_a_box_that_encloses_it_goes_home_the_way_it_came(planner: MotionPlanner) -> None:
    trial = Trial(planner)
    trial.ask(WANTED)
    trial.until(TouchPhase.RETREAT)
    trial.until(TouchPhase.WAIT)
    trial.ask(replace(WANTED, done=True, box_edges=np.array([0.3, 0.3, 0.4])))
    trial.go_on(20.0)
    assert trial.read("is_done")[0] == 1.0
    assert_array_equal(trial.q, UR5_HOME)


def test_without_a_way_home_it_stays_and_is_done(
    planner: MotionPlanner, monkeypatch: pytest.MonkeyPatch
) -> None:
    trial = Trial(planner)
    trial.ask(WANTED)
    trial.until(TouchPhase.RETREAT)
    trial.until(TouchPhase.WAIT)
    monkeypatch.setattr(planner, "path", lambda *arguments: None)
    trial.ask(replace(WANTED, done=True))
    trial.go_on(0.5)
    assert trial.read("is_done")[0] == 1.0
    assert TouchPhase.HOME not in trial.phases
