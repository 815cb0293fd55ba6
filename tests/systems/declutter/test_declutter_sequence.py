"""Looking, clearing and seeking, through the ports, on tables of rectangles."""

from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest
import shapely
from numpy.testing import assert_allclose
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import InputPortIndex, OutputPortIndex
from shapely.affinity import translate

from crossmodal.systems.declutter.declutter_graph import (
    NO_TARGET,
    NOTHING_LEFT,
    DeclutterConfig,
)
from crossmodal.systems.declutter.declutter_planner import DeclutterPlanner
from crossmodal.systems.declutter.declutter_sequence import (
    LEFT_ALONE,
    NO_VIEW_LEFT,
    TOO_MANY,
    UNREACHABLE,
    DeclutterSequence,
    DeclutterSequenceConfig,
    judge,
)
from crossmodal.systems.port_values import (
    NO_GRAPH,
    NO_PRIOR,
    NO_VIEW,
    ActionRequest,
    ArmOffset,
    DeclutterAction,
    DeclutterProgress,
    Grasp,
    Grasps,
    Segment,
    Segments,
    Tries,
    ViewRequest,
)
from tests.documented_ports import documented_ports
from tests.systems.declutter.scenes import image, rectangle

PLACES = [np.eye(4), np.diag([1.0, -1.0, -1.0, 1.0])]
NOWHERE = np.zeros((0, 3))
TABLE = ViewRequest(box_edges=np.array([0.6, 0.8, 0.4]))


def sequence(config: DeclutterSequenceConfig) -> DeclutterSequence:
    edges = np.full(3, 0.1)
    return DeclutterSequence("wineglass", np.zeros(3), edges, 0.0, PLACES, TABLE, config, 0.1)


@dataclass
class Robot:
    """Does what the sequence wants with rectangles, and shows what comes of it.

    Attributes:
        objects: By number, as they lie.
        outcomes: Of the actions to come; each does what it is to do if none is left.
        graspable: Numbers of objects that have grasps.
        hidden: By the index of the place of the camera, objects that it does not show.
        blind: Index of the places that the camera does not get to.
        edge: What is farther from below the camera is cut by the image's border, [m].
        reach: The camera does not get farther aside, [m].
    """

    objects: dict[int, Segment]
    outcomes: list[str] = field(default_factory=list)
    graspable: tuple[int, ...] = ()
    hidden: dict[int, tuple[int, ...]] = field(default_factory=dict)
    blind: tuple[int, ...] = ()
    edge: float = np.inf
    reach: float = np.inf
    config: DeclutterSequenceConfig = field(default_factory=DeclutterSequenceConfig)

    def __post_init__(self) -> None:
        self.system = sequence(self.config)
        self.context = self.system.CreateDefaultContext()
        self.planner = DeclutterPlanner("wineglass", DeclutterConfig(), 0.1)
        self.planning = self.planner.CreateDefaultContext()
        self.requests: list[ActionRequest] = []
        self.views: list[ViewRequest] = []
        self.fix("segments", Segments())
        self.fix("grasps", Grasps())
        self.fix("action_end", SimpleNamespace(number=0, outcome="", contacts=NOWHERE))
        self.fix("view_planned", NO_VIEW)
        self.system.GetInputPort("unreachable").FixValue(self.context, [0.0])
        self.tick()

    def fix(self, port: str, value: object) -> None:
        self.system.GetInputPort(port).FixValue(self.context, AbstractValue.Make(value))

    def read(self, port: str) -> object:
        return self.system.GetOutputPort(port).Eval(self.context)

    @property
    def progress(self) -> DeclutterProgress:
        found = self.read("declutter_progress")
        assert isinstance(found, DeclutterProgress)
        return found

    def tick(self) -> None:
        """Both systems tick, each with what the other one said before."""
        for port in ("segments", "grasps"):
            value = self.system.GetInputPort(port).Eval(self.context)
            self.planner.GetInputPort(port).FixValue(self.planning, AbstractValue.Make(value))
        tries = AbstractValue.Make(self.read("tries"))
        self.planner.GetInputPort("tries").FixValue(self.planning, tries)
        self.planner.ExecuteForcedEvents(self.planning)
        graph = self.planner.GetOutputPort("declutter_graph").Eval(self.planning)
        self.fix("declutter_graph", graph)
        self.system.ExecuteForcedEvents(self.context)

    def look(self, view: ViewRequest) -> None:
        turned = [np.array_equal(X_WC[:3, :3], view.X_WC[:3, :3]) for X_WC in PLACES]
        place = turned.index(True) if any(turned) else 0  # Else it was aimed from there.
        self.views.append(view)
        p_WC = view.X_WC[:2, 3]
        if place in self.blind or np.linalg.norm(p_WC) > self.reach:
            self.system.GetInputPort("unreachable").FixValue(self.context, [float(view.number)])
            return
        shown = [
            replace(s, is_cut=bool(np.linalg.norm(s.centroid - p_WC) > self.edge))
            for n, s in self.objects.items()
            if n not in self.hidden.get(place, ())
        ]
        within = shapely.Point(p_WC).buffer(min(self.edge, 2.0))
        self.fix("segments", image(*shown, number=view.number, shown=within))
        grasp = Grasp(X_WE=np.eye(4), width=0.05, quality=0.9)
        grasps = {n: (grasp, replace(grasp, quality=0.5)) for n in self.graspable}
        self.fix("grasps", Grasps(number=view.number, grasps=grasps))

    def act(self, request: ActionRequest) -> None:
        self.requests.append(request)
        outcome = self.outcomes.pop(0) if self.outcomes else "done"
        moved = self.objects[request.object]
        if outcome == "done" and request.action is DeclutterAction.PUSH:
            way = request.pushes[0].length * request.pushes[0].direction
            self.objects[request.object] = replace(moved, contour=translate(moved.contour, *way))
        elif outcome == "done":
            way = request.places[0] - moved.centroid
            self.objects[request.object] = replace(moved, contour=translate(moved.contour, *way))
        elif outcome == "falls":
            del self.objects[request.object]
        contacts = NOWHERE
        if outcome == "blocked" and request.pushes:
            push = request.pushes[0]
            contacts = np.append(push.place + 0.01 * push.direction, np.inf)[None]
        end = SimpleNamespace(number=request.number, outcome=outcome, contacts=contacts)
        self.fix("action_end", end)

    def run(self, ticks: int = 200) -> "Robot":
        for _ in range(ticks):
            view, request = self.read("view_latest"), self.read("action_request")
            assert isinstance(view, ViewRequest)
            assert isinstance(request, ActionRequest)
            if self.progress.done:
                return self
            if view.home:
                if request.number > len(self.requests):
                    self.act(request)
            elif view.number > len(self.views):
                self.look(view)
            self.tick()
        raise AssertionError("it does not end")


