"""Looking through its ports, with an ideal arm."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from known_scene import camera_arm, camera_planner, pose_at
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.sensors import ImageDepth32F, ImageRgba8U

from crossmodal.controllers.arm.motion_planner import MotionPlanner
from crossmodal.controllers.primitives.arm_task import TransitConfig
from crossmodal.controllers.primitives.look import Look, LookConfig, LookPhase
from crossmodal.maths import se3
from crossmodal.plants.robots.panda import PANDA_AWAY
from crossmodal.plants.robots.ur5 import UR5_HOME
from crossmodal.systems.port_values import (
    NO_TOUCH,
    NO_VIEW,
    StampedImage,
    TouchRequest,
    ViewRequest,
)

PERIOD, REST = 0.05, 0.3
CONFIG = LookConfig(
    period=PERIOD, transit=TransitConfig(speed=1.0, joint_speed=1.0, rest_time=REST)
)
CENTRE = np.array([0.5, 0.0, 0.1])
BOX = np.eye(4)
BOX[:3, 3] = CENTRE


def view(number: int, eye: list[float]) -> ViewRequest:
    X_WC = se3.looking_at(np.array(eye), CENTRE)
    return ViewRequest(number=number, X_WC=X_WC, box_edges=np.array([0.1, 0.1, 0.2]), X_WB=BOX)


FIRST, SECOND = view(1, [0.3, 0.1, 0.5]), view(2, [0.35, -0.2, 0.48])


@pytest.fixture(scope="module")
def planner() -> MotionPlanner:
    return camera_planner()


class Trial:
    """A camera's arm that is always where it is commanded to be."""

    def __init__(self, planner: MotionPlanner) -> None:
        self.system = Look(CONFIG, camera_arm(), planner, PANDA_AWAY, {"touch_arm": 6})
        self.simulator = Simulator(self.system)
        self.context = self.simulator.get_mutable_context()
        self.fix("touch_arm_joint_state_measured", np.append(UR5_HOME, np.zeros(6)))
        self.ask(NO_VIEW)
        self.touch(NO_TOUCH)
        self.phases = [""]
        self.sees = True
        self.measure()

    def fix(self, port: str, value: Any) -> None:
        self.system.GetInputPort(port).FixValue(self.context, value)

    def ask(self, wanted: ViewRequest) -> None:
        self.fix("view_latest", AbstractValue.Make(wanted))

    def touch(self, wanted: TouchRequest) -> None:
        self.fix("touch_latest", AbstractValue.Make(wanted))

    def read(self, port: str) -> Any:
        return self.system.GetOutputPort(port).Eval(self.context)

    def number(self, port: str) -> int:
        return int(self.read(port)[0])

    def measure(self) -> None:
        if self.read("phase") != self.phases[-1]:
            self.phases.append(self.read("phase"))
        self.q = np.array(self.read("joint_position_commanded"))
        self.fix("joint_state_measured", np.append(self.q, np.zeros(7)))
        if self.sees:
            image = StampedImage(time=self.context.get_time(), image=ImageDepth32F())
            self.fix("depth_measured", AbstractValue.Make(image))

    def go_on(self, duration: float) -> None:
        for _ in range(round(duration / PERIOD)):
            self.simulator.AdvanceTo(self.context.get_time() + PERIOD)
            self.measure()

    def until(self, phase: LookPhase) -> None:
        for _ in range(round(20.0 / PERIOD)):
            self.go_on(PERIOD)
            if self.read("phase") == phase:
                return
        raise AssertionError(f"{self.phases} without '{phase}'")


def test_a_view_counts_once_the_camera_rests_there(planner: MotionPlanner) -> None:
    trial = Trial(planner)
    trial.go_on(0.2)
    assert (trial.phases, trial.number("is_away")) == ([""], 1)
    trial.ask(FIRST)
    trial.until(LookPhase.MOVE)
    assert trial.number("is_away") == 0
    arrived = None
    while trial.read("phase") == LookPhase.MOVE:
        assert trial.number("looked") == 0
        before = trial.q
        trial.go_on(PERIOD)
        arrived = trial.context.get_time() if np.abs(trial.q - before).max() > 0 else arrived
    assert arrived is not None
    assert trial.context.get_time() - arrived > REST - PERIOD
    assert (trial.read("phase"), trial.number("looked")) == (LookPhase.LOOK, 1)
    assert_allclose(pose_at(camera_arm(), trial.q), FIRST.X_WC, atol=1e-3)
    there = trial.q
    trial.go_on(1.0)  # The same request is not a new view.
    assert_array_equal(trial.q, there)
    trial.ask(SECOND)
    trial.until(LookPhase.MOVE)
    assert trial.number("looked") == 1
    trial.until(LookPhase.LOOK)
    assert trial.number("looked") == 2
    assert_allclose(pose_at(camera_arm(), trial.q), SECOND.X_WC, atol=1e-3)
    assert (trial.number("unreachable"), trial.number("is_away")) == (0, 0)


