"""The belief about an object's pose: samples of its density under all that was measured.

The density of a pose after a few touches has several modes and bent valleys, which no Gaussian
describes. Many hypotheses are refined, which finds the modes. Samples are drawn by refining as many
hypotheses again, each under a prior mean and measurements drawn from their distributions; random
walks correct them. What is reported is the pose whose surface is on average nearest to theirs.

Source of the samples: D. S. Oliver, N. He, A. C. Reynolds, Conditioning permeability fields to
pressure data, ECMOR V, 1996 (randomized maximum likelihood).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array, Ids, Mask
from crossmodal.maths.compiled import hot
from crossmodal.systems.port_values import ObjectPose, PosePrior, deviations, of_middle
from crossmodal.systems.pose.evidence import Evidence, Table
from crossmodal.systems.pose.pose_solver import Problem, linearise, refine, walk
from crossmodal.systems.pose.surface import Surface, surface_distance
from crossmodal.systems.pose.target_model import TargetModel


@dataclass(frozen=True, kw_only=True)
class SolverConfig:
    """How the density is explored.

    Attributes:
        starts: Hypotheses drawn from the prior.
        coarse_points: Of a view, against which all are tried.
        fine_points: Of a view, against which the best are refined.
        samples: Of the density.
        steps: Of the random walk to each sample, at most.
        budget: Residuals that are computed in one sweep over hypotheses or samples; how many
            hypotheses are refined and how far samples walk follows from it.
        seed: Of the draws; the same evidence gives the same belief.
    """

    starts: int = 96
    coarse_points: int = 80
    fine_points: int = 400
    samples: int = 64
    steps: int = 40
    budget: int = 6000
    seed: int = 0


COARSE = np.geomspace(10e-3, 3e-3, 8)  # Floors of the noise, step by step, [m].
FINE = np.array([3.0, 2.0, 1.4, 1.0, 0.7, 0.7, 0.7, 0.7, 0.7, 0.7]) * 1e-3
_SAME = 9.0  # Squared distance up to which two hypotheses are one mode.
_UNLIKELY = float(np.log(1e-4))  # Of a mode beside the likeliest one; it is left out.
_STEPS_ALONG = 8  # About so many residuals take as long as one line of free space.
_SHORTEST = 5  # Steps of a walk that is worth its while.
_STEP = 0.4  # Of the random walk, in standard deviations.
_LOSS_POINTS, _LOSS_CANDIDATES = 100, 12


def uniform_rotations(count: int) -> Array:
    """About evenly spread rotations (count, 3, 3).

    Source: M. Alexa, Super-Fibonacci spirals: fast, low-discrepancy sampling of SO(3), 2022.
    """
    s = np.arange(count) + 0.5
    t = s / count
    alpha = 2.0 * np.pi * s / np.sqrt(2.0)
    beta = 2.0 * np.pi * s / 1.533751168755204288118041
    r, R = np.sqrt(t), np.sqrt(1.0 - t)
    quaternions = np.column_stack(
        [r * np.sin(alpha), r * np.cos(alpha), R * np.sin(beta), R * np.cos(beta)]
    )
    return np.asarray(Rotation.from_quat(quaternions).as_matrix())


def start_poses(
    prior: PosePrior,
    model: TargetModel,
    count: int,
    rng: np.random.Generator,
    points: Array | None = None,
) -> Array:
    """Poses (count + 1, 4, 4) of the model's middle: the prior's mean, and draws from it.

    Where the prior knows no position, a measured point (of `points`, (N, 3)) lies on a sample of
    the surface, both drawn by lot.
    """
    X = np.tile(of_middle(prior.X, model.middle), (count + 1, 1, 1))
    if np.isfinite(prior.rotation_sigma):
        turns = prior.rotation_sigma * rng.normal(size=(count, 3))
        X[1:, :3, :3] = prior.X[:3, :3] @ Rotation.from_rotvec(turns).as_matrix()
    else:
        X[1:, :3, :3] = uniform_rotations(count)
    if np.isfinite(prior.translation_sigma):
        X[1:, :3, 3] += prior.translation_sigma * rng.normal(size=(count, 3))
    elif points is not None and len(points):
        s = points[rng.integers(len(points), size=count)]
        o = model.surface.points[rng.integers(len(model.surface.points), size=count)]
        X[1:, :3, 3] = s - np.einsum("nij,nj->ni", X[1:, :3, :3], o)
    return X


def stood(X: Array, table: Table, model: TargetModel) -> Array:
    """Poses (K, 4, 4) turned the shortest way to a stable stand, at the table's height."""
    Y = X.copy()
    u = np.einsum("kji,j->ki", X[:, :3, :3], table.up)
    stable = model.stable[np.argmax(u @ model.stable.T, axis=1)]
    axis = np.cross(stable, u)
    sine = np.linalg.norm(axis, axis=1, keepdims=True)
    angle = np.arctan2(sine, np.sum(u * stable, axis=1, keepdims=True))
    turn = Rotation.from_rotvec(axis * angle / np.maximum(sine, 1e-12))
    Y[:, :3, :3] = X[:, :3, :3] @ turn.as_matrix()
    lowest = np.min(Y[:, :3, :3].transpose(0, 2, 1) @ table.up @ model.hull.T, axis=1)
    Y[:, :3, 3] += np.outer(table.height - lowest - X[:, :3, 3] @ table.up, table.up)
    return Y


