"""Synthetic streams of a body's noisy pose, plain ones and ones that leave the filters' model.

The parent P is the sensor, at rest. The body's frame B starts 0.8 to 1.2 m from Po in a random
direction with a random orientation; the joint's axis is random, and at the given radius from Bo, in
a random direction normal to it. Every frame, the first included, is measured as X_PB exp(n), n
Gaussian, the same in all rotations and in all translations: the noise acts at the body. What
differs from stream to stream is the motion, the share of outliers, and by how much the reported
covariance is wrong.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.vectors import normal_basis

RATE = 15.0  # [Hz]
Motion = Callable[[Array], Array]
FREE, BALL = "free", "ball"  # Motions that no joint with one degree of freedom explains.
OUTLIER_TRANSLATION = 0.05  # Length of an outlier's displacement, [m].
OUTLIER_ROTATION = np.deg2rad(20.0)
BEND_LENGTH = 0.15  # Over which deviations are alike, [m] of the child's path.
BEND_LEVER = 0.3  # [m].


@dataclass(kw_only=True)
class Case:
    """One kind of stream.

    Attributes:
        name: As the table calls it.
        joint: Type that moves the child, a value of `JointType`, or `FREE` or `BALL`.
        accepted: Types that are right at the end.
        motion: Configuration [m or rad] over time [s], zero at zero.
        duration: [s].
        radius: From the axis to the body, [m].
        pitch: Of a screw, [m/rad].
        translation_noise: One standard deviation per direction, [m].
        rotation_noise: The same, [rad].
        reported: Standard deviation that is reported, as a multiple of the true one.
        outliers: Share of the frames that are off by 5 cm and 20 deg in a random direction; None
            for a stream of whose frames none is drawn.
        bend: Smooth sideways deviation of the child from the joint's path: one standard deviation
            per direction, [m], and as many radians per `BEND_LEVER`.
        correlation_time: Of the noise, a Gauss-Markov process of first order, [s]; zero if white.
        wander: Besides, a smooth error of the rotation that is not reported, a Gaussian process in
            time: one standard deviation per direction, [rad].
        wander_time: Over which it is alike, [s].
        rotations: In every how many-th frame a rotation is measured; zero for none.
        held: How often each pose is sent before the next.
    """

    name: str
    joint: str
    accepted: tuple[str, ...]
    motion: Motion
    duration: float = 10.0
    radius: float = 0.35
    pitch: float = 0.0
    translation_noise: float = 3e-3
    rotation_noise: float = float(np.deg2rad(1.0))
    reported: float = 1.0
    outliers: float | None = 0.0
    bend: float = 0.0
    correlation_time: float = 0.0
    wander: float = 0.0
    wander_time: float = 1.0
    rotations: int = 1
    held: int = 1

    @property
    def covariance(self) -> Array:
        """That is reported of each frame (6, 6), in B."""
        scale = np.repeat([self.rotation_noise, self.translation_noise], 3)
        return np.asarray(np.diag((self.reported * scale) ** 2))

    def has_rotation(self, frame: int) -> bool:
        """Whether a rotation is measured in a frame."""
        return self.rotations > 0 and frame % self.rotations == 0


@dataclass(kw_only=True)
class RobustnessStream:
    """A stream and its truth; a held pose has that of its measurement.

    Attributes:
        times: (N,) [s].
        covariances: (N, 6, 6) reported, infinite on the diagonal where nothing was measured.
        X_PB_measured: (N, 4, 4).
        X_PB: (N, 4, 4) true.
        configuration: (N,) [m] or [rad].
        axis_P: (3,) unit vector in the direction of growing configuration.
        p_PA: (3,) a point of the axis, [m].
    """

    times: Array
    covariances: Array
    X_PB_measured: Array
    X_PB: Array
    configuration: Array
    axis_P: Array
    p_PA: Array


def _unit(rng: np.random.Generator) -> Array:
    v = rng.normal(size=3)
    return np.asarray(v / np.linalg.norm(v))


def joint_pose(case: Case, axis: Array, point: Array, q: float) -> Array:
    """The motion (4, 4) of the child in P from configuration zero to q [m or rad]."""
    turn, slide = (0.0, q) if case.joint == "prismatic" else (q, case.pitch * q)
    X = np.eye(4)
    X[:3, :3] = Rotation.from_rotvec(axis * turn).as_matrix()
    X[:3, 3] = point - X[:3, :3] @ point + slide * axis
    return X


def moved_joint(case: Case, stream: RobustnessStream, d: Array) -> tuple[Array, Array, Array]:
    """The first pose, the axis and its place, moved from the true ones by d (6 + 2 + 2,)."""
    B = normal_basis(stream.axis_P)
    axis = stream.axis_P + d[6:8] @ B
    point = stream.p_PA if case.joint == "prismatic" else stream.p_PA + d[8:10] @ B
    return stream.X_PB[0] @ se3.exp(d[:6]), axis / np.linalg.norm(axis), point


def _free_poses(case: Case, X0: Array, times: Array, rng: np.random.Generator) -> Array:
    """A body carried about by hand: turned about changing axes, and moved unless on a ball."""
    turns, shifts = rng.normal(size=(4, 3)), rng.normal(size=(4, 3))
    rates, phases = rng.uniform(0.3, 1.0, size=(4, 1)), rng.uniform(0.0, 6.0, size=(4, 1))
    centre = X0[:3, 3] + case.radius * _unit(rng)
    poses = []
    for t in times:
        swing = np.sin(rates * t + phases) - np.sin(phases)
        w = (turns * swing * 0.35).sum(axis=0)
        X = np.eye(4)
        X[:3, :3] = Rotation.from_rotvec(w).as_matrix()
        X[:3, 3] = centre - X[:3, :3] @ centre
        if case.joint == FREE:
            X[:3, 3] += (shifts * swing * 0.06).sum(axis=0)
        poses.append(X @ X0)
    return np.array(poses)


def _smooth(x: Array, length: float, rng: np.random.Generator, columns: int) -> Array:
    """Smooth random functions (N, columns) of x (N,), of unit variance."""
    K = np.exp(-0.5 * ((x[:, None] - x) / length) ** 2)
    return np.asarray(
        np.linalg.cholesky(K + 1e-9 * np.eye(x.size)) @ rng.normal(size=(x.size, columns))
    )


def _bent(case: Case, poses: Array, axis: Array, rng: np.random.Generator) -> Array:
    """The poses (N, 4, 4) with smooth sideways deviations, a Gaussian process."""
    p = poses[:, :3, 3]
    displacement = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))])
    deviations = _smooth(displacement, BEND_LENGTH, rng, 6)
    bent = []
    for X, v, e in zip(poses, np.gradient(p, axis=0), deviations, strict=True):
        along, about = X[:3, :3].T @ v / np.linalg.norm(v), X[:3, :3].T @ axis
        moved, turned = case.bend * e[3:], case.bend / BEND_LEVER * e[:3]
        moved -= along * (along @ moved)
        if case.joint == "revolute":
            turned -= about * (about @ turned)
        bent.append(X @ se3.exp(np.concatenate([turned, moved])))
    return np.array(bent)


def simulate_case(case: Case, seed: int | tuple[int, int]) -> RobustnessStream:
    """One stream, the same for the same seed, which may be a pair: a seed, and a case's number."""
    rng = np.random.default_rng(seed)
    axis, X0 = _unit(rng), np.eye(4)
    X0[:3, :3] = Rotation.random(random_state=rng).as_matrix()
    X0[:3, 3] = rng.uniform(0.8, 1.2) * _unit(rng)
    normal = np.cross(axis, _unit(rng))
    p_PA = X0[:3, 3] + case.radius * normal / np.linalg.norm(normal)
    frames = np.repeat(np.arange(round(case.duration * RATE) + 1), case.held)
    times = frames / RATE
    q = case.motion(times)
    if case.joint in (FREE, BALL):
        poses = _free_poses(case, X0, times, rng)
    else:
        poses = np.array([joint_pose(case, axis, p_PA, x) @ X0 for x in q])
    if case.bend > 0.0:
        poses = _bent(case, poses, axis, rng)
    scale = np.repeat([case.rotation_noise, case.translation_noise], 3)
    r = np.exp(-1.0 / (RATE * case.correlation_time)) if case.correlation_time > 0.0 else 0.0
    measured: list[Array] = []
    noise, wander = np.zeros(6), np.zeros((frames.size, 3))
    if case.wander > 0.0:
        wander = case.wander * _smooth(times, case.wander_time, rng, 3)
    for k, X in enumerate(poses):
        if k % case.held > 0:
            measured.append(measured[-1])
            continue
        fresh = scale * rng.normal(size=6)
        noise = r * noise + np.sqrt(1.0 - r * r) * fresh if k > 0 else fresh
        error = noise + np.concatenate([wander[k], np.zeros(3)])
        if case.outliers is not None and rng.random() < case.outliers:
            error += np.concatenate(
                [OUTLIER_ROTATION * _unit(rng), OUTLIER_TRANSLATION * _unit(rng)]
            )
        measured.append(X @ se3.exp(error))
        if not case.has_rotation(frames[k]):
            measured[-1][:3, :3] = np.eye(3)
    seen = np.array([case.has_rotation(int(frame)) for frame in frames])
    covariances = np.tile(case.covariance, (frames.size, 1, 1))
    covariances[~seen, :3, :3] += np.diag([np.inf] * 3)
    return RobustnessStream(
        times=np.arange(frames.size) / (RATE * case.held),
        covariances=covariances,
        X_PB_measured=np.array(measured),
        X_PB=poses,
        configuration=q,
        axis_P=axis,
        p_PA=p_PA,
    )


