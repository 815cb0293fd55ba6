"""The translation-invariant quaternion filter (TIQF): a pose from corresponding points.

Points o_i of the model and s_i of the scene, taken from their means, are turned into each other by
the rotation alone: s_i = R o_i. For the unit quaternion x = (w, v) of R that is linear,

    H_i x = 0,    H = [[0, -(s - o)'], [s - o, [s + o]x]],

a measurement that is always zero. With white noise of variance rho of s_i - R o_i per axis and
P = x x' + Sigma, its covariance is rho (tr(P) I - P).

Source: "Active Visuo-Tactile Interactive Robotic Perception for Accurate Object Pose Estimation in
Dense Clutter", section II-C. Its H is misprinted and its noise lacks the factor; both are derived
here. The sum over all pairs of points is N times the sum over centred points, so that all pairs
count at no cost.

The Kalman filter's own covariance takes each pair for certain. Against a surface, whose nearest
samples are the pairs, it is far too small; what is reported is derived in `_covariance`.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from crossmodal.maths.arrays import Array, Ids
from crossmodal.maths.compiled import hot
from crossmodal.systems.port_values import ObjectPose, PosePrior, of_middle
from crossmodal.systems.pose.evidence import Evidence
from crossmodal.systems.pose.pose_belief import start_poses
from crossmodal.systems.pose.surface import Surface, nearest_of_eight
from crossmodal.systems.pose.target_model import TargetModel

_SAMPLES = 64  # Of the Gaussian.


@dataclass(frozen=True, kw_only=True)
class QuaternionFilterConfig:
    """How the filter is run.

    The pose slides along the surface in many small steps, whose sum is much larger than each: it
    has come to rest only where they are far below its errors.

    Attributes:
        starts: Rotations that are tried from the prior, besides its mean.
        coarse_points: Of each view, against which the starts are tried.
        fine_points: Of each view, against which the best is refined.
        iterations: At most, of each run.
        rotation_step: Change below which it ends, [rad].
        translation_step: The same of the translation, [m].
        seed: Of the draws.
    """

    starts: int = 24
    coarse_points: int = 100
    fine_points: int = 1000
    iterations: int = 100
    rotation_step: float = 1e-5
    translation_step: float = 1e-6
    seed: int = 0


def measurement_matrices(s: Array, o: Array) -> Array:
    """H (N, 4, 4) of centred points (N, 3) of the scene and of the model."""
    H = np.zeros((len(s), 4, 4))
    difference, total = s - o, s + o
    H[:, 0, 1:], H[:, 1:, 0] = -difference, difference
    H[:, 1, 2], H[:, 1, 3], H[:, 2, 3] = -total[:, 2], total[:, 1], -total[:, 0]
    H[:, 2, 1], H[:, 3, 1], H[:, 3, 2] = total[:, 2], -total[:, 1], total[:, 0]
    return H


def measurement_noise(x: Array, covariance: Array, rho: float) -> Array:
    """Covariance (4, 4) of H x for a quaternion (4,) with covariance (4, 4)."""
    P = np.outer(x, x) + covariance
    return rho * (np.trace(P) * np.eye(4) - P)


def update_quaternion(
    x: Array, covariance: Array, H: Array, rho: Array, at: Array | None = None
) -> tuple[Array, Array]:
    """A Kalman correction by H_i x = 0 for all i, in the form of information.

    Along x both H x and its noise are zero whatever was measured, so that only what is across x
    counts.

    Args:
        x: Prior mean (4,), a unit quaternion.
        covariance: Prior (4, 4).
        H: (N, 4, 4).
        rho: Variance of each relative vector (N,), [m^2].
        at: The quaternion (4,) at which the noise is taken; the prior mean if None.

    Returns:
        Posterior mean (4,), normalised, and covariance (4, 4).
    """
    at = x if at is None else at
    across = np.eye(4) - np.outer(at, at)
    W = across @ np.linalg.pinv(measurement_noise(at, np.zeros((4, 4)), 1.0)) @ across
    prior = np.linalg.inv(covariance)
    scaled = H / np.sqrt(rho)[:, None, None]
    information = prior + scaled.reshape(-1, 4).T @ (W @ scaled).reshape(-1, 4)
    posterior: Array = np.asarray(np.linalg.inv(0.5 * (information + information.T)), dtype=float)
    mean = posterior @ (prior @ x)
    return mean / np.linalg.norm(mean), posterior


def quaternion_prior(R: Array, sigma: float) -> tuple[Array, Array]:
    """Mean (4,) and covariance (4, 4) of a rotation (3, 3) with `sigma` per axis, [rad].

    Along x itself the covariance is as large as across it; the length is not known by it.
    """
    x = np.roll(Rotation.from_matrix(R).as_quat(), 1)
    return x, np.eye(4) * min(0.25 * sigma**2, 1.0)


@hot
def correspondences(X: Array, s: Array, facing: Array, surface: Surface) -> Ids:
    """The surface's samples (N,), by number, that are nearest to points (N, 3)."""
    found, p, f = np.empty(len(s), np.int64), np.empty(3), np.empty(3)
    for n in range(len(s)):
        for j in range(3):
            p[j], f[j] = 0.0, 0.0
            for i in range(3):
                p[j] += X[i, j] * (s[n, i] - X[i, 3])
                f[j] += X[i, j] * facing[n, i]
        k = nearest_of_eight(p, f, surface)
        if k < 0:
            f[:] = 0.0
            k = nearest_of_eight(p, f, surface)
        found[n] = k
    return found


