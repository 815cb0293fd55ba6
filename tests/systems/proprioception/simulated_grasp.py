"""A simulated hand that moves a body: offset, bending, features, and both filters in a loop."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Diagram, DiagramBuilder

from crossmodal.maths import se3
from crossmodal.systems.port_values import (
    HELD_BODY,
    NO_SLIP,
    BodyMotion,
    BodyMotions,
    EndEffectorBelief,
    FeatureBelief,
    GraspBelief,
    HeldBody,
    MotionBelief,
    PoseBelief,
    SlipBelief,
)
from crossmodal.systems.proprioception.bent_hand import screw
from crossmodal.systems.proprioception.grasp_model import GraspModel
from crossmodal.systems.proprioception.grasp_model_config import GraspModelConfig
from crossmodal.systems.proprioception.held_body_motion import HeldBodyMotion
from crossmodal.systems.proprioception.held_body_state import HeldBodyMotionConfig

PERIOD = 1.0 / 15.0
X_WH_START = np.array(
    [[0.0, 0.0, 1.0, 0.8], [0.0, 1.0, 0.0, -0.2], [-1.0, 0.0, 0.0, 0.9], [0.0, 0.0, 0.0, 1.0]]
)
OFFSET_SIGMA = np.repeat([np.deg2rad(3.0), 0.01], 3)
ENCODER_SIGMA = np.repeat([5e-5, 5e-5], 3)
BENDING_SIGMA = np.repeat([8e-3, 1e-3], 3)
FEATURE_SIGMA, LANDMARK_SIGMA = 2e-3, 1e-3


@dataclass(kw_only=True)
class Scene:
    """What truly happens.

    Attributes:
        displacement: Of the body since the reference (4, 4), in W, at a time [s].
        coordinates: (phi, d) of the grasp at a time [s]; None: the hand has left the body there and
            goes on as `hand_alone` says.
        hand_alone: Displacement of the hand (4, 4) in W at a time, where it has left the body.
        axis: Of the grasp in H (3,), through point (3,).
        dark_from: [s].
        lit_from: [s]; if above zero, the features are placed in the body where it is believed to be
            when the light goes on.
        duration: [s].
        seen_share: Of the features, as far as they are seen at once.
        passed: How many of the others have come, and as many have gone, at a time [s].
    """

    displacement: Callable[[float], np.ndarray]
    coordinates: Callable[[float], tuple[float, float] | None] = lambda t: (0.0, 0.0)
    hand_alone: Callable[[float], np.ndarray] = lambda t: np.eye(4)
    axis: np.ndarray = field(default_factory=lambda: np.array([0.0, 1.0, 0.0]))
    point: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, -0.02]))
    dark_from: float = np.inf
    lit_from: float = 0.0
    duration: float = 8.0
    seen_share: float = 1.0
    passed: Callable[[float], int] = lambda t: 0


@dataclass(kw_only=True)
class Tick:
    """One tick's truth and beliefs."""

    X_WB: np.ndarray
    body: HeldBody  # None once it is lost; only those who lose it ask.
    prior: PoseBelief
    grasp: GraspBelief


def pull(speed: float = 0.02) -> Callable[[float], np.ndarray]:
    """A drawer that follows the hand along -x."""
    return lambda t: se3.exp(np.array([0.0, 0.0, 0.0, -speed * t, 0.0, 0.0]))


def swing(radius: float = 0.35, speed: float = 0.02) -> Callable[[float], np.ndarray]:
    """A flap about a horizontal axis below the handle, parallel to the bar."""
    hinge = X_WH_START[:3, 3] - [0.0, 0.0, radius]
    return lambda t: se3.exp(screw(np.array([0.0, -1.0, 0.0]), hinge) * speed * t / radius)


class AutoRegression:
    """Standard normal vectors whose error stays for about `time` seconds."""

    def __init__(self, rng: np.random.Generator, time: float) -> None:
        self._rng, self._rho = rng, np.exp(-PERIOD / time)
        self.value = rng.normal(size=6)

    def step(self) -> np.ndarray:
        noise = np.sqrt(1 - self._rho**2) * self._rng.normal(size=6)
        self.value = self._rho * self.value + noise
        return self.value