def _steady(final: float, duration: float) -> Motion:
    return lambda t: final * t / duration


def _sine(amplitude: float, period: float) -> Motion:
    return lambda t: amplitude * np.sin(2.0 * np.pi * t / period)


def _at_once(final: float, start: float, duration: float) -> Motion:
    return lambda t: final * np.clip((t - start) / duration, 0.0, 1.0)


def _in_steps(final: float) -> Motion:
    return lambda t: final * (np.clip(t - 1.0, 0.0, 3.0) + np.clip(t - 7.0, 0.0, 3.0)) / 6.0


def _still(t: Array) -> Array:
    return 0.0 * t


def _cases_of_table(door: Case, drawer: Case, rigid: Case) -> list[Case]:
    deg = np.deg2rad
    moving = [door, drawer]
    cases = []
    for share in (0.02, 0.1):
        cases += [
            replace(c, name=f"{c.name}, {100 * share:.0f} % outliers", outliers=share)
            for c in (*moving, rigid)
        ]
    cases += [
        replace(door, name="door, 90 deg in 1 s", motion=_at_once(deg(90), 2.0, 1.0), radius=0.5),
        replace(drawer, name="drawer, 0.3 m in 0.5 s", motion=_at_once(0.3, 2.0, 0.5)),
    ]
    for factor, size in ((1 / 3, "a third of"), (3.0, "three times")):
        cases += [
            replace(c, name=f"{c.name}, {size} the noise reported", reported=factor)
            for c in (*moving, rigid)
        ]
    screw = replace(door, joint="screw", accepted=("screw",), duration=15.0)
    cases += [
        replace(screw, name="screw, 1 cm a turn", pitch=0.01 / (2 * np.pi), motion=_steady(8, 15)),
        replace(screw, name="screw, 5 cm a radian", pitch=0.05, motion=_steady(2, 15)),
    ]
    cases += [
        replace(rigid, name=f"{joint} motion", joint=joint, accepted=("disconnected", "none"))
        for joint in (FREE, BALL)
    ]
    cases += [
        replace(door, name=f"door, 30 deg, period {p:g} s", motion=_sine(deg(30), p), duration=16.0)
        for p in (8.0, 4.0, 2.0)
    ]
    cases += [
        replace(drawer, name="drawer stops at once", motion=_at_once(0.1, 1.0, 5.0)),
        replace(
            drawer,
            name="drawer stops at once, 1 mm",
            motion=_at_once(0.1, 1.0, 5.0),
            translation_noise=1e-3,
            rotation_noise=float(deg(0.3)),
        ),
        replace(door, name="wheel, 120 deg/s", motion=_steady(deg(120) * 15, 15), duration=15.0),
        replace(door, name="wheel, 300 deg/s", motion=_steady(deg(300) * 15, 15), duration=15.0),
        replace(door, name="hinge at 3 m", motion=_steady(0.15, 20), radius=3.0, duration=20.0),
        replace(door, name="hinge at 10 m", motion=_steady(0.06, 20), radius=10.0, duration=20.0),
    ]
    fine: dict[str, Any] = {
        "bend": 2e-3,
        "translation_noise": 1e-3,
        "rotation_noise": float(deg(0.3)),
    }
    cases += [
        replace(door, name="door, bent by 2 mm, 1 mm", **fine),
        replace(drawer, name="drawer, bent by 2 mm, 1 mm", motion=_steady(0.4, 12), **fine),
    ]
    return cases + _cases_of_trackers(door, drawer, rigid)


