"""Refines and samples poses of a known object under all that was measured, compiled.

A hypothesis is a pose X_WO and the errors c of the calibration. With R, t of X_WO and the group's
displacement D(A c) of `Evidence`, a measured point s lies at p = R' (D(A c) s - t) in O, and its
residual is its distance to the surface. The steps are (phi, tau, dc): R exp(phi), t + tau, c + dc.

With the surface's gradient m in O, M = R m in W and a = (s x M, M, r M, (r - (r k) k) M), where
r = s - eye and k is the camera's axis, which is how the residual changes when the measured point is
displaced, its row of the Jacobian is

    d/dphi = -R' (a_1 - t x M),    d/dtau = -M,    d/dc = a' A.

So each group is summed up by H = sum w a a' and b = sum w a r alone.
"""

from typing import NamedTuple

import numpy as np

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array, Ids
from crossmodal.maths.compiled import hot
from crossmodal.systems.pose.surface import Surface, surface_distance

WIDTH = 3.0  # Of the weighting function, standard deviations.
_SLACK = 5e-4  # By so much a line of free space may enter the object, [m].
_FREE_SIGMA = 1e-3  # Standard deviation of its place, [m].
_WEAK = 1e-2  # Information about the start, where nothing else tells, [1/rad^2, 1/m^2].


class Problem(NamedTuple):
    """All that the density of pose and calibration depends on.

    Attributes:
        X_prior: (4, 4) of the object's middle.
        W_prior: Information (6, 6) about rotation in O and translation in W.
        c_prior: Mean errors of the calibration (m,), with a standard deviation of one.
        s: Points (N, 3), and so on as in `Evidence`.
        table: (up, height, height_sigma, tilt_sigma, leaning) (7,), or empty.
        surface: Of the `TargetModel`, as the following.
    """

    X_prior: Array
    W_prior: Array
    c_prior: Array
    s: Array
    sigma: Array
    facing: Array
    group: Ids
    free: Array
    free_group: Ids
    outline: Array
    outline_sigma: Array
    outline_group: Ids
    A: Array
    eye: Array
    axis: Array
    table: Array
    surface: Surface
    hull: Array
    stable: Array
    radius: float


@hot
def _into_object(
    R: Array, t: Array, E: Array, d: Array, eye: Array, k: Array, s: Array, moved: Array, p: Array
) -> None:
    """Writes D s (in W) into `moved` and R' (D s - t) into `p`, with E = exp(d[:6])."""
    r, along = np.empty(3), 0.0
    for i in range(3):
        r[i] = s[i] - eye[i]
        along += k[i] * r[i]
    for i in range(3):
        r[i] = s[i] + d[6] * r[i] + d[7] * (r[i] - along * k[i])
    for i in range(3):
        moved[i] = E[i, 3]
        for j in range(3):
            moved[i] += E[i, j] * r[j]
    for i in range(3):
        p[i] = 0.0
        for j in range(3):
            p[i] += R[j, i] * (moved[j] - t[j])


@hot
def _add(
    R: Array,
    s: Array,
    eye: Array,
    k: Array,
    m: Array,
    r: float,
    w: float,
    H: Array,
    b: Array,
) -> None:
    """Adds a residual `r` with weight `w` to its group's H (8, 8), its upper half, and b (8,)."""
    M, a = np.empty(3), np.empty(8)
    for i in range(3):
        M[i] = 0.0
        for j in range(3):
            M[i] += R[i, j] * m[j]
    a[0] = s[1] * M[2] - s[2] * M[1]
    a[1] = s[2] * M[0] - s[0] * M[2]
    a[2] = s[0] * M[1] - s[1] * M[0]
    along, towards, stretch = 0.0, 0.0, 0.0
    for i in range(3):
        a[3 + i] = M[i]
        along += k[i] * (s[i] - eye[i])
        towards += k[i] * M[i]
        stretch += (s[i] - eye[i]) * M[i]
    a[6], a[7] = stretch, stretch - along * towards
    for i in range(8):
        b[i] += w * a[i] * r
        for j in range(i, 8):
            H[i, j] += w * a[i] * a[j]


