"""Where to touch an object next: candidate rays, whether they will meet it, what each would teach.

A touch is a straight approach of a fingertip along a ray. Whether and where it meets the object is
predicted for several poses drawn from the belief, so that doubt about the pose is doubt about the
touch.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from crossmodal.maths.arrays import Array, Ids, Mask
from crossmodal.maths.compiled import hot
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.validation import number
from crossmodal.systems.active.believed_box import believed_box
from crossmodal.systems.port_values import ObjectPose
from crossmodal.systems.pose.surface import cast_rays
from crossmodal.systems.pose.target_model import TargetModel


@dataclass(kw_only=True)
class TouchConfig:
    """Which touches are considered."""

    # Poses drawn from the belief.
    poses: int = number(16, at_least=1, at_most=1000)
    # From where an approach starts, before the box that is believed to hold the object.
    standoff: float = number(0.08, at_least=0.0, at_most=1.0, unit="m")
    # By how much approaches come from above at most, rather than along a face's normal.
    tilt: float = number(0.0, at_least=0.0, at_most=90.0, unit="deg")
    # By how much an approach goes on beyond where the object would be met at the latest.
    overtravel: float = number(0.03, at_least=0.0, at_most=1.0, unit="m")
    # Radius of the finger that approaches.
    finger: float = number(0.0, at_least=0.0, at_most=0.1, unit="m")
    # Least share of the poses that it meets.
    hit: float = number(0.85, at_least=0.0, at_most=1.0)
    # Least mean cosine between the approach and the surface's normal.
    incidence: float = number(0.7, at_least=0.0, at_most=1.0)
    # Noise of a contact.
    sigma: float = number(1e-3, at_least=1e-6, at_most=0.1, unit="m")
    # Least height of an approach above what the object stands on.
    clearance: float = number(0.02, at_least=0.0, at_most=1.0, unit="m")

    def of_finger(self) -> Array:
        """Points (F, 2) of the finger's end face: its middle, and six on its rim, [m]."""
        if self.finger == 0.0:
            return np.zeros((1, 2))
        angles = np.pi / 3.0 * np.arange(6)
        rim = self.finger * np.column_stack([np.cos(angles), np.sin(angles)])
        return np.vstack([np.zeros((1, 2)), rim])


@dataclass(frozen=True, kw_only=True)
class TouchPredictions(Immutable):
    """What each of R approaches would meet under each of K poses.

    Attributes:
        starts: (R, 3) in W, [m].
        directions: Unit vectors (R, 3) in W.
        distances: (K, R) from the start to the contact, infinite for a miss, [m].
        rows: (K, R, 6) by how much the distance to the surface changes with the pose, rotation in O
            and translation of the object's middle in W. Zero for a miss.
        incidence: (K, R) cosines between approach and normal; zero for a miss.
        poses: X_WO (K, 4, 4) of the object's middle.
        covariance: Of the pose (6, 6).
    """

    starts: Array
    directions: Array
    distances: Array
    rows: Array
    incidence: Array
    poses: Array
    covariance: Array

    @property
    def hit(self) -> Array:
        """Share of the poses (R,) that each approach meets."""
        return np.asarray(np.isfinite(self.distances).mean(axis=0))

    def feasible(self, config: TouchConfig) -> Mask:
        """Which approaches (R,) are likely to meet the object, and not at a grazing angle."""
        met = np.isfinite(self.distances)
        incidence = self.incidence.sum(axis=0) / np.maximum(met.sum(axis=0), 1)
        return np.asarray((self.hit >= config.hit) & (incidence >= config.incidence))