def _cases_of_trackers(door: Case, drawer: Case, rigid: Case) -> list[Case]:
    return [
        *[
            replace(c, name=f"{c.name}, errors correlated over 0.5 s", correlation_time=0.5)
            for c in (door, drawer, rigid)
        ],
        *[replace(c, name=f"{c.name}, each pose sent 4 times", held=4) for c in (door, rigid)],
        *[replace(c, name=f"{c.name}, positions alone", rotations=0) for c in (door, drawer)],
        replace(rigid, name="rigid, a rotation in every fifth frame", rotations=5),
    ]


def plain_cases(outliers: float | None = None) -> list[Case]:
    """The nine plain streams, which move evenly and are seen to 1 mm, 3 mm and 1 cm."""
    joints = [
        ("drawer", "prismatic", 1.0, 0.225, 11.25),
        ("door", "revolute", 0.35, np.deg2rad(85.0), 30.0),
        ("lid", "revolute", 0.15, np.deg2rad(100.0), 30.0),
    ]
    return [
        Case(
            name=f"{name} {noise}",
            joint=joint,
            accepted=(joint,),
            motion=_steady(final, round(duration * RATE) / RATE),
            duration=duration,
            radius=radius,
            translation_noise=translation,
            rotation_noise=float(np.deg2rad(rotation)),
            outliers=outliers,
        )
        for name, joint, radius, final, duration in joints
        for noise, translation, rotation in (
            ("1 mm", 1e-3, 0.3),
            ("3 mm", 3e-3, 1.0),
            ("1 cm", 1e-2, 3.0),
        )
    ]