@dataclass(frozen=True, kw_only=True)
class _Points:
    s: Array
    facing: Array
    sigma: Array
    group: Ids


def _run(
    X: Array,
    x0: Array,
    covariance: Array,
    p_prior: Array,
    translation_sigma: float,
    points: _Points,
    model: TargetModel,
    config: QuaternionFilterConfig,
    iterations: int,
) -> tuple[Array, float]:
    """Correspondences and filter in turns, each time from the same prior.

    Returns:
        The pose of the middle (4, 4) and the mean squared residual in variances.
    """
    weight = points.sigma**-2.0
    share = weight / weight.sum()
    rho = 2.0 * points.sigma**2  # Of a relative vector: of both its points.
    certain = weight.sum() / (weight.sum() + translation_sigma**-2.0)
    x = x0
    for _ in range(iterations):
        o = model.surface.points[correspondences(X, points.s, points.facing, model.surface)]
        s_mean, o_mean = share @ points.s, share @ o
        H = measurement_matrices(points.s - s_mean, o - o_mean)
        if x0 @ x < 0.0:
            x = -x
        x, _ = update_quaternion(x0, covariance, H, rho, at=x)
        R = Rotation.from_quat(np.roll(x, -1)).as_matrix()
        # The mean of the points with what was known of the position before.
        t = certain * (s_mean - R @ o_mean) + (1.0 - certain) * p_prior
        turned = Rotation.from_matrix(X[:3, :3].T @ R).magnitude()
        moved = float(np.linalg.norm(t - X[:3, 3]))
        X = np.eye(4)
        X[:3, :3], X[:3, 3] = R, t
        if turned < config.rotation_step and moved < config.translation_step:
            break
    o = model.surface.points[correspondences(X, points.s, points.facing, model.surface)]
    e = points.s - o @ X[:3, :3].T - X[:3, 3]
    return X, float(np.mean(np.sum(e**2, axis=1) * weight))


def _chosen(evidence: Evidence, most: int, rng: np.random.Generator) -> _Points:
    rows = np.arange(len(evidence.points))
    if len(rows) > most:
        rows = np.sort(rng.choice(rows, most, replace=False))
    return _Points(
        s=evidence.points[rows],
        facing=evidence.facing[rows],
        sigma=evidence.sigma[rows],
        group=evidence.group[rows],
    )


