"""An episode made of port values with known errors, so that no simulation is needed."""

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem, State

from diagrams.crossmodal.scenario import Interval, Scenario
from diagrams.run.record import (
    EpisodeResult,
    FrameRecord,
    ModalityRecord,
    PinholeCamera,
    TickRecord,
    Truth,
)
from maths import se3
from maths.arrays import Array
from systems.port_values import (
    HELD_BODY,
    STATIC_BODY,
    BodyMotion,
    BodyMotions,
    FeatureBelief,
    GraspBelief,
    GraspType,
    JointBelief,
    JointBeliefs,
    JointModelBelief,
    JointType,
    MotionBelief,
)

PERIOD = 1.0 / 15.0
GRASP_TIME = 3.0
LIGHTS_OFF = 9.5


def joint_belief(
    joint_type: JointType,
    axis: Array,
    q: float,
    q_std: float,
    axis_std: float,
    child_id: int = HELD_BODY,
    probability: float = 0.97,
    point: Array | None = None,
) -> JointBelief:
    """A belief with the same axis and configuration in both moving types."""
    axis = axis / np.linalg.norm(axis)
    model = JointModelBelief(
        log_evidence=0.0,
        axis_P=axis,
        axis_covariance=axis_std**2 * (np.eye(3) - np.outer(axis, axis)),
        p_PA=np.zeros(3) if point is None else point,
        p_PA_covariance=1e-4 * np.eye(3),
        configuration=np.array([q, 0.02]),
        configuration_covariance=np.diag([q_std**2, 1e-6]),
    )
    probabilities = {kind: (1.0 - probability) / 3.0 for kind in JointType}
    probabilities[joint_type] = probability
    return JointBelief(
        parent_id=STATIC_BODY,
        child_id=child_id,
        probabilities=probabilities,
        models=dict.fromkeys(JointType, model),
        updates=10,
    )


def body_motion(body_id: int, X_WB: Array, X_WB_0: Array, feature_ids: Array) -> BodyMotion:
    count = len(feature_ids)
    return BodyMotion(
        body_id=body_id,
        motion=MotionBelief(X=X_WB, V=np.zeros(6), covariance=1e-6 * np.eye(12)),
        X_WB_reference=X_WB_0,
        feature_ids=feature_ids.astype(np.int64),
        p_BF=np.zeros((count, 3)),
        p_BF_covariance=np.zeros((3 * count, 3 * count)),
    )