def wandering_cases() -> list[Case]:
    """Nine motions as trackers see them whose rotations err smoothly, by more than they report."""
    deg = np.deg2rad
    base: dict[str, Any] = {"rotation_noise": float(deg(0.2)), "duration": 12.0}
    door = Case(
        name="door", joint="revolute", accepted=("revolute",), motion=_steady(deg(85), 12), **base
    )
    drawer = replace(door, name="drawer", joint="prismatic", accepted=("prismatic",))
    drawer = replace(drawer, motion=_steady(0.3, 12))
    motions = [
        drawer,
        replace(drawer, name="drawer to and fro", motion=_sine(0.15, 6.0)),
        replace(drawer, name="drawer with pauses", motion=_in_steps(0.3)),
        door,
        replace(door, name="door to and fro", motion=_sine(deg(30), 6.0)),
        replace(door, name="lid", radius=0.15, motion=_steady(deg(100), 12)),
        replace(
            door,
            name="screw",
            joint="screw",
            accepted=("screw",),
            pitch=0.05,
            motion=_steady(2.0, 12),
        ),
        replace(door, name="rigid", joint="rigid", accepted=("rigid",), motion=_still),
        replace(door, name="free", joint=FREE, accepted=("disconnected",)),
    ]
    return [
        replace(
            case,
            name=f"{case.name}, {1e3 * noise:g} mm, {size:g} deg over {tau:g} s",
            translation_noise=noise,
            wander=float(deg(size)),
            wander_time=tau,
        )
        for case in motions
        for noise in (1e-3, 3e-3)
        for size in (1.0, 2.0, 4.0)
        for tau in (0.5, 1.5, 5.0)
    ]


def all_cases() -> list[Case]:
    """The cases of the table but for the nine plain streams."""
    door = Case(
        name="door",
        joint="revolute",
        accepted=("revolute",),
        motion=_steady(np.deg2rad(85.0), 15.0),
        duration=15.0,
    )
    drawer = Case(
        name="drawer",
        joint="prismatic",
        accepted=("prismatic",),
        motion=_steady(0.225, 11.25),
        duration=11.25,
    )
    rigid = Case(name="rigid", joint="rigid", accepted=("rigid",), motion=_still)
    return [door, drawer, rigid, *_cases_of_table(door, drawer, rigid)]
