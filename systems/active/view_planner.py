"""The planner of views: from where to look next, until there were enough views."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pydrake.systems.framework import Context

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.validation import check, number, numbers
from crossmodal.systems.active.believed_box import box_around
from crossmodal.systems.active.occupancy_grid import (
    OccupancyGrid,
    empty_grid,
    expected_gains,
    with_view,
)
from crossmodal.systems.port_values import (
    NO_MEASUREMENT,
    NO_PRIOR,
    NO_VIEW,
    UNKNOWN_POSE,
    Bodies,
    ObjectPose,
    PosePrior,
    ViewRequest,
    has_settled,
    of_middle,
)
from crossmodal.systems.pose.target_model import TargetModel
from crossmodal.systems.recursive_filter import RecursiveFilter

NO_GRID = OccupancyGrid(log_odds=np.zeros((0, 0, 0)), corner=np.zeros(3), cell=0.0)
VIEW_CRITERIA = ("entropy", "random", "same")


@dataclass(kw_only=True)
class ViewPlannerConfig:
    """How many views there are, and by what they are chosen."""

    count: int = number(1, at_least=0, at_most=20)  # Of views at most.
    # A view that changes the pose by less is the last one; zero: all are taken.
    settled_translation: float = number(0.0, at_least=0.0, at_most=1.0, unit="m")
    # The same for its rotation; the last one changes neither by more.
    settled_rotation: float = number(0.0, at_least=0.0, at_most=180.0, unit="deg")
    # The expected fall in entropy (entropy), a lot (random), or where the first one was (same).
    criterion: str = "entropy"
    # Of the camera from the object's middle.
    distance: float = number(0.55, at_least=0.1, at_most=5.0, unit="m")
    # Of the camera above the object, between two ends.
    elevation: np.ndarray = numbers(
        np.array([20.0, 60.0]), at_least=-80.0, at_most=80.0, unit="deg", shape=(2,)
    )
    # Candidates are so many directions around, at each of the elevations.
    around: int = number(24, at_least=1, at_most=1000)
    elevations: int = number(4, at_least=1, at_most=100)  # Of the candidates, how many.
    # Edge of a cell of the occupancy grid.
    cell: float = number(0.01, at_least=1e-3, at_most=1.0, unit="m")
    # Rays by which a candidate is judged, along each side of its image.
    rays: int = number(50, at_least=1, at_most=1000)
    # Half the angle that the camera sees, along each side.
    half_angle: float = number(20.0, above=0.0, below=90.0, unit="deg")


@dataclass(frozen=True, kw_only=True)
class ViewPlannerState(Immutable):
    """What was seen, and the view that is wanted.

    Attributes:
        grid: With all views; None before the first tick.
        request: The view that is wanted.
        seen: Number of views in the grid.
        decided: Of views after which the next one was chosen.
        belief: About the pose then.
    """

    grid: OccupancyGrid | None = None
    request: ViewRequest = NO_VIEW
    seen: int = 0
    decided: int = -1
    belief: ObjectPose = UNKNOWN_POSE


def hemisphere(centre: Array, config: ViewPlannerConfig) -> Array:
    """Candidates X_WC (V, 4, 4) that look at `centre` (3,) from all sides."""
    views = []
    low, high = config.elevation
    for elevation in np.deg2rad(np.linspace(low, high, config.elevations)):
        for azimuth in np.linspace(-np.pi, np.pi, config.around, endpoint=False):
            out = np.array(
                [
                    np.cos(elevation) * np.cos(azimuth),
                    np.cos(elevation) * np.sin(azimuth),
                    np.sin(elevation),
                ]
            )
            views.append(se3.looking_at(centre + config.distance * out, centre))
    return np.array(views)


class ViewPlanner(RecursiveFilter):
    """Chooses the next view whenever one has been taken.

    Input ports:
    - `pose_guess`: `PosePrior`, about where the object is.
    - `pose_measurement`: `PoseMeasurement`, the last one.
    - `object_pose`: `ObjectPose`, which tells whether a view has changed the pose; may stay
      unconnected.
    - `obstacles`: tuple of vertices (N, 3) in W of convex bodies that hold all other objects,
      [m]; may stay unconnected.

    Output ports:
    - `view_latest`: `ViewRequest` of the last tick, from the state alone.
    - `grid_latest`: `OccupancyGrid` with all views until then; `NO_GRID` before the first tick.
    """

    def __init__(
        self,
        model: TargetModel,
        config: ViewPlannerConfig,
        period: float,
        seed: int = 0,
        can_look: Callable[[ViewRequest], bool] = lambda request: True,
    ) -> None:
        """Makes the planner.

        Args:
            model: Of the object.
            config: Of the views.
            period: Of the ticks, [s].
            seed: Of what is drawn by lot.
            can_look: Whether the robot can bring its camera to a view.
        """
        super().__init__()
        check(config, "ViewPlanner")
        if config.criterion not in VIEW_CRITERIA:
            known = ", ".join(VIEW_CRITERIA)
            raise ValueError(
                f"ViewPlanner: criterion = '{config.criterion}', but it must be one of {known}"
            )
        self._config, self._model, self._seed = config, model, seed
        self._can_look = can_look
        self._guess = self._declare_value_input("pose_guess", NO_PRIOR)
        self._measurement = self._declare_value_input("pose_measurement", NO_MEASUREMENT)
        self._pose = self._declare_value_input("object_pose", UNKNOWN_POSE)
        self._obstacles = self._declare_value_input("obstacles", ())
        self._declare_recursion(ViewPlannerState(), self._calc, period)
        self._declare_latest("view_latest", lambda state: state.request)
        self._declare_latest("grid_latest", lambda state: state.grid or NO_GRID)

    def _calc(self, context: Context, state: Any) -> ViewPlannerState:
        new = self._read(self._measurement, context)
        config, request, grid = self._config, state.request, state.grid
        taken = new.number if new.kind == "view" else state.seen
        if grid is None:
            guess: PosePrior = self._read(self._guess, context)
            if not guess.given:
                unchanged: ViewPlannerState = state
                return unchanged
            radius = self._model.radius
            half = radius + 2.0 * min(guess.translation_sigma, radius)
            grid = empty_grid(of_middle(guess.X, self._model.middle)[:3, 3], half, config.cell)
        if taken > state.seen:
            grid = with_view(grid, new.eye, new.points, new.passed)
        state = replace(state, grid=grid, seen=taken)
        belief: ObjectPose | None = self._read_optional(self._pose, context)
        # What the last view has told of the pose may not be known yet.
        if taken == state.decided or (belief is not None and 0 < taken != belief.number):
            return state
        belief = belief or UNKNOWN_POSE
        limits = config.settled_translation, float(np.deg2rad(config.settled_rotation))
        if taken > 1 and has_settled(state.belief, belief, *limits):
            request = replace(request, done=True)
        elif taken < config.count:
            obstacles = self._read_optional(self._obstacles, context) or ()
            request = self._choose(grid, belief, request, taken + 1, obstacles)
        return replace(state, request=request, decided=taken, belief=belief)

    def _choose(
        self,
        grid: OccupancyGrid,
        belief: ObjectPose,
        last: ViewRequest,
        number: int,
        obstacles: Bodies,
    ) -> ViewRequest:
        config = self._config
        centre = grid.corner + 0.5 * grid.cell * np.array(grid.log_odds.shape)
        edges, X_WB = grid.cell * np.array(grid.log_odds.shape), np.eye(4)
        X_WB[:3, 3] = centre
        if belief.known:
            # The grid stays where it is.
            centre = belief.X[:3, 3]
            edges, X_WB = box_around(belief, self._model.hull)
        views = hemisphere(centre, config)
        side = np.tan(np.deg2rad(config.half_angle)) * np.linspace(-1.0, 1.0, config.rays)
        u, v = np.meshgrid(side, side)
        rays = np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)])
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        gains = expected_gains(grid, views, rays)
        wanted = ViewRequest(
            number=number,
            box_edges=edges,
            X_WB=X_WB,
            obstacles=obstacles,
            candidates=views,
            gains=gains,
        )
        if config.criterion == "same" and number > 1:
            return replace(wanted, X_WC=last.X_WC)
        rng = np.random.default_rng([self._seed, number])
        lots = rng.uniform(size=len(views))
        by_lot = config.criterion == "random" or number == 1
        order = np.argsort(-(lots if by_lot else gains), kind="stable")
        requests = (replace(wanted, X_WC=views[v], gain=float(gains[v])) for v in order)
        found = next(filter(self._can_look, requests), None)
        return found or replace(wanted, X_WC=views[order[0]])
