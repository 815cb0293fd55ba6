"""Weights, trees and choices of the declutter graph."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import shapely
from numpy.testing import assert_allclose, assert_array_equal
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree

from crossmodal.systems.declutter.declutter_graph import (
    NO_TARGET,
    NOTHING_LEFT,
    TARGET_FREE,
    DeclutterConfig,
    actions_left,
    declutter_graph,
    edge_weight,
    edge_weights,
    spanning_tree,
)
from crossmodal.systems.port_values import (
    NO_TRIES,
    DeclutterAction,
    DeclutterGraph,
    Segment,
    Tries,
)
from tests.systems.declutter.scenes import image, random_scene, rectangle

CONFIG = DeclutterConfig()  # An overlap of .05, distances below 10 cm.
GRASP, PUSH = DeclutterAction.GRASP, DeclutterAction.PUSH


def graph_of(
    *segments: Segment, qualities: dict[int, float] | None = None, tries: Tries = NO_TRIES
) -> DeclutterGraph:
    return declutter_graph(image(*segments), "wineglass", qualities or {}, tries, CONFIG)


def row(*places: float) -> list[Segment]:
    """Squares of 4 cm along x; the first one is the target."""
    return [
        rectangle(number, "can" if number else "wineglass", (x, 0.0))
        for number, x in enumerate(places)
    ]


@pytest.mark.parametrize("angle", [0.0, 0.5, 2.0])
@pytest.mark.parametrize("share", [0.1, 0.25, 0.5, 0.9])
def test_overlaps_weigh_by_their_iou(share: float, angle: float) -> None:
    """Two equal rectangles of which this share is common."""
    shift = 0.06 * (1.0 - share)
    place = shift * np.cos(angle), shift * np.sin(angle)
    one = rectangle(0, "", (0.0, 0.0), (0.06, 0.03), angle)
    other = rectangle(1, "", place, (0.06, 0.03), angle)
    iou = share / (2.0 - share)
    assert edge_weight(one, other, CONFIG) == pytest.approx(1.0 + (iou - 0.05) / 0.95)
    assert edge_weight(other, one, CONFIG) == edge_weight(one, other, CONFIG)


def test_a_square_and_a_turned_one_weigh_by_their_octagon() -> None:
    one, other = rectangle(0, "", (0.3, 0.0)), rectangle(1, "", (0.3, 0.0), angle=np.pi / 4.0)
    octagon = 2.0 * (np.sqrt(2.0) - 1.0)
    iou = octagon / (2.0 - octagon)
    assert edge_weight(one, other, CONFIG) == pytest.approx(1.0 + (iou - 0.05) / 0.95)


@pytest.mark.parametrize("gap", [0.0, 0.01, 0.05, 0.099])
def test_nearness_falls_with_the_distance(gap: float) -> None:
    one, other = row(0.0, 0.04 + gap)
    assert edge_weight(one, other, CONFIG) == pytest.approx(1.0 - gap / 0.1)


def test_what_is_far_has_no_edge() -> None:
    one, other = row(0.0, 0.14)
    assert edge_weight(one, other, CONFIG) == 0.0


def test_any_overlap_outranks_any_nearness() -> None:
    barely = 2.0 * 0.05 / 1.05 + 1e-3  # The share that squares have in common, just above mu_o.
    overlapping = row(0.0, 0.04 * (1.0 - barely))
    assert edge_weight(*overlapping, CONFIG) > 1.0
    assert edge_weight(*row(0.0, 0.04), CONFIG) == 1.0  # They touch.
    # As printed, contours half a metre apart would weigh 2.
    assert edge_weight(*row(0.0, 0.04), CONFIG) < edge_weight(*overlapping, CONFIG)


def test_the_weight_is_continuous_from_far_to_the_same_place() -> None:
    shifts = np.linspace(0.16, 0.0, 1001)
    weights = [edge_weight(*row(0.0, shift), CONFIG) for shift in shifts]
    assert (np.diff(weights) >= 0.0).all()
    steepest = 2.0 / 0.04 / 0.95  # Of the IoU of two equal squares, where they coincide.
    assert np.diff(weights).max() < steepest * 0.16 / 1000
    assert_allclose([weights[0], weights[-1]], [0.0, 2.0])


def test_boxes_that_overlap_a_little_do_not_jump_at_the_threshold() -> None:
    """The box of an L holds its notch: boxes overlap where contours are apart."""
    corners = [[0.0, 0.0], [0.2, 0.0], [0.2, 0.02], [0.02, 0.02], [0.02, 0.2], [0.0, 0.2]]
    ell = Segment(number=0, contour=shapely.Polygon(corners))
    weights = [
        edge_weight(ell, rectangle(1, "", (0.19 - shift, 0.19 - shift), (0.06, 0.06)), CONFIG)
        for shift in np.linspace(0.0, 0.09, 500)
    ]
    assert min(weights) < 1.0 < max(weights)
    assert np.abs(np.diff(weights)).max() < 2e-2


@pytest.mark.parametrize("seed", range(20))
def test_the_tree_is_the_maximum_spanning_tree(seed: int) -> None:
    scene = random_scene(seed, spread=0.15)
    weights = edge_weights(scene, 0, CONFIG)
    tree = spanning_tree(weights, 0)
    _, labels = connected_components(weights)
    connected = np.flatnonzero(labels == labels[0])
    assert sorted(tree) == connected.tolist()
    total = sum(weights[i, parent] for i, parent in tree.items() if parent >= 0)
    # A constant is added, so that edges that weigh nothing are not the same as none.
    within = weights[np.ix_(connected, connected)]
    expected = minimum_spanning_tree(np.where(within > 0.0, 3.0 - within, 0.0)).toarray()
    assert total == pytest.approx(3.0 * (len(connected) - 1) - expected.sum())
    order = list(tree)
    for i, parent in tree.items():  # Each hangs on one that joined before.
        assert i == 0 or order.index(parent) < order.index(i)


def test_edges_of_the_same_weight_are_taken_by_their_indices() -> None:
    for count in (3, 40):
        alike = np.ones((count, count)) - np.eye(count)
        assert spanning_tree(alike, 0) == {0: -1} | dict.fromkeys(range(1, count), 0)
    square = np.array([[0, 1, 1, 0], [1, 0, 0, 1], [1, 0, 0, 1], [0, 1, 1, 0]], float)
    assert spanning_tree(square, 3) == {3: -1, 1: 3, 0: 1, 2: 0}


def test_a_vertex_without_edges_is_a_tree() -> None:
    assert spanning_tree(np.zeros((3, 3)), 1) == {1: -1}


def test_the_scenes_by_lot_have_objects_in_the_tree_and_beside_it() -> None:
    sizes = {len(spanning_tree(edge_weights(random_scene(s, spread=0.15), 0, CONFIG), 0))
             for s in range(20)}  # fmt: skip
    assert min(sizes) < 10
    assert max(sizes) > 4


def test_objects_hang_on_each_other_as_they_stand() -> None:
    graph = graph_of(*row(0.0, 0.05, 0.08, -0.06, 0.5))
    parents = {v.segment.number: v.parent for v in graph.vertices}
    assert parents == {0: -1, 1: 0, 2: 1, 3: 0}
    assert [segment.number for segment in graph.apart] == [4]
    assert [v.segment.number for v in graph.vertices] == [0, 1, 3, 2]
    assert [v.segment.number for v in graph.leaves()] == [3, 2]
    assert graph.vertex(1).weight == pytest.approx(0.9)
    assert graph.vertex(0).weight == 0.0
    assert graph.number == 1


def test_what_is_near_another_object_but_not_the_target_is_not_in_the_way() -> None:
    graph = graph_of(*row(0.0, 0.12, 0.17))
    assert [v.segment.number for v in graph.vertices] == [0, 1]
    assert [segment.number for segment in graph.apart] == [2]


def test_the_leaf_of_the_highest_weight_is_next_though_an_inner_vertex_weighs_more() -> None:
    graph = graph_of(*row(0.0, 0.02, 0.05, -0.06), qualities={1: 0.9, 2: 0.9, 3: 0.9})
    assert graph.vertex(1).weight > graph.vertex(2).weight > 1.0
    assert graph.vertex(2).parent == 1
    assert graph.vertex(3).weight == pytest.approx(0.8)
    assert graph.next == 2
    assert graph.why == ""


@pytest.mark.parametrize("order", [(0, 1, 2, 3), (3, 2, 1, 0), (2, 0, 3, 1)])
def test_of_equal_leaves_the_lowest_number_is_next(order: tuple[int, ...]) -> None:
    """Four squares around the target, all as far from it but for rounding errors."""
    turns = 0.3 + 0.5 * np.pi * np.arange(4)
    places = np.array([0.37, 0.11]) + 0.07 * np.column_stack([np.cos(turns), np.sin(turns)])
    target = rectangle(9, "wineglass", (0.37, 0.11), angle=0.3)
    around = [rectangle(3 + k, "can", tuple(places[k]), angle=turns[k]) for k in order]
    far = {segment.number: segment.contour.distance(target.contour) for segment in around}
    assert far[3] > min(far.values())  # Without rounding it would not be the nearest one.
    assert far[3] == pytest.approx(min(far.values()))
    graph = graph_of(target, *around)
    assert graph.next == 3
    assert {v.parent for v in graph.vertices} == {-1, 9}
    assert [v.segment.number for v in graph.vertices] == [9, 3, 4, 5, 6]


@pytest.mark.parametrize("seed", range(5))
def test_the_order_of_the_objects_does_not_matter(seed: int) -> None:
    scene = list(random_scene(seed, spread=0.2))
    expected = graph_of(*scene)
    np.random.default_rng(seed).shuffle(scene)  # type: ignore[arg-type]
    found = graph_of(*scene)
    assert found.vertices == expected.vertices
    assert found.next == expected.next
    assert len(found.pushes) == len(expected.pushes)
    assert found.pushes or seed == 3  # Its target is free.
    for push, wanted in zip(found.pushes, expected.pushes, strict=True):
        assert_array_equal(push.point, wanted.point)
        assert push.finger == wanted.finger


def test_taking_away_what_is_next_frees_the_target() -> None:
    left = list(random_scene(4))
    for _ in range(len(left)):
        graph = graph_of(*left, qualities={s.number: 1.0 for s in left})
        if graph.next < 0:
            break
        left = [segment for segment in left if segment.number != graph.next]
    assert graph.why == TARGET_FREE
    assert 1 <= len(left) < 10


def test_a_good_grasp_is_a_grasp_and_a_bad_one_a_push() -> None:
    scene = row(0.0, 0.05, 0.12, -0.05, -0.12)
    graph = graph_of(*scene, qualities={1: 0.7, 2: 0.6999, 3: 7.0, 4: np.nan})
    actions = {v.segment.number: v.action for v in graph.vertices}
    assert actions == {0: None, 1: GRASP, 2: PUSH, 3: GRASP, 4: PUSH}


def test_what_is_next_has_its_push() -> None:
    graph = graph_of(*row(0.0, 0.1))
    assert (graph.next, graph.vertex(1).action) == (1, PUSH)
    assert_allclose(graph.pushes[0].direction, [1.0, 0.0], atol=1e-12)
    graph = graph_of(*row(0.0, 0.05), qualities={1: 0.7})
    assert (graph.next, graph.vertex(1).action) == (1, GRASP)
    assert graph.pushes == ()


def test_two_objects_of_a_class_are_two_vertices() -> None:
    graph = graph_of(*row(0.0, 0.05, -0.06))
    assert [v.segment.name for v in graph.vertices] == ["wineglass", "can", "can"]


def test_what_touches_the_target_and_has_its_name_is_a_part_of_it() -> None:
    target = replace(rectangle(0, "wineglass", (0.0, 0.0), (0.06, 0.06)), top=0.2)
    cap = replace(rectangle(2, "wineglass", (0.045, 0.0), (0.03, 0.03)), top=0.3)
    apart = rectangle(3, "wineglass", (-0.09, 0.0))
    graph = graph_of(target, rectangle(1, "can", (0.07, 0.0)), cap, apart, qualities={2: 0.9})
    assert [vertex.segment.number for vertex in graph.vertices] in ([0, 1, 3], [0, 3, 1])
    whole = graph.vertices[0].segment
    assert whole.contour.contains(cap.contour)
    assert whole.top == 0.3
    assert graph_of(target, cap).why == TARGET_FREE


def test_of_two_targets_the_larger_one_is_the_root() -> None:
    small = rectangle(0, "wineglass", (0.0, 0.0), (0.03, 0.03))
    large = rectangle(5, "wineglass", (0.06, 0.0), (0.05, 0.05))
    graph = graph_of(small, large)
    assert graph.vertices[0].segment.number == 5
    assert graph.next == 0
    same = rectangle(7, "wineglass", (0.0, 0.1), (0.05, 0.05))
    assert graph_of(same, large, small).vertices[0].segment.number == 5


def test_without_anything_nothing_is_next() -> None:
    graph = declutter_graph(image(), "spray", {}, NO_TRIES, CONFIG)
    assert (graph.next, graph.why, graph.vertices) == (-1, NO_TARGET, ())


def test_a_target_that_was_never_seen_is_thought_to_be_beneath_the_largest_heap() -> None:
    heap = [rectangle(k, "can", (0.04 * k, 0.0), (0.05, 0.05)) for k in range(3)]
    alone = rectangle(7, "oil", (0.5, 0.0), (0.08, 0.08))
    graph = declutter_graph(image(*heap, alone), "spray", {}, NO_TRIES, CONFIG)
    root = graph.vertices[0].segment
    assert (root.number, root.name, graph.is_guess) == (8, "spray", True)
    assert_allclose(root.centroid, [0.04, 0.0], atol=1e-9)
    assert graph.next in (0, 1, 2)
    assert [segment.number for segment in graph.apart] == [7]
    tries = NO_TRIES
    for number in range(3):
        for _ in range(CONFIG.tries):
            tries = tries.with_failure(number, DeclutterAction.PUSH, False)
    graph = declutter_graph(image(*heap, alone), "spray", {}, tries, CONFIG)
    assert (graph.next, graph.why) == (-1, NO_TARGET)


def test_a_target_alone_is_free() -> None:
    graph = graph_of(*row(0.0, 0.5))
    assert (graph.next, graph.why) == (-1, TARGET_FREE)
    assert [segment.number for segment in graph.apart] == [1]
    assert graph_of(*row(0.0)).why == TARGET_FREE


def test_two_objects_of_the_same_number_are_refused() -> None:
    with pytest.raises(ValueError, match=r"the same number: \[0, 1, 1\]"):
        graph_of(*row(0.0, 0.05), rectangle(1, "box", (0.1, 0.0)))


def failures(grasps: int, pushes: int, number: int = 1, tries: Tries = NO_TRIES) -> Tries:
    for action in [GRASP] * grasps + [PUSH] * pushes:
        tries = tries.with_failure(number, action, False)
    return tries


@pytest.mark.parametrize(
    ("quality", "grasps", "pushes", "left"),
    [
        (0.7, 0, 0, [GRASP, PUSH]),
        (0.7, 1, 0, [GRASP, PUSH]),
        (0.7, 2, 0, [PUSH]),
        (0.7, 2, 1, [PUSH]),
        (0.7, 2, 2, []),
        (0.7, 0, 2, [GRASP]),
        (0.05, 0, 0, [PUSH, GRASP]),
        (0.05, 0, 2, [GRASP]),
        (0.05, 2, 2, []),
        (0.0, 0, 0, [PUSH]),
        (0.0, 0, 2, []),
        (-3.0, 0, 0, [PUSH]),
        (np.nan, 0, 2, []),
    ],
)
def test_what_has_failed_twice_is_not_tried_again(
    quality: float, grasps: int, pushes: int, left: list[DeclutterAction]
) -> None:
    assert actions_left(1, quality, failures(grasps, pushes), CONFIG) == left


def test_other_objects_failures_do_not_count() -> None:
    assert actions_left(1, 0.7, failures(2, 2, number=2), CONFIG) == [GRASP, PUSH]


def test_an_object_whose_tries_are_used_up_is_passed_over() -> None:
    scene, qualities = row(0.0, 0.05, -0.06), {1: 0.7, 2: 0.7}
    assert graph_of(*scene, qualities=qualities).next == 1
    graph = graph_of(*scene, qualities=qualities, tries=failures(2, 2))
    assert graph.next == 2
    assert graph.vertex(1).action is None
    assert graph.vertex(1).why == "all tries are used up: 2 x grasp, 2 x push"
    assert graph.vertex(2).why == ""
    assert graph.why == ""


def test_when_all_are_used_up_the_graph_says_so() -> None:
    graph = graph_of(*row(0.0, 0.05), tries=failures(0, 2))
    assert (graph.next, graph.why) == (-1, NOTHING_LEFT)
    assert graph.vertex(1).why == "all tries are used up: 2 x push"


def enclosed() -> list[Segment]:
    """A small object within the reach of pushes, all of which a ring of the target stops."""
    angles = np.linspace(0.05, 2.0 * np.pi - 0.05, 60)
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    ring = np.concatenate([0.09 * circle, 0.07 * circle[::-1]])
    target = Segment(number=0, name="wineglass", contour=shapely.Polygon(ring))
    return [target, rectangle(1, "can", (0.0, 0.0))]


def test_an_object_that_cannot_be_pushed_is_grasped_if_it_can_be() -> None:
    graph = graph_of(*enclosed(), qualities={1: 0.02})
    assert (graph.next, graph.vertex(1).action) == (1, GRASP)
    assert graph.pushes == ()
    graph = graph_of(*enclosed())
    assert (graph.next, graph.why) == (-1, NOTHING_LEFT)
    assert graph.vertex(1).why == "every push meets something else or sweeps the target"


def test_leaves_are_tried_from_the_highest_weight_on() -> None:
    for seed in range(10):
        graph = graph_of(*random_scene(seed), qualities=dict.fromkeys(range(10), 0.9))
        ranked = sorted(graph.leaves(), key=lambda leaf: (-leaf.weight, leaf.segment.number))
        assert all(a.weight >= b.weight for a, b in pairwise(ranked))
        possible = [leaf for leaf in ranked if leaf.action is not None]
        if possible:
            assert graph.next == possible[0].segment.number


def test_what_is_likely_to_work_comes_first() -> None:
    """Two overlap the target; the one that overlaps it more cannot be pushed any more."""
    target = rectangle(0, "wineglass", (0.0, 0.0))
    scene = target, rectangle(1, "can", (0.02, 0.0)), rectangle(2, "can", (-0.03, 0.0))
    tries = failures(0, 2, number=1)
    assert graph_of(*scene, qualities={1: 0.9, 2: 0.9}, tries=tries).next == 1
    assert graph_of(*scene, qualities={1: 0.4, 2: 0.9}, tries=tries).next == 2
    assert (
        graph_of(*scene, qualities={1: 0.4}, tries=failures(0, 2, number=2, tries=tries)).next == 1
    )


def test_glass_is_pushed_when_nothing_else_is_likely_to_work() -> None:
    target = rectangle(0, "wineglass", (0.0, 0.0))
    near, glass = rectangle(1, "can", (0.06, 0.0)), rectangle(2, "can", (-0.03, 0.0))
    assert graph_of(target, near, glass).next == 2
    glass = replace(glass, is_glass=True)
    assert graph_of(target, near, glass).next == 1
    assert graph_of(target, near, glass, tries=failures(2, 2, number=1)).next == 2


def test_that_on_which_something_lies_waits() -> None:
    target, low = rectangle(0, "wineglass", (0.0, 0.0)), rectangle(1, "can", (0.03, 0.0))
    above = replace(rectangle(2, "can", (0.05, 0.0)), top=0.1)
    qualities = {1: 0.9, 2: 0.9}
    assert graph_of(target, low, above, qualities=qualities).next == 2
    glass = replace(above, is_glass=True)  # Nobody knows how high that is.
    turned = graph_of(target, low, glass, qualities=qualities)
    assert turned.next == max(turned.leaves(), key=lambda leaf: leaf.weight).segment.number


def test_what_others_cover_waits_and_is_to_be_seen_from_elsewhere() -> None:
    """Two can be grasped; the one that overlaps the target more is partly covered."""
    target, whole = rectangle(0, "wineglass", (0.0, 0.0)), rectangle(2, "can", (-0.03, 0.0))
    covered = replace(rectangle(1, "can", (0.02, 0.0)), covered=0.2)
    first = graph_of(target, covered, whole, qualities={1: 0.9, 2: 0.9})
    assert (first.next, first.is_covered) == (2, False)
    alone = graph_of(target, covered, qualities={1: 0.9})
    assert (alone.next, alone.is_covered) == (1, True)
    little = replace(covered, covered=0.05)
    assert graph_of(target, little, whole, qualities={1: 0.9, 2: 0.9}).next == 1


def test_what_was_moved_twice_and_is_still_in_the_way_waits_for_the_others() -> None:
    target, near = rectangle(0, "wineglass", (0.0, 0.0)), rectangle(1, "can", (0.05, 0.0))
    far = rectangle(2, "can", (-0.08, 0.0))
    tries = NO_TRIES
    for expected in (1, 1, 2, 2, 1):
        found = graph_of(target, near, far, tries=tries).next
        assert found == expected
        tries = tries.with_motion(found)


def test_what_covers_a_leaf_is_moved_before_it_even_if_that_is_not_sure() -> None:
    """Three in a row from the target: glass in the middle lies on the outer one."""
    target, on, leaf = row(0.0, 0.05, 0.08)
    glass = replace(on, is_glass=True)  # Its pushes are never sure.
    assert graph_of(target, glass, leaf).next == leaf.number
    found = graph_of(target, glass, replace(leaf, covered=0.3))
    assert (found.next, found.is_covered) == (glass.number, False)


def test_what_hangs_on_a_leaf_that_cannot_be_moved_is_moved_instead() -> None:
    """Three in a row from the target: the outer one stays, so the middle one is next."""
    chain = row(0.0, 0.05, 0.08)
    assert graph_of(*chain).next == 2
    graph = graph_of(*chain, tries=failures(0, 2, number=2))
    assert graph.next == 1
    assert graph.vertex(2).action is None
    both = failures(0, 2, number=2, tries=failures(0, 2))
    assert graph_of(*chain, tries=both).why == NOTHING_LEFT
