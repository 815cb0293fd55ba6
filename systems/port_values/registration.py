"""By how much what a camera sees and what arms say of places is displaced."""

from dataclasses import dataclass, replace

import numpy as np

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array


@dataclass(frozen=True, kw_only=True)
class DisplacementBelief:
    """Displacements by the calibrations' errors, each of all points near Q: measured minus true.

    A point p that the camera sees, or that an arm says its end-effector's body has, is displaced
    by delta + omega x (p - Q).

    Attributes:
        names: Of what is displaced: the camera first, then the arms.
        p_WQ: Q (3,), [m]; NaN before anything is known.
        mean: (6 K,), for each name (omega, delta) in W, [rad, m].
        covariance: (6 K, 6 K).
    """

    names: tuple[str, ...]
    p_WQ: Array
    mean: Array
    covariance: Array

    @property
    def known(self) -> bool:
        """Whether anything is known."""
        return bool(np.isfinite(self.p_WQ).all())

    def part(self, name: str) -> slice:
        """Where in mean and covariance the displacement of `name` is."""
        start = 6 * self.names.index(name)
        return slice(start, start + 6)

    def of(self, *names: str) -> tuple[Array, Array]:
        """Mean (6 k,) and covariance (6 k, 6 k) of some of them, in this order."""
        chosen = np.concatenate([np.arange(6) + self.part(name).start for name in names])
        return self.mean[chosen], self.covariance[np.ix_(chosen, chosen)]

    def about(self, p_WQ: Array) -> "DisplacementBelief":
        """The same about another point (3,)."""
        J = np.eye(6)
        J[3:, :3] = -se3.skew(p_WQ - self.p_WQ)
        J_all = np.kron(np.eye(len(self.names)), J)
        return replace(
            self, p_WQ=p_WQ, mean=J_all @ self.mean, covariance=J_all @ self.covariance @ J_all.T
        )


def displacement_at(p_W: Array, p_WQ: Array) -> Array:
    """(..., 3, 6): displacement of points (..., 3) by (omega, delta) about Q (3,)."""
    r = np.asarray(p_W) - p_WQ
    J = np.zeros((*r.shape[:-1], 3, 6))
    J[..., 0, 1], J[..., 1, 2], J[..., 2, 0] = r[..., 2], r[..., 0], r[..., 1]
    J[..., 1, 0], J[..., 2, 1], J[..., 0, 2] = -r[..., 2], -r[..., 0], -r[..., 1]
    J[..., 0, 3] = J[..., 1, 4] = J[..., 2, 5] = 1.0
    return J


def unknown_displacements(names: tuple[str, ...]) -> DisplacementBelief:
    """What stands for displacements before anything is known."""
    size = 6 * len(names)
    return DisplacementBelief(
        names=names,
        p_WQ=np.full(3, np.nan),
        mean=np.full(size, np.nan),
        covariance=np.full((size, size), np.nan),
    )