def row(*names: str) -> dict[int, Segment]:
    """An object and up to two more, 9 cm to its one side and its other."""
    return {
        k: rectangle(k, name, (0.5, y))
        for k, (name, y) in enumerate(zip(names, (0.0, 0.09, -0.09), strict=False))
    }


def test_documented_ports_are_the_declared_ones() -> None:
    system = sequence(DeclutterSequenceConfig())
    inputs = [
        system.get_input_port(InputPortIndex(i)).get_name() for i in range(system.num_input_ports())
    ]
    outputs = [
        system.get_output_port(OutputPortIndex(i)).get_name()
        for i in range(system.num_output_ports())
    ]
    assert documented_ports(DeclutterSequence.__doc__, "input") == inputs
    assert documented_ports(DeclutterSequence.__doc__, "output") == outputs


def test_a_target_that_stands_alone_is_sought_at_once() -> None:
    robot = Robot(row("wineglass")).run()
    assert (robot.requests, robot.progress.steps) == ([], ())
    assert (robot.progress.found, robot.progress.why) == (True, "")
    assert robot.read("pose_guess").given  # type: ignore[attr-defined]


@pytest.mark.parametrize("is_reached", [True, False])
def test_first_the_arm_is_looked_at(is_reached: bool) -> None:
    X_WC = np.diag([-1.0, -1.0, 1.0, 1.0])
    edges = np.full(3, 0.1)
    system = DeclutterSequence(
        "can", np.zeros(3), edges, 0.0, PLACES, TABLE, DeclutterSequenceConfig(), 0.1, X_WC
    )
    context = system.CreateDefaultContext()

    def view(offset: ArmOffset, unreachable: float = 0.0) -> ViewRequest:
        for port, value in (
            ("segments", Segments()),
            ("grasps", Grasps()),
            ("declutter_graph", NO_GRAPH),
            ("action_end", SimpleNamespace(number=0, outcome="", contacts=NOWHERE)),
            ("view_planned", NO_VIEW),
            ("arm_offset", offset),
        ):
            system.GetInputPort(port).FixValue(context, AbstractValue.Make(value))
        system.GetInputPort("unreachable").FixValue(context, [unreachable])
        system.ExecuteForcedEvents(context)
        found: ViewRequest = system.GetOutputPort("view_latest").Eval(context)
        return found

    for _ in range(3):
        first = view(ArmOffset())
        assert first.number == 1
        assert_allclose(first.X_WC, X_WC)
    second = view(ArmOffset(view=1)) if is_reached else view(ArmOffset(), unreachable=1.0)
    assert second.number == 2
    assert_allclose(second.X_WC, PLACES[0])


