"""One short recorded episode for all tests that look at a run's folder."""

from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def recorded_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a run with its sensor streams: the lights go off after some centimetres."""
    from crossmodal.diagrams.applications import load_scenario
    from crossmodal.diagrams.run.episode import run_episode
    from crossmodal.diagrams.run.folder.run_folder import SENSORS_FILE, write_run

    folder = tmp_path_factory.mktemp("run")
    application, scenario = load_scenario(
        "drawer-lights-off",
        [
            "seed=7",
            "control.sequence.travel=0.07",
            "task.opening=0.04",
            "disturbances.lights_off.0.start=7.0",
        ],
    )
    record = run_episode(application, scenario, sensors_file=folder / SENSORS_FILE)
    write_run(folder, application, record, application.evaluate(record))
    return folder
