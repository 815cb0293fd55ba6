"""What is in a recording: topics, rates, gaps, clocks, and what their first messages hold."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from crossmodal.systems.recordings.camera_info import CAMERA_INFO
from crossmodal.systems.recordings.clock import StampClock
from crossmodal.systems.recordings.images import IMAGE_TYPES, encoding_of, size_of
from crossmodal.systems.recordings.open_recording import open_recording
from crossmodal.systems.recordings.pose_topics import POSE_TYPES, TF
from crossmodal.systems.recordings.recording import RecordingError, TopicFacts, stamp_of

JOINTS, WRENCH = "sensor_msgs/msg/JointState", "geometry_msgs/msg/WrenchStamped"
ARRAYS = ("std_msgs/msg/Float64MultiArray", "std_msgs/msg/Float32MultiArray")
FLUID = "sensor_msgs/msg/FluidPressure"
FLAGS = ("std_msgs/msg/Bool", "std_msgs/msg/Float64", "std_msgs/msg/Float32")
USED = (*IMAGE_TYPES, CAMERA_INFO, JOINTS, WRENCH, *ARRAYS, FLUID, *FLAGS, *POSE_TYPES)
_GAP = 3.0  # A pause is a gap from so many intervals on.


@dataclass(kw_only=True)
class TopicSurvey:
    """What is known of a topic.

    Attributes:
        facts: Its name, type and count.
        times: Of its messages, sorted, on the recording's axis, [ns].
        first: Its first message; None of a type that nothing is made of.
        frames: Of TF, those whose poses are there.
        jumps: How often its clock was set.
        late: By how much a message was logged after its stamp, at most, [s].
        disordered: Messages whose stamps are before those of the message before.
    """

    facts: TopicFacts
    times: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    first: Any = None
    frames: set[str] = field(default_factory=set)
    jumps: int = 0
    late: float = 0.0
    disordered: int = 0

    @property
    def interval(self) -> float:
        """Usual time between two messages, [s]; infinite of a single one."""
        if len(self.times) < 2:
            return np.inf
        pauses = 1e-9 * np.diff(self.times)
        return float(np.mean(pauses) if self._has_bursts else np.median(pauses))

    @property
    def _has_bursts(self) -> bool:
        """Whether messages come in bunches, as where several publish frames of TF."""
        return self.facts.type in TF or 2 * len(np.unique(self.times)) <= len(self.times)

    @property
    def rate(self) -> float:
        """[Hz]; zero of a single message."""
        return 1.0 / self.interval if self.interval > 0.0 else np.inf

    @property
    def gaps(self) -> list[tuple[float, float]]:
        """Pauses of several intervals: beginnings since the first message, and lengths, [s]."""
        if len(self.times) < 3 or self._has_bursts:
            return []
        pauses = 1e-9 * np.diff(self.times)
        starts = 1e-9 * (self.times[:-1] - self.times[0])
        long = pauses > _GAP * max(self.interval, 1e-9)
        return [(float(t), float(dt)) for t, dt in zip(starts[long], pauses[long], strict=True)]

    def holds(self) -> str:
        """What its messages hold, in words."""
        kind, first = self.facts.type, self.first
        if first is None:
            return ""
        if kind in IMAGE_TYPES:
            try:
                width, height = size_of(first)
            except RecordingError as error:
                return str(error)
            return f"{width} x {height} {encoding_of(first)}"
        if kind == JOINTS:
            return f"{len(first.position)} joints: {', '.join(first.name) or 'without names'}"
        if kind in ARRAYS:
            return f"{len(first.data)} numbers"
        if kind in TF:
            return ", ".join(sorted(self.frames))
        return ""


@dataclass(kw_only=True)
class Survey:
    """What is in a recording.

    Attributes:
        path: Of the recording.
        topics: By name.
    """

    path: Path
    topics: dict[str, TopicSurvey]

    @property
    def start(self) -> int:
        """Of the first message, [ns]."""
        return min(int(each.times[0]) for each in self.topics.values() if len(each.times))

    @property
    def end(self) -> int:
        """Of the last message, [ns]."""
        return max(int(each.times[-1]) for each in self.topics.values() if len(each.times))

    def of_type(self, *types: str) -> list[TopicSurvey]:
        """The topics of some types, by name."""
        return [each for each in self.topics.values() if each.facts.type in types]


def survey(path: Path, progress: Callable[[int], object] | None = None) -> Survey:
    """Reads a recording once, message by message.

    Args:
        path: Of the recording.
        progress: Called with each message's number.

    Raises:
        RecordingError: where it cannot be read to its end.
    """
    with open_recording(path) as recording:
        topics = {name: TopicSurvey(facts=facts) for name, facts in recording.topics.items()}
        stamps: dict[str, list[int]] = {name: [] for name in topics}
        clocks = {name: StampClock() for name in topics}
        late = dict.fromkeys(topics, 0)
        for number, logged in enumerate(recording.messages(list(topics))):
            each = topics[logged.topic]
            stamp = 0
            if logged.type in USED:
                message = logged.decode()
                stamp = stamp_of(message)
                each.first = message if each.first is None else each.first
                if logged.type in TF:
                    each.frames |= {one.child_frame_id for one in message.transforms}
            time = clocks[logged.topic].time(stamp, logged.time)
            late[logged.topic] = max(late[logged.topic], logged.time - time)
            stamps[logged.topic].append(time)
            if progress is not None:
                progress(number)
    for name, each in topics.items():
        times = np.array(stamps[name], dtype=np.int64)
        each.disordered = int(np.sum(np.diff(times) < 0))
        each.times, each.jumps = np.sort(times), clocks[name].jumps
        each.late = 1e-9 * late[name]
    return Survey(
        path=path, topics={name: each for name, each in topics.items() if len(each.times)}
    )
