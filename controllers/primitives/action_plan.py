"""The motions of an arm that takes an object away: straight lines near objects, a path to them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice, product
from typing import Any

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix

from crossmodal.controllers.arm.motion_planner import MotionPlanner, box_vertices
from crossmodal.controllers.primitives.move_object_config import ActionPhase, MoveObjectConfig
from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable
from crossmodal.models.gripper_taxels import PALM, PALM_ABOVE, TRAVEL, WIDTH

_UP = np.array([0.0, 0.0, 1.0])
# By which the hand of a push leans to a side if it cannot come straight down: beside high things
# the wrist, which is thicker than the hand, has no room, [rad].
_TILTS = np.deg2rad([0.0, 20.0, -20.0])
_ABOVE = 0.01  # Between palm and what is pushed; heights err by as much, [m].
_POSTURES = 4  # Of the arm, that are tried for one place of the gripper.
_SHORT = 2e-3  # By which a straight line may end early, [m].
_BESIDE = 0.06  # Places that are nearer to each other are alike, [m].
_AROUND = 0.3  # Edge of the box around an object, of which only the height is known, [m].


@dataclass(frozen=True, kw_only=True)
class Leg(Immutable):
    """A part of an action.

    Attributes:
        phase: What is done.
        postures: Through which the arm moves (K, n), [rad]; none where the fingers move.
        speed: Largest one of the end-effector, [m/s].
        undoes: Whether it goes back over the last leg, so that neither is left to be undone.
    """

    phase: ActionPhase
    postures: Array | None = None
    speed: float = 0.0
    undoes: bool = False


@dataclass(frozen=True, kw_only=True)
class ActionPlan(Immutable):
    """What is done one after the other.

    Attributes:
        legs: Of the action.
        opening: How far each finger is opened on the way, [m].
        X_WE: Of the gripper (4, 4) when it has come down.
        spare: Of the way down, without which the fingers still reach far enough to grasp, [m].
        push: That is made; None for a grasp.
    """

    legs: tuple[Leg, ...]
    opening: float
    X_WE: Array
    spare: float = 0.0
    push: Any = None


class ActionPlanner:
    """Plans for one arm; between its plans the gripper is closed in the planner's scene.

    On the straight ways of a grasp or a push only the arm is kept away from things: whoever chose
    it has seen to the gripper's room. Where the arm has none, the hand of a push leans to a side.

    Args:
        planner: Of the arm.
        gripper: Name of the gripper's model in its scene.
        config: Of the actions.
    """

    def __init__(self, planner: MotionPlanner, gripper: str, config: MoveObjectConfig) -> None:
        self._planner, self._gripper, self._config = planner, gripper, config

    def plan(
        self, request: Any, q_start: Array, guesses: list[Array], others: dict[str, Array]
    ) -> ActionPlan | None:
        """The plan of a request; None if the arm cannot do it.

        Args:
            request: An `ActionRequest`.
            q_start: Where the arm is (n,), [rad].
            guesses: Postures (n,) near which others are sought, [rad].
            others: Joint positions of other models by their names.
        """
        for plan, x, y in (
            self._grasps(request, guesses, others)
            if request.action == "grasp"
            else self._pushes(request, guesses, others)
        ):
            down = plan.legs[0].postures
            assert down is not None
            path = self.path(request, plan, np.array([x, y]), q_start, down[0], others)
            if path is not None:
                legs = (Leg(phase=ActionPhase.TRANSIT, postures=path), *plan.legs)
                return replace(plan, legs=legs)
        self._close()
        return None

    def path(
        self,
        request: Any,
        plan: ActionPlan,
        place: Array,
        q_start: Array,
        q_goal: Array,
        others: dict[str, Array],
    ) -> Array | None:
        """Postures (K, n) from one to another around all objects; None if none was found, [rad].

        Args:
            request: With them.
            plan: Of that.
            place: Of the object that is acted on (2,), in W, [m].
            q_start: Where it begins (n,), [rad].
            q_goal: Where it ends (n,), [rad].
            others: Joint positions of other models by their names.
        """
        top = self._top(request, plan.X_WE)
        edges = np.array([_AROUND, _AROUND, top])
        around = box_vertices(edges, RigidTransform([*place, 0.5 * top]))
        self._look(request, others, plan.opening, [around])
        path = self._planner.path(q_start, q_goal, np.random.default_rng(request.number))
        self._close()
        return path

    def down(
        self, request: Any, plan: ActionPlan, q: Array, length: float, others: dict[str, Array]
    ) -> Array:
        """Postures (K, n) straight down from one, as far as it is free, [rad].

        Args:
            request: With all objects.
            plan: Of that.
            q: Where it begins (n,), [rad].
            length: Of the line, [m].
            others: Joint positions of other models by their names.
        """
        self._look(request, others, plan.opening)
        line = self._planner.line(q, -_UP, length)
        self._close()
        return line

    def _close(self) -> None:
        self._planner.look_at({self._gripper: np.zeros(2)})

    def _grasps(
        self, request: Any, guesses: list[Array], others: dict[str, Array]
    ) -> Iterator[tuple[ActionPlan, float, float]]:
        for grasp in request.grasps if len(request.places) else ():
            opening = min(0.5 * grasp.width, TRAVEL)
            for turn in (0.0, np.pi):  # The gripper is symmetric.
                X_WE = RigidTransform(grasp.X_WE) @ RigidTransform(
                    RotationMatrix.MakeZRotation(turn), np.zeros(3)
                )
                X = X_WE.GetAsMatrix4()
                self._look(request, others, opening)
                spare = self._top(request, X) - X[2, 3] - self._config.grasped
                for down, short in self._ways_down(request, X_WE, guesses, max(spare, 0.0)):
                    carried = self._carried(request, down[-1], X_WE.translation())
                    if carried is None:
                        continue
                    legs = (
                        Leg(
                            phase=ActionPhase.DESCEND,
                            postures=down,
                            speed=self._config.descent_speed,
                        ),
                        Leg(phase=ActionPhase.CLOSE),
                        *carried,
                        Leg(phase=ActionPhase.OPEN),
                    )
                    x, y, _ = X_WE.translation()
                    yield ActionPlan(legs=legs, opening=opening, X_WE=X, spare=spare - short), x, y
                    break

    def _carried(self, request: Any, q: Array, p_WE: Array) -> tuple[Leg, ...] | None:
        """Up, level and down again, to the first place where that is possible.

        Where it is not, it is not beside it either.
        """
        config = self._config
        failed = list[Array]()
        heights = np.maximum(config.lift, request.passed + config.above)
        highest = max((vertices[:, 2].max() for vertices in request.obstacles), default=0.0)
        length = max(heights.max(), highest + config.above)
        up = self._planner.line(q, _UP, length, hand_is_free=True)
        step = self._planner.length(up) / max(len(up) - 1, 1)
        least = np.ceil((heights - _SHORT) / max(step, _SHORT)).astype(int)
        # Beside something high the hand has room above it only.
        free = [k for k in range(least.min(), len(up)) if self._planner.is_free(up[k])]
        ends = np.append(free, len(up))[np.searchsorted(free, least)]
        for place, end in zip(request.places, ends, strict=True):
            if end == len(up) or any(np.linalg.norm(place - p) < _BESIDE for p in failed):
                continue
            failed.append(place)
            lift, height = up[: end + 1], end * step
            way = np.append(place - p_WE[:2], 0.0)
            length = float(np.linalg.norm(way))
            level = self._planner.line(lift[-1], way / max(length, 1e-9), length)
            if self._planner.length(level) < length - _SHORT:
                continue
            fast = self._planner.line(level[-1], -_UP, height - config.above)
            # Its place has room for the fingers, too; a table may be lower than believed.
            rest = height - self._planner.length(fast)
            if rest > config.above + _SHORT:
                continue
            slow = self._planner.line(fast[-1], -_UP, rest, hand_is_free=True)
            if self._planner.length(slow) < rest - _SHORT:
                continue
            # What it has lain on may have been something else: it goes on to the table.
            further = self._planner.line(slow[-1], -_UP, max(p_WE[2], 0.0))
            slow = np.vstack([slow, further[1:]])
            return (
                Leg(phase=ActionPhase.LIFT, postures=lift, speed=config.carry_speed),
                Leg(phase=ActionPhase.CARRY, postures=level, speed=config.carry_speed),
                Leg(phase=ActionPhase.LOWER, postures=fast, speed=config.carry_speed),
                Leg(phase=ActionPhase.LOWER, postures=slow, speed=config.speed),
            )
        return None

    def _pushes(
        self, request: Any, guesses: list[Array], others: dict[str, Array]
    ) -> Iterator[tuple[ActionPlan, float, float]]:
        config = self._config
        for tilt, push in product(_TILTS, request.pushes):
            along = np.append(push.direction, 0.0)
            across = np.cross(_UP, along)
            height = push.height + 0.5 * WIDTH * abs(np.sin(tilt))
            if tilt and not _leans_over(push, height, tilt, request.top):
                continue
            for sign in (1.0, -1.0):  # Either finger may be in front; z is down.
                self._look(request, others, push.opening)
                down_right = RotationMatrix(np.column_stack([sign * along, -sign * across, -_UP]))
                R_WE = RotationMatrix(AngleAxis(tilt, along)) @ down_right
                X_WE = RigidTransform(R_WE, [*push.place, height])
                is_free = tilt == 0.0
                for down, _ in self._ways_down(request, X_WE, guesses, hand_is_free=is_free):
                    way = push.length + push.reach
                    pushed = self._planner.line(down[-1], along, way, hand_is_free=is_free)
                    if self._planner.length(pushed) < push.length:
                        continue
                    legs = (
                        Leg(
                            phase=ActionPhase.DESCEND,
                            postures=down,
                            speed=config.descent_speed,
                        ),
                        Leg(phase=ActionPhase.PUSH, postures=pushed, speed=config.speed),
                    )
                    X = X_WE.GetAsMatrix4()
                    plan = ActionPlan(legs=legs, opening=push.opening, X_WE=X, push=push)
                    yield plan, push.point[0], push.point[1]
                    break

    def _ways_down(
        self,
        request: Any,
        X_WE: RigidTransform,
        guesses: list[Array],
        spare: float = 0.0,
        hand_is_free: bool = True,
    ) -> Iterator[tuple[Array, float]]:
        """Postures (K, n) along z of E to a pose, from above the object's top.

        They begin above all that the hand could meet on the way, if the arm gets there: between
        high things hardly any path leads to a place from which it could go straight down. They may
        end earlier by what is spare [m]; by how much they do is the second value.
        """
        z = X_WE.rotation().col(2)
        top = self._top(request, X_WE.GetAsMatrix4())
        for highest in sorted(
            {top, max(top, _top_near(request, X_WE.translation()))}, reverse=True
        ):
            length = max(highest - X_WE.translation()[2], 0.0) + self._config.above
            X_before = RigidTransform(X_WE.rotation(), X_WE.translation() - length * z)
            for q in islice(self._planner.postures(X_before, guesses), _POSTURES):
                if self._planner.is_free(q):
                    down = self._planner.line(q, z, length, hand_is_free=hand_is_free)
                    short = length - self._planner.length(down)
                    if short < spare + _SHORT:
                        yield down, short

    @staticmethod
    def _top(request: Any, X_WE: Array) -> float:
        """Height of the object; where it is not known, some more than that of the gripper."""
        return float(request.top if np.isfinite(request.top) else X_WE[2, 3] + 0.05)

    def _look(
        self,
        request: Any,
        others: dict[str, Array],
        opening: float,
        around: Sequence[Array] = (),
    ) -> None:
        """What is in the way: with the object around, on the way to it, and near it without."""
        self._planner.look_at(
            {**others, self._gripper: np.full(2, opening)},
            [*request.obstacles, *around],
            None if around else self._config.near,
        )


def _leans_over(push: Any, height: float, tilt: float, top: float) -> bool:
    """Whether the palm of closed fingers that lean by a tilt [rad] passes over what is pushed."""
    lowest = height + PALM_ABOVE * np.cos(tilt) - 0.5 * PALM[1] * abs(np.sin(tilt))
    return push.opening == 0.0 and top + _ABOVE < lowest


def _top_near(request: Any, p_WE: Array) -> float:
    """Greatest height of the obstacles within the hand's reach of a place, zero for none, [m]."""
    reach = 0.5 * float(np.hypot(*PALM))
    tops = [
        vertices[:, 2].max()
        for vertices in request.obstacles
        if np.linalg.norm(vertices[:, :2] - p_WE[:2], axis=1).min() < reach
    ]
    return float(max(tops, default=0.0))
