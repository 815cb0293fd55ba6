"""Writes down what the network believes and what is true, for the evaluation after the episode."""

from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, InputPort, LeafSystem, State
from pydrake.systems.sensors import ImageRgba8U

from diagrams.run.record import FrameRecord, ModalityRecord, TickRecord, Truth
from maths.arrays import Array
from systems.port_values import (
    UNKNOWN_END_EFFECTOR,
    BodyMotions,
    GraspBelief,
    JointBeliefs,
    JointType,
    PoseBelief,
    no_features,
)


@dataclass(kw_only=True)
class RecorderConfig:
    period: float = 1.0 / 15.0  # The network's period, [s].
    frame_interval: float = 0.5  # Least time between kept colour images, [s].
    max_frames: int = 32  # Kept colour images; beyond it every other one is given up.


class EpisodeRecorder(LeafSystem):
    """Logs the beliefs of each modality, the truth and some images into lists of its own.

    At the instant of a tick, before the network updates, it reads what the sensors see there: the
    truth and the image. Half a period later it reads the `latest` beliefs, which are still those of
    the tick, and stamps them with the tick's time. So belief and truth belong to one instant.

    The lists live outside the Context, so one recorder serves one simulation.

    .. pydrake_system::

        name: EpisodeRecorder
        input_ports:
        - color_image
        - interaction_active
        - cheat_configuration
        - cheat_body_pose
        - <modality>_joints_latest
        - <modality>_body_motions_latest
        - <modality>_features_latest
        - <modality>_grasp_latest
        - <modality>_end_effector_latest
        - <modality>_hand_bending_latest

    - `color_image`: `ImageRgba8U`. - `interaction_active` (1): non-zero while the hand holds.
    - `cheat_configuration` (1): the joint's true position, [m or rad]. - `cheat_body_pose`:
      `RigidTransform` X_WB of the moved body.
    - `<modality>_joints_latest`, `<modality>_body_motions_latest`, `<modality>_features_latest`,
      `<modality>_grasp_latest`, `<modality>_end_effector_latest` and
      `<modality>_hand_bending_latest`: `JointBeliefs`, `BodyMotions`, `FeatureBelief`,
      `GraspBelief`, `EndEffectorBelief` and `PoseBelief` X_EH; those without a source stay
      unconnected, as may the image.

    Frames: W world, B the moved body.
    """

    def __init__(self, config: RecorderConfig, modalities: Sequence[str]) -> None:
        super().__init__()
        for name in ("period", "frame_interval"):
            value = getattr(config, name)
            if not value > 0:
                raise ValueError(f"EpisodeRecorder: need {name} > 0 s, got {value!r}")
        if config.max_frames < 3:
            raise ValueError(f"EpisodeRecorder: need max_frames >= 3, got {config.max_frames}")
        self._config = config
        self._frame_interval = config.frame_interval
        self.modalities = {name: ModalityRecord() for name in modalities}
        self.frames: list[FrameRecord] = []
        self._times: list[float] = []
        self._configurations: list[float] = []
        self._X_WB: list[Array] = []
        self._grasp_times: list[float] = []
        self._held = False

        self._color = self.DeclareAbstractInputPort("color_image", Value(ImageRgba8U()))
        self._active = self.DeclareVectorInputPort("interaction_active", 1)
        self._configuration = self.DeclareVectorInputPort("cheat_configuration", 1)
        self._body_pose = self.DeclareAbstractInputPort("cheat_body_pose", Value(RigidTransform()))
        self._ports: dict[str, dict[str, InputPort]] = {}
        for modality in modalities:
            self._ports[modality] = {
                name: self.DeclareAbstractInputPort(
                    f"{modality}_{name}_latest", AbstractValue.Make(model)
                )
                for name, model in _belief_models().items()
            }
        self.DeclarePeriodicPublishEvent(config.period, 0.0, self._record_truth)
        self.DeclarePeriodicPublishEvent(config.period, 0.5 * config.period, self._record_beliefs)

    def truth(
        self,
        joint_name: str,
        joint_type: JointType,
        axis_W: Array,
        point_W: Array,
        parent_moves: bool = False,
    ) -> Truth:
        """The recorded truth, completed by the constants of the joint."""
        return Truth(
            joint_name=joint_name,
            joint_type=joint_type,
            axis_W=np.asarray(axis_W, dtype=float),
            point_W=np.asarray(point_W, dtype=float),
            times=np.array(self._times),
            configuration=np.array(self._configurations),
            X_WB=np.array(self._X_WB).reshape(-1, 4, 4),
            grasp_time=self._grasp_times[0] if self._grasp_times else float("nan"),
            regrasp_times=self._grasp_times[1:],
            parent_moves=parent_moves,
        )

    def _record_truth(self, context: Context) -> None:
        time = context.get_time()
        self._times.append(time)
        self._configurations.append(float(np.asarray(self._configuration.Eval(context))[0]))
        self._X_WB.append(np.asarray(self._body_pose.Eval(context).GetAsMatrix4()))
        held = bool(np.asarray(self._active.Eval(context))[0] > 0.5)
        if held and not self._held:
            self._grasp_times.append(time)
        self._held = held
        due = not self.frames or time >= self.frames[-1].time + self._frame_interval - 1e-6
        if due and self._color.HasValue(context):
            color = np.array(self._color.Eval(context).data[:, :, :3])
            self.frames.append(FrameRecord(time=time, color=color))

    def _record_beliefs(self, context: Context) -> None:
        if not self._times:
            return
        time = self._times[-1]
        for modality, ports in self._ports.items():
            values = {
                name: port.Eval(context) for name, port in ports.items() if port.HasValue(context)
            }
            features = values.get("features")
            self.modalities[modality].ticks.append(
                TickRecord(
                    time=time,
                    joints=values.get("joints", JointBeliefs()),
                    bodies=values.get("body_motions", BodyMotions()),
                    grasp=values.get("grasp"),
                    feature_count=0 if features is None else len(features.ids),
                    end_effector=values.get("end_effector"),
                    hand_bending=values.get("hand_bending"),
                )
            )
            if features is not None and self.frames and self.frames[-1].time == time:
                self.frames[-1].features[modality] = features
        self._thin_out_frames()

    def _thin_out_frames(self) -> None:
        if len(self.frames) > self._config.max_frames:
            del self.frames[1::2]
            self._frame_interval *= 2.0