def acting(evidence: Evidence) -> Mask:
    """Which errors of the calibration (m,) displace anything that was measured."""
    return np.asarray(evidence.displaced.any(axis=(0, 1)))


def problem_of(
    evidence: Evidence, prior: PosePrior, model: TargetModel, most: int, rng: np.random.Generator
) -> Problem:
    """What the density depends on, with at most so many points of each group."""
    table, stands = evidence.table, np.zeros(0)
    if table is not None:
        sigmas = table.height_sigma, table.tilt_sigma
        stands = np.array([*table.up, table.height, *sigmas, table.leaning])
    rows = _thinned(evidence, most, rng)
    A = np.ascontiguousarray(evidence.displaced[:, :, acting(evidence)])
    return Problem(
        X_prior=of_middle(prior.X, model.middle),
        W_prior=prior.information,
        c_prior=np.zeros(A.shape[2]),
        s=evidence.points[rows],
        sigma=evidence.sigma[rows],
        facing=evidence.facing[rows],
        group=evidence.group[rows],
        free=evidence.free,
        free_group=evidence.free_group,
        outline=evidence.outline,
        outline_sigma=evidence.outline_sigma,
        outline_group=evidence.outline_group,
        A=A,
        eye=evidence.eye,
        axis=evidence.axis,
        table=stands,
        surface=model.surface,
        hull=model.hull,
        stable=model.stable,
        radius=model.radius,
    )


def _thinned(evidence: Evidence, most: int, rng: np.random.Generator) -> Ids:
    chosen = [np.zeros(0, np.int64)]
    for group in range(len(evidence.displaced)):
        rows = np.nonzero(evidence.group == group)[0]
        chosen.append(rng.choice(rows, most, replace=False) if len(rows) > most else rows)
    return np.sort(np.concatenate(chosen))


class _Modes(NamedTuple):
    """The density's maxima, the likeliest first.

    Attributes:
        X: Poses (K, 4, 4) of the middle.
        c: Errors of the calibration (K, a), those that act on what was measured.
        P: Covariances (K, 6 + a, 6 + a), with any angle about an axis of symmetry.
        roots: Square roots (K, 6 + a, 6 + a) of the covariances without that.
        probabilities: (K,).
    """

    X: Array
    c: Array
    P: Array
    roots: Array
    probabilities: Array


