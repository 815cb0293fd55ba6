"""The declutter graph: a tree of objects around a target, and which of them to take away how.

Source: section II-B of the paper on active visuo-tactile perception in clutter, equations 1 and 2.
Equation 1 gives an edge the IoU of two boxes above mu_o and 1/distance otherwise, so that any
contour nearer than a metre outranks any overlap. Here an edge weighs

    w = 1 + (IoU - mu_o) / (1 - mu_o)                        where IoU > mu_o, 1 to 2,
    w = 1 - min(d / mu_d, 1) (1 - IoU / mu_o)                otherwise, 0 to 1,

and there is none where w = 0. So every overlap outranks every nearness; w is continuous, rises with
IoU and falls with d. Nearness makes an edge to the target alone, where the paper makes one between
any two objects: what is near another one need not be moved before it, only what lies over it, and
on a small table all hang together at any time. Equation 2 stands: an object is grasped if the
quality of its best grasp is at least mu_q, and pushed otherwise. What has failed too often is
replaced by the other action.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import shapely
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import number
from crossmodal.systems.declutter.fingers import comes_down
from crossmodal.systems.declutter.push import PushConfig
from crossmodal.systems.declutter.push_planning import plan_pushes
from crossmodal.systems.declutter.segments import intersection_over_union
from crossmodal.systems.port_values import (
    DeclutterAction,
    DeclutterGraph,
    DeclutterVertex,
    Push,
    Segment,
    Segments,
    Tries,
)

NO_TARGET = "no target in view"
TARGET_FREE = "target is free"
NOTHING_LEFT = "nothing that is in the way can be moved"
BLOCKED = "every push begins where something has stopped a finger"

_ALIKE = 0.5  # IoU of two outlines of one object.
_GAP = 0.005  # Half the largest distance between objects of one heap, [m].
_HIDDEN = 0.02  # Radius and height of what stands for a target that was never seen, [m].
_DIGITS = 9  # Weights that agree so far are alike: rounding errors decide nothing.


@dataclass(kw_only=True)
class DeclutterConfig:
    """What hangs together, and how it is taken apart."""

    # mu_o: a larger IoU of two boxes is an overlap.
    overlap: float = number(0.05, at_least=1e-3, below=1.0)
    # mu_d: what is nearer is in the target's way. The paper's .5 m would be all of the table.
    near: float = number(0.1, at_least=1e-3, at_most=10.0, unit="m")
    # mu_q: an object with a better grasp is grasped. On 92 views that our network had not learned
    # from, 71 % of such grasps hold by geometry, of those of .35 to .7 a third, of others a tenth.
    grasp_quality: float = number(0.7, at_least=0.0, at_most=1.0)
    # Share of an object's outline that others may be before: else it is taken away after those that
    # are seen whole, and looked at from elsewhere before that.
    covered: float = number(0.1, at_least=0.0, at_most=1.0)
    # Of each action on each object; one that was moved so often waits until the others were.
    tries: int = number(2, at_least=1, at_most=100)
    push: PushConfig = field(default_factory=PushConfig)


def edge_weight(first: Segment, second: Segment, config: DeclutterConfig) -> float:
    """Of the edge between two objects, 0 to 2; zero for none. See the module's text."""
    overlap = intersection_over_union(first.box, second.box)
    if overlap > config.overlap:
        weight = 1.0 + (overlap - config.overlap) / (1.0 - config.overlap)
    else:
        apart = min(first.contour.distance(second.contour) / config.near, 1.0)
        weight = 1.0 - apart * (1.0 - overlap / config.overlap)
    return round(weight, _DIGITS)


def edge_weights(segments: Sequence[Segment], root: int, config: DeclutterConfig) -> Array:
    """Of all pairs of objects (N, N), symmetric, zero on the diagonal.

    Those without the root have an edge only if they overlap.
    """
    weights = np.zeros((len(segments), len(segments)))
    for i, first in enumerate(segments):
        for j in range(i):
            weight = edge_weight(first, segments[j], config)
            if weight > 1.0 or root in (i, j):
                weights[i, j] = weights[j, i] = weight
    return weights


