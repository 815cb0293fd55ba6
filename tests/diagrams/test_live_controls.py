"""What the live pages of the applications offer acts on something."""

import inspect
import re
from collections.abc import Iterator

import pytest
from pydrake.systems.framework import Diagram, InputPort, System

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.run.build import build_estimators, build_station
from crossmodal.diagrams.run.live.controls import heard_controls

LEAST = 6
_SEEN = 17  # Letters of a name that the page has room for.


def inner_ports(port: InputPort) -> Iterator[InputPort]:
    """The inputs of single systems that an input of a Diagram reaches."""
    system = port.get_system()
    if not isinstance(system, Diagram):
        yield port
        return
    for inner, index in system.GetInputPortLocators(port.get_index()):
        yield from inner_ports(inner.get_input_port(index))


def is_read(port: InputPort) -> bool:
    """Whether the code of a single system does more with an input than to declare it."""
    system: System = port.get_system()
    code = inspect.getsource(type(system))
    for base in type(system).__mro__[1:]:
        if base.__module__.startswith("crossmodal."):
            code += inspect.getsource(base)
    holders = [rf"\b{port.get_name()}\.Eval"]  # Of a variable in a constructor.
    for name, value in vars(system).items():
        values = value.values() if isinstance(value, dict) else [value]
        inputs = [one.get_index() for one in values if isinstance(one, InputPort)]
        if port.get_index() in inputs:
            holders.append(rf"self\.{name}\b(?! =)")
    return any(re.search(holder, code) for holder in holders)


@pytest.mark.parametrize("name", ["drawer", "flap", "pose"])
def test_at_least_six_controls_are_read_and_say_what_the_scenario_has(name: str) -> None:
    application, scenario = load_scenario(name, [])
    station = build_station(application, scenario).diagram
    offered = application.controls(scenario)
    controls = heard_controls(offered, build_estimators(application, scenario).values())
    assert controls == list(offered)
    assert len(controls) >= LEAST
    assert all(len(control.name) <= _SEEN for control in controls)
    assert len({control.name for control in controls}) == len(controls)
    for control in controls:
        assert control.low <= control.value <= control.high
        if control.silences:
            assert station.HasOutputPort(control.port), control.port
        else:
            port = station.GetInputPort(control.port)
            assert port.size() == 1
            assert any(map(is_read, inner_ports(port))), control.port


@pytest.mark.parametrize(
    ("name", "changes", "offered"),
    [
        ("drawer", [], {"light [%]", "cover"}),
        ("drawer", ["modalities=[proprioception]"], set()),
        ("flap", [], {"cover"}),
        ("pose", [], {"cover"}),
        ("clutter", [], {"light [%]", "cover"}),
    ],
)
def test_light_is_offered_where_something_perceives_by_colour(
    name: str, changes: list[str], offered: set[str]
) -> None:
    application, scenario = load_scenario(name, changes)
    names = {control.name for control in application.controls(scenario)}
    assert names & {"light [%]", "cover"} == offered


def test_arms_that_never_touch_have_no_controls_of_touches() -> None:
    names = [
        [c.port for c in app.controls(s)] for app, s in map(load_scenario, ("clutter", "declutter"))
    ]
    assert set(names[0]) - set(names[1]) == {"touch_pace", "approach_speed", "contact_threshold"}


def test_only_streams_that_an_estimator_of_the_run_reads_can_be_silenced() -> None:
    application, scenario = load_scenario("drawer", ["modalities=[vision]"])
    estimators = build_estimators(application, scenario).values()
    controls = heard_controls(application.controls(scenario), estimators)
    assert [control.port for control in controls if control.silences] == ["depth_measured"]


def test_a_rig_without_robots_has_nothing_to_be_moved() -> None:
    application, scenario = load_scenario("pose-estimation", [])
    assert application.controls(scenario) == []
