"""What was measured of an object: its surface, its outlines, free space, what it stands on.

All positions are in the world W. Measurements come in groups, one for each view or for the touches
of one arm: what is wrong with the calibration of camera or arm displaces all points of a group
together, by errors c that all groups share. With d = A c and r = p - eye, a point p truly is at

    D p = exp(d[:6]) (p + d[6] r + d[7] (r - (r k) k)),

which is what a wrong pose of the camera, a wrong scale of its depths and a wrong focal length do,
with its axis k.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from crossmodal.maths.arrays import Array, Ids
from crossmodal.maths.immutable import Immutable


@dataclass(frozen=True, kw_only=True)
class Table(Immutable):
    """What the object stands on.

    Attributes:
        up: Unit vector (3,) in W.
        height: Of its surface along `up`, [m], with standard deviation `height_sigma`.
        height_sigma: [m].
        tilt_sigma: Standard deviation by which the object leans, [rad]; infinite where it may lean
            on others.
        leaning: Probability that it does not stand on the table as it should.
    """

    up: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    height: float = 0.0
    height_sigma: float = 2e-3
    tilt_sigma: float = np.deg2rad(0.5)
    leaning: float = 0.02


@dataclass(frozen=True, kw_only=True)
class Evidence(Immutable):
    """All that is known of one object so far.

    Attributes:
        points: On its surface (N, 3), in W, [m].
        sigma: Of each one's own noise (N,), [m].
        facing: Unit vectors (N, 3), in W, from which each was seen or touched: the surface faces
            them. Zero where that is not known.
        group: Of each point (N,).
        free: Start and end (R, 2, 3) of lines along which nothing is, in W, [m].
        free_group: Of each line (R,).
        outline: Unit vectors (T, 3), in W, of planes through the eye of a view, which the object
            touches, with all of it behind them.
        outline_sigma: Standard deviation of the distance at which it does (T,), [m].
        outline_group: Of each plane (T,).
        displaced: A (G, 8, m), by which a group is displaced per standard deviation of each error c
            of the calibration: twists (rotation, translation) in W about Wo, shares by which points
            are farther from the eye, and farther from the camera's axis.
        eye: Of each group (G, 3), where its camera is, in W, [m]; zero for touches.
        axis: Unit vectors (G, 3) in W, along which the cameras look; zero for touches.
        table: None where it stands on nothing that is known.
    """

    points: Array = field(default_factory=lambda: np.zeros((0, 3)))
    sigma: Array = field(default_factory=lambda: np.zeros(0))
    facing: Array = field(default_factory=lambda: np.zeros((0, 3)))
    group: Ids = field(default_factory=lambda: np.zeros(0, np.int64))
    free: Array = field(default_factory=lambda: np.zeros((0, 2, 3)))
    free_group: Ids = field(default_factory=lambda: np.zeros(0, np.int64))
    outline: Array = field(default_factory=lambda: np.zeros((0, 3)))
    outline_sigma: Array = field(default_factory=lambda: np.zeros(0))
    outline_group: Ids = field(default_factory=lambda: np.zeros(0, np.int64))
    displaced: Array = field(default_factory=lambda: np.zeros((0, 8, 0)))
    eye: Array = field(default_factory=lambda: np.zeros((0, 3)))
    axis: Array = field(default_factory=lambda: np.zeros((0, 3)))
    table: Table | None = None

    def __post_init__(self) -> None:
        for name in ("points", "sigma", "facing", "free", "outline", "outline_sigma", "displaced"):
            if not np.isfinite(getattr(self, name)).all():
                raise ValueError(f"Evidence: {name} is not finite")
        if np.any(self.sigma <= 0.0) or np.any(self.outline_sigma <= 0.0):
            raise ValueError("Evidence: a sigma is not positive")

    def with_group(
        self,
        displaced: Array,
        points: Array,
        sigma: Array | float,
        facing: Array | None = None,
        free: Array | None = None,
        *,
        eye: Array | None = None,
        axis: Array | None = None,
    ) -> "Evidence":
        """With one more view, or with the touches of one more arm.

        Args:
            displaced: (8, m) of this group, or the first six rows of it.
            points: (N, 3).
            sigma: (N,) or one for all.
            facing: (N, 3), or zero.
            free: Lines (R, 2, 3) along which nothing is, [m].
            eye: Where the camera is (3,), [m].
            axis: Unit vector (3,) along which it looks.
        """
        number = len(self.displaced)
        displaced = all_displacements(displaced)
        m = displaced.shape[1]
        known = self.displaced if number else np.zeros((0, 8, m))
        if known.shape[2] != m:
            raise ValueError(f"Evidence: a group with {m} errors beside {known.shape[2]}")
        at = [np.zeros(3) if place is None else place for place in (eye, axis)]
        grown = replace(
            self,
            displaced=np.concatenate([known, displaced[None]]),
            eye=np.concatenate([self.eye, at[0][None]]),
            axis=np.concatenate([self.axis, at[1][None]]),
        )
        return grown.with_measured(number, points, sigma, facing, free)

    def after_a_motion(self, twists: Array) -> "Evidence":
        """With the object moved since, by unknown shares of some twists (6, k) in W about Wo.

        These shares are more errors, of all that was measured before alone.
        """
        groups, rows, errors = self.displaced.shape
        grown = np.zeros((groups, rows, errors + twists.shape[1]))
        grown[:, :, :errors], grown[:, :6, errors:] = self.displaced, twists
        return replace(self, displaced=grown)

    def with_measured(
        self,
        group: int,
        points: Array,
        sigma: Array | float,
        facing: Array | None = None,
        free: Array | None = None,
    ) -> "Evidence":
        """With more points and free lines of a group that there is already; see `with_group`."""
        points = np.asarray(points, dtype=float).reshape(-1, 3)
        facing = np.zeros_like(points) if facing is None else facing
        free = np.zeros((0, 2, 3)) if free is None else free
        return replace(
            self,
            points=np.concatenate([self.points, points]),
            sigma=np.concatenate([self.sigma, np.broadcast_to(sigma, len(points))]),
            facing=np.concatenate([self.facing, facing]),
            group=np.concatenate([self.group, np.full(len(points), group)]),
            free=np.concatenate([self.free, free]),
            free_group=np.concatenate([self.free_group, np.full(len(free), group)]),
        )

    def with_outline(self, group: int, outline: Array, sigma: Array) -> "Evidence":
        """With planes (T, 3) that touch the outline in a view, as far as sigma (T,) tells, [m]."""
        return replace(
            self,
            outline=np.concatenate([self.outline, outline]),
            outline_sigma=np.concatenate([self.outline_sigma, sigma]),
            outline_group=np.concatenate([self.outline_group, np.full(len(outline), group)]),
        )


def all_displacements(displaced: Array, errors: int = 0) -> Array:
    """Displacements (8, m) of which the first six rows, or all, are given, and the first errors.

    Args:
        displaced: (6, n) or (8, n).
        errors: At least so many there are.
    """
    rows, columns = displaced.shape
    return np.pad(displaced, ((0, 8 - rows), (0, max(errors - columns, 0))))
