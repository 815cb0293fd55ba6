"""An episode made of port values with known errors, so that no simulation is needed."""

from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem, State

from crossmodal.diagrams.crossmodal.scenario import Scenario
from crossmodal.diagrams.joints.joint_truth import JointTruth, Truth, truth_of_ticks
from crossmodal.diagrams.run.calibration import Calibration, CalibrationErrors, Camera, calibrated
from crossmodal.diagrams.run.record import EpisodeRecord, EstimatorRecord, Event, Picture, Tick
from crossmodal.diagrams.run.scenario import CameraConfig, LightsOff
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.systems.port_values import (
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
PITCH = 0.0127  # Of a screw, [m/rad]; believed 3 % too large.
_NAMES = {JointType.PRISMATIC: "drawer", JointType.REVOLUTE: "hinge", JointType.SCREW: "spindle"}


def joint_belief(
    joint_type: JointType,
    axis: Array,
    q: float,
    q_std: float,
    axis_std: float,
    child_id: int = HELD_BODY,
    probability: float = 0.97,
    point: Array | None = None,
    pitch: float = np.nan,
) -> JointBelief:
    """A belief with the same axis and configuration in all moving types, the pitch 5 % unsure."""
    axis = axis / np.linalg.norm(axis)
    model = JointModelBelief(
        log_evidence=0.0,
        axis_P=axis,
        axis_covariance=axis_std**2 * (np.eye(3) - np.outer(axis, axis)),
        p_PA=np.zeros(3) if point is None else point,
        p_PA_covariance=1e-4 * np.eye(3),
        configuration=np.array([q, 0.02]),
        configuration_covariance=np.diag([q_std**2, 1e-6]),
        pitch_mixture=np.array([[1.0, pitch, (0.05 * pitch) ** 2]]),
    )
    rest = (1.0 - probability) / (len(JointType) - 1)
    probabilities = dict.fromkeys(JointType, rest)
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
        assigned_ids=feature_ids.astype(np.int64),
        p_BF=np.zeros((count, 3)),
        p_BF_covariance=np.zeros((3 * count, 3 * count)),
    )


def synthetic_episode(
    joint_type: JointType = JointType.PRISMATIC,
    seed: int = 3,
    duration: float = 16.0,
    opens_to: float = 1.0,
) -> EpisodeRecord:
    """A drawer, door or press pulled from 4 s on; vision is born late and ends with the lights.

    Args:
        opens_to: The sign of its configuration then.
    """
    rng = np.random.default_rng(seed)
    times = np.arange(0.0, duration + 1e-9, PERIOD)
    q = opens_to * (0.001 + 0.02 * np.maximum(0.0, times - 4.0))
    if joint_type != JointType.PRISMATIC:
        q = q * 4.0
    axis = (
        np.array([-1.0, 0.05, 0.02]) if joint_type == JointType.PRISMATIC else np.array([0, 0, 1.0])
    )
    axis = axis / np.linalg.norm(axis)
    point = np.array([0.8, 0.35, 0.5])
    handle = np.array([0.75, 0.0, 0.5])
    pitch = PITCH if joint_type == JointType.SCREW else np.nan
    climb = 0.0 if np.isnan(pitch) else pitch
    X_WB = np.array([_pose(joint_type, axis, point, handle, value, climb) for value in q])
    joint = JointTruth(
        name=_NAMES[joint_type],
        type=str(joint_type),
        axis_W=axis,
        point_W=point,
        parent_moves=False,
        pitch=pitch,
    )
    scenario = Scenario(system="crossmodal", name="drawer", seed=seed, duration=duration)
    scenario.cameras = {
        "camera": CameraConfig(
            position=np.array([-0.3, 0.75, 1.1]), looking_at=np.array([0.75, 0.0, 0.45])
        )
    }
    scenario.disturbances.lights_off.append(LightsOff(start=LIGHTS_OFF))
    (config,) = scenario.cameras.values()
    camera = config.camera()
    record = EpisodeRecord(
        scenario=scenario,
        calibration=Calibration(cameras={"camera": calibrated(camera, CalibrationErrors())}),
        station=[
            Tick(
                time=float(time),
                values={
                    "cheat_joint": joint,
                    "cheat_configuration": np.array([value]),
                    "cheat_body_pose": RigidTransform(X),
                    "interaction_active": np.array([float(time >= GRASP_TIME - 1e-9)]),
                },
            )
            for time, value, X in zip(times, q, X_WB, strict=True)
        ],
        estimators={},
        duration=duration,
        wall_time=11.0,
        events=[Event(time=2.0, name="closing"), Event(time=GRASP_TIME, name="exploring")],
        peak_memory=700_000_000,
    )
    truth = truth_of_ticks(record.station)
    errors = {"vision": (0.0015, 0.8), "proprioception": (0.006, 1.5), "crossmodal": (0.001, 0.4)}
    static = np.column_stack([rng.uniform(0.76, 0.8, 60), rng.uniform(-0.4, 0.4, 60),
                              rng.uniform(0.1, 0.8, 60)])  # fmt: skip
    moving = np.column_stack([np.full(40, 0.74), rng.uniform(-0.2, 0.2, 40),
                              rng.uniform(0.4, 0.6, 40)])  # fmt: skip
    features = [
        _features(camera, static, moving, X @ np.linalg.inv(truth.X_WB[0])) for X in truth.X_WB
    ]
    for name, (q_error, axis_error) in errors.items():
        record.estimators[name] = _estimator(
            name, truth, q_error, np.deg2rad(axis_error), features, rng
        )
    for time in np.arange(0.0, duration, 0.5):
        nearest = float(times[int(np.argmin(np.abs(times - time)))])
        record.pictures.append(_picture(nearest))
    return record


