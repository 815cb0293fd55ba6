"""Motions of an arm from rest to rest through postures, within its speed limits."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from crossmodal.controllers.arm.kinematics import ArmModel
from crossmodal.controllers.arm.minimum_jerk import PEAK_RATE, minimum_jerk
from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable

_SAMPLES = 12  # Of a segment, at which the end-effector's speed is looked at.
_SHORTEST = 0.05  # Duration of a segment at least, [s].


@dataclass(frozen=True, kw_only=True)
class JointMotion(Immutable):
    """Straight segments in joint space.

    Attributes:
        times: At which the knots are reached (K,), increasing, [s].
        knots: Postures (K, n), [rad].
        steady: Whether the segments are passed at constant rates; else each goes from rest to rest
            by the minimum-jerk blend.
        eased: Whether time runs by that blend over the whole motion, from rest to rest.
    """

    times: Array
    knots: Array
    steady: bool = False
    eased: bool = False

    @property
    def end(self) -> float:
        """When the last knot is reached, [s]."""
        return float(self.times[-1])

    def at(self, time: float) -> Array:
        """The posture (n,) at a time [s]; before the first knot and after the last one, theirs."""
        time = self._eased(time)
        k = int(np.searchsorted(self.times, time, side="right")) - 1
        if k < 0 or k + 1 >= len(self.times):
            return self.knots[max(k, 0)]
        s = (time - self.times[k]) / (self.times[k + 1] - self.times[k])
        share = s if self.steady else minimum_jerk(s)[0]
        return self.knots[k] + share * (self.knots[k + 1] - self.knots[k])

    def back(self, time: float, q: Array) -> Array:
        """Postures (K, n) from where the arm is, back to the first knot, none of them ahead of it.

        An arm lags behind its command: the last knot that was commanded may lie ahead of it.

        Args:
            time: At which the arm is there, [s].
            q: Its posture (n,), [rad].
        """
        passed = self.knots[: int(np.searchsorted(self.times, self._eased(time)))]
        while len(passed) > 1 and (passed[-1] - q) @ (passed[-1] - passed[-2]) > 0.0:
            passed = passed[:-1]
        return np.vstack([q, passed[::-1]])

    def _eased(self, time: float) -> float:
        start, duration = float(self.times[0]), self.end - float(self.times[0])
        if not self.eased or duration == 0.0:
            return time
        return start + duration * minimum_jerk((time - start) / duration)[0]


def resting(q: Array) -> JointMotion:
    """The motion that stays at a posture (n,)."""
    return JointMotion(times=np.zeros(1), knots=q[None].copy())


def rest_to_rest(
    path: Array, arm: ArmModel, start: float, speed: float, joint_speed: Array
) -> JointMotion:
    """The motion through the postures of a path (K, n).

    Args:
        path: Postures, [rad].
        arm: The robot's own model.
        start: When it begins, [s].
        speed: Largest speed of the end-effector's origin, [m/s].
        joint_speed: Largest speed of each joint (n,), [rad/s].
    """
    times, still = [start], np.zeros(arm.num_joints)
    for q0, q1 in pairwise(path):
        shares = np.linspace(0.0, 1.0, _SAMPLES)
        postures = [arm.Evaluate(np.append(q0 + s * (q1 - q0), still)) for s in shares]
        p = np.array([posture.X_WE[:3, 3] for posture in postures])
        rate = np.linalg.norm(np.diff(p, axis=0), axis=1).max() * (_SAMPLES - 1)
        least = max(rate / speed, float(np.max(np.abs(q1 - q0) / joint_speed)))
        times.append(times[-1] + max(PEAK_RATE * least, _SHORTEST))
    return JointMotion(times=np.array(times), knots=np.array(path))


def along_line(
    postures: Array,
    arm: ArmModel,
    start: float,
    speed: float,
    joint_speed: Array,
    eased: bool = False,
) -> JointMotion:
    """The motion through postures (K, n) close to each other, the end-effector at one speed.

    It is slower where a joint would be too fast, and at the ends if it is eased; then `speed` is
    its largest.

    Args:
        postures: [rad].
        arm: The robot's own model.
        start: When it begins, [s].
        speed: Of the end-effector's origin, [m/s].
        joint_speed: Largest speed of each joint (n,), [rad/s].
        eased: Whether it goes from rest to rest by the minimum-jerk blend.
    """
    still = np.zeros(arm.num_joints)
    p = np.array([arm.Evaluate(np.append(q, still)).X_WE[:3, 3] for q in postures])
    steps = np.linalg.norm(np.diff(p, axis=0), axis=1) / speed
    steps = np.maximum(steps, np.max(np.abs(np.diff(postures, axis=0)) / joint_speed, axis=1))
    steps = np.maximum(steps, 1e-6)  # Times increase also where a posture comes twice.
    passed = np.concatenate([[0.0], np.cumsum(steps)]) * (PEAK_RATE if eased else 1.0)
    return JointMotion(times=start + passed, knots=np.array(postures), steady=True, eased=eased)
