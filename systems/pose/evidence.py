"""What was measured of an object: points on its surface, space that is free, what it stands on.

All positions are in the world W. Measurements come in groups, one for each view or for the touches
of one arm: what is wrong with the calibration of camera or arm displaces all points of a group
together, exp(A c) of where they are, with the errors c of the calibration, which all groups share.
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
        displaced: A (G, 6, m), twists (rotation, translation) in W about Wo by which a group is
            displaced per standard deviation of each error c of the calibration.
        table: None where it stands on nothing that is known.
    """

    points: Array = field(default_factory=lambda: np.zeros((0, 3)))
    sigma: Array = field(default_factory=lambda: np.zeros(0))
    facing: Array = field(default_factory=lambda: np.zeros((0, 3)))
    group: Ids = field(default_factory=lambda: np.zeros(0, np.int64))
    free: Array = field(default_factory=lambda: np.zeros((0, 2, 3)))
    free_group: Ids = field(default_factory=lambda: np.zeros(0, np.int64))
    displaced: Array = field(default_factory=lambda: np.zeros((0, 6, 0)))
    table: Table | None = None

    def __post_init__(self) -> None:
        for name in ("points", "sigma", "facing", "free", "displaced"):
            if not np.isfinite(getattr(self, name)).all():
                raise ValueError(f"Evidence: {name} is not finite")
        if np.any(self.sigma <= 0.0):
            raise ValueError("Evidence: a sigma is not positive")

    def with_group(
        self,
        displaced: Array,
        points: Array,
        sigma: Array | float,
        facing: Array | None = None,
        free: Array | None = None,
    ) -> "Evidence":
        """With one more view, or with the touches of one more arm.

        Args:
            displaced: (6, m) of this group.
            points: (N, 3).
            sigma: (N,) or one for all.
            facing: (N, 3), or zero.
            free: Lines (R, 2, 3) along which nothing is, [m].
        """
        number = len(self.displaced)
        m = displaced.shape[1]
        known = self.displaced if number else np.zeros((0, 6, m))
        if known.shape[2] != m:
            raise ValueError(f"Evidence: a group with {m} errors beside {known.shape[2]}")
        grown = replace(self, displaced=np.concatenate([known, displaced[None]]))
        return grown.with_measured(number, points, sigma, facing, free)

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