@hot
def _robust(d2: float, width: float) -> tuple[float, float]:
    """Weight and cost of a squared distance by the Geman-McClure function, of a squared width."""
    share = width / (width + d2)
    return share * share, share * d2


@hot
def _deepest(p: Array, q: Array, radius: float, surface: Surface, m: Array) -> tuple[float, float]:
    """How deep a line goes into the object, and where, by steps as long as what is free around it.

    Args:
        p: Where it starts (3,), relative to the middle, [m].
        q: Where it ends (3,).
        radius: Of the sphere about the middle that holds all of the object, [m].
        surface: Of the object.
        m: The gradient (3,) of the distance at the deepest place, overwritten.

    Returns:
        Signed distance there, [m], infinite if it stays outside of the sphere, and the share of the
        way.
    """
    deepest, where = np.inf, 0.0
    d, x, gradient, nowhere = np.empty(3), np.empty(3), np.empty(3), np.zeros(3)
    length, nearest, square = 0.0, 0.0, 0.0
    for i in range(3):
        d[i] = q[i] - p[i]
        length += d[i] * d[i]
        nearest -= d[i] * p[i]
        square += p[i] * p[i]
    length = np.sqrt(length)
    if length == 0.0:
        return deepest, where
    nearest /= length
    half = radius**2 - square + nearest**2
    if half <= 0.0:
        return deepest, where
    half = np.sqrt(half)
    along, stop = max(nearest - half, 0.0), min(nearest + half, length)
    while along <= stop:
        for i in range(3):
            x[i] = p[i] + along / length * d[i]
        r = surface_distance(x, nowhere, surface, gradient)
        if r < deepest:
            deepest, where = r, along / length
            m[:] = gradient
        # The distance is by the sample nearest to a voxel's centre.
        step = max(r - surface.voxel, surface.voxel)
        along = min(along + step, stop) if along < stop else np.inf
    return deepest, where


@hot
def _sum_groups(
    R: Array,
    t: Array,
    E: Array,
    d: Array,
    floor: float,
    problem: Problem,
    H: Array,
    b: Array,
    lines_count: bool,
) -> float:
    """Sums points, outlines and, if they count, free lines up in `H` (G, 8, 8) and `b` (G, 8).

    Returns:
        The cost of all, which free lines have in either case.
    """
    eye, axis = problem.eye, problem.axis
    s, free = problem.s, problem.free
    surface, facing, R_OW = problem.surface, problem.facing, R.T
    moved, p, m, towards = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    cost, width = 0.0, WIDTH**2
    for n in range(len(s)):
        g = problem.group[n]
        _into_object(R, t, E[g], d[g], eye[g], axis[g], s[n], moved, p)
        for j in range(3):
            towards[j] = 0.0
            for i in range(3):
                towards[j] += R_OW[j, i] * facing[n, i]
        r = surface_distance(p, towards, surface, m)
        scale = max(problem.sigma[n], floor)
        if not np.isfinite(r):
            cost += width  # The back of the surface is not what was seen.
            continue
        w, c = _robust((r / scale) ** 2, width)
        cost += c
        _add(R, moved, eye[g], axis[g], m, r, w / scale**2, H[g], b[g])
    cost += _sum_outlines(R, t, E, d, floor, problem, H, b)
    scale = max(_FREE_SIGMA, floor)
    end, q, at = np.empty(3), np.empty(3), np.empty(3)
    for ray in range(len(free)):
        g = problem.free_group[ray]
        _into_object(R, t, E[g], d[g], eye[g], axis[g], free[ray, 0], moved, p)
        _into_object(R, t, E[g], d[g], eye[g], axis[g], free[ray, 1], end, q)
        r, along = _deepest(p, q, problem.radius, surface, m)
        if r < -_SLACK:
            w, c = _robust(((r + _SLACK) / scale) ** 2, width)
            cost += c
            if not lines_count:
                continue
            for i in range(3):
                at[i] = moved[i] + along * (end[i] - moved[i])
            _add(R, at, eye[g], axis[g], m, r + _SLACK, w / scale**2, H[g], b[g])
    return cost