def _pose(
    joint_type: JointType, axis: Array, point: Array, handle: Array, q: float, climb: float
) -> Array:
    X = np.eye(4)
    X[:3, 3] = handle
    if joint_type == JointType.PRISMATIC:
        return np.asarray(se3.exp(np.concatenate([np.zeros(3), q * axis])) @ X)
    way = climb * axis - np.cross(axis, point)
    return np.asarray(se3.exp(q * np.concatenate([axis, way])) @ X)


def _estimator(
    name: str,
    truth: Truth,
    q_error: float,
    axis_error: float,
    features: list[FeatureBelief],
    rng: np.random.Generator,
) -> EstimatorRecord:
    record = EstimatorRecord(tick_times=list(rng.uniform(0.005, 0.02, len(truth.times))))
    side = np.cross(truth.axis_W, [0.0, 0.0, 1.0] if abs(truth.axis_W[2]) < 0.9 else [1.0, 0, 0])
    side /= np.linalg.norm(side)
    body_id = 2 if name == "vision" else HELD_BODY
    opening = truth.opening()
    drift = 0.0
    sign = -1.0 if name == "proprioception" else 1.0
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
            q = sign * (opening[k] + drift)
            pitch, point = 1.03 * truth.pitch, truth.point_W
            joints.joints.append(
                joint_belief(kind, axis, q, q_error, spread, body_id, probability, point, pitch)
            )
            bodies.bodies.append(
                body_motion(body_id, truth.X_WB[k], truth.X_WB[0], np.arange(100, 140))
            )
        values: dict[str, Any] = {"joints_latest": joints, "body_motions_latest": bodies}
        if name != "proprioception":
            values["features_latest"] = features[k]
        if name != "vision":
            values["grasp_latest"] = GraspBelief(
                probabilities=dict.fromkeys(GraspType, 0.25),
                axis_H=np.array([0.0, 1.0, 0.0]), p_HA=np.zeros(3),
                line_covariance=np.zeros((6, 6)), free_motion=np.zeros((6, 6)),
            )  # fmt: skip
        record.ticks.append(Tick(time=float(time), values=values))
    return record


def _features(camera: Camera, static: Array, moving: Array, displacement: Array) -> FeatureBelief:
    """The resting features, and those of the body that has been moved by `displacement` (4, 4)."""
    moved = moving @ displacement[:3, :3].T + displacement[:3, 3]
    points = np.vstack([static, moved])
    return FeatureBelief(
        ids=np.concatenate([np.arange(40, 40 + len(static)), np.arange(100, 140)]).astype(np.int64),
        uv=camera.project(points),
        p_WF=points,
        covariance=np.tile(1e-6 * np.eye(3), (len(points), 1, 1)),
        age=np.full(len(points), 5),
    )