def spanning_tree(weights: Array, root: int) -> dict[int, int]:
    """The maximum spanning tree of what is connected to the root.

    Among edges of the same weight the one between the lowest indices comes first.

    Args:
        weights: (N, N), symmetric; zero where there is no edge.
        root: Index of the root.

    Returns:
        Indices of the vertices' parents by their own, breadth first; -1 for the root.
    """
    i, j = np.nonzero(np.triu(weights))
    ranks = np.empty(len(i))
    ranks[np.argsort(-weights[i, j], kind="stable")] = np.arange(1, len(i) + 1)
    tree = minimum_spanning_tree(csr_array((ranks, (i, j)), shape=weights.shape))
    order, parent = breadth_first_order(tree + tree.T, root)
    return {int(k): int(parent[k]) if k != root else -1 for k in order}


def actions_left(
    number: int, quality: float, tries: Tries, config: DeclutterConfig
) -> list[DeclutterAction]:
    """The actions on an object that may still be tried, the preferred one first.

    Args:
        number: Of the object.
        quality: Of its best grasp, clipped to 0 to 1; at zero and for NaN there is no grasp.
        tries: What has failed.
        config: With mu_q and how often an action is tried.
    """
    quality = min(max(float(np.nan_to_num(quality)), 0.0), 1.0)
    grasp, push = DeclutterAction.GRASP, DeclutterAction.PUSH
    order = [grasp, push] if quality >= config.grasp_quality else [push, grasp]
    possible = order if quality > 0.0 else [push]
    return [action for action in possible if tries.may(number, action, config.tries)]


def declutter_graph(
    scene: Segments,
    target: str,
    qualities: Mapping[int, float],
    tries: Tries,
    config: DeclutterConfig,
    remembered: Segment | None = None,
    table: shapely.Geometry | None = None,
) -> DeclutterGraph:
    """The graph of a scene, and what to take away next.

    That is a leaf on which an action may still be tried and is possible: one on which nothing lies
    before others, then one that was not moved twice yet, then that of the highest incoming weight,
    and among equal ones that of the lowest number. A leaf without such an action stays where it is,
    and what it hangs on counts as a leaf. What others cover, or lie on, comes after all others.
    Before all that come actions that are likely to work: a grasp of quality mu_q, and a push that
    meets nothing. Glass is not pushed before: how high it is, and so where its outline lies, is a
    guess, the better the more of it stands alone.

    Args:
        scene: All objects.
        target: Name of the target's class.
        qualities: Of the objects' best grasps, by their numbers; none: no grasp.
        tries: What has failed.
        config: Of the graph and of pushes.
        remembered: The target as it was seen before; where it is not seen now, it is there still.
            Where it was never seen, it is thought to be beneath the largest heap.
        table: The part of it to which objects may be pushed, in W; None for anywhere.

    Raises:
        ValueError: where two objects have the same number.
    """
    root = scene.largest(target)
    shown = scene.segments
    if root is None and remembered is not None:
        root = _in_place_of(remembered, shown)
        shown = shown if root in shown else (*shown, root)
    is_guess = root is None
    if root is None:
        if not shown:
            return DeclutterGraph(number=scene.number, why=NO_TARGET)
        root = _beneath(shown, target)
        shown = (*shown, root)
    root, shown = _as_one(root, shown)
    segments = sorted(shown, key=lambda segment: segment.number)
    numbers = [segment.number for segment in segments]
    if len(set(numbers)) < len(numbers):
        raise ValueError(f"two objects have the same number: {numbers}")
    at = numbers.index(root.number)
    weights = edge_weights(segments, at, config)
    tree = spanning_tree(weights, at)
    left = {n: actions_left(n, qualities.get(n, 0.0), tries, config) for n in numbers}
    vertices = {root.number: DeclutterVertex(segment=root)}
    for i, parent in list(tree.items())[1:]:
        n = numbers[i]
        vertices[n] = DeclutterVertex(
            segment=segments[i],
            parent=numbers[parent],
            weight=float(weights[i, parent]),
            quality=float(qualities.get(n, 0.0)),
            action=next(iter(left[n]), None),
            why="" if left[n] else _used_up(n, tries),
        )
    graph = DeclutterGraph(
        number=scene.number,
        vertices=tuple(vertices.values()),
        apart=tuple(segment for i, segment in enumerate(segments) if i not in tree),
        is_guess=is_guess,
        why=NO_TARGET if is_guess else TARGET_FREE if len(tree) == 1 else NOTHING_LEFT,
    )
    beneath = {s.number for s in segments if _lies_beneath(s, segments, config)}

    def rank(leaf: DeclutterVertex) -> tuple[bool, bool, float, int]:
        n = leaf.segment.number
        return n not in beneath, tries.moved.get(n, 0) < config.tries, leaf.weight, -n

    staying, possible = set[int](), list[DeclutterGraph]()
    while leaves := graph.leaves(staying):
        leaf = max(leaves, key=rank)
        n, why = leaf.segment.number, leaf.why
        others = [segment for segment in segments if segment.number != n]
        for action in left[n]:
            pushes: tuple[Push, ...] = ()
            if action is DeclutterAction.PUSH:
                pushes = plan_pushes(leaf.segment, others, root, config.push, table)
                why = pushes[0].why or BLOCKED
                pushes = tuple(push for push in pushes if not push.why and comes_down(push, tries))
                if not pushes:
                    continue
                is_sure = pushes[0].is_sure and not leaf.segment.is_glass
            else:
                is_sure = qualities[n] >= config.grasp_quality
            vertices[n] = replace(leaf, action=action)
            is_covered = leaf.segment.covered > config.covered
            possible.append(replace(graph, next=n, is_covered=is_covered, pushes=pushes, why=""))
            if is_sure and n not in beneath and not is_covered:
                return replace(possible[-1], vertices=tuple(vertices.values()))
            break
        else:
            vertices[n] = replace(leaf, action=None, why=why)
        staying.add(n)
    # What others lie on is held by them.
    found = min(possible, key=lambda g: g.is_covered or g.next in beneath, default=graph)
    return replace(found, vertices=tuple(vertices.values()))


