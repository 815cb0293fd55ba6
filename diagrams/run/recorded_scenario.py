"""What of a scenario a recording depends on, and whether a replay still agrees with it."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from crossmodal.diagrams.run.application import Application
from crossmodal.diagrams.run.folder.fingerprint import contents
from crossmodal.diagrams.run.scenario import Scenario
from crossmodal.diagrams.run.yaml_input.loader import parse_yaml
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError

# What a replay may replace of every scenario: what perceives, and what happens to the streams on
# their way there, not what was measured.
_REPLACEABLE = ("modalities", "variants", "calibration", "disturbances.faults")
_SAYS_NOTHING = ("name", "description", "versions")


def replaceable(application: Application) -> list[str]:
    """The keys of an application's scenarios of which a replay may have other values."""
    return [*application.replaceable, *_REPLACEABLE]


def is_replaceable(application: Application, key: str) -> bool:
    """Whether a replay may have another value of a scenario's key, such as `perception.cut`."""
    ways = tuple(f"{name}{end}" for name in replaceable(application) for end in ".[")
    return f"{key}.".startswith(ways)


def check_replaced(application: Application, assignments: Sequence[str]) -> None:
    """Refuses the first assignment `key.path=value` that needs another simulation.

    Raises:
        ScenarioError: naming it, and what can be replaced.
    """
    for assignment in assignments:
        if not is_replaceable(application, assignment.split("=")[0].strip()):
            raise ScenarioError(
                f"--set {assignment}: a replay keeps what was measured; only"
                f" {', '.join(replaceable(application))} can be replaced (`replaceable` of the"
                " application says what only its estimators read)"
            )


def check_unchanged(
    application: Application, scenario: Scenario, recorded: str, source: str
) -> None:
    """Refuses a scenario under which something else would have been measured.

    Keys that only one of the two has are of another version of the program.

    Args:
        scenario: To be replayed.
        recorded: What the recording holds; empty where nothing is known.
        source: The scenario's file, for the message.

    Raises:
        ScenarioError: naming the first value that differs, and where the recording holds none.
    """
    if not recorded:
        return
    then = parse_yaml(recorded, "the recording's scenario")
    now = parse_yaml(contents(application, scenario), source)
    for key in _SAYS_NOTHING:
        then.pop(key, None)
    for key, was, is_ in _differences(then, now):
        if not is_replaceable(application, key):
            raise ScenarioError(
                f"{source}: {key} = {is_!r}, but it was recorded with {was!r};"
                " a replay keeps what was measured, only"
                f" {', '.join(replaceable(application))} can be replaced"
            )


def _differences(then: Any, now: Any, path: str = "") -> Iterator[tuple[str, Any, Any]]:
    if isinstance(then, Mapping) and isinstance(now, Mapping):
        for key in then:
            if key in now:
                yield from _differences(then[key], now[key], f"{path}.{key}".lstrip("."))
    elif isinstance(then, list) and isinstance(now, list) and len(then) == len(now):
        for index, (was, is_) in enumerate(zip(then, now, strict=True)):
            yield from _differences(was, is_, f"{path}[{index}]")
    elif then != now:
        yield path, then, now