def test_until_the_way_is_clear_nothing_is_known_of_the_pose() -> None:
    robot = Robot(row("wineglass", "can"))
    assert robot.read("pose_guess") is NO_PRIOR
    robot.look(robot.read("view_latest"))  # type: ignore[arg-type]
    for _ in range(4):
        robot.tick()
    assert robot.read("view_latest").home  # type: ignore[attr-defined]
    assert robot.read("pose_guess") is NO_PRIOR


@pytest.mark.parametrize("graspable", [(), (1, 2)])
def test_one_object_after_the_other_is_taken_away(graspable: tuple[int, ...]) -> None:
    robot = Robot(row("wineglass", "can", "sponge"), graspable=graspable).run()
    action = DeclutterAction.GRASP if graspable else DeclutterAction.PUSH
    assert [(r.object, r.action, r.number) for r in robot.requests] == [
        (1, action, 1),
        (2, action, 2),
    ]
    assert [(s.object, s.name, s.worked) for s in robot.progress.steps] == [
        (1, "can", True),
        (2, "sponge", True),
    ]
    assert (robot.progress.found, robot.progress.why) == (True, "")
    assert len(robot.views) == 3
    assert len(robot.read("obstacles")) == 2  # type: ignore[arg-type]


def test_a_request_has_what_the_arm_needs() -> None:
    robot = Robot(row("wineglass", "can"), graspable=(1,)).run()
    (request,) = robot.requests
    assert [grasp.quality for grasp in request.grasps] == [0.9, 0.5]
    assert len(request.obstacles) == 1  # The target; the object itself is none.
    assert len(request.places) > 0


def test_a_grasp_that_failed_is_not_made_again() -> None:
    robot = Robot(row("wineglass", "can"), outcomes=["slipped"], graspable=(1,)).run()
    first, second = robot.requests
    assert [grasp.quality for grasp in first.grasps] == [0.9, 0.5]
    assert [grasp.quality for grasp in second.grasps] == [0.5]
    assert [(s.outcome, s.worked) for s in robot.progress.steps] == [
        ("slipped", False),
        ("done", True),
    ]


def test_after_two_grasps_it_is_pushed_and_after_two_pushes_left_alone() -> None:
    robot = Robot(row("wineglass", "can"), outcomes=["no"] * 4, graspable=(1,)).run()
    grasp, push = DeclutterAction.GRASP, DeclutterAction.PUSH
    assert [request.action for request in robot.requests] == [grasp, grasp, push, push]
    assert robot.progress.why == NOTHING_LEFT
    assert robot.progress.found
    assert robot.read("pose_guess").given  # type: ignore[attr-defined]


def test_what_falls_off_the_table_is_gone() -> None:
    robot = Robot(row("wineglass", "can"), outcomes=["falls"]).run()
    (step,) = robot.progress.steps
    assert (step.worked, step.displacement) == (True, np.inf)
    assert robot.progress.why == ""


def test_so_many_actions_and_no_more() -> None:
    config = DeclutterSequenceConfig(actions=1)
    robot = Robot(row("wineglass", "can", "sponge"), config=config).run()
    assert len(robot.requests) == 1
    assert (robot.progress.found, robot.progress.why) == (True, TOO_MANY)


def test_without_clearing_the_pose_is_sought_at_once() -> None:
    config = DeclutterSequenceConfig(clear=False)
    robot = Robot(row("wineglass", "can"), config=config).run()
    assert (robot.requests, robot.progress.found) == ([], True)
    assert robot.progress.why == LEFT_ALONE


