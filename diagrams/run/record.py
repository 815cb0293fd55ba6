"""What an episode hands to the evaluation: what was believed, what was seen and what was true."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from diagrams.crossmodal.scenario import Scenario
from maths.arrays import Array
from systems.port_values import (
    BodyMotions,
    FeatureBelief,
    GraspBelief,
    JointBeliefs,
    JointType,
    MotionBelief,
    PoseBelief,
)


@dataclass(kw_only=True)
class Truth:
    """What is true about the explored joint. Only the evaluation reads it.

    Attributes:
        joint_name: Its name in the object's model.
        joint_type: Prismatic or revolute.
        axis_W: Unit axis (3,), the direction of growing q.
        point_W: A point (3,) on the axis, [m].
        times: Instants of the network's ticks (T,), [s].
        configuration: The joint's position q (T,), [m or rad].
        X_WB: Pose (T, 4, 4) of the moved body.
        grasp_time: The instant the hand was closed, [s]; estimated configurations count from here.
        regrasp_times: When it was closed again after a lost grasp, [s]; then they count from there.
        parent_moves: Whether the joint's parent can move too; axis and point are those before
            anything moved.
    """

    joint_name: str
    joint_type: JointType
    axis_W: Array
    point_W: Array
    times: Array
    configuration: Array
    X_WB: Array
    grasp_time: float
    parent_moves: bool = False
    regrasp_times: list[float] = field(default_factory=list)

    def last_grasp(self, time: float) -> float:
        """When the hand was last closed before `time`, [s]; else when it was closed first."""
        return max(
            (again for again in self.regrasp_times if again <= time), default=self.grasp_time
        )

    def opening(self) -> Array:
        """The joint's travel since the grasp (T,), [m or rad]; zero at the first tick after it."""
        if len(self.times) == 0:
            return self.configuration
        start = min(int(np.searchsorted(self.times, self.grasp_time)), len(self.times) - 1)
        return self.configuration - self.configuration[start]


@dataclass(kw_only=True)
class TickRecord:
    """What one modality believed after the tick at `time`.

    Attributes:
        time: Instant of the tick, [s].
        joints: The kinematic model.
        bodies: The moving bodies.
        grasp: None without proprioception.
        feature_count: Tracked point features; 0 without vision.
        end_effector: None without proprioception, like the next.
        hand_bending: X_EH.
    """

    time: float
    joints: JointBeliefs
    bodies: BodyMotions
    grasp: GraspBelief | None = None
    feature_count: int = 0
    end_effector: MotionBelief | None = None
    hand_bending: PoseBelief | None = None


@dataclass(kw_only=True)
class ModalityRecord:
    """One modality's beliefs over the episode and the wall time of each of its ticks, [s]."""

    ticks: list[TickRecord] = field(default_factory=list)
    tick_times: list[float] = field(default_factory=list)


@dataclass(kw_only=True)
class PinholeCamera:
    """The calibrated camera.

    Attributes:
        K: Intrinsic matrix (3, 3), [pixels].
        X_WC: Pose (4, 4); x right, y down, z forward.
    """

    K: Array
    X_WC: Array

    def project(self, p_WP: Array) -> Array:
        """Pixels (N, 2) of points (N, 3) in the world; NaN behind the camera."""
        p_CP = (np.atleast_2d(p_WP) - self.X_WC[:3, 3]) @ self.X_WC[:3, :3]
        depth = np.where(p_CP[:, 2] > 1e-6, p_CP[:, 2], np.nan)
        return (p_CP @ self.K.T)[:, :2] / depth[:, None]


@dataclass(kw_only=True)
class FrameRecord:
    """A colour image (H, W, 3) uint8 at `time` [s] and each modality's features at that tick."""

    time: float
    color: npt.NDArray[np.uint8]
    features: dict[str, FeatureBelief] = field(default_factory=dict)


@dataclass(kw_only=True)
class Phase:
    """A part of the task: the joint's target travel and what it truly reached, [m or rad]."""

    target: float
    reached: float


@dataclass(kw_only=True)
class Event:
    """Something that the robot knew that it did, at `time` [s]."""

    time: float
    name: str


@dataclass(kw_only=True)
class EpisodeResult:
    """One simulated episode.

    Attributes:
        scenario: As run, its `seed` set.
        truth: For the evaluation alone.
        modalities: By name, one for each of `scenario.modalities`.
        frames: Some camera images, in order of time.
        camera: Where they were taken from.
        duration: Simulated time, [s].
        wall_time: Of the simulation, without setting up, compiling and writing, [s].
        failure: Why the task was not done, in one line; None for a success.
        phases: By name; the exploration always.
        events: In order of time.
        peak_memory: Of the process, [bytes].
        interrupted: A person stopped it before its end.
        meshcat_html: The recording as a page that opens without a server.
        sensors_file: Where the sensor streams were kept.
    """

    scenario: Scenario
    truth: Truth
    modalities: dict[str, ModalityRecord]
    camera: PinholeCamera
    duration: float
    wall_time: float
    frames: list[FrameRecord] = field(default_factory=list)
    failure: str | None = None
    phases: dict[str, Phase] = field(default_factory=dict)
    events: list[Event] = field(default_factory=list)
    peak_memory: int = 0
    interrupted: bool = False
    meshcat_html: str | None = None
    sensors_file: Path | None = None
