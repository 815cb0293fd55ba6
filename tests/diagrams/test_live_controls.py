"""What the live pages of the applications offer acts on something."""

import pytest

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.run.episode import build_estimators, build_station

LEAST = 6
_SEEN = 17  # Letters of a name that the page has room for.


@pytest.mark.parametrize("name", ["drawer", "flap", "pose"])
def test_at_least_six_controls_write_to_something_and_say_what_the_scenario_has(name: str) -> None:
    application, scenario = load_scenario(name, [])
    controls = application.controls(scenario)
    station = build_station(application, scenario).diagram
    estimators = build_estimators(application, scenario).values()
    assert len(controls) >= LEAST
    assert all(len(control.name) <= _SEEN for control in controls)
    assert len({control.name for control in controls}) == len(controls)
    for control in controls:
        assert control.low <= control.value <= control.high
        if control.silences:
            assert station.HasOutputPort(control.port), control.port
            assert any(estimator.HasInputPort(control.port) for estimator in estimators)
        else:
            assert station.GetInputPort(control.port).size() == 1


def test_a_rig_without_robots_has_nothing_to_be_moved() -> None:
    application, scenario = load_scenario("pose-estimation", [])
    assert application.controls(scenario) == []