def make_diagram(
    vision: bool,
    body_config: HeldBodyMotionConfig,
    grasp_config: GraspModelConfig,
    grasp_wire: bool = True,
) -> Diagram:
    """Body and grasp filter in their loop, with the hand's ports exported.

    Without `grasp_wire` the grasp model does not see the body and stays the prior.
    """
    builder = DiagramBuilder()
    body = builder.AddNamedSystem("body", HeldBodyMotion(body_config, vision))
    grasp = builder.AddNamedSystem("grasp", GraspModel(grasp_config))
    builder.Connect(grasp.GetOutputPort("grasp_latest"), body.GetInputPort("grasp_latest"))
    if grasp_wire:
        seen = grasp.GetInputPort("body_motions_estimated")
        builder.Connect(body.GetOutputPort("body_motions_estimated"), seen)
    for name in (
        "end_effector_estimated",
        "hand_bending_estimated",
        "slip_estimated",
        "interaction_active",
    ):
        builder.ExportInput(body.GetInputPort(name), name)
        builder.ConnectInput(name, grasp.GetInputPort(name))
    if vision:
        builder.ExportInput(body.GetInputPort("features_estimated"), "features_estimated")
        builder.ExportInput(body.GetInputPort("body_motions_estimated"), "body_motions_seen")
    for name in ("body_prior", "body_motions_estimated"):
        builder.ExportOutput(body.GetOutputPort(name), name)
    builder.ExportOutput(grasp.GetOutputPort("grasp_estimated"), "grasp_estimated")
    return builder.Build()


