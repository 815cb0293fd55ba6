"""What all tests share: a recorded episode, Drake's newer refusal of None, and where to import."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from filelock import FileLock
from pydrake.common.value import AbstractValue, Value

# Processes that a test starts run this checkout, too, whatever their folder is.
_ROOT = str(Path(__file__).parents[1])
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [_ROOT, os.environ.get("PYTHONPATH")]))


@pytest.fixture(scope="session", autouse=True)
def none_is_no_value() -> None:
    """Ports and states refuse None, as they do in Drake's wheels for Python 3.12 and later."""

    def refusing(function: Callable[..., Any], place: int) -> Callable[..., Any]:
        def checked(*arguments: Any) -> Any:
            if len(arguments) > place and arguments[place] is None:
                raise TypeError("None is no value of a port or a state")
            return function(*arguments)

        return checked

    of_objects: Any = Value[object]
    of_objects.__init__ = refusing(of_objects.__init__, 1)
    of_objects.set_value = refusing(of_objects.set_value, 1)
    AbstractValue.Make = staticmethod(refusing(AbstractValue.Make, 0))  # type: ignore[method-assign]


@pytest.fixture(scope="session")
def recorded_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a run with its sensor streams: the lights go off after some centimetres.

    It is simulated by the first process that needs it, for all.
    """
    temporary = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        temporary = temporary.parent
    folder = temporary / "recorded-run"
    with FileLock(f"{folder}.lock"):
        if not folder.exists():
            made = tmp_path_factory.mktemp("run")
            _record(made)
            made.rename(folder)
    return folder


def _record(folder: Path) -> None:
    from crossmodal.diagrams.applications import load_scenario
    from crossmodal.diagrams.evaluation.run_writer import write_run
    from crossmodal.diagrams.run.episode import run_episode
    from crossmodal.diagrams.run.folder.run_folder import SENSORS_FILE

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
