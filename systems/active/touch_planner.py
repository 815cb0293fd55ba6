"""The planner of touches: where to touch next, until enough is known."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from pydrake.systems.framework import Context

from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.validation import check, number
from crossmodal.systems.active.believed_box import box_around
from crossmodal.systems.active.touch_planning import (
    CRITERIA,
    TouchConfig,
    candidate_rays,
    predict_touches,
)
from crossmodal.systems.port_values import (
    NO_TOUCH,
    NO_VIEW,
    UNKNOWN_POSE,
    Bodies,
    ObjectPose,
    TouchRequest,
    ViewRequest,
    has_settled,
)
from crossmodal.systems.pose.target_model import TargetModel
from crossmodal.systems.recursive_filter import RecursiveFilter

SETTLED = "the pose has settled"  # Why no touch follows, then.

_ALIKE = 0.03  # Approaches that begin this close to each other are alike, [m];
_LEVER = 0.1  # so are those whose directions differ by so little at this distance, [m].


@dataclass(kw_only=True)
class TouchPlannerConfig:
    """How many touches there are, and by what they are chosen."""

    # Of views before the first touch.
    after_views: int = number(1, at_least=0, at_most=100)
    # A chosen touch that changes the pose by less is the last one; zero: all are made.
    settled_translation: float = number(0.0, at_least=0.0, at_most=1.0, unit="m")
    # The same for its rotation; the last one changes neither by more.
    settled_rotation: float = number(0.0, at_least=0.0, at_most=180.0, unit="deg")
    # Touches by lot, before others are chosen.
    random_touches: int = number(0, at_least=0, at_most=100)
    # Touches by `criterion`.
    chosen_touches: int = number(4, at_least=0, at_most=100)
    criterion: str = "expected-adi"  # Or log-det, divergence, pruning, random.
    # Touches that are drawn by lot, of which one is chosen.
    candidates: int = number(1000, at_least=1, at_most=100000)
    # Of these, the best that are not alike, and that a robot is asked whether it can make them.
    asked: int = number(60, at_least=1, at_most=100000)
    touch: TouchConfig = field(default_factory=TouchConfig)


@dataclass(frozen=True, kw_only=True)
class TouchPlannerState(Immutable):
    """The touch that is wanted, after which measurement, and what was believed then."""

    request: TouchRequest = NO_TOUCH
    after: int = -1
    belief: ObjectPose = UNKNOWN_POSE


class TouchPlanner(RecursiveFilter):
    """Chooses the next touch whenever a measurement has come.

    It is the one with the largest gain among those that a robot can make. What counts is the pose
    as the touching arm meets it: `ObjectPose.as_met`.

    Input ports:
    - `object_pose`: `ObjectPose`, whose number tells that a measurement has come.
    - `view_latest`: `ViewRequest`, which says when no more views follow; may stay unconnected, then
      there are as many as the configuration says.
    - `obstacles`: tuple of vertices (N, 3) in W of convex bodies that hold all other objects,
      [m]; may stay unconnected.

    Output ports:
    - `touch_estimated`: `TouchRequest` for this tick's belief.
    - `touch_latest`: the same of the last tick, from the state alone.
    """

    def __init__(
        self,
        model: TargetModel,
        config: TouchPlannerConfig,
        height: float | None,
        period: float,
        seed: int = 0,
        can_touch: Callable[[TouchRequest], bool] = lambda request: True,
        displaced: Array | None = None,
    ) -> None:
        """Makes the planner.

        Args:
            model: Of the object.
            config: Of the touches.
            height: Of what the object stands on, [m]; None if nothing is known of it.
            period: Of the ticks, [s].
            seed: Of what is drawn by lot.
            can_touch: Whether the robot can make a touch.
            displaced: (6, m) by which twist in W contacts are displaced per error of the
                calibration.
        """
        super().__init__()
        check(config, "TouchPlanner")
        if config.criterion not in CRITERIA:
            known = ", ".join(CRITERIA)
            raise ValueError(
                f"TouchPlanner: criterion = '{config.criterion}', but it must be one of {known}"
            )
        self._model, self._config, self._seed = model, config, seed
        self._can_touch, self._displaced = can_touch, displaced
        self._height = -np.inf if height is None else height
        self._pose = self._declare_value_input("object_pose", UNKNOWN_POSE)
        self._view = self._declare_value_input("view_latest", NO_VIEW)
        self._obstacles = self._declare_value_input("obstacles", ())
        self._declare_recursion(TouchPlannerState(), self._calc, period)
        self._declare_estimated("touch_estimated", lambda state: state.request)
        self._declare_latest("touch_latest", lambda state: state.request)

    def _calc(self, context: Context, state: Any) -> TouchPlannerState:
        belief: ObjectPose = self._read(self._pose, context)
        view: ViewRequest | None = self._read_optional(self._view, context)
        measured = belief.number
        unchanged: TouchPlannerState = state
        config, last = self._config, state.request.number
        looking = measured < config.after_views and not (view is not None and view.done)
        if not belief.known or looking or measured == state.after:
            return unchanged
        if state.request.done:
            return replace(unchanged, after=measured)
        if self._displaced is not None:
            belief = belief.as_met(self._displaced)
        obstacles = self._read_optional(self._obstacles, context) or ()
        request, limits = None, (config.settled_translation, np.deg2rad(config.settled_rotation))
        if last > config.random_touches and has_settled(state.belief, belief, *limits):
            request = self._no_more(belief, last, obstacles, SETTLED)
        elif last == config.random_touches + config.chosen_touches:
            request = self._no_more(belief, last, obstacles, "all touches are done")
        if request is None:
            criterion = "random" if last < config.random_touches else config.criterion
            request = self._choose(belief, last + 1, criterion, obstacles)
        return TouchPlannerState(request=request, after=measured, belief=belief)

    def _no_more(
        self, belief: ObjectPose, number: int, obstacles: Bodies, why: str
    ) -> TouchRequest:
        """No touch; the arm still has to find home around the objects."""
        edges, X_WB = box_around(belief, self._model.hull)
        return TouchRequest(
            number=number, done=True, why=why, box_edges=edges, X_WB=X_WB, obstacles=obstacles
        )

    def _choose(
        self, belief: ObjectPose, number: int, criterion: str, obstacles: Bodies
    ) -> TouchRequest:
        config, model = self._config, self._model
        rng = np.random.default_rng([self._seed, number])
        starts, directions = candidate_rays(
            belief, model, config.touch, config.candidates, rng, height=self._height
        )
        if len(starts) == 0:
            return self._no_more(belief, number - 1, obstacles, "no approach is clear")
        predicted = predict_touches(belief, model, starts, directions, config.touch, rng)
        feasible = predicted.feasible(config.touch)
        hit = predicted.hit
        if not hit.any():
            return self._no_more(belief, number - 1, obstacles, "no approach meets the object")
        if not feasible.any():
            # Nothing is likely enough to be met: the likeliest teaches most.
            feasible = hit >= hit.max()
        gains = CRITERIA[criterion](predicted, model, config.touch.sigma, rng)
        edges, X_WB = box_around(belief, model.hull)
        candidates = np.stack([starts, directions], axis=1)[feasible]
        approaches = np.hstack([starts, _LEVER * directions])
        left = np.where(feasible, gains, -np.inf)
        for _ in range(config.asked):
            best = int(np.argmax(left))
            if not np.isfinite(left[best]):
                break
            met = predicted.distances[:, best]
            met = met[np.isfinite(met)]
            request = TouchRequest(
                number=number,
                start=starts[best],
                direction=directions[best],
                reach=float(met.max()) + config.touch.overtravel,
                expected=float(np.median(met)),
                box_edges=edges,
                X_WB=X_WB,
                obstacles=obstacles,
                gain=float(gains[best]),
                hit=float(hit[best]),
                candidates=candidates,
                gains=gains[feasible],
            )
            if self._can_touch(request):
                return request
            # An arm that cannot make this touch cannot make those close beside it.
            left[np.linalg.norm(approaches - approaches[best], axis=1) < _ALIKE] = -np.inf
        return self._no_more(belief, number - 1, obstacles, "no feasible touch")