class Episode:
    """Truth and noisy streams of one scene and seed."""

    def __init__(self, scene: Scene, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.scene, self.rng = scene, rng
        self.c = rng.normal(size=6)
        self.bending_error = AutoRegression(rng, 30.0)
        size = np.array([0.1, 0.1, 0.05, 0.004, 0.004, 0.004])
        self.bending_end = size * rng.normal(size=6)
        self.p_WF = rng.uniform([0.85, -0.4, 0.75], [0.9, 0.1, 1.0], (30, 3))
        X_WE, _ = self._end_effector(0.0)
        self.X_reference = np.eye(4)
        self.X_reference[:3, 3] = X_WE[:3, 3]
        self.p_BF = self.p_WF - self.X_reference[:3, 3]
        self.p_BF_seen = self.p_BF + LANDMARK_SIGMA * rng.normal(size=self.p_BF.shape)
        self.reset_count = 0

    def X_WH(self, t: float) -> np.ndarray:
        coordinates = self.scene.coordinates(t)
        if coordinates is None:
            return self.scene.hand_alone(t) @ X_WH_START
        turn = screw(self.scene.axis, self.scene.point) * coordinates[0]
        turn[3:] += self.scene.axis * coordinates[1]
        return self.scene.displacement(t) @ X_WH_START @ se3.exp(-turn)

    def X_WB(self, t: float) -> np.ndarray:
        return self.scene.displacement(t) @ self.X_reference

    def _bending(self, t: float) -> np.ndarray:
        return se3.exp(self.bending_end * min(t / 2.0, 1.0))

    def _end_effector(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Measured X_WE and its offset bias_jacobian."""
        X_WE = self.X_WH(t) @ se3.inverse(self._bending(t))
        start = np.eye(4)
        start[:3, 3] = X_WH_START[:3, 3]
        L = se3.adjoint(se3.inverse(X_WE) @ start) * OFFSET_SIGMA
        noise = ENCODER_SIGMA * self.rng.normal(size=6) * (t > 0)
        return X_WE @ se3.exp(-(L @ self.c + noise)), L

    def streams(self, t: float) -> tuple[EndEffectorBelief, PoseBelief]:
        X_WE, L = self._end_effector(t)
        ramp = min(t / 2.0, 1.0)
        error = ramp * BENDING_SIGMA * self.bending_error.step()
        covariance = np.zeros((12, 12))
        covariance[:6, :6] = L @ L.T + np.diag(ENCODER_SIGMA**2)
        covariance[6:, 6:] = np.diag(np.repeat([3e-3, 1e-3], 3) ** 2)
        twist = se3.log(se3.inverse(self.X_WH(t)) @ self.X_WH(t + 1e-3)) / 1e-3
        V = se3.adjoint(self._bending(t)) @ twist
        end_effector = EndEffectorBelief(X=X_WE, V=V, covariance=covariance, bias_jacobian=L)
        bending = PoseBelief(
            X=self._bending(t) @ se3.exp(-error),
            covariance=ramp**2 * np.diag(BENDING_SIGMA**2) + 1e-12 * np.eye(6),
        )
        return end_effector, bending

    def place(self, t: float, X_WB: np.ndarray) -> None:
        """Places the features in the body, which is believed to be at `X_WB`."""
        error = se3.inverse(X_WB) @ self.X_WB(t)
        self.p_BF_seen = self.p_BF_seen @ error[:3, :3].T + error[:3, 3]
        self.reset_count = 1

    def vision(self, t: float) -> tuple[FeatureBelief, BodyMotions]:
        lit = self.scene.lit_from <= t < self.scene.dark_from
        count = round(self.scene.seen_share * len(self.p_BF)) if lit else 0
        seen = np.arange(count) + self.scene.passed(t)
        X = self.X_WB(t)
        p_WF = self.p_BF @ X[:3, :3].T + X[:3, 3]
        p_WF = p_WF + FEATURE_SIGMA * self.rng.normal(size=p_WF.shape)
        ids = np.arange(len(p_WF), dtype=np.int64)
        covariance = np.tile(FEATURE_SIGMA**2 * np.eye(3), (count, 1, 1))
        features = FeatureBelief(
            ids=ids[seen],
            uv=np.zeros((count, 2)),
            p_WF=p_WF[seen],
            covariance=covariance,
            age=ids[seen],
        )
        motion = MotionBelief(X=np.eye(4), V=np.zeros(6), covariance=np.eye(12))
        body = BodyMotion(
            body_id=HELD_BODY,
            motion=motion,
            X_WB_reference=self.X_reference,
            feature_ids=ids,
            p_BF=self.p_BF_seen,
            p_BF_covariance=LANDMARK_SIGMA**2 * np.eye(3 * len(ids)),
            reset_count=self.reset_count,
        )
        return features, BodyMotions(bodies=[body])


def run(
    scene: Scene,
    seed: int,
    vision: bool,
    body_config: HeldBodyMotionConfig | None = None,
    grasp_config: GraspModelConfig | None = None,
    grasp_wire: bool = True,
    slip: Callable[[float], SlipBelief] = lambda t: NO_SLIP,
) -> list[Tick]:
    """Both filters over one episode, `slip` being what load and pressures say at a time."""
    episode = Episode(scene, seed)
    diagram = make_diagram(
        vision,
        body_config or HeldBodyMotionConfig(),
        grasp_config or GraspModelConfig(),
        grasp_wire,
    )
    context = diagram.CreateDefaultContext()
    diagram.GetInputPort("interaction_active").FixValue(context, 1.0)
    ticks = []
    for number in range(int(scene.duration / PERIOD)):
        t = number * PERIOD
        context.SetTime(t)
        end_effector, bending = episode.streams(t)
        values = {
            "end_effector_estimated": end_effector,
            "hand_bending_estimated": bending,
            "slip_estimated": slip(t),
        }
        for name, value in values.items():
            diagram.GetInputPort(name).FixValue(context, AbstractValue.Make(value))
        if vision:
            if 0.0 < scene.lit_from <= t and not episode.reset_count:
                episode.place(t, diagram.GetOutputPort("body_prior").Eval(context).X)
            features, motions = episode.vision(t)
            for name, value in (("features_estimated", features), ("body_motions_seen", motions)):
                diagram.GetInputPort(name).FixValue(context, AbstractValue.Make(value))
        X_WB = episode.X_WB(t)
        ticks.append(
            Tick(
                X_WB=X_WB,
                body=diagram.GetOutputPort("body_motions_estimated").Eval(context).find(HELD_BODY),
                prior=diagram.GetOutputPort("body_prior").Eval(context),
                grasp=diagram.GetOutputPort("grasp_estimated").Eval(context),
            )
        )
        diagram.ExecuteForcedEvents(context)
    return ticks


def body_error(tick: Tick) -> np.ndarray:
    return se3.log(se3.inverse(tick.body.motion.X) @ tick.X_WB)


def body_nees(tick: Tick) -> float:
    e = body_error(tick)
    return float(e @ np.linalg.solve(tick.body.motion.covariance[:6, :6], e))