@hot
def _sum_outlines(
    R: Array, t: Array, E: Array, d: Array, floor: float, problem: Problem, H: Array, b: Array
) -> float:
    """Adds planes that touch the outline to `H` (G, 8, 8) and `b` (G, 8); their cost.

    Each says as much as a point, at the place of the plane that the object's farthest corner is
    nearest to, on a face along the plane.
    """
    n, x, s, m = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    moved, p = np.empty(3), np.empty(3)
    cost, width = 0.0, WIDTH**2
    for k in range(len(problem.outline)):
        g = problem.outline_group[k]
        eye, outward = problem.eye[g], problem.outline[k]
        for i in range(3):
            n[i] = 0.0
            for j in range(3):
                n[i] += E[g, i, j] * outward[j]
        for i in range(3):
            m[i] = R[0, i] * n[0] + R[1, i] * n[1] + R[2, i] * n[2]
        farthest, at = -np.inf, 0
        for corner in range(len(problem.hull)):
            h = problem.hull[corner]
            along = h[0] * m[0] + h[1] * m[1] + h[2] * m[2]
            if along > farthest:
                farthest, at = along, corner
        beyond = 0.0
        for i in range(3):
            x[i] = t[i]
            for j in range(3):
                x[i] += R[i, j] * problem.hull[at, j]
            beyond += outward[i] * (x[i] - eye[i])
        for i in range(3):
            s[i] = x[i] - beyond * outward[i]
        _into_object(R, t, E[g], d[g], eye, problem.axis[g], s, moved, p)
        r = 0.0
        for i in range(3):
            r += n[i] * (moved[i] - x[i])
        scale = max(problem.outline_sigma[k], floor)
        w, c = _robust((r / scale) ** 2, width)
        cost += c
        _add(R, moved, eye, problem.axis[g], m, r, w / scale**2, H[g], b[g])
    return cost


@hot
def _add_table(
    R: Array,
    t: Array,
    problem: Problem,
    floor: float,
    N: Array,
    v: Array,
) -> float:
    """Adds that the object stands on the table to N and v; the cost of that.

    Either it stands, at the table's height and upright, or it leans in any way with its lowest
    point anywhere up to its own size above the table: a mixture of both densities. Nothing is
    below.
    """
    hull, stable, up = problem.hull, problem.stable, problem.table[:3]
    height, leaning = problem.table[3], problem.table[6]
    height_sigma, tilt_sigma = max(problem.table[4], floor), max(problem.table[5], 10.0 * floor)
    u, lowest, at = np.zeros(3), np.inf, 0
    for i in range(3):
        for j in range(3):
            u[i] += R[j, i] * up[j]
    for n in range(len(hull)):
        z = 0.0
        for i in range(3):
            z += hull[n, i] * u[i]
        if z < lowest:
            lowest, at = z, n
    r = lowest - height
    J = np.zeros(6)
    for i in range(3):
        r += up[i] * t[i]
        J[3 + i] = up[i]
        # d(h.u)/dphi with u -> u - phi x u.
        J[i] = hull[at, (i + 1) % 3] * u[(i + 2) % 3] - hull[at, (i + 2) % 3] * u[(i + 1) % 3]
    square = (r / height_sigma) ** 2
    below = square if r < 0.0 else 0.0
    other = leaning / (1.0 - leaning) * np.sqrt(2.0 * np.pi) * height_sigma / problem.radius
    away = np.zeros(3)
    upright = np.isfinite(tilt_sigma) and len(stable) > 0
    if upright:
        best, n = -2.0, 0
        for k in range(len(stable)):
            cosine = stable[k, 0] * u[0] + stable[k, 1] * u[1] + stable[k, 2] * u[2]
            if cosine > best:
                best, n = cosine, k
        # The rotation from u to the stable direction d is about u x d; u turns by -phi.
        d, sine = stable[n], 0.0
        for i in range(3):
            away[i] = u[(i + 1) % 3] * d[(i + 2) % 3] - u[(i + 2) % 3] * d[(i + 1) % 3]
            sine += away[i] * away[i]
        sine = np.sqrt(sine)
        angle = np.arctan2(sine, best)
        away *= angle / sine if sine > 1e-9 else 1.0
        square += (angle / tilt_sigma) ** 2
        other *= 0.5 * len(stable) * tilt_sigma**2  # Of the whole sphere of directions.
    # Below, both densities fall with the depth.
    likely = np.exp(-0.5 * (square - below))
    w = likely / (likely + other)
    level = (1.0 if r < 0.0 else w) / height_sigma**2
    for i in range(6):
        v[i] -= level * J[i] * r
        for j in range(6):
            N[i, j] += level * J[i] * J[j]
    if upright:
        for i in range(3):
            v[i] -= w / tilt_sigma**2 * away[i]
            for j in range(3):
                N[i, j] += w / tilt_sigma**2 * ((1.0 if i == j else 0.0) - u[i] * u[j])
    return float(below - 2.0 * np.log((likely + other) / (1.0 + other)))


