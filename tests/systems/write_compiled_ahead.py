"""Writes `systems/compiled_ahead.yaml` anew: what Python calls in recordings and short episodes.

python -m tests.systems.write_compiled_ahead
"""

import multiprocessing
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml
from numba import types
from numba.core.dispatcher import Dispatcher

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.run.episode import run_episode
from crossmodal.systems.compile_ahead import LIST
from crossmodal.systems.pose_tracks.pose_track import from_its_start
from crossmodal.systems.pose_tracks.repeats import estimate_repeats
from crossmodal.systems.pose_tracks.track_files import read_track
from tests.recordings.outputs import RECORDINGS, perceive

# By application: scenarios, and what makes their episodes short; `joints` is the command.
EPISODES: dict[str, dict[str, list[str]]] = {
    "joints": {},
    "crossmodal": {"drawer": ["duration=1"]},
    "flap": {"flap": ["duration=10"]},
    "clutter": {
        "pose-estimation": ["touches.chosen_touches=1"],
        "touches": ["touches.random_touches=1", "touches.chosen_touches=1"],
        "pose": [
            "views.count=1",
            "touches.chosen_touches=1",
            *(
                f"control.{task}.transit.{change}"
                for task in ("look", "touch")
                for change in ("speed=0.4", "joint_speed=1")
            ),
        ],
    },
}
FOLDER = Path(__file__).parents[2] / "benchmarks/tracks"
# Of a hand on a drawer, and of markers on a drawer and a door.
TRACKS = [FOLDER / f"{name}.txt" for name in ("drawer", "drawer_001", "left_door_001")]
HEADER = "# Written by `python -m tests.systems.write_compiled_ahead`; see compile_ahead.py.\n"
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
    """The calls of one application as `compile_ahead` reads them."""
    named_tuples: dict[str, str] = {}
    functions: dict[str, list[str]] = {}
    for name, kinds in sorted(calls, key=str):
        functions.setdefault(name, []).append(_written(kinds, named_tuples))
    return {"named_tuples": named_tuples, "functions": functions}


def _written(kinds: tuple[Any, ...], named_tuples: dict[str, str]) -> str:
    """Types as Python reads them; named tuples are collected, the inner ones first."""
    written = []
    for kind in kinds:
        if isinstance(kind, types.NamedTuple | types.NamedUniTuple):
            cls, fields = kind.instance_class, _written(kind.types, named_tuples)
            named_tuples[f"{cls.__module__}.{cls.__name__}"] = fields
            written.append(cls.__name__)
        elif isinstance(kind, types.Array) and kind.mutable and kind.layout in "AC":
            last = "::1" if kind.layout == "C" else ":"
            written.append(f"{kind.dtype}[{', '.join([':'] * (kind.ndim - 1) + [last])}]")
        else:
            written.append(repr(kind))
    return ", ".join(written)


def find_joints() -> None:
    """What `crossmodal joints` does with a few tracks of real objects."""
    for track in TRACKS:
        estimate_repeats([from_its_start(read_track(track, rate=15.0))])


def functions_of(application: str) -> dict[str, Any]:
    """What an application calls; in a process of its own, since a first call is noted once."""
    with noted_calls() as calls:
        if application == "crossmodal":
            for folder in RECORDINGS:
                perceive(folder)
        if application == "joints":
            find_joints()
        for name, changes in EPISODES[application].items():
            run_episode(*load_scenario(name, changes))
    return document(calls)


def main() -> None:
    # Functions of the old list may be gone.
    LIST.write_text(yaml.safe_dump({"named_tuples": {}, "functions": {}}))
    spawn = multiprocessing.get_context("spawn")
    # What a process compiles hides the calls of what is compiled with it: the first time only fills
    # the cache.
    for _ in range(2):
        with ProcessPoolExecutor(mp_context=spawn, max_tasks_per_child=1) as pool:
            found = dict(zip(EPISODES, pool.map(functions_of, EPISODES), strict=True))
    named_tuples = {k: v for one in found.values() for k, v in one["named_tuples"].items()}
    functions = {application: one["functions"] for application, one in found.items()}
    whole = {"named_tuples": named_tuples, "functions": functions}
    LIST.write_text(HEADER + yaml.safe_dump(whole, sort_keys=False, width=100))


if __name__ == "__main__":
    main()
