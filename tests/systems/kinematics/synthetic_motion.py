"""Bodies that move on known joints, measured with noise."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.systems.kinematics.joint_filters import (
    JointFilters,
    JointFiltersConfig,
    JointFiltersState,
)
from crossmodal.systems.port_values import JointType

RATE = 15.0  # [Hz]
Motion = Callable[[Array], Array]


def steady(t: Array) -> Array:
    """Two centimetres per second from the first frame on."""
    return 0.02 * t


def at_rest(t: Array) -> Array:
    return 0.0 * t


def stop_and_go(t: Array) -> Array:
    return 0.02 * (np.minimum(t, 4.0) + np.clip(t - 8.0, 0.0, None))


def to_and_fro(t: Array) -> Array:
    return 0.1 * (1.0 - np.cos(2.0 * np.pi * t / 8.0))


@dataclass(kw_only=True)
class Scene:
    """A joint in P, the child's pose at q = 0 and its motion; q is the path over the lever.

    Attributes:
        joint: Rigid and disconnected stand still.
        radius: From the axis to the child, [m].
        pitch: Of a screw, [m/rad].
        distance: From Po to the child, [m].
        motion: Path over time, [m].
        seconds: Duration.
        translation: Noise, [m].
        rotation: Noise, [deg].
        correlation_time: Of the noise, [s].
    """

    joint: JointType
    radius: float = 0.35
    pitch: float = 0.1
    distance: float = 1.0
    motion: Motion = steady
    seconds: float = 10.0
    translation: float = 3e-3
    rotation: float = 1.0
    correlation_time: float = 0.0

    @property
    def covariance(self) -> Array:
        """Of each measurement (6, 6)."""
        return np.diag(np.repeat([np.deg2rad(self.rotation) ** 2, self.translation**2], 3))


@dataclass(kw_only=True)
class Run:
    """A scene, measured once.

    Attributes:
        times: (N,) [s].
        q: (N,) true configuration.
        X_PB: (N, 4, 4) true poses.
        measured: (N, 4, 4).
        axis: (3,) in P.
        point: (3,) of the axis in P.
    """

    times: Array
    q: Array
    X_PB: Array
    measured: Array
    axis: Array
    point: Array


def _unit(rng: np.random.Generator) -> Array:
    v = rng.normal(size=3)
    return np.asarray(v / np.linalg.norm(v))


def _noise(scene: Scene, count: int, rng: np.random.Generator) -> Array:
    n = rng.normal(size=(count, 6))
    if scene.correlation_time > 0.0:
        r = np.exp(-1.0 / (RATE * scene.correlation_time))
        for k in range(1, count):
            n[k] = r * n[k - 1] + np.sqrt(1.0 - r**2) * n[k]
    return n * np.repeat([np.deg2rad(scene.rotation), scene.translation], 3)


def simulate(scene: Scene, seed: int) -> Run:
    """Measures a scene in a random arrangement."""
    rng = np.random.default_rng(seed)
    axis = _unit(rng)
    X0 = se3.exp(np.concatenate([2.0 * _unit(rng), np.zeros(3)]))
    X0[:3, 3] = scene.distance * _unit(rng)
    normal = np.cross(axis, _unit(rng))
    point = X0[:3, 3] + scene.radius * normal / np.linalg.norm(normal)
    times = np.arange(round(scene.seconds * RATE) + 1) / RATE
    q = scene.motion(times)
    twist = np.concatenate([np.zeros(3), axis])
    if scene.joint in (JointType.REVOLUTE, JointType.SCREW):
        q = q / max(scene.radius, 0.2)
        climb = scene.pitch * axis if scene.joint == JointType.SCREW else np.zeros(3)
        twist = np.concatenate([axis, np.cross(point, axis) + climb])
    X = np.array([se3.exp(x * twist) @ X0 for x in q])
    noise = _noise(scene, times.size, rng)
    measured = np.array([a @ se3.exp(n) for a, n in zip(X, noise, strict=True)])
    return Run(times=times, q=q, X_PB=X, measured=measured, axis=axis, point=point)


def filter_states(
    scene: Scene, run: Run, config: JointFiltersConfig | None = None
) -> tuple[JointFilters, list[JointFiltersState]]:
    """The filters and their state after each measurement."""
    filters = JointFilters(config or JointFiltersConfig())
    states = [filters.start(run.measured[0], scene.covariance, float(run.times[0]))]
    for t, X in zip(run.times[1:], run.measured[1:], strict=True):
        states.append(filters.update(states[-1], X, scene.covariance, float(t)))
    return filters, states
