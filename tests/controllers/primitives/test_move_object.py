"""Grasps and pushes through their ports, with an ideal arm and what presses the taxels by hand."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
import shapely
from known_scene import pose_at, touch_arm, touch_planner
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator

from crossmodal.controllers.arm.motion_planner import MotionPlanner, box_vertices
from crossmodal.controllers.primitives.arm_task import TransitConfig
from crossmodal.controllers.primitives.move_object import MoveObject
from crossmodal.controllers.primitives.move_object_config import (
    ActionEnd,
    ActionPhase,
    MoveObjectConfig,
)
from crossmodal.maths.arrays import Array
from crossmodal.models.gripper_taxels import gripper_taxels, tip_taxels
from crossmodal.plants.robots.panda import PANDA_AWAY
from crossmodal.plants.robots.ur5 import UR5_HOME
from crossmodal.systems.port_values import (
    NO_ACTION,
    ActionRequest,
    DeclutterAction,
    Grasp,
    Push,
)
from tests.documented_ports import documented_of

PERIOD = 0.01
CONFIG = MoveObjectConfig(
    period=PERIOD, transit=TransitConfig(speed=1.0, joint_speed=1.0, rest_time=0.1)
)
LAYOUT = gripper_taxels()
INNER = [np.flatnonzero((LAYOUT.finger == f) & (LAYOUT.array % 4 == 3)) for f in (0, 1)]
OUTER = [np.flatnonzero((LAYOUT.finger == f) & (LAYOUT.array % 4 == 1)) for f in (0, 1)]
STIFFNESS = CONFIG.grip.stiffness
AT, HEIGHT, PLACE = np.array([0.55, 0.05]), 0.05, np.array([0.6, 0.3])
X_GRASP = np.eye(4)
X_GRASP[:3, :3] = np.diag([1.0, -1.0, -1.0])
X_GRASP[:3, 3] = [*AT, HEIGHT]
GRASP = ActionRequest(
    number=1,
    action=DeclutterAction.GRASP,
    object=4,
    grasps=(Grasp(X_WE=X_GRASP, width=0.08, quality=0.9),),
    places=np.array([PLACE]),
    passed=np.zeros(1),
    top=0.1,
)
# Where a finger would come down.
BESIDE = box_vertices(np.array([0.2, 0.02, 0.24]), RigidTransform([AT[0], AT[1] + 0.03, 0.12]))
GAP = 0.005
PUSH = ActionRequest(
    number=1,
    object=4,
    pushes=(
        Push(
            point=AT,
            direction=np.array([0.0, 1.0]),
            length=0.1,
            reach=0.03,
            height=0.03,
            place=AT - [0.0, GAP + 0.014],
            finger=shapely.box(AT[0] - 0.0135, AT[1] - GAP - 0.028, AT[0] + 0.0135, AT[1] - GAP),
        ),
    ),
    top=0.1,
)


@dataclass
class World:
    """An object between or ahead of the fingers, by what it does to them.

    Attributes:
        half_width: Of what is grasped, [m]; zero: there is nothing.
        weight: Of that, [N].
        friction: Shear over normal at which it is lost.
        lifted: From which height of the fingers on it hangs on them, [m].
        obstacle: Height of what meets the fingers' ends on the way down, [m].
        sideways: Load across the fingers until it is lowered, [N].
        resistance: Of what is pushed, [N].
        pushed: From where to where the finger meets it (2,), along y of W, [m].
        wall: Along y of W, farther than which the arm does not push, unfelt by taxels, [m].
    """

    half_width: float = 0.03
    weight: float = 3.0
    friction: float = 0.6
    lifted: float = HEIGHT + 0.004
    obstacle: float = -1.0
    sideways: float = 0.0
    resistance: float = 1.0
    pushed: tuple[float, float] = (AT[1] - 0.014, 1.0)
    wall: float = np.inf

    def act(self, X_WE: Array, phase: str, command: Array) -> tuple[Array, Array]:
        """Forces on the taxels (140, 3), [N], and where the fingers are (2,), [m]."""
        forces, height = np.zeros((140, 3)), X_WE[2, 3]
        if phase == ActionPhase.DESCEND and height < self.obstacle:
            forces[tip_taxels()[0], 2] = -0.5
        if phase == ActionPhase.PUSH and self.pushed[0] < X_WE[1, 3] < self.pushed[1]:
            lead = 0 if X_WE[1, 0] > 0.0 else 1
            share = self.resistance / len(OUTER[lead])
            forces[OUTER[lead], 0] = -X_WE[1, 0] * share
        near = np.linalg.norm(X_WE[:2, 3] - AT) < 0.01 and height < HEIGHT + 0.01
        if not near and phase not in tuple(ActionPhase)[5:9]:  # It is not between the fingers.
            return forces, np.maximum(command, 0.0)
        fingers = np.maximum(command, self.half_width)
        normal = np.clip(STIFFNESS * (fingers - command), 0.0, 10.0) * (self.half_width > 0.0)
        load = self.weight if height > self.lifted and normal.all() else 0.0
        if load > self.friction * normal.sum():
            self.half_width = 0.0
            return forces, np.maximum(command, 0.0)
        for finger, sign in enumerate((1.0, -1.0)):
            forces[INNER[finger], 0] = sign * normal[finger] / 16.0
            forces[INNER[finger], 2] = 0.5 * load / 16.0
            if load and phase != ActionPhase.LOWER:
                forces[INNER[finger], 1] = 0.5 * self.sideways / 16.0
        return forces, fingers


@pytest.fixture(scope="module")
def planner() -> MotionPlanner:
    return touch_planner()


class Trial:
    """`MoveObject` with an arm and fingers that are always where they are commanded to be."""

    def __init__(self, planner: MotionPlanner, world: World) -> None:
        self.system = MoveObject(
            CONFIG, touch_arm(), planner, "gripper", UR5_HOME, {"camera_arm": PANDA_AWAY}
        )
        self.simulator = Simulator(self.system)
        self.context = self.simulator.get_mutable_context()
        self.world, self.rng, self.noise = world, np.random.default_rng(0), 0.01
        self.offsets = self.rng.normal(0.0, 0.05, (140, 3))
        self.phases, self.q = [""], UR5_HOME
        self.largest_step, self.silent = 0.0, np.zeros(140, bool)
        self.fix("camera_arm_joint_state_measured", np.append(PANDA_AWAY, np.zeros(7)))
        self.ask(NO_ACTION)
        self.fix("is_clear", [1.0])
        self.measure()

    def fix(self, port: str, value: Any) -> None:
        self.system.GetInputPort(port).FixValue(self.context, value)

    def ask(self, wanted: ActionRequest) -> None:
        self.fix("action_request", AbstractValue.Make(wanted))

    def read(self, port: str) -> Any:
        return self.system.GetOutputPort(port).Eval(self.context)

    def measure(self) -> None:
        phase = self.read("phase")
        if phase != self.phases[-1]:
            self.phases.append(phase)
        q = np.array(self.read("joint_position_commanded"))
        self.largest_step = max(self.largest_step, float(np.abs(q - self.q).max()))
        self.q = q
        command = np.array(self.read("finger_position_commanded"))
        forces, fingers = self.world.act(pose_at(touch_arm(), q), phase, command)
        measured = forces + self.offsets + self.noise * self.rng.standard_normal((140, 3))
        measured[self.silent] = 0.0
        if phase != ActionPhase.PUSH or pose_at(touch_arm(), q)[1, 3] < self.world.wall:
            self.fix("joint_state_measured", np.append(q, np.zeros(6)))
        self.fix("taxel_measured", measured.ravel())
        self.fix("finger_position_measured", fingers)

    def go_on(self, duration: float) -> None:
        for _ in range(round(duration / PERIOD)):
            self.simulator.AdvanceTo(self.context.get_time() + PERIOD)
            self.measure()

    def run(self, number: int = 1, longest: float = 60.0) -> ActionEnd:
        for _ in range(round(longest / PERIOD)):
            self.go_on(PERIOD)
            end: ActionEnd = self.read("action_end")
            if end.number == number:
                return end
        raise AssertionError(f"{self.phases} without an end")


def done(planner: MotionPlanner, wanted: ActionRequest, world: World) -> tuple[Trial, ActionEnd]:
    """An action from its request to its end; the arm is at home and no command jumped."""
    trial = Trial(planner, world)
    trial.ask(wanted)
    end = trial.run()
    assert_array_equal(trial.q, UR5_HOME)
    # At the arm's largest joint speed.
    assert trial.largest_step < 1.01 * 3.2 * PERIOD
    return trial, end


def test_a_grasp_is_made_phase_by_phase(planner: MotionPlanner) -> None:
    trial, end = done(planner, GRASP, World())
    assert end.outcome == "placed"
    assert_allclose(end.X_WE[:2, 3], PLACE, atol=1e-3)
    assert HEIGHT - 1e-3 < end.X_WE[2, 3] < HEIGHT + 5e-3
    assert_allclose(end.X_WE[:3, 2], [0.0, 0.0, -1.0], atol=2e-3)
    grasping = [str(phase) for phase in ActionPhase if phase != ActionPhase.PUSH]
    assert trial.phases == [*grasping, ""]
    assert trial.read("is_done")[0] == 0.0
    trial.ask(replace(GRASP, done=True))
    trial.go_on(1.0)
    assert trial.read("is_done")[0] == 1.0
    assert_array_equal(trial.read("finger_position_commanded"), np.zeros(2))


def test_what_is_heavy_is_held_more_tightly(planner: MotionPlanner) -> None:
    """Twice 5 N bear 5.5 N at a friction of .55; it presses so that .4 would do."""
    trial = Trial(planner, World(weight=5.5))
    trial.ask(GRASP)
    while trial.read("phase") != ActionPhase.CARRY:
        trial.go_on(PERIOD)
    pressed = STIFFNESS * (0.03 - trial.read("finger_position_commanded"))
    assert_allclose(pressed, 0.5 * 5.5 / CONFIG.grip.load, rtol=0.1)
    assert trial.run().outcome == "placed"


@pytest.mark.parametrize(
    ("world", "phase"),
    [
        (World(friction=0.2), ActionPhase.LIFT),  # It drops as soon as it is lifted.
        (World(weight=10.0), ActionPhase.LIFT),  # More than .5 of 18 N are not borne safely.
    ],
    ids=["drops", "heavy"],
)
def test_what_slips_is_put_down_where_it_was(
    planner: MotionPlanner, world: World, phase: ActionPhase
) -> None:
    trial, end = done(planner, GRASP, world)
    assert end.outcome == "slipped"
    assert ActionPhase.CARRY not in trial.phases
    assert trial.phases[trial.phases.index(phase) + 1] == ActionPhase.LOWER
    assert_allclose(end.X_WE[:3, 3], X_GRASP[:3, 3], atol=2e-3)


def test_a_load_across_the_fingers_that_fades_does_not_drop_what_is_held(
    planner: MotionPlanner,
) -> None:
    _, end = done(planner, GRASP, World(weight=1.0, sideways=2.0))
    assert end.outcome == "placed"
    # It is let go where it has been lifted from, not above.
    assert end.X_WE[2, 3] == pytest.approx(HEIGHT, abs=6e-3)


def test_what_drops_while_it_is_carried_has_slipped_there(planner: MotionPlanner) -> None:
    trial = Trial(planner, World())
    trial.ask(GRASP)
    while trial.read("phase") != ActionPhase.CARRY:
        trial.go_on(PERIOD)
    trial.go_on(1.0)
    trial.world.half_width = 0.0
    at = pose_at(touch_arm(), trial.q)[:2, 3]
    end = trial.run()
    assert end.outcome == "slipped"
    assert_allclose(end.X_WE[:2, 3], at, atol=0.02)
    assert_array_equal(trial.q, UR5_HOME)


def test_a_gripper_that_closes_on_nothing_has_missed(planner: MotionPlanner) -> None:
    trial, end = done(planner, GRASP, World(half_width=0.0))
    assert end.outcome == "missed"
    assert ActionPhase.LIFT not in trial.phases
    assert np.isnan(end.X_WE).all()


@pytest.mark.parametrize("wanted", [GRASP, PUSH], ids=["grasp", "push"])
def test_what_meets_the_fingers_ends_on_the_way_down_blocks(
    planner: MotionPlanner, wanted: ActionRequest
) -> None:
    trial, end = done(planner, wanted, World(obstacle=HEIGHT + 0.04))
    assert end.outcome == "blocked"
    assert trial.phases[4:6] == [ActionPhase.RETREAT, ""]
    ((x, y, depth),) = end.contacts
    assert np.linalg.norm([x - AT[0], y - AT[1]]) < 0.06
    assert depth == np.inf


def test_what_stops_the_fingers_once_they_are_deep_enough_does_not_matter(
    planner: MotionPlanner,
) -> None:
    # Their ends stop 2.5 cm below the object's top.
    trial, _ = done(planner, GRASP, World(obstacle=HEIGHT + 0.025))
    assert trial.phases[4] == ActionPhase.CLOSE


def test_what_stops_the_fingers_just_before_the_grasp_is_the_table(planner: MotionPlanner) -> None:
    world = World(obstacle=HEIGHT + 0.003, lifted=HEIGHT + 0.01)
    assert done(planner, GRASP, world)[1].outcome == "placed"


def test_it_is_the_table_only_as_near_as_its_height_is_known(planner: MotionPlanner) -> None:
    for landing, phase in ((0.005, ActionPhase.RETREAT), (0.015, ActionPhase.CLOSE)):
        grasp = replace(GRASP, top=0.06, landing=landing)
        assert done(planner, grasp, World(obstacle=HEIGHT + 0.01))[0].phases[4] == phase


def test_fingers_that_have_landed_close_and_are_lifted_above_the_table(
    planner: MotionPlanner,
) -> None:
    table, heights = HEIGHT + 0.003, list[float]()
    trial = Trial(planner, World(obstacle=table, lifted=HEIGHT + 0.01))
    trial.ask(GRASP)
    for _ in range(round(20.0 / PERIOD)):
        trial.go_on(PERIOD)
        if trial.read("phase") in (ActionPhase.CLOSE, ActionPhase.LIFT):
            heights.append(float(pose_at(touch_arm(), trial.q)[2, 3]))
    assert trial.phases[4:7] == [ActionPhase.CLOSE, ActionPhase.LIFT, ActionPhase.CARRY]
    assert table + 0.5 * CONFIG.relief < min(heights) < table + CONFIG.relief


@pytest.mark.parametrize(
    "change",
    [
        {"grasps": (replace(GRASP.grasps[0], X_WE=np.diag([1.0, -1.0, -1.0, 1.0])),)},
        {"places": np.array([[0.55, 2.0]]), "passed": np.zeros(1)},
        {"obstacles": (BESIDE,)},
    ],
    ids=["grasp", "place", "obstacle"],
)
def test_what_cannot_be_done_is_reported_and_the_next_one_is_done(
    planner: MotionPlanner, change: dict[str, Any]
) -> None:
    trial = Trial(planner, World())
    trial.ask(replace(GRASP, **change))
    end = trial.run(longest=1.0)
    assert end.outcome == "unreachable"
    assert_array_equal(trial.q, UR5_HOME)
    trial.ask(replace(GRASP, number=2))
    assert trial.run(number=2).outcome == "placed"


def test_a_push_goes_its_length_from_the_contact_on(planner: MotionPlanner) -> None:
    trial, end = done(planner, PUSH, World())
    assert end.outcome == "pushed"
    assert end.pushed == pytest.approx(0.1, abs=3e-3)
    assert trial.phases[3:6] == [ActionPhase.DESCEND, ActionPhase.PUSH, ActionPhase.RETREAT]


def test_a_light_push_is_felt_by_all_taxels_of_a_face(planner: MotionPlanner) -> None:
    """.06 N on 24 taxels with a noise of .01 N each."""
    _, end = done(planner, PUSH, World(resistance=0.06))
    assert end.outcome == "pushed"
    assert end.pushed == pytest.approx(0.1, abs=2e-2)


@pytest.mark.parametrize(
    ("world", "outcome", "pushed"),
    [
        (World(pushed=(AT[1] - 0.014, AT[1] + 0.016)), "lost", 0.03),
        (World(resistance=0.0), "missed", 0.0),
        (World(resistance=20.0), "blocked", 0.0),
        (World(wall=AT[1] + 0.03), "blocked", 0.06),
    ],
    ids=["lost", "missed", "stuck", "held up by what no taxel feels"],
)
def test_a_push_that_fails_says_why(
    planner: MotionPlanner, world: World, outcome: str, pushed: float
) -> None:
    _, end = done(planner, PUSH, world)
    assert end.outcome == outcome
    assert end.pushed == pytest.approx(pushed, abs=0.02)


def test_it_waits_until_the_other_arm_is_out_of_the_way(planner: MotionPlanner) -> None:
    trial = Trial(planner, World())
    trial.fix("is_clear", [0.0])
    trial.ask(GRASP)
    trial.go_on(0.5)
    assert trial.phases == [""]
    trial.fix("is_clear", [1.0])
    trial.go_on(2 * PERIOD)
    assert trial.read("phase") == ActionPhase.TARE


def test_without_taxels_at_the_end_nothing_is_done(planner: MotionPlanner) -> None:
    trial = Trial(planner, World())
    trial.silent[tip_taxels()[3]] = True
    trial.measure()
    trial.ask(GRASP)
    trial.go_on(1.0)
    assert "at the fingers' end always say the same" in trial.read("failure")
    assert trial.read("is_done")[0] == 1.0
    assert trial.phases == ["", ActionPhase.TARE, ""]


def test_documented_ports_are_the_declared_ones(planner: MotionPlanner) -> None:
    system = Trial(planner, World()).system
    inputs = [system.get_input_port(k).get_name() for k in range(system.num_input_ports())]
    outputs = [system.get_output_port(k).get_name() for k in range(system.num_output_ports())]
    named = [name.replace("<other>", "camera_arm") for name in documented_of(MoveObject, "input")]
    assert sorted(named) == sorted(inputs)
    assert documented_of(MoveObject, "output") == outputs