def _in_place_of(remembered: Segment, shown: Sequence[Segment]) -> Segment:
    """What is seen where an object was, if that has its outline, and otherwise the object itself.

    An image may take it for something else.
    """

    def alike(segment: Segment) -> float:
        return intersection_over_union(segment.contour, remembered.contour)

    nearest = max(shown, key=alike, default=remembered)
    return nearest if alike(nearest) > _ALIKE else remembered


def _as_one(root: Segment, shown: tuple[Segment, ...]) -> tuple[Segment, tuple[Segment, ...]]:
    """The root with what touches it and has its name, and all objects without that.

    A bottle's cap, far above its shoulders, may be seen as another bottle; of two bottles side by
    side nobody knows which one is sought. Neither is to be taken away.
    """
    own = [
        segment
        for segment in shown
        if segment.name == root.name and segment.contour.distance(root.contour) < 2.0 * _GAP
    ]
    if len(own) < 2:
        return root, shown
    contour = shapely.union_all([segment.contour for segment in own]).convex_hull
    whole = replace(root, contour=contour, top=max(segment.top for segment in own))
    numbers = {segment.number for segment in own}
    return whole, (whole, *(segment for segment in shown if segment.number not in numbers))


def _beneath(shown: Sequence[Segment], target: str) -> Segment:
    """Where a target that was never seen is thought to be: in the middle of the largest heap."""
    heaps = shapely.union_all([segment.contour.buffer(_GAP) for segment in shown])
    middle = max(shapely.get_parts(heaps), key=shapely.area).centroid
    number = max(segment.number for segment in shown) + 1
    return Segment(number=number, name=target, contour=middle.buffer(_HIDDEN), top=_HIDDEN)


def _lies_beneath(segment: Segment, others: Sequence[Segment], config: DeclutterConfig) -> bool:
    """Whether one of them is higher and over it; of glass it is not known how high it is."""
    return any(
        other.top > segment.top
        and not other.is_glass
        and intersection_over_union(segment.contour, other.contour) > config.overlap
        for other in others
    )


def _used_up(number: int, tries: Tries) -> str:
    found = []
    for action in DeclutterAction:
        if count := tries.count(number, action):
            found.append(f"{count} x {action}")
        if (number, action) in tries.unreachable:
            found.append(f"{action} out of reach")
    return f"all tries are used up: {', '.join(found)}"
