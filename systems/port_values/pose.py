"""An object whose pose is sought: what was measured, what is believed, and what to do next."""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable

Bodies = tuple[Array, ...]  # Vertices (N, 3) in W of convex bodies, [m].


@dataclass(frozen=True, kw_only=True)
class PosePrior(Immutable):
    """What is known of a pose before anything is measured.

    Attributes:
        X: X_WO (4, 4) of the mesh's frame.
        rotation_sigma: Standard deviation of each component of the rotation vector, [rad]; infinite
            where the object may be turned in any way.
        translation_sigma: Of each coordinate of the object's middle, [m].
        given: Whether it is known by now; nothing is looked at or touched before.
    """

    X: Array
    rotation_sigma: float
    translation_sigma: float
    given: bool = True

    @property
    def information(self) -> Array:
        """Of rotation in O and translation of the middle in W (6, 6)."""
        sigma = np.repeat([self.rotation_sigma, self.translation_sigma], 3)
        return np.diag(sigma**-2.0)


NO_PRIOR = PosePrior(X=np.eye(4), rotation_sigma=np.inf, translation_sigma=1.0, given=False)


@dataclass(frozen=True, kw_only=True)
class ObjectPose(Immutable):
    """What is believed of an object's pose. Poses M are those of the object's middle.

    Attributes:
        known: Whether anything is; else all is NaN or empty.
        X: X_WM (4, 4), the pose that is reported.
        covariance: Second moment (6, 6) of the density about it: rotation in O, translation in W.
        joint: Covariance (6 + m, 6 + m) of the pose, as before, and the calibration's errors.
        samples: X_WM (S, 4, 4).
        calibration: Errors of the calibration (S, m), in standard deviations.
        modes: X_WM (K, 4, 4) of the density's maxima, the likeliest first.
        probabilities: Of the modes (K,), by Laplace's approximation.
        middle: p_OM (3,).
        number: Of the last measurement that it contains.
    """

    known: bool = True
    number: int = 0
    X: Array
    covariance: Array
    joint: Array
    samples: Array
    calibration: Array
    modes: Array
    probabilities: Array
    middle: Array

    @property
    def X_WO(self) -> Array:
        """The pose that is reported (4, 4), of the mesh's frame."""
        return of_mesh(self.X, self.middle)

    def as_met(self, displaced: Array) -> "ObjectPose":
        """The same of the pose as an arm meets it, which is off by errors of the calibration.

        Where it is believed to be in W, it is displaced from; what it measures is displaced back.

        Args:
            displaced: (6, m) by which twist in W about Wo what it measures is displaced per
                standard deviation of each error of the calibration.
        """
        known = self._known(displaced)
        twists = -self.calibration[:, :known] @ displaced[:, :known].T
        X_mean = se3.exp(twists.mean(axis=0))
        samples = np.array([se3.exp(V) @ X for V, X in zip(twists, self.samples, strict=True)])
        e = deviations(X_mean @ self.X, samples)
        change = np.eye(len(self.joint))
        change[:6] = self.change_as_met(displaced)
        return replace(
            self,
            X=X_mean @ self.X,
            covariance=e.T @ e / len(e) + 1e-10 * np.eye(6),
            joint=change @ self.joint @ change.T,
            samples=samples,
            modes=X_mean @ self.modes,
        )

    def change_as_met(self, displaced: Array) -> Array:
        """(6, 6 + m) by how much that pose changes with the pose and the calibration's errors."""
        known = self._known(displaced)
        turn, shift = displaced[:3, :known], displaced[3:, :known]
        at_middle = shift + np.cross(turn, self.X[:3, 3], axisa=0, axisc=0)
        change = np.eye(6, len(self.joint))
        change[:, 6 : 6 + known] = -np.vstack([self.X[:3, :3].T @ turn, at_middle])
        return change

    def _known(self, displaced: Array) -> int:
        """Of how many of the errors something is known: a filter may know of none."""
        return min(displaced.shape[1], len(self.joint) - 6)

    def distance(self, X_WO: Array) -> float:
        """Squared Mahalanobis distance of a pose (4, 4) of the mesh's frame, 6 dof."""
        e = deviations(self.X, of_middle(X_WO, self.middle)[None])[0]
        return float(e @ np.linalg.solve(self.covariance, e))


def of_middle(X_WO: Array, middle: Array) -> Array:
    """X_WM (4, 4) of a pose of the mesh's frame."""
    X = X_WO.copy()
    X[:3, 3] += X_WO[:3, :3] @ middle
    return X


def of_mesh(X_WM: Array, middle: Array) -> Array:
    """X_WO (4, 4) of a pose of the middle."""
    X = X_WM.copy()
    X[:3, 3] -= X_WM[:3, :3] @ middle
    return X


def has_settled(before: ObjectPose, after: ObjectPose, translation: float, rotation: float) -> bool:
    """Whether a measurement has changed a pose by less than so much, [m] and [rad]."""
    if not (before.known and after.known):
        return False
    step = deviations(before.X, after.X[None])[0]
    return bool(np.linalg.norm(step[3:]) < translation and np.linalg.norm(step[:3]) < rotation)


def deviations(X: Array, Y: Array) -> Array:
    """Steps (S, 6), rotation in O and translation in W, from a pose X (4, 4) to poses Y."""
    turns = Rotation.from_matrix(X[:3, :3].T @ Y[:, :3, :3]).as_rotvec()
    return np.concatenate([turns, Y[:, :3, 3] - X[:3, 3]], axis=1)