def test_at_half_the_pace_a_motion_takes_twice_as_long(planner: MotionPlanner) -> None:
    ends = []
    for pace in (1.0, 0.5):
        trial = Trial(planner)
        trial.fix("pace", [pace])
        trial.ask(FIRST)
        trial.until(LookPhase.MOVE)
        ends.append(trial.system._state(trial.context).motion.times)
    assert_allclose(np.diff(ends[1]), 2.0 * np.diff(ends[0]))


def test_a_camera_that_gives_no_image_is_waited_for_and_then_given_up(
    planner: MotionPlanner,
) -> None:
    trial = Trial(planner)
    trial.ask(FIRST)
    trial.until(LookPhase.MOVE)
    trial.sees = False  # What was seen on the way is not the view.
    trial.until(LookPhase.WAIT)
    assert trial.read("failure") == f"the camera has given no image for {CONFIG.patience:g} s"
    assert trial.number("looked") == 0
    trial.ask(SECOND)
    trial.go_on(1.0)
    assert trial.read("phase") == ""


def test_a_view_counts_once_colour_has_come_too(planner: MotionPlanner) -> None:
    trial = Trial(planner)
    trial.fix("color_measured", AbstractValue.Make(StampedImage(time=0.0, image=ImageRgba8U())))
    trial.ask(FIRST)
    trial.until(LookPhase.MOVE)
    trial.until(LookPhase.WAIT)
    assert "no image" in trial.read("failure")


@pytest.mark.parametrize(
    "wanted", [replace(NO_TOUCH, number=1), replace(NO_TOUCH, done=True)], ids=["touch", "done"]
)
def test_it_goes_home_when_it_is_the_other_arms_turn(
    planner: MotionPlanner, wanted: TouchRequest
) -> None:
    trial = Trial(planner)
    trial.ask(FIRST)
    trial.until(LookPhase.LOOK)
    trial.touch(wanted)
    trial.until(LookPhase.HOME)
    while trial.read("phase") == LookPhase.HOME:
        at_home = bool(np.abs(trial.q - PANDA_AWAY).max() < 1e-9)
        assert trial.number("is_away") == at_home
        trial.go_on(PERIOD)
    assert trial.phases == ["", *(str(phase) for phase in list(LookPhase)[1:]), ""]
    assert_array_equal(trial.q, PANDA_AWAY)
    assert (trial.number("is_away"), trial.number("looked")) == (1, 1)
    trial.ask(SECOND)
    trial.go_on(1.0)
    assert (trial.read("phase"), trial.number("is_away")) == ("", 1)


def test_it_goes_home_when_no_view_is_wanted_and_comes_back(planner: MotionPlanner) -> None:
    trial = Trial(planner)
    trial.ask(FIRST)
    trial.until(LookPhase.LOOK)
    trial.ask(replace(FIRST, home=True))
    trial.until(LookPhase.WAIT)
    assert_array_equal(trial.q, PANDA_AWAY)
    assert (trial.number("is_away"), trial.number("looked")) == (1, 1)
    trial.ask(SECOND)
    trial.until(LookPhase.LOOK)
    assert (trial.number("is_away"), trial.number("looked")) == (0, 2)


def test_without_another_way_home_it_goes_back_as_it_came(planner: MotionPlanner) -> None:
    trial = Trial(planner)
    home = trial.q
    for number, wanted in enumerate((FIRST, SECOND), start=1):
        trial.ask(wanted)
        trial.until(LookPhase.LOOK)
        assert trial.number("looked") == number
    trial.ask(replace(SECOND, box_edges=np.ones(3)))  # The box now holds the camera, too.
    trial.touch(replace(NO_TOUCH, number=1))
    passed = []
    for _ in range(round(20.0 / PERIOD)):
        trial.go_on(PERIOD)
        passed.append(pose_at(camera_arm(), trial.q)[:3, 3])
        if trial.number("is_away"):
            break
    assert_array_equal(trial.q, home)
    assert trial.read("failure") == ""
    assert np.linalg.norm(np.array(passed) - FIRST.X_WC[:3, 3], axis=1).min() < 5e-3
    trial.touch(NO_TOUCH)
    trial.ask(replace(FIRST, number=3))
    trial.until(LookPhase.LOOK)
    assert trial.number("looked") == 3


def test_a_view_that_cannot_be_got_to_is_reported(planner: MotionPlanner) -> None:
    trial = Trial(planner)
    trial.ask(view(1, [2.0, 0.0, 0.5]))
    trial.go_on(0.1)
    assert (trial.number("unreachable"), trial.number("looked")) == (1, 0)
    assert trial.phases == [""]
    assert_array_equal(trial.q, PANDA_AWAY)
    trial.ask(SECOND)
    trial.until(LookPhase.LOOK)
    assert (trial.number("unreachable"), trial.number("looked")) == (1, 2)


@pytest.mark.parametrize(("height", "unreachable"), [(0.2, 0), (0.8, 1)])
def test_the_box_that_holds_the_object_is_in_the_way(
    planner: MotionPlanner, height: float, unreachable: int
) -> None:
    trial = Trial(planner)
    trial.ask(replace(view(1, [0.45, 0.0, 0.35]), box_edges=np.array([0.15, 0.1, height])))
    trial.go_on(0.1)
    assert trial.number("unreachable") == unreachable