def _covariance(
    X: Array, points: _Points, before: Array, evidence: Evidence, model: TargetModel
) -> Array:
    """Covariance (6, 6) of the pose at which the filter came to rest: rotation in O, middle in W.

    Points may slide along the surface, as their pairs are found anew. So only what is along the
    normals n tells the pose: a step (phi, tau) changes such a residual by -j' (phi, tau) with
    j = (o x n, R n). A group's information is L = sum j j' / sigma^2. Groups displaced by V, as the
    pose would be, displace the estimate by P sum L V, with P = (before^-1 + sum L)^-1.

    Beside the normals a residual is where a sample happens to lie: noise that pulls as well.

    Args:
        X: Pose of the middle (4, 4).
        points: That were measured.
        before: Covariance (6, 6) before them.
        evidence: By which groups are displaced.
        model: Of the object.
    """
    R, t = X[:3, :3], X[:3, 3]
    nearest = correspondences(X, points.s, points.facing, model.surface)
    o, normals = model.surface.points[nearest], model.surface.normals[nearest]
    e = (points.s - t) @ R - o
    beside = e - np.sum(e * normals, axis=1, keepdims=True) * normals
    # How points that pull at the samples turn and move the pose.
    J, K = (np.hstack([np.cross(o, pull), pull @ R.T]) for pull in (normals, beside))
    J, K = J / points.sigma[:, None], K / points.sigma[:, None] ** 2
    information, pulled = np.linalg.inv(before), np.zeros((6, evidence.displaced.shape[2]))
    for group, displaced in enumerate(evidence.displaced):
        of_group = J[points.group == group]
        L = of_group.T @ of_group
        at_middle = displaced[3:6] + np.cross(displaced[:3], t, axisa=0, axisc=0)
        ray, axis = t - evidence.eye[group], evidence.axis[group]
        at_middle += np.outer(ray, displaced[6]) + np.outer(ray - axis @ ray * axis, displaced[7])
        information += L
        pulled += L @ np.concatenate([R.T @ displaced[:3], at_middle])
    P = np.linalg.inv(information)
    B, noise = P @ pulled, P @ (K.T @ K) @ P
    # What the surface does not tell stays where it was before, however much noise there is.
    noise = before - before @ np.linalg.solve(before + noise, before)
    covariance = P + noise + B @ B.T
    return np.asarray(0.5 * (covariance + covariance.T))


def filter_pose(
    evidence: Evidence, prior: PosePrior, model: TargetModel, config: QuaternionFilterConfig
) -> ObjectPose:
    """The pose after all points that were measured, with samples of its Gaussian.

    Free space and table are not used.

    Each start keeps the prior's covariance about its own rotation; the one with the least residual
    and deviation from the prior wins and is refined.
    """
    rng = np.random.default_rng(config.seed)
    sigma = min(prior.rotation_sigma, np.pi)
    X0 = of_middle(prior.X, model.middle)
    if len(evidence.points) == 0:
        before = np.diag(np.repeat([sigma, prior.translation_sigma], 3) ** 2)
        return _result(X0, before, model, config)
    few, many = (
        _chosen(evidence, most, rng) for most in (config.coarse_points, config.fine_points)
    )
    best, least = X0, np.inf
    for X in start_poses(prior, model, config.starts, rng):
        x, covariance = quaternion_prior(X[:3, :3], sigma)
        arguments = x, covariance, X0[:3, 3], prior.translation_sigma
        Y, residual = _run(X, *arguments, few, model, config, 15)
        turned = Rotation.from_matrix(X0[:3, :3].T @ Y[:3, :3]).magnitude()
        moved = np.linalg.norm(Y[:3, 3] - X0[:3, 3])
        cost = len(few.s) * residual + (moved / prior.translation_sigma) ** 2
        cost += (turned / prior.rotation_sigma) ** 2
        if cost < least:
            best, least = Y, cost
    x, covariance = quaternion_prior(best[:3, :3], sigma)
    arguments = x, covariance, X0[:3, 3], prior.translation_sigma
    X, _ = _run(best, *arguments, many, model, config, config.iterations)
    # Points of the surface are known, and the middle is no farther from them than the radius.
    sigmas = np.array([sigma, min(prior.translation_sigma, model.radius)])
    before = np.diag(np.repeat(sigmas, 3) ** 2)
    return _result(X, _covariance(X, many, before, evidence, model), model, config)


def _result(
    X: Array, covariance: Array, model: TargetModel, config: QuaternionFilterConfig
) -> ObjectPose:
    """The belief of X_WM (4, 4) with a covariance (6, 6), and samples drawn from its Gaussian."""
    rng = np.random.default_rng(config.seed)
    errors = rng.multivariate_normal(np.zeros(6), covariance, _SAMPLES)
    samples = np.tile(X, (_SAMPLES, 1, 1))
    samples[:, :3, :3] = X[:3, :3] @ Rotation.from_rotvec(errors[:, :3]).as_matrix()
    samples[:, :3, 3] += errors[:, 3:]
    return ObjectPose(
        X=X,
        covariance=covariance,
        joint=covariance,
        samples=samples,
        calibration=np.zeros((_SAMPLES, 0)),
        modes=X[None],
        probabilities=np.ones(1),
        middle=model.middle,
    )