def looking_at(position: Array, target: Array) -> Array:
    """X_WC (4, 4) of a camera with x right, y down, z forward."""
    z = (target - position) / np.linalg.norm(target - position)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    X = np.eye(4)
    X[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    X[:3, 3] = position
    return X


def synthetic_episode(
    joint_type: JointType = JointType.PRISMATIC, seed: int = 3, duration: float = 16.0
) -> EpisodeResult:
    """A drawer or door pulled from 4 s on; vision is born late and ends when the lights go off."""
    rng = np.random.default_rng(seed)
    times = np.arange(0.0, duration + 1e-9, PERIOD)
    q = 0.001 + 0.02 * np.maximum(0.0, times - 4.0)
    if joint_type == JointType.REVOLUTE:
        q = q * 4.0
    axis = (
        np.array([-1.0, 0.05, 0.02]) if joint_type == JointType.PRISMATIC else np.array([0, 0, 1.0])
    )
    axis = axis / np.linalg.norm(axis)
    point = np.array([0.8, 0.35, 0.5])
    handle = np.array([0.75, 0.0, 0.5])
    X_WB = np.array([_pose(joint_type, axis, point, handle, value) for value in q])
    truth = Truth(
        joint_name="drawer" if joint_type == JointType.PRISMATIC else "hinge",
        joint_type=joint_type,
        axis_W=axis,
        point_W=point,
        times=times,
        configuration=q,
        X_WB=X_WB,
        grasp_time=GRASP_TIME,
    )
    scenario = Scenario(name="drawer", seed=seed, duration=duration)
    scenario.disturbances.lights_off.append(Interval(start=LIGHTS_OFF))
    result = EpisodeResult(
        scenario=scenario,
        truth=truth,
        modalities={},
        camera=PinholeCamera(
            K=np.array([[577.0, 0, 319.5], [0, 577.0, 239.5], [0, 0, 1.0]]),
            X_WC=looking_at(np.array([-0.3, 0.75, 1.1]), np.array([0.75, 0.0, 0.45])),
        ),
        duration=duration,
        wall_time=11.0,
        peak_memory=700_000_000,
    )
    errors = {"vision": (0.0015, 0.8), "proprioception": (0.006, 1.5), "crossmodal": (0.001, 0.4)}
    static = np.column_stack([rng.uniform(0.76, 0.8, 60), rng.uniform(-0.4, 0.4, 60),
                              rng.uniform(0.1, 0.8, 60)])  # fmt: skip
    moving = np.column_stack([np.full(40, 0.74), rng.uniform(-0.2, 0.2, 40),
                              rng.uniform(0.4, 0.6, 40)])  # fmt: skip
    for name, (q_error, axis_error) in errors.items():
        result.modalities[name] = _modality(name, truth, q_error, np.deg2rad(axis_error), rng)
    for time in np.arange(0.0, duration, 0.5):
        k = int(np.argmin(np.abs(times - time)))
        result.frames.append(
            _frame(float(times[k]), result.camera, static, moving, X_WB[k] @ np.linalg.inv(X_WB[0]))
        )
    return result


def _pose(joint_type: JointType, axis: Array, point: Array, handle: Array, q: float) -> Array:
    X = np.eye(4)
    X[:3, 3] = handle
    if joint_type == JointType.PRISMATIC:
        return np.asarray(se3.exp(np.concatenate([np.zeros(3), q * axis])) @ X)
    return np.asarray(se3.exp(np.concatenate([q * axis, -q * np.cross(axis, point)])) @ X)


def _modality(
    name: str, truth: Truth, q_error: float, axis_error: float, rng: np.random.Generator
) -> ModalityRecord:
    record = ModalityRecord(tick_times=list(rng.uniform(0.005, 0.02, len(truth.times))))
    side = np.cross(truth.axis_W, [0.0, 0.0, 1.0] if abs(truth.axis_W[2]) < 0.9 else [1.0, 0, 0])
    side /= np.linalg.norm(side)
    body_id = 2 if name == "vision" else HELD_BODY
    opening = truth.opening()
    drift = 0.0
    sign = -1.0 if name == "proprioception" else 1.0
    frozen = opening
    for k, time in enumerate(truth.times):
        seen = time >= (5.5 if name == "vision" else GRASP_TIME)
        joints, bodies = JointBeliefs(), BodyMotions()
        if name == "vision" and time >= LIGHTS_OFF:
            seen = False
        if seen:
            age = max(time - 4.0, 0.1)
            drift = 0.9 * drift + rng.normal(0.0, 0.4 * q_error)
            spread = axis_error * np.sqrt(12.0 / (1.0 + age**2))
            axis = sign * (truth.axis_W + spread * rng.normal(0.0, 0.3) * side)
            kind = truth.joint_type if time > 5.0 else JointType.RIGID
            probability = min(0.4 + 0.1 * age**2, 0.995)
            q = sign * (frozen[k] + drift)
            joints.joints.append(
                joint_belief(kind, axis, q, q_error, spread, body_id, probability, truth.point_W)
            )
            bodies.bodies.append(
                body_motion(body_id, truth.X_WB[k], truth.X_WB[0], np.arange(100, 140))
            )
        grasp = None
        if name != "vision":
            grasp = GraspBelief(
                probabilities=dict.fromkeys(GraspType, 0.25),
                X_HB=np.eye(4), covariance=np.eye(6), axis_H=np.array([0.0, 1.0, 0.0]),
                p_HA=np.zeros(3), line_covariance=np.zeros((6, 6)), free_motion=np.zeros((6, 6)),
            )  # fmt: skip
        record.ticks.append(
            TickRecord(
                time=float(time),
                joints=joints,
                bodies=bodies,
                grasp=grasp,
                feature_count=0 if name == "proprioception" else 100,
            )
        )
    return record


def _frame(
    time: float, camera: PinholeCamera, static: Array, moving: Array, displacement: Array
) -> FrameRecord:
    moved = moving @ displacement[:3, :3].T + displacement[:3, 3]
    points = np.vstack([static, moved])
    color = np.full((480, 640, 3), 20 if time >= LIGHTS_OFF else 150, dtype=np.uint8)
    color[::40] //= 2
    features = FeatureBelief(
        ids=np.arange(40 + len(static), dtype=np.int64),
        uv=camera.project(points),
        p_WF=points,
        covariance=np.tile(1e-6 * np.eye(3), (len(points), 1, 1)),
        age=np.full(len(points), 5),
    )
    features.ids[len(static) :] = np.arange(100, 140)
    return FrameRecord(
        time=time, color=color, features={"vision": features, "crossmodal": features}
    )


class ReplayedBeliefs(LeafSystem):
    """Outputs a synthetic episode's beliefs as the network's `latest` ports would be.

    The belief of the tick at t is stored at t, so it is what a reader sees after t.
    """

    def __init__(self, result: EpisodeResult) -> None:
        super().__init__()
        self._result = result
        state = self.DeclareAbstractState(Value(-1))
        self._index = int(state)
        self.DeclarePeriodicUnrestrictedUpdateEvent(PERIOD, 0.0, self._step)
        ticket = {self.abstract_state_ticket(state)}
        for modality, record in result.modalities.items():
            for name in ("joints", "body_motions", "features"):

                def calc(
                    context: Context,
                    output: AbstractValue,
                    record: ModalityRecord = record,
                    modality: str = modality,
                    name: str = name,
                ) -> None:
                    k = context.get_abstract_state(self._index).get_value()
                    output.set_value(self._value(record, modality, name, k))

                self.DeclareAbstractOutputPort(
                    f"{modality}_{name}_latest",
                    lambda record=record, modality=modality, name=name: AbstractValue.Make(
                        self._value(record, modality, name, -1)
                    ),
                    calc,
                    prerequisites_of_calc=ticket,
                )
        self.DeclareVectorOutputPort(
            "cheat_configuration", 1, lambda c, o: o.SetFromVector([self._truth_at(c)[0]])
        )
        self.DeclareAbstractOutputPort(
            "cheat_body_pose",
            lambda: Value(RigidTransform()),
            lambda c, o: o.set_value(RigidTransform(self._truth_at(c)[1])),
        )
        self.DeclareVectorOutputPort(
            "interaction_active",
            1,
            lambda c, o: o.SetFromVector([float(c.get_time() >= GRASP_TIME - 1e-9)]),
        )

    def _step(self, context: Context, state: State) -> None:
        k = context.get_abstract_state(self._index).get_value()
        state.get_mutable_abstract_state(self._index).set_value(k + 1)

    def _value(self, record: ModalityRecord, modality: str, name: str, k: int) -> object:
        k = min(k, len(record.ticks) - 1)
        if name == "joints":
            return record.ticks[k].joints if k >= 0 else JointBeliefs()
        if name == "body_motions":
            return record.ticks[k].bodies if k >= 0 else BodyMotions()
        frames = self._result.frames
        time = max(k, 0) * PERIOD
        return min(frames, key=lambda frame: abs(frame.time - time)).features["crossmodal"]

    def _truth_at(self, context: Context) -> tuple[float, Array]:
        truth = self._result.truth
        k = int(np.argmin(np.abs(truth.times - context.get_time())))
        return float(truth.configuration[k]), truth.X_WB[k]


def connect_all(builder: DiagramBuilder, source: LeafSystem, sink: LeafSystem) -> None:
    """Connects ports of the same name."""
    for index in range(sink.num_input_ports()):
        port = sink.get_input_port(index)
        if source.HasOutputPort(port.get_name()):
            builder.Connect(source.GetOutputPort(port.get_name()), port)


def empty_episode() -> EpisodeResult:
    """An episode that a person stopped before its first tick."""
    result = synthetic_episode()
    result.interrupted, result.duration, result.wall_time = True, 0.0, 0.0
    result.frames.clear()
    truth = result.truth
    truth.times, truth.configuration = np.zeros(0), np.zeros(0)
    truth.X_WB, truth.grasp_time = np.zeros((0, 4, 4)), float("nan")
    for record in result.modalities.values():
        record.ticks.clear()
        record.tick_times.clear()
    return result
