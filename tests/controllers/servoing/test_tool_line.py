"""The tip of a held tool comes to a line and follows it, or says why it does not."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.common.value import Value
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from crossmodal.controllers.arm.kinematics import ArmModel
from crossmodal.controllers.servoing.flip_decisions import FlipPhase
from crossmodal.controllers.servoing.tool_line import ToolLine, tip_twist
from crossmodal.controllers.servoing.tool_line_decisions import (
    LinePhase,
    LineState,
    TipPath,
    ToolLineConfig,
    next_line_state,
    posture_on_table,
    unusable,
)
from crossmodal.diagrams.flap.flip_control import FlipControlConfig, make_line_control
from crossmodal.maths import se3
from crossmodal.plants.robots.arm_with_hand import make_arm_with_load
from crossmodal.plants.robots.lwr import LWR_WITH_THREE_FINGERS
from crossmodal.systems.port_values import UNKNOWN_TOOL, HingeBelief, ToolBelief

CONFIG = ToolLineConfig()
Q = np.array([-0.2, -0.43, 0.97, 1.19, 1.12, -0.89, 0.16])  # The hand lies along y.
STILL = np.concatenate([Q, np.zeros(7)])


@cache
def model() -> MultibodyPlant:
    base = RigidTransform(np.array([0.0, -0.45, 0.0]))
    return make_arm_with_load(LWR_WITH_THREE_FINGERS, base)


@cache
def arm() -> ArmModel:
    return ArmModel(model())


def pose(R: np.ndarray, p: np.ndarray) -> np.ndarray:
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = R, p
    return X


def tool(deviation: float = 0.003) -> ToolBelief:
    """A wiper below the hand, its flap turned by 115 deg about -y of the world."""
    X_WE = arm().Evaluate(STILL).X_WE
    k = np.array([0.0, -1.0, 0.0])
    X_WK = pose(np.column_stack([[0, 0, -1.0], np.cross(k, [0, 0, -1.0]), k]), [0.46, 0.05, 0.55])
    X_KT = pose(se3.so3_exp(np.array([0.0, 0.0, 2.0])), np.zeros(3))
    X_KT[:3, 3] = 0.085 * X_KT[:3, 0]
    hinge = HingeBelief(known=True, k_W=k, p_WK=X_WK[:3, 3], covariance=np.eye(6))
    covariance = deviation**2 * np.eye(3)
    return replace(
        UNKNOWN_TOOL,
        hinge=hinge,
        L1_W=X_WK[:3, 3] - X_WE[:3, 3],
        L1_covariance=covariance,
        L2_covariance=covariance,
        X_EK=se3.inverse(X_WE) @ X_WK,
        X_KT=X_KT,
    )


def turn(X: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(X[:3, :3])


class Episode:
    """Runs the decisions with an arm whose tip is where it should be."""

    def __init__(self, config: ToolLineConfig = CONFIG, offset: float = 0.0) -> None:
        self.config, self.offset = config, np.array([0.0, 0.0, offset])
        self.state, self.time = LineState(), 0.0
        self.X_WE = arm().Evaluate(STILL).X_WE
        self.phases: list[LinePhase] = []

    def go(self, seconds: float, flip: FlipPhase, belief: object = None) -> "Episode":
        for _ in range(round(seconds / self.config.period)):
            self.state = next_line_state(
                self.state, self.time, self.X_WE, flip, belief, self.config
            )
            if self.state.path is not None and self.state.X_ET is not None:
                X_WT = self.state.path.at(self.time)[0].copy()
                X_WT[:3, 3] += self.offset
                self.X_WE = X_WT @ se3.inverse(self.state.X_ET)
            self.phases.append(self.state.phase)
            self.time += self.config.period
        return self

    @property
    def tip(self) -> np.ndarray:
        assert self.state.X_ET is not None
        return self.X_WE @ self.state.X_ET


def test_the_tool_waits_for_the_finger_and_then_follows_the_line() -> None:
    episode = Episode().go(1.0, FlipPhase.FLIP, tool())
    assert episode.state.X_ET is None
    episode.go(1.0, FlipPhase.RETREAT, tool())
    assert episode.state.phase == LinePhase.WAIT
    assert episode.state.X_ET is not None
    episode.go(40.0, FlipPhase.DONE, tool())
    order = [a for a, b in zip(episode.phases, [None, *episode.phases], strict=False) if a != b]
    assert order == [
        LinePhase.WAIT, LinePhase.APPROACH, LinePhase.LOWER, LinePhase.LINE, LinePhase.DONE,
    ]  # fmt: skip
    assert_allclose(episode.tip[:3, 3], CONFIG.end, atol=1e-9)


def test_the_tool_is_the_one_at_the_end_of_the_flip() -> None:
    later = replace(tool(), X_EK=np.eye(4))
    episode = Episode().go(0.1, FlipPhase.RETREAT, tool()).go(0.1, FlipPhase.DONE, later)
    assert_allclose(episode.state.X_ET, tool().X_EK @ tool().X_KT)


def test_an_arm_that_the_estimators_take_to_be_displaced_puts_the_tip_elsewhere_by_that() -> None:
    off = np.array([0.003, -0.002, 0.005])
    displaced = replace(tool(), L1_W=tool().L1_W + off)
    state = Episode().go(0.1, FlipPhase.RETREAT, displaced).state
    X_WE = arm().Evaluate(STILL).X_WE
    assert_allclose(state.displacement, off, atol=1e-12)
    assert_allclose(state.tip(X_WE)[:3, 3], (X_WE @ state.X_ET)[:3, 3] - off)


def test_a_flip_that_failed_leads_to_no_line() -> None:
    episode = Episode().go(0.1, FlipPhase.FLIP, tool()).go(1.0, FlipPhase.FAILED, tool())
    assert episode.state.X_ET is None
    assert episode.state.phase == LinePhase.WAIT


@pytest.mark.parametrize(
    ("belief", "why"),
    [
        (None, "the tool is not known"),
        (UNKNOWN_TOOL, "the tool is not known"),
        (tool(0.05), "L1 of the tool is known to 50 mm only"),
    ],
)
def test_a_tool_that_is_not_known_is_not_moved_and_that_is_told(belief: object, why: str) -> None:
    episode = Episode().go(0.1, FlipPhase.RETREAT, belief).go(1.0, FlipPhase.DONE, tool())
    assert episode.state.phase == LinePhase.FAILED
    assert episode.state.why == f"the line on the table is not begun: {why}"
    assert episode.state.path is None


def test_a_hinge_that_stands_upright_is_not_laid_level() -> None:
    upright = replace(
        tool(), X_KT=pose(turn(se3.exp(np.array([0, 1.5708, 0, 0, 0, 0]))), [0, 0, 0])
    )
    episode = Episode().go(0.1, FlipPhase.RETREAT, upright).go(0.1, FlipPhase.DONE)
    assert "upright" in episode.state.why


def test_a_line_that_is_out_of_reach_is_given_up() -> None:
    episode = Episode(offset=0.01).go(0.1, FlipPhase.RETREAT, tool()).go(40.0, FlipPhase.DONE)
    assert episode.state.phase == LinePhase.FAILED
    assert episode.state.why.endswith("does not reach the place above the line on the table")


def test_a_known_tool_is_usable() -> None:
    assert unusable(tool(), 0.03) == ""


def test_on_the_table_the_hinge_is_level_and_the_flap_points_down_as_it_headed() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        R_WT = turn(arm().Evaluate(STILL).X_WE @ tool().X_EK @ tool().X_KT)
        R_WT = se3.so3_exp(rng.normal(0.0, 0.3, 3)) @ R_WT
        R = posture_on_table(R_WT, 0.3)
        assert_allclose(R.T @ R, np.eye(3), atol=1e-12)
        assert np.linalg.det(R) == pytest.approx(1.0)
        assert R[2, 2] == pytest.approx(0.0, abs=1e-12)
        assert R[2, 0] == pytest.approx(-np.sin(0.3))
        assert R[:2, 0] @ R_WT[:2, 0] > 0.0
        assert R[0, 2] * R_WT[1, 2] == pytest.approx(R[1, 2] * R_WT[0, 2])


def test_a_way_has_the_velocity_that_it_claims_and_ends_at_rest() -> None:
    X_end = se3.exp(np.array([0.3, -0.5, 0.2, 0.0, 0.0, 0.0]))
    X_end[:3, 3] = [0.1, 0.2, -0.3]
    path = TipPath(1.0, 2.0, np.eye(4), X_end)
    for time in (1.2, 2.0, 2.7):
        X, V = path.at(time)
        moved = se3.log(se3.inverse(path.at(time - 1e-5)[0]) @ path.at(time + 1e-5)[0])
        assert_allclose(V, moved / 2e-5, atol=1e-6)
    X, V = path.at(3.5)
    assert_allclose(X, X_end, atol=1e-12)
    assert_allclose(V, 0.0)


def test_the_arms_twist_moves_the_tip_by_the_ways() -> None:
    """By finite differences: E moves by its twist, T as the way says, plus what brings it back."""
    X_WE, X_ET = arm().Evaluate(STILL).X_WE, tool().X_EK @ tool().X_KT
    X_WT = X_WE @ X_ET
    X_end = X_WT @ se3.exp(np.array([0.2, 0.4, -0.1, 0.05, 0.02, -0.03]))
    path = TipPath(0.0, 1.0, X_WT, X_end)
    step = 1e-6
    V = tip_twist(path.at(0.4)[0], X_ET, path, 0.4, 2.0)
    moved = path.at(0.4)[0] @ se3.inverse(X_ET) @ se3.exp(step * V) @ X_ET
    assert_allclose(moved, path.at(0.4 + step)[0], atol=1e-9)
    off = se3.exp(np.array([0.0, 0.0, 0.0, 0.001, 0.0, 0.0]))
    back = tip_twist(X_WT @ off, X_ET, path, 0.0, 2.0)
    R_TE = X_ET[:3, :3].T
    assert_allclose(R_TE @ (back[3:] + np.cross(back[:3], X_ET[:3, 3])), [-0.002, 0, 0], atol=1e-9)


class FollowingArm(LeafSystem):
    """Joints that are where they are commanded to be one period later, as a sensor reads them."""

    def __init__(self, offset: np.ndarray) -> None:
        super().__init__()
        self.DeclareVectorInputPort("commanded", 7)
        state = self.DeclareDiscreteState(np.concatenate([Q + offset, np.zeros(7)]))
        self.DeclareStateOutputPort("measured", state)
        self.DeclarePeriodicDiscreteUpdateEvent(
            0.01,
            0.0,
            lambda context, values: values.get_mutable_vector().SetFromVector(
                np.concatenate([self.get_input_port().Eval(context) + offset, np.zeros(7)])
            ),
        )


@pytest.mark.parametrize("offset", [0.0, 0.001])
def test_a_tool_that_is_known_exactly_follows_the_line(
    offset: float,
) -> None:
    """The arm in a closed loop with its control; an offset of the drives is fed back."""
    builder = DiagramBuilder()
    control = builder.AddSystem(make_line_control(FlipControlConfig(), model(), Q))
    joints = builder.AddSystem(FollowingArm(np.full(7, offset)))
    builder.Connect(control.GetOutputPort("joint_position_commanded"), joints.get_input_port())
    builder.Connect(joints.get_output_port(), control.GetInputPort("joint_state_measured"))
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = control.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    control.GetInputPort("tool_latest").FixValue(context, Value[object](tool()))
    flip = control.GetInputPort("flip_phase")
    flip.FixValue(context, [float(FlipPhase.RETREAT)])
    simulator.Initialize()
    simulator.AdvanceTo(0.1)
    flip.FixValue(context, [float(FlipPhase.DONE)])
    errors = []
    while simulator.get_context().get_time() < 30.0:
        phase = control.GetOutputPort("phase").Eval(context)[0]
        p_WT = control.GetOutputPort("tip_estimated").Eval(context)
        if phase == LinePhase.LINE:
            errors.append(np.hypot(p_WT[1] - CONFIG.start[1], p_WT[2] - CONFIG.start[2]))
        if phase >= LinePhase.DONE:
            break
        simulator.AdvanceTo(simulator.get_context().get_time() + 0.05)
    assert phase == LinePhase.DONE
    assert len(errors) > 50
    assert max(errors) < 2e-4  # What arriving leaves, and it decays.
    assert max(errors[len(errors) // 2 :]) < 1e-4
    assert_allclose(p_WT, CONFIG.end, atol=CONFIG.arrival_distance)


def test_without_a_tool_the_arm_stays_and_the_tip_is_unknown() -> None:
    system = ToolLine(CONFIG, arm())
    context = system.CreateDefaultContext()
    system.GetInputPort("joint_state_measured").FixValue(context, STILL)
    system.GetInputPort("flip_phase").FixValue(context, [float(FlipPhase.RETREAT)])
    simulator = Simulator(system, context)
    simulator.Initialize()
    simulator.AdvanceTo(0.05)
    assert system.GetOutputPort("phase").Eval(context)[0] == LinePhase.FAILED
    assert "not known" in system.GetOutputPort("failure").Eval(context)
    assert_allclose(system.GetOutputPort("twist_desired").Eval(context), 0.0)
    assert np.isnan(system.GetOutputPort("tip_estimated").Eval(context)).all()


def test_a_line_without_length_is_refused() -> None:
    with pytest.raises(ValueError, match="ToolLine: end"):
        ToolLine(ToolLineConfig(end=CONFIG.start), arm())