def candidate_rays(
    belief: ObjectPose,
    model: TargetModel,
    config: TouchConfig,
    count: int,
    rng: np.random.Generator,
    up: Array | None = None,
    height: float = -np.inf,
) -> tuple[Array, Array]:
    """Approaches to the faces of the box that holds the object, but the lowest one.

    They aim at the object at its likeliest pose.

    Args:
        belief: About its pose.
        model: Of the object.
        config: Of touches.
        count: Of approaches.
        rng: Of where on the faces they aim at.
        up: Unit vector (3,) in W.
        height: Of what the object stands on along `up`, [m].

    Returns:
        Starts and directions (count, 3) in W; fewer where approaches would come too low.
    """
    up = np.array([0.0, 0.0, 1.0]) if up is None else up
    X, corners = belief.X, model.hull
    low, high = corners.min(axis=0), corners.max(axis=0)
    lowest, highest = believed_box(belief, corners)
    size = high - low
    axes = [(axis, sign) for axis in range(3) for sign in (-1.0, 1.0)]
    normals = np.array([sign * np.eye(3)[axis] for axis, sign in axes])
    upwards = normals @ X[:3, :3].T @ up
    areas = np.array([np.prod(np.delete(size, axis)) for axis, _ in axes])
    areas = np.where(upwards > -0.7, areas, 0.0)
    faces = rng.choice(6, count, p=areas / areas.sum())
    aims = low + rng.uniform(size=(count, 3)) * size
    # A face's number is twice its axis, and one more where the normal is along it.
    aims[np.arange(count), faces // 2] = np.column_stack([lowest, highest]).ravel()[faces]
    aims = aims @ X[:3, :3].T + X[:3, 3]
    directions = -normals[faces] @ X[:3, :3].T
    angle = np.deg2rad(config.tilt) * rng.uniform(size=(len(aims), 1)) if config.tilt else 0.0
    level = np.abs(directions @ up)[:, None] < 0.9
    directions = np.where(level, np.cos(angle) * directions - np.sin(angle) * up, directions)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    starts = aims - config.standoff * directions
    # A fingertip must not touch what the object stands on.
    clear = np.minimum(starts @ up, aims @ up) > height + config.clearance
    return starts[clear], directions[clear]


def predict_touches(
    belief: ObjectPose,
    model: TargetModel,
    starts: Array,
    directions: Array,
    config: TouchConfig,
    rng: np.random.Generator,
) -> TouchPredictions:
    """What approaches would meet under poses drawn from the belief.

    Args:
        belief: About the pose.
        model: Of the object.
        starts: Of the approaches (R, 3), in W, [m].
        directions: Unit vectors (R, 3) in W.
        config: Of touches.
        rng: Of the poses that are drawn.
    """
    count, rays = config.poses, len(starts)
    X = belief.samples[rng.choice(len(belief.samples), count, replace=False)]
    distances = np.empty((count, rays))
    rows, incidence = np.zeros((count, rays, 6)), np.zeros((count, rays))
    face = across(directions, config.of_finger())
    points = face.shape[1]
    fingers = (starts[:, None] + face).reshape(-1, 3)
    along = np.repeat(directions, points, axis=0)
    farthest = np.linalg.norm(starts - belief.X[:3, 3], axis=1).max() + 2.0 * model.radius
    reach = np.full(len(fingers), farthest)
    for k in range(count):
        R, t = X[k, :3, :3], X[k, :3, 3]
        p, d = np.ascontiguousarray((fingers - t) @ R), np.ascontiguousarray(along @ R)
        cast, found = cast_rays(p, d, reach, model.surface, False)
        # What the finger meets first is where it is stopped.
        first = cast.reshape(rays, points).argmin(axis=1) + points * np.arange(rays)
        distances[k], samples, p, d = cast[first], found[first], p[first], d[first]
        _differentiate(
            p, d, distances[k], model.surface.normals, samples, X[k], rows[k], incidence[k]
        )
    return TouchPredictions(
        starts=starts,
        directions=directions,
        distances=distances,
        rows=rows,
        incidence=incidence,
        poses=X,
        covariance=belief.joint[:6, :6],
    )


@hot
def _differentiate(
    p: Array,
    d: Array,
    distances: Array,
    normals: Array,
    samples: Ids,
    X: Array,
    rows: Array,
    incidence: Array,
) -> None:
    """Writes how the distances (R,) of contacts at p + distance d change, and their incidence.

    Args:
        p: Starts (R, 3), about the object's middle.
        d: Unit vectors (R, 3) in O.
        distances: To the contacts, [m].
        normals: Of the object's samples, in O.
        samples: That are met (R,), -1 for a miss, of which nothing is written.
        X: X_WM (4, 4).
        rows: With the pose (R, 6).
        incidence: Cosines (R,).
    """
    at = np.empty(3)
    for r in range(len(p)):
        if samples[r] < 0:
            continue
        n = normals[samples[r]]
        for i in range(3):
            at[i] = p[r, i] + distances[r] * d[r, i]
            incidence[r] -= d[r, i] * n[i]
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            rows[r, i] = at[k] * n[j] - at[j] * n[k]
            rows[r, 3 + i] = -(X[i, 0] * n[0] + X[i, 1] * n[1] + X[i, 2] * n[2])


def across(directions: Array, face: Array) -> Array:
    """Offsets (R, F, 3) of a finger's points (F, 2) across its directions (R, 3)."""
    level = np.where(np.abs(directions[:, 2:]) < 0.9, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])
    x = np.cross(directions, level)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    y = np.cross(directions, x)
    return np.asarray(face[:, :1] * x[:, None] + face[:, 1:] * y[:, None])


Criterion = Callable[[TouchPredictions, TargetModel, float, np.random.Generator], Array]


def random_touch(
    predicted: TouchPredictions, model: TargetModel, sigma: float, rng: np.random.Generator
) -> Array:
    """Gains (R,) by lot."""
    return rng.uniform(size=len(predicted.starts))


