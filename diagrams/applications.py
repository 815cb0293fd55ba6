"""The applications that there are, and how a scenario finds its own.

Besides those that come with the program there are those of installed packages, which name them as
entry points of the group `crossmodal.applications`, and those that the environment variable
`CROSSMODAL_APPLICATIONS` names, with commas between them: a Python file or a module each. Each of
these modules holds an `APPLICATION`.
"""

import os
import re
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any

from crossmodal.diagrams.run.application import Application
from crossmodal.diagrams.run.folder.run_folder import (
    ESTIMATES_FILE,
    SCENARIO_FILE,
    SUMMARY_FILE,
    read_summary,
)
from crossmodal.diagrams.run.own_code import GROUP
from crossmodal.diagrams.run.own_module import load_module
from crossmodal.diagrams.run.recorded_scenario import check_replaced
from crossmodal.diagrams.run.scenario import parse_scenario, read_document
from crossmodal.diagrams.run.variants import asked_for, with_files_found
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, one_line, suggestion

if TYPE_CHECKING:
    import pandas as pd

OWN = "CROSSMODAL_APPLICATIONS"
_COME_ALONG = tuple(
    f"crossmodal.diagrams.{name}.application" for name in ("crossmodal", "flap", "clutter")
)


class ApplicationWarning(UserWarning):
    """An application of the user's own is left out, since it cannot be had."""


def applications() -> dict[str, Application]:
    """All applications by name, those that come with the program first.

    One that cannot be had is left out with a warning.
    """
    own = filter(None, (name.strip() for name in os.environ.get(OWN, "").split(",")))
    installed = (entry.module for entry in entry_points(group=GROUP))
    return _load(tuple(dict.fromkeys([*_COME_ALONG, *installed, *own])))


@cache
def _load(sources: tuple[str, ...]) -> dict[str, Application]:
    found: dict[str, Application] = {}
    for source in sources:
        try:
            application = _application(source)
            if application.name in found:
                raise ScenarioError(
                    f"application '{source}': there are two applications '{application.name}'"
                )
        except ScenarioError as error:
            if source in _COME_ALONG:
                raise
            warnings.warn(f"{error}; it is left out", ApplicationWarning, stacklevel=3)
            continue
        found[application.name] = application
    return found


def _application(source: str) -> Application:
    module = load_module(source, f"application '{source}'")
    application = getattr(module, "APPLICATION", None)
    if not isinstance(application, Application):
        raise ScenarioError(f"application '{source}': holds no Application called APPLICATION")
    return application


def find_application(name: str, source: str) -> Application:
    """The application that a scenario's `system` names.

    Args:
        source: The scenario's file, for the message.
    """
    known = applications()
    if not name:
        raise ScenarioError(
            f"{source}: does not say which application it is for;"
            f" write `system: {next(iter(known))}`"
        )
    if name not in known:
        raise ScenarioError(f"{source}: system = '{name}': {own_suggestion(name, known)}")
    return known[name]


def scenarios_of(application: Application) -> dict[str, Path]:
    """The scenarios that come with an application, by name; model directives are none."""
    files = sorted(application.scenarios.glob("*.yaml"), key=lambda path: path.stem)
    return {path.stem: path for path in files if not path.name.endswith(".dmd.yaml")}


def scenario_files() -> dict[str, Path]:
    """The scenarios that come with the applications, by name."""
    found: dict[str, Path] = {}
    for application in applications().values():
        found |= scenarios_of(application)
    return dict(sorted(found.items()))


def find_scenario(name_or_path: str) -> Path:
    """The file of a scenario given by its name or by its path."""
    known = scenario_files()
    if name_or_path in known:
        return known[name_or_path]
    path = Path(name_or_path)
    if path.suffix in (".yaml", ".yml") or os.path.isfile(path):  # Of any text, however long.
        return path
    raise ScenarioError(f"unknown scenario '{name_or_path}'; {own_suggestion(name_or_path, known)}")


def own_suggestion(word: str, known: Iterable[str]) -> str:
    """As `suggestion`; where nothing is near, also where applications of one's own are named."""
    hint = suggestion(word, known)
    if hint.startswith("did you mean"):
        return hint
    own = os.environ.get(OWN, "")
    says = f"is {own}" if own else "is not set"
    return f"{hint}; applications of your own are named in {OWN}, which {says}"


