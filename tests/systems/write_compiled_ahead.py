"""Writes `systems/compiled_ahead.yaml` anew: what Python calls in all recordings and two episodes.

python -m tests.systems.write_compiled_ahead
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import yaml
from numba import types
from numba.core.dispatcher import Dispatcher

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.run.episode import run_episode
from crossmodal.systems.compile_ahead import LIST
from tests.recordings.outputs import RECORDINGS, perceive

Call = tuple[str, tuple[types.Type, ...]]


@contextmanager
def noted_calls() -> Iterator[set[Call]]:
    """The compiled functions of this package that Python calls inside it for the first time."""
    calls: set[Call] = set()
    usual = Dispatcher._compile_for_args

    def noting(function: Any, *args: Any, **named: Any) -> Any:
        if function.__module__.startswith("crossmodal."):
            kinds = tuple(function.typeof_pyval(value) for value in args)
            calls.add((f"{function.__module__}.{function.__name__}", kinds))
        return usual(function, *args, **named)

    Dispatcher._compile_for_args = noting
    try:
        yield calls
    finally:
        Dispatcher._compile_for_args = usual


def document(calls: set[Call]) -> dict[str, Any]:
    """The calls as `compile_ahead` reads them."""
    named_tuples: dict[str, list[str]] = {}
    functions: dict[str, list[str]] = {}
    for name, kinds in calls:
        written = ", ".join(_written(kind, named_tuples) for kind in kinds)
        functions[name] = sorted({*functions.get(name, []), written})
    return {"named_tuples": named_tuples, "functions": dict(sorted(functions.items()))}


def _written(kind: Any, named_tuples: dict[str, list[str]]) -> str:
    if not isinstance(kind, types.NamedTuple):
        return repr(kind)
    fields = [_written(field, named_tuples) for field in kind.types]  # Inner ones come first.
    cls = kind.instance_class
    named_tuples[f"{cls.__module__}.{cls.__name__}"] = fields
    return str(cls.__name__)


def main() -> None:
    with noted_calls() as calls:
        for folder in RECORDINGS:
            perceive(folder)
        for name, duration in (("drawer", 1.0), ("flap", 10.0)):
            run_episode(*load_scenario(name, [f"duration={duration}"]))
    LIST.write_text(yaml.safe_dump(document(calls), sort_keys=False, width=100))


if __name__ == "__main__":
    main()