def test_what_the_arm_cannot_begin_fails_without_the_camera_leaving() -> None:
    robot = Robot(row("wineglass", "can"))
    robot.look(robot.read("view_latest"))  # type: ignore[arg-type]
    while not robot.read("action_request").number:  # type: ignore[attr-defined]
        robot.tick()
    robot.fix("action_end", SimpleNamespace(number=1, outcome=UNREACHABLE, contacts=NOWHERE))
    robot.tick()
    view = robot.read("view_latest")
    assert (view.number, view.home) == (2, False)  # type: ignore[attr-defined]
    # Whatever the next image makes of it.
    rests = {n: rectangle(n, "can", (0.5, 0.1 * n)) for n in (1, 2)}
    shown = image(rectangle(2, "can", (0.6, 0.2)))
    step = judge(robot.read("action_request"), UNREACHABLE, 3, rests, shown, 0.02)  # type: ignore[arg-type]
    assert (step.worked, step.displacement, step.image) == (False, np.inf, 3)
    assert step.others == ()
    step = judge(robot.read("action_request"), "slipped", 3, rests, shown, 0.02)  # type: ignore[arg-type]
    assert (step.worked, step.others) == (True, (2,))


def test_a_target_near_the_image_s_border_is_not_free_before_it_is_looked_at_from_above() -> None:
    robot = Robot(row("wineglass"), edge=0.55).run()
    assert [tuple(view.X_WC[:2, 3]) for view in robot.views] == [(0.0, 0.0), (0.5, 0.0)]
    assert robot.progress.why == ""
    assert len(Robot(row("wineglass"), edge=0.65).run().views) == 1


def test_a_target_that_is_hidden_is_looked_for_from_elsewhere() -> None:
    robot = Robot(row("wineglass", "can"), hidden={0: (0,)}).run()
    assert [r.object for r in robot.requests] == [1]
    np.testing.assert_array_equal(robot.views[1].X_WC, PLACES[1])
    assert robot.progress.found


def test_what_is_covered_is_looked_at_from_elsewhere_before_it_is_moved() -> None:
    objects = row("wineglass", "can")
    objects[1] = replace(objects[1], covered=0.5)
    robot = Robot(objects).run()
    # From both places before the action, and from where it is after it.
    assert [np.array_equal(view.X_WC, PLACES[0]) for view in robot.views] == [True, False, False]
    assert len(robot.requests) == 1


def test_a_target_that_another_place_shows_is_not_lost_by_looking_from_the_side() -> None:
    objects = row("wineglass", "can")
    objects[1] = replace(objects[1], covered=0.5)
    robot = Robot(objects, hidden={1: (0,)}).run()
    assert [r.object for r in robot.requests] == [1]
    assert robot.progress.found


def test_without_a_target_in_any_view_it_ends_and_says_so() -> None:
    robot = Robot(row("can", "sponge")).run()
    assert (robot.progress.found, robot.progress.why) == (False, NO_TARGET)
    assert robot.read("pose_guess") is NO_PRIOR


class Buried(Robot):
    """No image shows the target before the first action."""

    def act(self, request: ActionRequest) -> None:
        super().act(request)
        self.hidden = {}


def test_a_target_that_no_image_shows_is_dug_for() -> None:
    objects = row("wineglass", "can")
    robot = Buried(objects, graspable=(1,), hidden={0: (0,), 1: (0,)}).run()
    # It was taken away from where the target might have been, which is far enough from where it is.
    assert [request.object for request in robot.requests] == [1]
    assert (robot.progress.found, robot.progress.why) == (True, "")


class Confused(Robot):
    """After the first action its images show something else in the target's place, or nothing."""

    instead: str = ""

    def act(self, request: ActionRequest) -> None:
        super().act(request)
        target = self.objects.pop(0, None)
        if self.instead and target is not None:
            self.objects[7] = replace(target, number=7, name=self.instead)


@pytest.mark.parametrize("instead", ["", "sponge"])
def test_a_target_that_is_not_seen_any_more_is_where_it_was(instead: str) -> None:
    robot = Confused(row("wineglass", "can", "can"))
    robot.instead = instead
    robot.run()
    assert [request.object for request in robot.requests] == [1, 2]
    assert (robot.progress.found, robot.progress.why) == (False, NO_TARGET)


