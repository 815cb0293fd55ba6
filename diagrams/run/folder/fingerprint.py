"""What decides whether a finished run is still the one that a scenario would give."""

import hashlib
import inspect
import platform
from collections.abc import Iterator
from dataclasses import replace
from functools import cache, partial
from importlib import metadata
from pathlib import Path
from typing import Any

import yaml
from pydrake.common.yaml import yaml_dump_typed

from crossmodal.diagrams.run.application import Application
from crossmodal.diagrams.run.folder.kept_files import kept_files, sums
from crossmodal.diagrams.run.scenario import Scenario
from crossmodal.maths.source_files import PACKAGE, source_files, sources_stamp
from crossmodal.models import SDF_DIR, WEIGHTS_DIR

_COMPUTES = ("drake", "numpy", "scipy", "opencv-python-headless", "numba")


@cache
def versions() -> dict[str, str]:
    """Of the program, its sources and what it computes with."""
    found = {"python": platform.python_version(), "source": _stamp_of_all()}
    for name in ("crossmodal", *_COMPUTES):
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found


def program() -> str:
    """The program, its sources and Drake, in a line."""
    known = versions()
    of_drake = f"Drake {known['drake']}"
    return f"crossmodal {known['crossmodal']} (source {known['source']}), {of_drake}"


def _stamp_of_all() -> str:
    # Room by room: in a checkout they are links, which a pattern does not follow.
    return sources_stamp(*(path for room in PACKAGE.iterdir() for path in room.rglob("*.py")))


def program_files(application: Application) -> list[Path]:
    """The Python files that decide what an episode comes to.

    They are those of the station, the estimators, the scenario, the calibration, the evaluation and
    the episode, and what these import. What only shows results is imported where it is called.
    """
    made_by = [
        application.scenario,
        application.resolve,
        application.make_calibration,
        application.make_station,
        application.make_estimators,
        application.close_loop,
        application.evaluate,
    ]
    own = [Path(inspect.getfile(part)) for value in made_by for part in _parts(value)]
    return source_files([PACKAGE / "diagrams/run/episode.py", *own])


def _parts(value: Any) -> Iterator[Any]:
    """The functions and classes that a function or a partial consists of."""
    if isinstance(value, partial):
        for part in (value.func, *value.args, *value.keywords.values()):
            yield from _parts(part)
    elif inspect.isfunction(value) or inspect.isclass(value):
        yield value


def source_hash(application: Application) -> str:
    """Hash of all files that can change an episode, as they were when they were first read."""
    return hashlib.sha256(
        (sources_stamp(*program_files(application)) + _stamp_of_data()).encode()
    ).hexdigest()[:16]


@cache
def _stamp_of_data() -> str:
    files = [path for place in (SDF_DIR, WEIGHTS_DIR) for path in sorted(place.rglob("*.*"))]
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()


def contents(application: Application, scenario: Scenario) -> str:
    """All that a scenario says, as YAML; of files that it names what is in them, not their places.

    The files that do not come with the program stand below `files` with their SHA-256 sums.
    """
    said, files = kept_files(application, scenario)
    found = sums(files, scenario)
    return yaml_dump_typed(said) + (yaml.safe_dump({"files": found}) if found else "")


def fingerprint(application: Application, scenario: Scenario) -> dict[str, Any]:
    """What decides whether a finished run is still the one that a scenario would give."""
    said = contents(application, replace(scenario, versions={}))
    return {
        "scenario_hash": hashlib.sha256(said.encode()).hexdigest()[:16],
        "source_hash": source_hash(application),
        "computed_with": {name: versions()[name] for name in _COMPUTES},
    }