def _belief_models() -> dict[str, object]:
    grasp = GraspBelief(
        probabilities={},
        X_HB=np.eye(4),
        covariance=np.eye(6),
        axis_H=np.array([1.0, 0.0, 0.0]),
        p_HA=np.zeros(3),
        line_covariance=np.zeros((6, 6)),
        free_motion=np.zeros((6, 6)),
    )
    return {
        "joints": JointBeliefs(),
        "body_motions": BodyMotions(),
        "features": no_features(),
        "grasp": grasp,
        "end_effector": UNKNOWN_END_EFFECTOR,
        "hand_bending": PoseBelief(X=np.eye(4), covariance=np.eye(6)),
    }


class TickStopwatch(LeafSystem):
    """Marks the wall time when its turn comes within the updates of one tick.

    Drake updates the systems of a Diagram in the order in which they were added. A stopwatch added
    before the filters of a modality and one after them measure what the filters' tick takes, as
    `stop.marks[k] - start.marks[k]`. What a stopwatch reads first, such as rendered images, is
    computed before it takes the time, and thereby left out.

    .. pydrake_system::

        name: TickStopwatch
        input_ports:
        - input_<n>

    - input_<n>: abstract, of any type given.
    """

    def __init__(self, period: float, inputs: Sequence[AbstractValue] = ()) -> None:
        super().__init__()
        if not period > 0:
            raise ValueError(f"TickStopwatch: need period > 0 s, got {period!r}")
        self.marks: list[float] = []
        self._inputs = [
            self.DeclareAbstractInputPort(f"input_{index}", model)
            for index, model in enumerate(inputs)
        ]
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._mark)

    def _mark(self, context: Context, _: State) -> None:
        for port in self._inputs:
            if port.HasValue(context):
                port.EvalAbstract(context)
        self.marks.append(perf_counter())