def _picture(time: float) -> Picture:
    color = np.full((480, 640, 3), 20 if time >= LIGHTS_OFF else 150, dtype=np.uint8)
    color[::40] //= 2
    return Picture(time=time, port="color_measured", color=color)


class ReplayedBeliefs(LeafSystem):
    """Outputs what station and estimators of a synthetic episode gave, as their ports would.

    The belief of the tick at t is stored at t, so it is what a reader sees after t.
    """

    def __init__(self, record: EpisodeRecord) -> None:
        super().__init__()
        self._record = record
        state = self.DeclareAbstractState(Value(-1))
        self._index = int(state)
        self.DeclarePeriodicUnrestrictedUpdateEvent(PERIOD, 0.0, self._step)
        empty = {"joints_latest": JointBeliefs(), "body_motions_latest": BodyMotions()}
        for name, estimator in record.estimators.items():
            for port, value in estimator.ticks[0].values.items():
                self._declare_belief(
                    name, port, empty.get(port, value), self.abstract_state_ticket(state)
                )
        for port, value in record.station[0].values.items():
            self._declare_truth(port, value)

    def _declare_belief(self, name: str, port: str, first: object, ticket: Any) -> None:
        ticks = self._record.estimators[name].ticks

        def calc(context: Context, output: AbstractValue) -> None:
            k = min(context.get_abstract_state(self._index).get_value(), len(ticks) - 1)
            output.set_value(ticks[k].values[port] if k >= 0 else first)

        self.DeclareAbstractOutputPort(
            f"{name}_{port}", lambda: AbstractValue.Make(first), calc, {ticket}
        )

    def _declare_truth(self, port: str, model: object) -> None:
        def calc(context: Context, output: Any) -> None:
            times = np.array([tick.time for tick in self._record.station])
            k = int(np.argmin(np.abs(times - context.get_time())))
            output.set_value(self._record.station[k].values[port])

        if isinstance(model, np.ndarray):
            self.DeclareVectorOutputPort(port, len(model), calc, {self.time_ticket()})
        else:
            self.DeclareAbstractOutputPort(
                port, lambda: AbstractValue.Make(model), calc, {self.time_ticket()}
            )

    def _step(self, context: Context, state: State) -> None:
        k = context.get_abstract_state(self._index).get_value()
        state.get_mutable_abstract_state(self._index).set_value(k + 1)


def connect_all(builder: DiagramBuilder, source: LeafSystem, sink: LeafSystem) -> None:
    """Connects ports of the same name."""
    for index in range(sink.num_input_ports()):
        port = sink.get_input_port(index)
        if source.HasOutputPort(port.get_name()):
            builder.Connect(source.GetOutputPort(port.get_name()), port)


def nudged(record: EpisodeRecord, way: float) -> EpisodeRecord:
    """The same episode, the joint moved by `way` [m or rad] while the hand closed.

    What vision believes of it counts from before that.
    """
    for tick in record.station:
        if tick.time < GRASP_TIME - 1e-9:
            tick.values["cheat_configuration"] = tick.values["cheat_configuration"] - way
    for tick in record.estimators["vision"].ticks:
        for joint in tick.values["joints_latest"].joints:
            joint.models[joint.type].configuration[0] += way
            joint.reference_age = tick.time
    return record


def without_truth(record: EpisodeRecord) -> EpisodeRecord:
    """The same episode as a real robot would record it: nobody knows what is true."""
    for tick in record.station:
        tick.values = {
            port: value for port, value in tick.values.items() if not port.startswith("cheat_")
        }
    return record


def empty_episode() -> EpisodeRecord:
    """An episode that a person stopped before its first tick."""
    record = synthetic_episode()
    record.interrupted, record.duration, record.wall_time = True, 0.0, 0.0
    for kept in (record.pictures, record.station, record.events):
        kept.clear()
    for estimator in record.estimators.values():
        estimator.ticks.clear()
        estimator.tick_times.clear()
    return record
