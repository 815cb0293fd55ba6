"""The order of things in clutter: look, take away, look again, then seek the target's pose."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

import numpy as np
import shapely
from pydrake.common.value import Value
from pydrake.systems.framework import Context

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.validation import check, number
from crossmodal.systems.declutter.arm_offset import as_met
from crossmodal.systems.declutter.around import (
    AroundConfig,
    bodies_around,
    free_places,
    guess_of,
    passed_heights,
)
from crossmodal.systems.declutter.declutter_graph import NO_TARGET, TARGET_FREE
from crossmodal.systems.declutter.displacement import displacement
from crossmodal.systems.declutter.fingers import grasps_left
from crossmodal.systems.port_values import (
    NO_ACTION,
    NO_GRAPH,
    NO_GRASPS,
    NO_OFFSET,
    NO_PRIOR,
    NO_PROGRESS,
    NO_SEGMENTS,
    NO_TRIES,
    NO_VIEW,
    ActionRequest,
    ArmOffset,
    Bodies,
    DeclutterAction,
    DeclutterGraph,
    DeclutterProgress,
    DeclutterStep,
    Grasps,
    PosePrior,
    Segment,
    Segments,
    Tries,
    ViewRequest,
)
from crossmodal.systems.recursive_filter import RecursiveFilter

LEFT_ALONE = "nothing is to be taken away"
TOO_MANY = "as many actions as are allowed"
UNREACHABLE = "unreachable"  # An outcome of an arm: it has not moved.
BLOCKED = "blocked"  # Another one: something was in its way.
ARM_VIEW = 1  # Number of the view of the arm, where there is one.
_UNSEEN = 0.1  # Share of the target's surroundings that may be hidden where it stands free.
_CENTRED = 2  # How often the camera is moved aside between two actions.
NO_VIEW_LEFT = "the camera gets to no view of the table"


@dataclass(kw_only=True)
class DeclutterSequenceConfig:
    """How long it goes on, and what counts as moved."""

    # Whether anything is taken away; otherwise the target's pose is sought at once.
    clear: bool = True
    # Of all objects together, for which the arm moves.
    actions: int = number(30, at_least=0, at_most=1000)
    # An object has been moved if it has gone as far; outlines of two images of one that rests
    # differ by less.
    moved: float = number(0.02, above=0.0, at_most=1.0, unit="m")
    around: AroundConfig = field(default_factory=AroundConfig)


class DeclutterPhase(StrEnum):
    """What is done."""

    ARM = "looks at the arm"
    LOOK = "looks at the table"
    CLEAR = "clears the way"
    POSE = "finds the target"


@dataclass(frozen=True, kw_only=True)
class SequenceState(Immutable):
    """What was seen and done, and what is wanted.

    Attributes:
        phase: What is done.
        view: That is wanted.
        place: Index of the place from which the table is looked at.
        middle: Of what is looked at (2,), in W, [m]; empty for the middle of the table.
        is_aimed: Whether the camera is turned to that from its place, where it cannot go over it.
        centred: How often the camera was moved aside since the last action, to see what the image's
            border had cut off.
        looks: How often it was looked at.
        unseen: From how many places in a row the target was not seen.
        sides: From how many it was looked since the last action, because what is to be taken away
            was covered.
        request: The last action.
        outcome: What the arm said of it; empty once it is judged.
        met: What the fingers met in it (K, 3), see `ActionEnd.contacts`.
        scene: The last image that was judged.
        rests: Where each object has come to rest, by its number.
        decided: Number of the image after which was decided what to do.
        tries: What has failed.
        progress: What was done.
        guess: Of the target's pose.
        obstacles: Bodies that hold all but the target.
    """

    phase: DeclutterPhase = DeclutterPhase.LOOK
    view: ViewRequest = NO_VIEW
    place: int = 0
    middle: Array = field(default_factory=lambda: np.zeros(0))
    is_aimed: bool = False
    centred: int = 0
    looks: int = 0
    unseen: int = 0
    sides: int = 0
    request: ActionRequest = NO_ACTION
    outcome: str = ""
    met: Array = field(default_factory=lambda: np.zeros((0, 3)))
    scene: Segments = NO_SEGMENTS
    rests: Mapping[int, Segment] = field(default_factory=dict)
    decided: int = 0
    tries: Tries = NO_TRIES
    progress: DeclutterProgress = NO_PROGRESS
    guess: PosePrior = NO_PRIOR
    obstacles: Bodies = ()


def judge(
    request: ActionRequest,
    outcome: str,
    image: int,
    rests: Mapping[int, Segment],
    after: Segments,
    moved: float,
) -> DeclutterStep:
    """What came of an action, by what is seen before and after it.

    What the arm could not even begin has not moved anything, whatever the images say.

    Args:
        request: The action.
        outcome: What the arm says of it.
        image: Number of the one by which it was chosen.
        rests: All objects where they have rested before, by their numbers.
        after: All objects.
        moved: A displacement that is more than what two images of a thing at rest differ by, [m].
    """
    now = {segment.number: segment for segment in after.segments}
    ways = {n: displacement(was, now[n], after.bare) for n, was in rests.items() if n in now}
    own = ways.pop(request.object, np.inf)
    if outcome == UNREACHABLE:
        ways = {}
    return DeclutterStep(
        image=image,
        object=request.object,
        name=rests[request.object].name,
        action=request.action,
        outcome=outcome,
        displacement=own,
        worked=own > moved and outcome != UNREACHABLE,
        others=tuple(sorted(n for n, way in ways.items() if way > moved)),
    )


def resting_places(
    rests: Mapping[int, Segment], after: Segments, moved: Collection[int]
) -> dict[int, Segment]:
    """Where all objects rest, the more of them is seen the better, by their numbers.

    What has moved and what is new is where the image shows it. Other outlines are kept, so that
    many small motions add up.

    Args:
        rests: The same before.
        after: All objects.
        moved: Numbers of those that were moved.
    """
    found = dict(rests)
    for segment in after.segments:
        before = rests.get(segment.number)
        if (
            before is None
            or segment.number in moved
            or (
                segment.contour.area > before.contour.area
                and displacement(before, segment, after.bare) == 0.0
            )
        ):
            found[segment.number] = segment
    return found


class DeclutterSequence(RecursiveFilter):
    """Looks at the table, has one object after the other taken away, then lets the pose be sought.

    An action is judged by the next image, not by the arm alone; an object that was not moved by it
    is remembered. Until the target is free, or nothing more can be done, no guess of its pose is
    given, so that nobody chooses views or touches.

    Input ports:
    - `segments`: `Segments` of the last image; places in W, [m].
    - `grasps`: `Grasps` of an image.
    - `declutter_graph`: `DeclutterGraph` of an image.
    - `arm_offset`: `ArmOffset`, by which requests are displaced, with the number of the view that
      has shown the arm. May stay unconnected, then by nothing.
    - `action_end`: how the last action ended, with `number` and `outcome`.
    - `unreachable`: (1,) number of the last view that the camera cannot get to.
    - `view_planned`: `ViewRequest` for the target's pose, numbered from one on.

    Output ports:
    - `view_latest`: `ViewRequest`; those for the pose are numbered on from those of the table.
    - `action_request`: `ActionRequest`.
    - `tries`: `Tries`.
    - `pose_guess`: `PosePrior` of the target; `NO_PRIOR` until its pose is to be sought.
    - `obstacles`: bodies that hold all but the target, as in `ActionRequest`.
    - `declutter_progress`: `DeclutterProgress`.

    Frames: W world, C camera.
    """

    def __init__(
        self,
        target: str,
        middle: Array,
        edges: Array,
        height: float,
        places: Sequence[Array],
        table: ViewRequest,
        config: DeclutterSequenceConfig,
        period: float,
        X_WArmView: Array | None = None,
    ) -> None:
        """Makes the sequence.

        Args:
            target: Name of the target's class.
            middle: p_OM (3,) of the target's model, [m].
            edges: Of the target's bounding box (3,), [m].
            height: Of the table in W, [m].
            places: X_WC (4, 4) from which all of the table is seen, the preferred one first.
            table: With the box in which all objects are, around which the camera goes.
            config: Of the sequence.
            period: Of the ticks, [s].
            X_WArmView: X_WC (4, 4) from which the arm is looked at once, before all else; None if
                it is not.
        """
        super().__init__()
        check(config, "DeclutterSequence")
        if not len(places):
            raise ValueError("DeclutterSequence: places is empty, but the table must be seen")
        self._target, self._config = target, config
        self._middle, self._edges = middle, edges
        self._height = height
        self._places, self._table, self._X_WArmView = tuple(places), table, X_WArmView
        self._segments = self._declare_value_input("segments", NO_SEGMENTS)
        self._grasps = self._declare_value_input("grasps", NO_GRASPS)
        self._graph = self._declare_value_input("declutter_graph", NO_GRAPH)
        self._offset = self._declare_value_input("arm_offset", NO_OFFSET)
        self._end = self.DeclareAbstractInputPort("action_end", Value[object]())
        self._unreachable = self.DeclareVectorInputPort("unreachable", 1)
        self._planned = self._declare_value_input("view_planned", NO_VIEW)
        self._declare_recursion(SequenceState(), self._calc, period)
        self._declare_latest("view_latest", lambda state: state.view)
        self._declare_latest("action_request", lambda state: state.request)
        self._declare_latest("tries", lambda state: state.tries)
        self._declare_latest("pose_guess", lambda state: state.guess)
        self._declare_latest("obstacles", lambda state: state.obstacles)
        self._declare_latest("declutter_progress", lambda state: state.progress)

    def _calc(self, context: Context, state: Any) -> SequenceState:
        if state.phase is DeclutterPhase.POSE:
            planned: ViewRequest = self._read(self._planned, context)
            view = replace(planned, number=planned.number + state.looks)
            return replace(state, view=view) if planned.number > 0 else state
        if state.phase is DeclutterPhase.CLEAR:
            end = self._read(self._end, context)
            if end.number == state.request.number:
                return self._look(replace(state, outcome=str(end.outcome), met=end.contacts))
            # What is not possible has ended by now; for anything else the camera leaves.
            return replace(state, view=replace(state.view, home=True))
        if state.looks == 0 and self._X_WArmView is not None:
            view = replace(self._table, number=ARM_VIEW, X_WC=self._X_WArmView)
            return replace(state, phase=DeclutterPhase.ARM, looks=ARM_VIEW, view=view)
        if state.phase is DeclutterPhase.ARM:
            seen = self._arm_offset(context).view, int(self._read(self._unreachable, context)[0])
            return self._look(state) if state.view.number in seen else state
        if state.looks == 0:
            return self._look(state)
        if self._read(self._unreachable, context)[0] == state.view.number:
            if len(state.middle) and not state.is_aimed:
                return self._look(replace(state, is_aimed=True))
            if len(state.middle):
                nowhere = replace(state, middle=np.zeros(0), is_aimed=False, centred=_CENTRED)
                return self._look(nowhere)
            return self._look_elsewhere(state, NO_VIEW_LEFT)
        scene: Segments = self._read(self._segments, context)
        if scene.number > state.scene.number:
            return self._judged(state, scene, self._arm_offset(context).mean)
        graph: DeclutterGraph = self._read(self._graph, context)
        if graph.number == scene.number > state.decided:
            return self._decide(context, replace(state, decided=scene.number), graph)
        return state

    def _arm_offset(self, context: Context) -> ArmOffset:
        found: ArmOffset = self._read_optional(self._offset, context) or NO_OFFSET
        return found

    def _look(self, state: SequenceState) -> SequenceState:
        number, X_WC = state.looks + 1, self._places[state.place].copy()
        if state.is_aimed:
            X_WC = se3.looking_at(X_WC[:3, 3], np.append(state.middle, self._height))
        elif len(state.middle):
            X_WC[:2, 3] += state.middle - self._table.X_WB[:2, 3]
        view = replace(self._table, number=number, X_WC=X_WC)
        return replace(state, phase=DeclutterPhase.LOOK, looks=number, view=view)

    def _look_elsewhere(self, state: SequenceState, why: str) -> SequenceState:
        """Looks from the next place; where none has shown the target, that is the end."""
        if state.unseen + 1 == len(self._places):
            return self._ended(state, why, None)
        return self._look_from_next(replace(state, unseen=state.unseen + 1))

    def _look_from_next(self, state: SequenceState) -> SequenceState:
        return self._look(replace(state, place=(state.place + 1) % len(self._places)))

    def _centred(self, state: SequenceState, graph: DeclutterGraph) -> SequenceState | None:
        """Moves the camera over the target and what is next, if its image cuts one of them off.

        If that does not show both, over what is next. While the target was never seen, over all
        that is cut off; where nothing can be moved, over the whole graph, if a part of it is. A
        target that seems to stand free is looked at from above once more if something near it may
        be hidden.
        """
        wanted = {v.segment.number: v.segment for v in graph.vertices}
        if graph.next >= 0:
            wanted = {n: wanted[n] for n in (graph.vertices[0].segment.number, graph.next)}
        cut = {s.number: s for s in state.scene.segments if s.is_cut}
        if graph.is_guess:
            wanted = cut
        elif state.centred > 0 and graph.next >= 0:
            wanted = {graph.next: wanted[graph.next]}
        is_free = graph.why == TARGET_FREE
        if state.centred == _CENTRED or not (
            cut.keys() & wanted.keys()
            or (is_free and self._hidden_near(state.scene, graph) > _UNSEEN)
        ):
            return None
        x, y, right, up = shapely.total_bounds([s.contour for s in wanted.values()])
        middle = 0.5 * np.array([x + right, y + up])
        before = state.middle if len(state.middle) else self._table.X_WB[:2, 3]
        if np.linalg.norm(middle - before) < self._config.moved:
            return None
        aimed = replace(state, middle=middle, is_aimed=False, centred=state.centred + 1)
        return self._look(aimed)

    def _hidden_near(self, scene: Segments, graph: DeclutterGraph) -> float:
        """Share of the target's surroundings where the image shows neither table nor objects."""
        contour = graph.vertices[0].segment.contour
        near = contour.buffer(self._config.around.near).difference(contour)
        seen = shapely.union_all([scene.bare, *(s.contour for s in scene.segments)])
        return float(near.difference(seen).area / near.area)

    def _judged(self, state: SequenceState, scene: Segments, offset: Array) -> SequenceState:
        """With what the last action, if there was one, has done.

        Args:
            state: Before.
            scene: The new image.
            offset: Of the arm from what the camera sees (3,), [m].
        """
        tries, progress, moved = state.tries, state.progress, set[int]()
        if state.outcome:
            step = judge(
                state.request,
                state.outcome,
                state.decided,
                state.rests,
                scene,
                self._config.moved,
            )
            moved = {step.object, *step.others}
            progress = replace(progress, steps=(*progress.steps, step))
            from_above = np.isinf(state.met[:, 2])
            tries = tries.blocked_at(state.met[from_above, :2] - offset[:2])
            if step.worked:
                tries = tries.with_motion(step.object)
                tries = tries.after_motion(*self._near(state.rests, moved))
            elif step.outcome == UNREACHABLE:
                tries = tries.out_of_reach(step.object, step.action)
            else:
                tries = tries.with_failure(step.object, step.action, step.outcome == BLOCKED)
        tries = replace(tries, number=scene.number)
        rests = resting_places(state.rests, scene, moved)
        return replace(state, scene=scene, rests=rests, outcome="", tries=tries, progress=progress)

    def _near(
        self, rests: Mapping[int, Segment], moved: Collection[int]
    ) -> tuple[set[int], shapely.Geometry]:
        """What the moved objects may have hindered, while they were where they have rested.

        Returns:
            Numbers of the objects near them, these among them; and where they were, and a finger
            may have met them.
        """
        gone = shapely.union_all([rests[n].contour for n in moved])
        near = self._config.around.near
        numbers = {n for n, segment in rests.items() if segment.contour.distance(gone) < near}
        return numbers, gone.buffer(self._config.moved)

    def _decide(
        self, context: Context, state: SequenceState, graph: DeclutterGraph
    ) -> SequenceState:
        centred = self._centred(state, graph)
        if centred is not None:
            return centred
        target = state.scene.largest(self._target)
        if target is not None:
            state = replace(state, unseen=0)
        elif graph.next < 0 or not self._config.clear or state.unseen + 1 < len(self._places):
            # Where there is no root, nothing is next.
            return self._look_elsewhere(state, NO_TARGET)
        if not self._config.clear:
            return self._ended(state, LEFT_ALONE, target)
        if graph.next < 0:
            return self._ended(state, "" if graph.why == TARGET_FREE else graph.why, target)
        begun = [step for step in state.progress.steps if step.outcome != UNREACHABLE]
        if len(begun) >= self._config.actions:
            return self._ended(state, TOO_MANY, target)
        vertex = graph.vertex(graph.next)
        if graph.is_covered and state.sides + 1 < len(self._places):
            return self._look_from_next(replace(state, sides=state.sides + 1))
        segments = [*(vertex.segment for vertex in graph.vertices), *graph.apart]
        others = [segment for segment in segments if segment.number != graph.next]
        grasps: Grasps = self._read(self._grasps, context)
        found = grasps_left(grasps, state.tries).get(graph.next, ())
        action = vertex.action or DeclutterAction.PUSH
        failed = state.tries.failed.get((graph.next, action), 0)
        is_grasp = action is DeclutterAction.GRASP
        around = self._config.around
        places = free_places(vertex.segment, others, graph.vertices[0].segment, around)
        request = ActionRequest(
            number=state.request.number + 1,
            action=action,
            object=graph.next,
            grasps=found[failed:] or found if is_grasp else (),
            pushes=graph.pushes[failed:] or graph.pushes,
            places=places,
            passed=passed_heights(vertex.segment, others, places, self._config.around),
            top=vertex.segment.top,
            obstacles=bodies_around(others, state.scene.table, self._config.around),
        )
        request = as_met(request, self._arm_offset(context), state.scene.table)
        return replace(
            state, phase=DeclutterPhase.CLEAR, request=request, sides=0, unseen=0, centred=0
        )

    def _ended(self, state: SequenceState, why: str, target: Segment | None) -> SequenceState:
        """Lets the pose be sought, if the target was seen."""
        others = [s for s in state.scene.segments if target is None or s.number != target.number]
        around, guess = self._config.around, NO_PRIOR
        if target is not None:
            eye = state.view.X_WC[:3, 3]
            guess = guess_of(target, self._middle, self._edges, self._height, eye, around)
        return replace(
            state,
            phase=DeclutterPhase.POSE,
            request=replace(state.request, done=True),
            progress=replace(state.progress, done=True, found=target is not None, why=why),
            guess=guess,
            obstacles=bodies_around(others, self._height, around),
        )
