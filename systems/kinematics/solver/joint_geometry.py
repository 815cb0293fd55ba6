"""The geometry of a joint in F, the child's measured reference frame, compiled.

A joint with parameters (Y, a, c, h) moves the child along one screw:

    X_FB(q) = E(q) Y,  E(q) = translation by a q (prismatic), or rotation by q about the axis
                       through c along a, and translation by a h q (screw; revolute, where the
                       pitch h is zero), or identity (rigid)

with Y = X_FB(0) the true reference pose (6 dimensions), a the unit axis (2), c the axis point
nearest to Fo (2, in the plane normal to a) and h the pitch [m/rad] (1). Tangent coordinates are in
this order: Y's right perturbation, then a and c along the same two unit vectors normal to a, and h.
"""

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.compiled import assign, hot
from crossmodal.maths.se3_in_place import perturb
from crossmodal.maths.vectors import tangent_basis

PRISMATIC, REVOLUTE, SCREW, RIGID = 0, 1, 2, 3
MOVING = (PRISMATIC, REVOLUTE, SCREW)
JOINTS = 4  # Models of a joint; after them comes a free motion.
FREE = JOINTS
BENT_SLIDE = 5  # A prismatic joint, linearised with a curvature besides, see `bent_slide`.
PARAMETERS = 11  # Number of parameters of the largest model.


@hot
def dimension(kind: int) -> int:
    """The number of parameters of a model."""
    if kind == PRISMATIC:
        return 8
    if kind in (REVOLUTE, BENT_SLIDE):
        return 10
    return PARAMETERS if kind == SCREW else 6


@hot
def turns(kind: int) -> bool:
    """Whether the child turns about an axis that has a place."""
    return kind in (REVOLUTE, SCREW)


@hot
def slides(kind: int) -> bool:
    """Whether the child moves along a line."""
    return kind in (PRISMATIC, BENT_SLIDE)


@hot
def _cross(x: Array, y: Array) -> tuple[float, float, float]:
    return x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]


@hot
def _into_body(Y: Array, w: Array, v: Array, out: Array) -> None:
    """Writes the twist (w, v) in the screw's moving frame as one in B into `out` (6,)."""
    x = v[0] - (Y[1, 3] * w[2] - Y[2, 3] * w[1])
    y = v[1] - (Y[2, 3] * w[0] - Y[0, 3] * w[2])
    z = v[2] - (Y[0, 3] * w[1] - Y[1, 3] * w[0])
    for i in range(3):
        out[i] = Y[0, i] * w[0] + Y[1, i] * w[1] + Y[2, i] * w[2]
        out[3 + i] = Y[0, i] * x + Y[1, i] * y + Y[2, i] * z


@hot
def child_pose(kind: int, Y: Array, a: Array, c: Array, pitch: float, q: float, X: Array) -> None:
    """Writes X_FB(q) = E(q) Y (4, 4) into `X`."""
    cosine, sine = (np.cos(q), np.sin(q)) if turns(kind) else (1.0, 0.0)
    slide = q if slides(kind) else pitch * q
    for j in range(4):
        # Rodrigues' formula on each column; the last one is a point, which turns about c.
        o = 1.0 if j == 3 else 0.0
        x, y, z = Y[0, j] - o * c[0], Y[1, j] - o * c[1], Y[2, j] - o * c[2]
        along = (1.0 - cosine) * (a[0] * x + a[1] * y + a[2] * z) + o * slide
        X[0, j] = cosine * x + sine * (a[1] * z - a[2] * y) + along * a[0] + o * c[0]
        X[1, j] = cosine * y + sine * (a[2] * x - a[0] * z) + along * a[1] + o * c[1]
        X[2, j] = cosine * z + sine * (a[0] * y - a[1] * x) + along * a[2] + o * c[2]
        X[3, j] = o


@hot
def screw_twists(kind: int, Y: Array, a: Array, c: Array, pitch: float, G: Array) -> None:
    """Writes six constant twists (6, 6) in the child, of which all Jacobians are combinations.

    Row 0 is the child's twist per unit of q. Rows 1 and 2 are rotations through c along the basis
    of the plane normal to the axis (`tangent_basis`), rows 3 and 4 translations along it, row 5 one
    along the axis.
    """
    w, v, B = np.zeros(3), np.zeros(3), np.empty((2, 3))
    tangent_basis(a, B)
    for i in range(2):
        _into_body(Y, w, B[i], G[3 + i])
    for i in range(2):
        v[0], v[1], v[2] = _cross(c, B[i])
        _into_body(Y, B[i], v, G[1 + i])
    _into_body(Y, w, a, G[5])
    if slides(kind):
        assign(G[0], G[5])
    else:
        v[0], v[1], v[2] = _cross(c, a)
        for i in range(3):
            v[i] += pitch * a[i]
        _into_body(Y, a, v, G[0])


@hot
def jacobian(kind: int, G: Array, pitch: float, q: float, J: Array) -> None:
    """Writes the child's twists per unit of q (row 0) and of (a, c, h) (rows 1 to 5) into `J`.

    `G` is from `screw_twists`; the tangent coordinates of a and c belong to its basis. Tilting a
    screw's axis by e moves the child, already at q, by a rotation of sin q e - (1 - cos q) a x e
    and a translation of h q (cos q e - sin q a x e). Rows 3 and 4 of a bent slide are of its
    curvature k, which turns the child by q k and moves it by q^2 / 2 k x a. `J` is (6, 6); rows
    that a model lacks are left as they are.
    """
    if slides(kind):
        for i in range(6):
            J[0, i], J[1, i], J[2, i] = G[0, i], q * G[3, i], q * G[4, i]
        if kind == BENT_SLIDE:
            half = 0.5 * q * q
            for i in range(6):
                J[3, i], J[4, i] = q * G[1, i] - half * G[4, i], q * G[2, i] + half * G[3, i]
        return
    s, d = np.sin(q), 1.0 - np.cos(q)
    for i in range(6):
        J[0, i] = G[0, i]
        J[1, i], J[2, i] = s * G[1, i] - d * G[2, i], s * G[2, i] + d * G[1, i]
        J[3, i], J[4, i] = -d * G[3, i] - s * G[4, i], -d * G[4, i] + s * G[3, i]
    if kind == SCREW:
        slide, cosine = pitch * q, 1.0 - d
        for i in range(6):
            J[1, i] += slide * (cosine * G[3, i] - s * G[4, i])
            J[2, i] += slide * (cosine * G[4, i] + s * G[3, i])
            J[5, i] = q * G[5, i]


@hot
def retract(kind: int, Y: Array, a: Array, c: Array, pitch: float, step: Array) -> float:
    """Moves (Y, a, c) by `step` in their tangent space, in place; returns the pitch moved by it."""
    perturb(Y, step, Y)
    if kind == RIGID:
        return pitch
    B = np.empty((2, 3))
    tangent_basis(a, B)
    norm = np.sqrt(step[6] ** 2 + step[7] ** 2)
    s, cosine = (np.sin(norm) / norm, np.cos(norm)) if norm > 1e-9 else (1.0, 1.0)
    for i in range(3):
        a[i] = cosine * a[i] + s * (step[6] * B[0, i] + step[7] * B[1, i])
        if turns(kind):
            c[i] += step[8] * B[0, i] + step[9] * B[1, i]
    length = np.sqrt(a[0] ** 2 + a[1] ** 2 + a[2] ** 2)
    along = (a[0] * c[0] + a[1] * c[1] + a[2] * c[2]) / length**2
    for i in range(3):
        c[i] -= along * a[i]
        a[i] /= length
    return pitch + step[10] if kind == SCREW else pitch