UNKNOWN_POSE = ObjectPose(
    known=False,
    X=np.full((4, 4), np.nan),
    covariance=np.full((6, 6), np.nan),
    joint=np.full((6, 6), np.nan),
    samples=np.zeros((0, 4, 4)),
    calibration=np.zeros((0, 0)),
    modes=np.zeros((0, 4, 4)),
    probabilities=np.zeros(0),
    middle=np.full(3, np.nan),
)


@dataclass(frozen=True, kw_only=True)
class PoseMeasurement(Immutable):
    """What one view or one touch has measured.

    Attributes:
        kind: `view` or `touch`; empty where nothing is new.
        number: Of views and touches together, from one on.
        points: On the object (N, 3), in W, [m].
        sigma: Standard deviation of each one's own noise (N,), [m].
        facing: Unit vectors (N, 3), in W, from which each was seen or touched.
        free: Start and end (R, 2, 3) of lines along which nothing is, in W, [m].
        outline: Of a view, unit vectors (T, 3) in W of planes through `eye`, which the object
            touches, with all of it behind them.
        outline_sigma: Standard deviation of the distance at which it does (T,), [m].
        eye: Of a view, where the camera is believed to be (3,), in W, [m].
        axis: Of a view, unit vector (3,) in W along which the camera looks.
        passed: Of a view, directions (B, 3) in W of rays that passed by the object.
        displaced: (6, m) by which twist in W about Wo all of this is displaced per standard
            deviation of each error of the calibration; of a view (8, m), with the shares by which
            points are farther from the eye, and farther from the axis. What has the same
            displacement belongs to one group.
    """

    kind: str = ""
    number: int = 0
    points: Array = field(default_factory=lambda: np.zeros((0, 3)))
    sigma: Array = field(default_factory=lambda: np.zeros(0))
    facing: Array = field(default_factory=lambda: np.zeros((0, 3)))
    free: Array = field(default_factory=lambda: np.zeros((0, 2, 3)))
    outline: Array = field(default_factory=lambda: np.zeros((0, 3)))
    outline_sigma: Array = field(default_factory=lambda: np.zeros(0))
    eye: Array = field(default_factory=lambda: np.full(3, np.nan))
    axis: Array = field(default_factory=lambda: np.full(3, np.nan))
    passed: Array = field(default_factory=lambda: np.zeros((0, 3)))
    displaced: Array = field(default_factory=lambda: np.zeros((6, 0)))


NO_MEASUREMENT = PoseMeasurement()


@dataclass(frozen=True, kw_only=True)
class TouchRequest(Immutable):
    """Where to touch next.

    Attributes:
        number: Of the touch, from one on; zero: none is wanted.
        start: Where the straight approach begins (3,), in W, [m].
        direction: Of the approach (3,), a unit vector in W.
        reach: Its length, [m].
        expected: Distance at which it is likely to meet the object, [m].
        box_edges: Edges (3,) of a box that is thought to hold the object, [m].
        X_WB: Pose (4, 4) of that box, its middle.
        obstacles: Vertices (N, 3) in W of convex bodies that hold all other objects, [m].
        gain: What the touch is expected to teach, by the criterion that chose it.
        hit: Probability that it meets the object.
        done: Whether no more touches follow.
        why: Why none follows, in words.
        candidates: Starts and directions (R, 2, 3) in W of the approaches that were likely to meet
            the object, among which it was chosen.
        gains: Of these (R,), by the same criterion.
    """

    number: int = 0
    start: Array = field(default_factory=lambda: np.zeros(3))
    direction: Array = field(default_factory=lambda: np.array([0.0, 0.0, -1.0]))
    reach: float = 0.0
    expected: float = 0.0
    box_edges: Array = field(default_factory=lambda: np.zeros(3))
    X_WB: Array = field(default_factory=lambda: np.eye(4))
    obstacles: Bodies = ()
    gain: float = np.nan
    hit: float = np.nan
    done: bool = False
    why: str = ""
    candidates: Array = field(default_factory=lambda: np.zeros((0, 2, 3)))
    gains: Array = field(default_factory=lambda: np.zeros(0))


NO_TOUCH = TouchRequest()


@dataclass(frozen=True, kw_only=True)
class ViewRequest(Immutable):
    """From where to look next.

    Attributes:
        number: Of the view, from one on; zero: none is wanted.
        X_WC: Of the camera (4, 4).
        box_edges: Edges (3,) of a box that is thought to hold the object, [m].
        X_WB: Pose (4, 4) of that box, its middle.
        home: Whether no view is wanted, and the camera is to be out of the way.
        obstacles: Vertices (N, 3) in W of convex bodies that hold all other objects, [m].
        gain: By how much the view is expected to lower the entropy of the occupancy grid, [bit].
        candidates: X_WC (V, 4, 4) among which it was chosen.
        gains: Of these (V,), [bit].
        done: Whether no more views follow, since the pose has settled.
    """

    number: int = 0
    X_WC: Array = field(default_factory=lambda: np.eye(4))
    box_edges: Array = field(default_factory=lambda: np.zeros(3))
    X_WB: Array = field(default_factory=lambda: np.eye(4))
    home: bool = False
    obstacles: Bodies = ()
    gain: float = np.nan
    candidates: Array = field(default_factory=lambda: np.zeros((0, 4, 4)))
    gains: Array = field(default_factory=lambda: np.zeros(0))
    done: bool = False


NO_VIEW = ViewRequest()
