"""The planner of what to take away, through its ports."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, InputPortIndex, OutputPortIndex

from crossmodal.systems.declutter.declutter_graph import (
    NOTHING_LEFT,
    DeclutterConfig,
    declutter_graph,
)
from crossmodal.systems.declutter.declutter_planner import DeclutterPlanner
from crossmodal.systems.declutter.push import PushConfig
from crossmodal.systems.port_values import (
    NO_GRAPH,
    NO_TRIES,
    DeclutterAction,
    DeclutterGraph,
    Grasp,
    Grasps,
    Segment,
    Segments,
    Tries,
)
from tests.documented_ports import documented_ports
from tests.systems.declutter.scenes import image, random_scene, rectangle


@pytest.fixture
def planner() -> DeclutterPlanner:
    return DeclutterPlanner("wineglass", DeclutterConfig(), 0.1)


@pytest.fixture
def context(planner: DeclutterPlanner) -> Context:
    return planner.CreateDefaultContext()


def tick(planner: DeclutterPlanner, context: Context, **inputs: object) -> DeclutterGraph:
    for name, value in inputs.items():
        planner.GetInputPort(name).FixValue(context, AbstractValue.Make(value))
    planner.ExecuteForcedEvents(context)
    graph: DeclutterGraph = planner.GetOutputPort("declutter_graph").Eval(context)
    return graph


def grasps_of(number: int, qualities: dict[int, float]) -> Grasps:
    """One grasp of each object, of that quality."""
    grasps = {
        k: (Grasp(X_WE=np.eye(4), width=0.05, quality=quality),) for k, quality in qualities.items()
    }
    return Grasps(number=number, grasps=grasps)


def scene(number: int = 1) -> Segments:
    cans = [rectangle(k, "can", (0.12 * k - 0.18, 0.0)) for k in (1, 2)]
    return image(rectangle(0, "wineglass", (0.0, 0.0)), *cans, number=number)


def test_documented_ports_are_the_declared_ones(planner: DeclutterPlanner) -> None:
    inputs = [planner.get_input_port(InputPortIndex(i)).get_name() for i in range(3)]
    outputs = [planner.get_output_port(OutputPortIndex(0)).get_name()]
    assert (planner.num_input_ports(), planner.num_output_ports()) == (3, 1)
    assert documented_ports(DeclutterPlanner.__doc__, "input") == inputs
    assert documented_ports(DeclutterPlanner.__doc__, "output") == outputs


def test_before_the_first_image_there_is_no_graph(
    planner: DeclutterPlanner, context: Context
) -> None:
    assert planner.GetOutputPort("declutter_graph").Eval(context) is NO_GRAPH
    assert tick(planner, context, segments=Segments()) is NO_GRAPH


def test_the_graph_is_that_of_the_image(planner: DeclutterPlanner, context: Context) -> None:
    seen = image(*random_scene(3), number=4)
    found = grasps_of(4, {2: 0.8, 5: 0.3})
    tries = replace(NO_TRIES.with_failure(5, DeclutterAction.GRASP, False), number=4)
    graph = tick(planner, context, segments=seen, grasps=found, tries=tries)
    expected = declutter_graph(seen, "wineglass", {2: 0.8, 5: 0.3}, tries, DeclutterConfig())
    assert graph.vertices == expected.vertices
    assert (graph.number, graph.next) == (4, expected.next)


def test_it_is_made_again_only_for_a_new_image(planner: DeclutterPlanner, context: Context) -> None:
    first = tick(planner, context, segments=scene())
    tries = Tries(failed={(1, DeclutterAction.PUSH): 2})
    assert first.next == 1
    assert tick(planner, context, tries=replace(tries, number=1)) is first
    assert tick(planner, context, segments=scene(2)) is first  # What has failed is not known yet.
    second = tick(planner, context, tries=replace(tries, number=2))
    assert (second.number, second.next) == (2, 2)


def test_it_waits_for_the_grasps_of_its_image(planner: DeclutterPlanner, context: Context) -> None:
    old = grasps_of(1, {1: 0.9})
    first = tick(planner, context, segments=scene(), grasps=old)
    assert first.vertex(1).action is DeclutterAction.GRASP
    assert tick(planner, context, segments=scene(2)) is first
    new = grasps_of(2, {1: 0.01})
    second = tick(planner, context, grasps=new)
    assert second.number == 2
    assert second.vertex(1).action is DeclutterAction.PUSH


@pytest.mark.parametrize("quality", [3.0, np.inf])
def test_qualities_are_clipped(planner: DeclutterPlanner, context: Context, quality: float) -> None:
    found = grasps_of(1, {1: quality, 2: -quality})
    graph = tick(planner, context, segments=scene(), grasps=found)
    assert graph.vertex(1).action is DeclutterAction.GRASP
    assert graph.vertex(2).action is DeclutterAction.PUSH


def test_objects_are_taken_away_until_all_tries_are_used_up(
    planner: DeclutterPlanner, context: Context
) -> None:
    """Nothing ever works; two pushes of each object are tried."""
    tries, done = NO_TRIES, []
    for number in range(1, 10):
        graph = tick(planner, context, segments=scene(number), tries=replace(tries, number=number))
        if graph.next < 0:
            break
        action = graph.vertex(graph.next).action
        assert action is not None
        done.append((graph.next, action))
        tries = tries.with_failure(graph.next, action, False)
    push = DeclutterAction.PUSH
    assert done == [(1, push), (1, push), (2, push), (2, push)]
    assert graph.why == NOTHING_LEFT


def test_a_target_that_was_guessed_to_be_somewhere_is_not_remembered_there(
    planner: DeclutterPlanner, context: Context
) -> None:
    others: tuple[Segment, ...] = scene().segments[1:]
    first = tick(planner, context, segments=image(*others))
    assert first.is_guess
    assert first.vertices[0].segment.number == 3
    moved = rectangle(1, "can", (0.5, 0.0), (0.1, 0.1))
    second = tick(planner, context, segments=image(moved, number=2))
    assert_allclose(second.vertices[0].segment.centroid, [0.5, 0.0], atol=1e-9)
    third = tick(planner, context, segments=scene(3))
    assert not third.is_guess
    assert third.vertices[0].segment.number == 0


def test_a_target_without_a_name_is_refused() -> None:
    with pytest.raises(ValueError, match="target = '', but it must be the name"):
        DeclutterPlanner("", DeclutterConfig(), 0.1)


def test_an_impossible_number_is_refused() -> None:
    config = replace(DeclutterConfig(), push=replace(PushConfig(), longest=-0.01))
    with pytest.raises(ValueError, match=r"DeclutterPlanner: push\.longest = -0\.01 m, need > 0"):
        DeclutterPlanner("wineglass", config, 0.1)


def test_tries_may_be_written_by_another_system() -> None:
    assert Tries(failed={(1, DeclutterAction.GRASP): 2}).count(1, DeclutterAction.GRASP) == 2
