"""Samples of joints, wrenches and pressures in messages of ROS, in the order of the robot's own."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.systems.recordings.recording import RecordingError


class JointRows:
    """Positions and rates (2 n,) of an arm's joints.

    Rates that were not recorded are the differences of positions.

    Args:
        topic: Of the joint states.
        names: Of the arm's joints from the base on; empty: the first ones of each message.
        count: n.
    """

    def __init__(self, topic: str, names: Sequence[str], count: int) -> None:
        self._topic, self._names, self._count = topic, names, count
        if names and len(names) != count:
            raise RecordingError(f"joint_names names {len(names)} joints; the arm has {count}")
        self._last: tuple[int, Array] | None = None

    def __call__(self, topic: str, time: int, message: Any) -> Array | None:
        position, velocity = np.asarray(message.position), np.asarray(message.velocity)
        if self._names:
            has = list(message.name)
            if not set(self._names) & set(has):
                return None  # Of another part of the robot, such as a gripper.
            missing = [name for name in self._names if name not in has]
            if missing:
                raise RecordingError(
                    f"'{topic}' has no joint '{missing[0]}'; has {', '.join(has)}: correct"
                    " joint_names in the map"
                )
            order = [has.index(name) for name in self._names]
        else:
            order = list(range(self._count))
        if len(position) <= max(order):
            raise RecordingError(
                f"'{topic}' has {len(position)} positions; the arm has {self._count} joints:"
                " write joint_names into the map"
            )
        q, last = position[order], self._last
        self._last = time, q
        if len(velocity) == len(position):
            return np.concatenate([q, velocity[order]])
        if last is None or time <= last[0]:
            return None
        return np.concatenate([q, (q - last[1]) / (1e-9 * (time - last[0]))])


def wrench_row(topic: str, time: int, message: Any) -> Array:
    """Torque [N m] and force [N] (6,) in the sensor's frame."""
    torque, force = message.wrench.torque, message.wrench.force
    return np.array([torque.x, torque.y, torque.z, force.x, force.y, force.z])


class PressureRows:
    """Pressures (n,) of the hand's chambers, [Pa]: in one message, or in a topic for each."""

    def __init__(self, topics: Sequence[str]) -> None:
        self._topics = list(topics)
        self._last = np.full(len(self._topics), np.nan)

    def __call__(self, topic: str, time: int, message: Any) -> Array | None:
        if hasattr(message, "data"):
            return np.asarray(message.data, dtype=float)
        k = self._topics.index(topic)
        self._last[k] = message.fluid_pressure
        whole = k == len(self._topics) - 1 and bool(np.isfinite(self._last).all())
        return self._last.copy() if whole else None