@hot
def linearise(
    X: Array,
    c: Array,
    floor: float,
    problem: Problem,
    N: Array,
    v: Array,
    lines_count: bool = True,
) -> float:
    """Writes information N and vector v of a Gauss-Newton step (phi, tau, dc) at X and c.

    Args:
        X: Pose (4, 4) of the object's middle.
        c: Errors of the calibration (m,), in standard deviations.
        floor: Least standard deviation of the residuals, [m].
        problem: What they depend on.
        N: (6 + m, 6 + m), overwritten.
        v: (6 + m,), overwritten.
        lines_count: Whether free lines add to N and v; the cost has them in either case.

    Returns:
        The cost: twice the negative log of the density, up to a constant.
    """
    m, groups, A = len(c), len(problem.A), problem.A
    H, b = np.zeros((groups, 8, 8)), np.zeros((groups, 8))
    E, d = np.empty((groups, 4, 4)), np.empty((groups, 8))
    J, e = np.zeros((8, 6 + m)), np.empty(6)
    R, t = np.ascontiguousarray(X[:3, :3]), np.ascontiguousarray(X[:3, 3])
    for g in range(groups):
        d[g] = A[g] @ c
        E[g] = se3.exp(d[g, :6])
    cost = _sum_groups(R, t, E, d, floor, problem, H, b, lines_count)
    N[:], v[:] = 0.0, 0.0
    e[:3] = se3.so3_log(np.ascontiguousarray(problem.X_prior[:3, :3].T) @ R)
    e[3:] = t - problem.X_prior[:3, 3]
    We = problem.W_prior @ e
    for i in range(6):
        v[i] -= We[i]
        cost += e[i] * We[i]
        N[i, i] += _WEAK
        for j in range(6):
            N[i, j] += problem.W_prior[i, j]
    for i in range(m):
        v[6 + i] -= c[i] - problem.c_prior[i]
        cost += (c[i] - problem.c_prior[i]) ** 2
        N[6 + i, 6 + i] += 1.0
    if len(problem.table) > 0:
        cost += _add_table(R, t, problem, floor, N, v)
    for j in range(3):
        x, y, z = R[0, j], R[1, j], R[2, j]
        J[0, j], J[1, j], J[2, j] = -x, -y, -z
        J[3, j] = -(t[1] * z - t[2] * y)
        J[4, j] = -(t[2] * x - t[0] * z)
        J[5, j] = -(t[0] * y - t[1] * x)
        J[3 + j, 3 + j] = -1.0
    for g in range(groups):
        for i in range(8):
            H[g, i, :i] = H[g, :i, i]
        J[:, 6:] = A[g]
        N += J.T @ (H[g] @ J)
        v -= J.T @ b[g]
    return cost