def expected_log_det(
    predicted: TouchPredictions, model: TargetModel, sigma: float, rng: np.random.Generator
) -> Array:
    """Gains (R,): by how much a contact shrinks the pose's covariance, a miss counting nothing."""
    gain, variance = _innovations(predicted, sigma)
    return _log_det_fall(gain, variance, predicted.covariance)


def _log_det_fall(gain: Array, variance: Array, covariance: Array) -> Array:
    """Half the mean fall (R,) of ln |C| by a contact: -1/2 ln(1 - g' C^-1 g / v).

    Args:
        gain: Covariances g (K, R, n) of the contacts' distances with what C is of.
        variance: Of the distances (K, R).
        covariance: C (n, n).
    """
    whitened = np.linalg.solve(np.linalg.cholesky(covariance), gain[..., None])
    share = np.sum(whitened[..., 0] ** 2, axis=2) / variance
    return np.asarray(-0.5 * np.log1p(-np.minimum(share, 1.0 - 1e-12)).mean(axis=0))


def expected_adi(
    predicted: TouchPredictions, model: TargetModel, sigma: float, rng: np.random.Generator
) -> Array:
    """Gains (R,): by how much the mean squared distance between surfaces falls, [m^2].

    A contact whose distance to the surface has the covariance g with the pose and the variance v
    takes g g' / v from the pose's covariance. A turn that does not move the surface earns nothing.
    """
    gain, variance = _innovations(predicted, sigma)
    falls = np.sum(gain @ _spread(predicted.poses, model) * gain, axis=2) / variance
    return np.asarray(falls.mean(axis=0))


def expected_squared_distance(covariance: Array, pose: Array, model: TargetModel) -> Array:
    """Mean squared distance (...) between the surfaces at a pose and at the true one, [m^2].

    The distance of the surface at pose X + e from that at X is j e at each of its points, so that
    its expected square is trace(M C) with M the mean of j j'.

    Args:
        covariance: C (..., 6, 6), rotation in O and translation of the object's middle in W.
        pose: X_WM (..., 4, 4).
        model: Of the object.
    """
    return np.asarray(np.sum(_spread(pose, model) * covariance, axis=(-2, -1)))


def _spread(pose: Array, model: TargetModel) -> Array:
    """M (..., 6, 6) of `expected_squared_distance`."""
    p, n = model.surface.points, model.surface.normals
    J = np.concatenate([-np.cross(p, n), -n], axis=1)
    to_world = np.zeros((*pose.shape[:-2], 6, 6))
    to_world[..., :3, :3] = np.eye(3)
    to_world[..., 3:, 3:] = pose[..., :3, :3]
    return np.asarray(to_world @ (J.T @ J / len(J)) @ np.swapaxes(to_world, -1, -2))


def _innovations(predicted: TouchPredictions, sigma: float) -> tuple[Array, Array]:
    """Covariances (K, R, 6) of contacts' distances with the pose, and their variances (K, R)."""
    gain = predicted.rows @ predicted.covariance
    return gain, sigma**2 + np.sum(gain * predicted.rows, axis=2)


def rotation_divergence(
    predicted: TouchPredictions, model: TargetModel, sigma: float, rng: np.random.Generator
) -> Array:
    """Gains (R,): expected Kullback-Leibler divergence of the rotation after from that before.

    With S before and P after a contact, d = 3, and the rotation's change of covariance S - P,

        1/2 [ln(|S| / |P|) + tr(S^-1 P) - d + tr(S^-1 (S - P))] = 1/2 ln(|S| / |P|).

    Source: the third paper's equation 25 in expectation, by which it chooses touches.
    """
    gain, variance = _innovations(predicted, sigma)
    return _log_det_fall(gain[..., :3], variance, predicted.covariance[:3, :3])


def expected_pruning(
    predicted: TouchPredictions, model: TargetModel, sigma: float, rng: np.random.Generator
) -> Array:
    """Gains (R,): the share of poses that a contact is expected to rule out.

    Two poses are told apart by a touch if they predict contacts at distances that differ by more
    than its noise, or if one of them predicts a miss.

    Source: S. Javdani et al., Efficient Touch Based Localization through Submodularity, 2013.
    """
    d = np.where(np.isfinite(predicted.distances), predicted.distances, 1e3)
    apart = (d[:, None] - d) / sigma
    return np.asarray(1.0 - np.exp(-0.25 * apart**2).mean(axis=(0, 1)))


CRITERIA: dict[str, Criterion] = {
    "random": random_touch,
    "divergence": rotation_divergence,
    "pruning": expected_pruning,
    "log-det": expected_log_det,
    "expected-adi": expected_adi,
}