def infer_pose(
    evidence: Evidence, prior: PosePrior, model: TargetModel, config: SolverConfig
) -> ObjectPose:
    """The belief after all that was measured."""
    rng = np.random.default_rng(config.seed)
    coarse = problem_of(evidence, prior, model, config.coarse_points, rng)
    fine = problem_of(evidence, prior, model, config.fine_points, rng)
    means = start_poses(prior, model, config.starts, rng, coarse.s)
    starts = means.copy()
    if evidence.table is not None:
        starts[2::2] = stood(starts[2::2], evidence.table, model)
    size = len(fine.s) + len(fine.outline) + _STEPS_ALONG * len(fine.free) + 1
    most = max(config.budget // size, 4)
    modes, costs = _find_modes(starts.copy(), coarse, fine, most, model.spins)
    residuals = len(fine.s) + len(fine.outline) + 1
    length = min(config.steps, 10 * config.budget // (residuals * config.samples))
    # Under so many points that a walk would be short, the modes are narrow: Gaussians. Lines of
    # free space bound the density and do not narrow it, so they do not count.
    is_sparse = length >= _SHORTEST
    if is_sparse:
        tried = 1 + np.flatnonzero(costs[1:] < costs[1:].min() - 2.0 * _UNLIKELY)
        tried = np.resize(tried, config.starts)
        samples, calibration = _randomised(means[tried], starts[tried], fine, config.samples, rng)
        steps = rng.normal(size=(config.samples, length, modes.P.shape[1]))
        lots = rng.uniform(size=(config.samples, length))
        walk(samples, calibration, _STEP, steps, lots, FINE[-1], fine)
    else:
        samples, calibration = _draw(modes, config.samples, rng)
    if model.spins.any():
        turns = np.pi * rng.uniform(-1.0, 1.0, (config.samples, 3)) @ model.spins
        samples[:, :3, :3] = samples[:, :3, :3] @ Rotation.from_rotvec(turns).as_matrix()
    candidates = modes.X
    if is_sparse:
        candidates = np.concatenate([modes.X, samples])[:_LOSS_CANDIDATES]
    points = rng.choice(len(model.surface.points), _LOSS_POINTS, replace=False)
    losses = _losses(candidates, samples, model.surface.points[points], model.surface)
    found = candidates[np.argmin(losses)]
    active = acting(evidence)
    joint = _joint_covariance(found, modes, active)
    e = deviations(found, samples)
    spread = e.T @ e / len(e) + 1e-10 * np.eye(6)
    errors = rng.normal(size=(config.samples, len(active)))  # Of others nothing is learned.
    errors[:, active] = calibration
    return ObjectPose(
        X=found,
        covariance=spread if is_sparse else joint[:6, :6],
        joint=joint,
        samples=samples,
        calibration=errors,
        modes=modes.X,
        probabilities=modes.probabilities,
        middle=model.middle,
    )


def _find_modes(
    X: Array, coarse: Problem, fine: Problem, most: int, spins: Array
) -> tuple[_Modes, Array]:
    """Refines hypotheses and keeps those that differ; also the costs (K,) that all come to.

    Args:
        X: Poses (K, 4, 4) to start from; overwritten.
        coarse: Against which all are refined.
        fine: Against which the best are.
        most: So many of these at most.
        spins: Of `TargetModel`.
    """
    c = np.zeros((len(X), coarse.A.shape[2]))
    all_costs, P = refine(X, c, COARSE, coarse)
    best = np.argsort(all_costs, kind="stable")
    if most < len(best):
        best = best[_distinct(X[best], _information(P[best]))][:most]
    X, c = X[best], c[best]
    costs, P = refine(X, c, FINE, fine)
    roots = np.asarray(np.linalg.cholesky(P), dtype=float)
    P[:, :3, :3] += np.pi**2 / 3.0 * spins  # Any angle is as likely.
    # Laplace's approximation: a mode weighs by its height and by how wide it is.
    logs = -0.5 * costs + 0.5 * np.linalg.slogdet(P)[1]
    order = np.argsort(-logs, kind="stable")
    order = order[logs[order] > logs.max() + _UNLIKELY]
    kept = order[_distinct(X[order], _information(P[order]))]
    weights = np.exp(logs[kept] - logs.max())
    weights /= weights.sum()
    return _Modes(X[kept], c[kept], P[kept], roots[kept], weights), all_costs


def _draw(modes: _Modes, count: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Poses (S, 4, 4) and errors of the calibration (S, a) from the modes' Gaussians."""
    chosen = rng.choice(len(modes.X), count, p=modes.probabilities)
    samples, calibration = modes.X[chosen], modes.c[chosen]
    steps = np.einsum("sij,sj->si", modes.roots[chosen], rng.normal(size=modes.P[chosen].shape[:2]))
    samples[:, :3, :3] = samples[:, :3, :3] @ Rotation.from_rotvec(steps[:, :3]).as_matrix()
    samples[:, :3, 3] += steps[:, 3:6]
    return samples, calibration + steps[:, 6:]


def _randomised(
    means: Array, starts: Array, problem: Problem, count: int, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Approximate samples of the density: poses (S, 4, 4) and errors of the calibration (S, a).

    Each is the maximum under a prior mean and measurements of its own, drawn from their
    distributions. Where all is linear these are exact samples. Otherwise each weighs as its density
    does beside that of being drawn: as the density across the directions in which what was measured
    changes with the pose, and as all that the measurements tell is large there. What remains of the
    drawn noise does not count: it differs by the number of measurements. Lines of free space bound
    the density; they change weights alone.

    Args:
        means: Of the prior (K, 4, 4), drawn from it.
        starts: Poses (K, 4, 4) from which the maxima are sought.
        problem: What was measured.
        count: Number S.
        rng: Of all that is drawn.
    """
    X, c = starts.copy(), rng.normal(size=(len(starts), problem.A.shape[2]))
    costs, floors = np.empty(len(starts)), np.concatenate([COARSE, FINE])
    size = 6 + c.shape[1]
    N, v = np.empty((size, size)), np.empty(size)
    turned = np.diag(np.repeat([3.0 / np.pi**2, 0.0], [3, size - 3]))  # By any angle at most.
    for k in range(len(starts)):
        one = slice(k, k + 1)
        refine(X[one], c[one], floors, _perturbed(problem, means[k], c[k].copy(), rng))
        costs[k] = linearise(X[k], c[k], FINE[-1], problem, N, v, False)
        costs[k] += np.linalg.slogdet(N + turned)[1] - v @ np.linalg.solve(N, v)
    summed = np.cumsum(np.exp(-0.5 * (costs - costs.min())))
    # Systematic resampling.
    at = np.searchsorted(summed, summed[-1] * (np.arange(count) + rng.uniform()) / count)
    return X[at], c[at]


def _perturbed(problem: Problem, X: Array, c: Array, rng: np.random.Generator) -> Problem:
    """The same with prior means X (4, 4) and c (a,), drawn noise on all else, and no free lines."""
    table = problem.table.copy()
    if len(table):
        table[3] += table[4] * rng.normal()
    s = problem.s + problem.sigma[:, None] * rng.normal(size=problem.s.shape)
    # A plane through the eye turns about it.
    to = problem.X_prior[:3, 3] - problem.eye[problem.outline_group]
    turn = problem.outline_sigma * rng.normal(size=len(to)) / np.sum(to**2, axis=1)
    outline = problem.outline + turn[:, None] * to
    free = problem.free[:0]
    return problem._replace(X_prior=X, c_prior=c, s=s, outline=outline, table=table, free=free)


def _joint_covariance(found: Array, modes: _Modes, active: Mask) -> Array:
    """Second moment (6 + m, 6 + m) of pose and calibration about a pose and the mean errors.

    Args:
        found: The pose (4, 4).
        modes: Of the density.
        active: Which errors (m,) act on what was measured.
    """
    c, weights = modes.c, modes.probabilities
    away = np.concatenate([deviations(found, modes.X), c - weights @ c], axis=1)
    spread = np.einsum("k,ki,kj->ij", weights, away, away)
    rows = np.flatnonzero(np.concatenate([np.ones(6, bool), active]))
    joint = np.eye(6 + len(active))
    joint[np.ix_(rows, rows)] = np.einsum("k,kij->ij", weights, modes.P) + spread
    return joint


def _information(P: Array) -> Array:
    """Of the poses (K, 6, 6) by covariances (K, 6 + m, 6 + m) of poses and calibration."""
    W = np.linalg.inv(np.ascontiguousarray(P[:, :6, :6]))
    return np.asarray(W, dtype=float)


@hot
def _losses(candidates: Array, samples: Array, points: Array, surface: Surface) -> Array:
    """Mean distances (C,) of the surface at poses (C, 4, 4) to that at the samples (S, 4, 4)."""
    losses, m, nowhere, p = np.zeros(len(candidates)), np.empty(3), np.zeros(3), np.empty(3)
    for k in range(len(candidates)):
        for n in range(len(samples)):
            X = se3.inverse(candidates[k]) @ samples[n]
            for q in points:
                for i in range(3):
                    p[i] = X[i, 3] + X[i, 0] * q[0] + X[i, 1] * q[1] + X[i, 2] * q[2]
                losses[k] += abs(surface_distance(p, nowhere, surface, m))
    return losses / (len(samples) * len(points))


@hot
def _distinct(X: Array, W: Array) -> Mask:
    """Which poses (K, 4, 4) are none of those before them, by their information (K, 6, 6)."""
    kept = np.ones(len(X), dtype=np.bool_)
    e = np.empty(6)
    for k in range(len(X)):
        for j in range(k):
            if kept[j]:
                R = np.ascontiguousarray(X[j, :3, :3].T) @ np.ascontiguousarray(X[k, :3, :3])
                e[:3] = se3.so3_log(R)
                e[3:] = X[k, :3, 3] - X[j, :3, 3]
                if e @ (W[j] @ e) < _SAME:
                    kept[k] = False
                    break
    return kept