@hot
def _step(X: Array, c: Array, dx: Array) -> None:
    X[:3, :3] = np.ascontiguousarray(X[:3, :3]) @ se3.so3_exp(dx[:3])
    X[:3, 3] += dx[3:6]
    c += dx[6:]


@hot
def refine(X: Array, c: Array, floors: Array, problem: Problem) -> tuple[Array, Array]:
    """Refines hypotheses by Gauss-Newton steps, each under one floor of the noise.

    Under the last floor a step is taken only if the density rises, and is damped otherwise: edges
    and rays make it uneven (Levenberg and Marquardt's method).

    Args:
        X: Poses (K, 4, 4) of the object's middle to start from; overwritten.
        c: Errors of the calibration (K, m) to start from; overwritten.
        floors: Least standard deviations (I,) of residuals at each step, falling, [m].
        problem: What was measured.

    Returns:
        Costs (K,) under the last floor, and covariances (K, 6 + m, 6 + m) of (phi, tau, dc).
    """
    count, size = len(X), 6 + c.shape[1]
    costs, covariances = np.empty(count), np.empty((count, size, size))
    N, v, best, at = np.empty((size, size)), np.empty(size), np.empty((size, size)), np.empty(size)
    for k in range(count):
        Y, d, damping = X[k].copy(), c[k].copy(), 0.0
        for i in range(len(floors)):
            cost = linearise(Y, d, floors[i], problem, N, v)
            polishing = i > 0 and floors[i] == floors[i - 1]
            if not polishing or cost < costs[k]:
                X[k], c[k], costs[k] = Y, d, cost
                best[:], at[:] = N, v
                damping *= 0.2
            else:
                damping = max(5.0 * damping, 0.1)
            M = best.copy()
            for axis in range(size):
                M[axis, axis] *= 1.0 + damping
            Y, d = X[k].copy(), c[k].copy()
            _step(Y, d, np.linalg.solve(M, at))
        cost = linearise(Y, d, floors[-1], problem, N, v)
        if cost < costs[k]:
            X[k], c[k], costs[k] = Y, d, cost
            best[:] = N
        covariances[k] = np.linalg.inv(best)
    return costs, covariances


@hot
def walk(
    X: Array, c: Array, length: float, steps: Array, lots: Array, floor: float, problem: Problem
) -> Array:
    """Draws from the density by random walks, each step as wide as the density is where it begins.

    Steps are drawn with the covariance that points and prior give at the place (Metropolis and
    Hastings's algorithm), so that a walk follows a valley that bends. Free lines bound where it
    goes, and say nothing of how wide the density is between them.

    Args:
        X: Poses (K, 4, 4) to start from; overwritten by where the walks end.
        c: Errors of the calibration (K, m); overwritten.
        length: Of a step, in standard deviations.
        steps: Standard normal numbers (K, S, 6 + m).
        lots: Uniform numbers (K, S) in (0, 1).
        floor: Least standard deviation of the residuals, [m].
        problem: What was measured.

    Returns:
        Costs (K,) where the walks end.
    """
    count, size = len(X), 6 + c.shape[1]
    costs = np.empty(count)
    N, there, v = np.empty((size, size)), np.empty((size, size)), np.empty(size)
    for k in range(count):
        costs[k] = linearise(X[k], c[k], floor, problem, N, v, False)
        root = np.linalg.cholesky(N)
        for n in range(steps.shape[1]):
            dx = length * np.linalg.solve(root.T, steps[k, n])
            Y, d = X[k].copy(), c[k].copy()
            _step(Y, d, dx)
            cost = linearise(Y, d, floor, problem, there, v, False)
            back = np.linalg.cholesky(there)
            # Twice the log of how likely the step is, and the one back.
            forth = 2.0 * np.log(np.diag(root)).sum() - np.sum((root.T @ dx) ** 2) / length**2
            home = 2.0 * np.log(np.diag(back)).sum() - np.sum((back.T @ dx) ** 2) / length**2
            if 2.0 * np.log(lots[k, n]) < costs[k] - cost + home - forth:
                X[k], c[k], costs[k] = Y, d, cost
                root = back
    return costs
