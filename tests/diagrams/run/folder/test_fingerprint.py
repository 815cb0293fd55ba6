"""What decides whether a finished run is still the one that a scenario would give."""

from dataclasses import replace

import pytest

from crossmodal.diagrams.applications import applications, load_scenario
from crossmodal.diagrams.crossmodal.application import APPLICATION
from crossmodal.diagrams.run.folder.fingerprint import fingerprint, program_files, versions
from crossmodal.maths.source_files import PACKAGE


def test_the_versions_that_ran_a_scenario_do_not_make_it_another() -> None:
    _, scenario = load_scenario("drawer")
    first = fingerprint(APPLICATION, scenario)
    assert fingerprint(APPLICATION, replace(scenario, versions={"drake": "1.0"})) == first
    assert fingerprint(APPLICATION, replace(scenario, seed=1)) != first


@pytest.mark.parametrize(
    ("name", "others"), [("crossmodal", ("flap", "servoing")), ("flap", ("crossmodal",))]
)
def test_what_an_episode_is_computed_by_decides_and_what_only_shows_it_does_not(
    name: str, others: tuple[str, ...]
) -> None:
    application = applications()[name]
    places = {path.relative_to(PACKAGE).as_posix() for path in program_files(application)}
    own = f"diagrams/{name}"
    assert places > {
        f"{own}/episode_parts.py",
        f"{own}/estimators.py",
        f"{own}/results/results.py",
        f"{own}/scenario.py",
        f"{own}/station/station_sensors.py",
        "diagrams/run/episode.py",
        "diagrams/run/recorder.py",
        "diagrams/stations/add_cameras.py",
        "maths/se3.py",
        "plants/scene.py",
        "systems/monitoring/window_monitor.py",
        "systems/port_values/__init__.py",
        "systems/sensors/rgbd_camera.py",
    }
    for place in places:
        shows = ("diagrams/commands", "plot", "meshcat", "campaign", "/metrics.py", "applications")
        shows += ("run/live", "controls.py", "legend")
        assert not any(part in place for part in shows), place
        assert not any(f"/{other}/" in place for other in others), place


def test_versions_name_what_it_computes_with() -> None:
    assert {"python", "source", "crossmodal", "drake", "numpy", "numba"} <= versions().keys()
    assert "not installed" not in versions().values()