@pytest.mark.parametrize(("blind", "views", "why"), [((0,), 2, ""), ((0, 1), 2, NO_VIEW_LEFT)])
def test_places_that_the_camera_does_not_get_to(
    blind: tuple[int, ...], views: int, why: str
) -> None:
    robot = Robot(row("wineglass"), blind=blind).run()
    assert (len(robot.views), robot.progress.why) == (views, why)
    assert robot.progress.found == (why == "")


def test_views_of_the_pose_are_numbered_on() -> None:
    robot = Robot(row("wineglass")).run()
    before = robot.read("view_latest")
    robot.tick()
    assert robot.read("view_latest").number == 1  # type: ignore[attr-defined]
    robot.fix("view_planned", replace(NO_VIEW, number=1, gain=3.0))
    robot.tick()
    after = robot.read("view_latest")
    assert isinstance(before, ViewRequest)
    assert isinstance(after, ViewRequest)
    assert (before.number, after.number, after.gain) == (1, 2, 3.0)


@pytest.mark.parametrize(
    ("way", "outcomes", "noticed"),
    [(0.03, [], [(0,), (0,)]), (0.012, ["no"] * 4, [(), (0,), (), (0,)])],
    ids=["at once", "many small motions add up"],
)
def test_what_was_moved_by_accident_is_noticed(
    way: float, outcomes: list[str], noticed: list[tuple[int, ...]]
) -> None:
    robot = Robot(row("wineglass", "can", "sponge"), outcomes=outcomes)

    def act(request: ActionRequest) -> None:
        Robot.act(robot, request)
        target = robot.objects[0]
        robot.objects[0] = replace(target, contour=translate(target.contour, -way, 0.0))

    robot.act = act  # type: ignore[method-assign]
    robot.run()
    assert [step.others for step in robot.progress.steps] == noticed


@pytest.mark.parametrize("reach", [np.inf, 0.05])
def test_the_camera_goes_over_target_and_next_where_its_image_cuts_one_off(reach: float) -> None:
    objects = {
        0: rectangle(0, "wineglass", (0.15, 0.0)),
        1: rectangle(1, "can", (0.21, 0.0)),
        2: rectangle(2, "sponge", (-0.3, 0.0)),  # It is not in the way.
    }
    robot = Robot(objects, edge=0.2, reach=reach).run()
    assert robot.progress.done
    assert robot.requests
    places = np.array([view.X_WC[:2, 3] for view in robot.views])
    assert_allclose(places[:2], [[0.0, 0.0], [0.18, 0.0]], atol=1e-9)
    if np.isfinite(reach):  # It is turned to it where it is.
        assert_allclose(places[2], 0.0)
        assert_allclose(robot.views[2].X_WC[:3, 2], [1.0, 0.0, 0.0], atol=1e-9)


def test_the_camera_goes_over_what_is_next_alone_where_no_image_shows_it_with_the_target() -> None:
    objects = {0: rectangle(0, "wineglass", (0.0, 0.0)), 1: rectangle(1, "can", (0.1, 0.0))}
    robot = Robot(objects, edge=0.04).run()
    places = np.array([view.X_WC[:2, 3] for view in robot.views])
    assert_allclose(places[:3], [[0.0, 0.0], [0.05, 0.0], [0.1, 0.0]], atol=1e-9)
    assert len(robot.requests) == 1


def test_what_cannot_be_moved_is_looked_at_whole_before_it_is_left_where_it_is() -> None:
    objects = {
        0: rectangle(0, "wineglass", (0.0, 0.0)),
        1: rectangle(1, "can", (0.0, 0.08)),
        2: rectangle(2, "sponge", (0.0, -0.08)),
    }
    robot = Robot(objects, edge=0.05, outcomes=["unreachable"]).run()
    assert robot.progress.why == NOTHING_LEFT
    assert [request.object for request in robot.requests] == [1, 2]
    assert_allclose(robot.views[-1].X_WC[:2, 3], [0.0, 0.04], atol=1e-9)


def test_no_push_begins_where_a_finger_was_stopped_until_what_is_there_has_moved() -> None:
    objects = row("wineglass", "can")
    robot = Robot(objects, outcomes=["blocked", "done"])
    robot.run()
    first, second, *_ = robot.requests
    assert first.object == second.object == 1
    assert np.linalg.norm(first.pushes[0].place - second.pushes[0].place) > 0.01
    tries = robot.read("tries")
    assert isinstance(tries, Tries)
    assert tries.blocked.is_empty  # The can, behind which that was, has gone.