def load_scenario(
    name_or_path: str, overrides: Sequence[str] = (), *, units_known: bool = True
) -> tuple[Application, Any]:
    """Reads and checks a scenario, and finds its application.

    Args:
        overrides: Assignments `key.path=value` that replace what the file says.
        units_known: Whether the scenario already decides in which unit a value is whose field
            leaves it open; not before another object has taken the place of its own.

    Returns:
        The application, and the scenario as an instance of the application's dataclass.
    """
    path = find_scenario(name_or_path)
    with _named(overrides):
        return _load_scenario(path, overrides, units_known=units_known)


def _load_scenario(
    path: Path, overrides: Sequence[str], *, units_known: bool
) -> tuple[Application, Any]:
    document = read_document(path, overrides, scenario_files())
    system = document.get("system", "")
    if not isinstance(system, str):
        raise ScenarioError(f"{path}: system must be text, the name of an application")
    application = find_application(system, str(path))
    scenario = resolved(application, document, path, overrides)
    if units_known:
        parse_scenario(application.scenario, document, path, scenario.units)
    return application, scenario


def resolved(
    application: Application, document: Mapping[str, Any], path: Path, overrides: Sequence[str]
) -> Any:
    """The scenario that a mapping describes, checked, with the variants that run and their files.

    Args:
        path: Of its file.
        overrides: Assignments `key.path=value` that the mapping already contains.

    Raises:
        ScenarioError: for values that no episode can have.
    """
    parsed = parse_scenario(application.scenario, document, path)
    variants = asked_for(parsed.variants, parsed.modalities, overrides)
    return application.resolve(replace(parsed, variants=with_files_found(variants, path)), path)


@contextmanager
def _named(overrides: Sequence[str]) -> Iterator[None]:
    """Adds to a message about a scenario's key the assignment that has set it."""
    try:
        yield
    except ScenarioError as error:
        text = str(error)
        keys = re.findall(r"[A-Za-z_]\w*(?:\.\w+)*", text)
        for assignment in reversed(overrides):
            key = assignment.partition("=")[0].strip()
            at = any(f"{found}.".startswith(f"{key}.") for found in keys)
            if at and not text.startswith(f"--set {assignment}"):
                raise ScenarioError(f"{text} (set by {assignment})") from error
        raise


def load_recorded(folder: Path, overrides: Sequence[str] = ()) -> tuple[Application, Any]:
    """Reads and checks the scenario of a recorded run, to be replayed.

    Args:
        overrides: As of `load_scenario`, of what perceives.

    Raises:
        ScenarioError: if there is no recording, or a change would need another simulation.
    """
    from crossmodal.diagrams.run.replay import check_recorded

    path = check_recorded(folder)
    application, scenario = load_scenario(str(path), overrides)
    check_replaced(application, overrides)
    return application, scenario


def experiments() -> Mapping[str, Application]:
    """The application of every experiment, by the experiment's name."""
    return {
        name: application
        for application in applications().values()
        for name in application.experiments
    }


@dataclass(frozen=True, kw_only=True)
class RecordedRun:
    """What a run has left in its folder, for notebooks and scripts.

    Attributes:
        folder: Where it is; `run.replay` reads its sensor streams there.
        application: What ran it.
        scenario: As it was run, of the application's dataclass.
        estimates: The table over time, see `Results.estimates`.
        summary: What `summary.json` holds.
    """

    folder: Path
    application: Application
    scenario: Any
    estimates: "pd.DataFrame"
    summary: dict[str, Any]

    def dark(self) -> list[tuple[float, float]]:
        """Starts and ends of the times in which the cameras saw nothing, [s]."""
        spans = self.scenario.disturbances.dark()
        return [(interval.start, interval.end) for _, interval in spans]


def read_run(folder: Path | str) -> RecordedRun:
    """Reads the folder that `crossmodal run` has written.

    Raises:
        ScenarioError: where it is not the folder of a complete run.
    """
    import pandas as pd

    folder = Path(folder)
    for name in (SCENARIO_FILE, ESTIMATES_FILE, SUMMARY_FILE):
        if not (folder / name).is_file():
            raise ScenarioError(f"{folder}: holds no {name}; name the folder of a complete run")
    application, scenario = load_scenario(str(folder / SCENARIO_FILE))
    summary = read_summary(folder)
    if not summary:
        raise ScenarioError(f"{folder / SUMMARY_FILE}: is no summary of a run")
    try:
        estimates = pd.read_parquet(folder / ESTIMATES_FILE)
    except (OSError, ValueError) as error:
        path = folder / ESTIMATES_FILE
        raise ScenarioError(f"{path}: is damaged: {one_line(error)}; run it again") from None
    return RecordedRun(
        folder=folder,
        application=application,
        scenario=scenario,
        estimates=estimates,
        summary=summary,
    )
