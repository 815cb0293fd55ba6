"""Many episodes of one scenario over seeds, and the table of what came out."""

import json
import logging
import os
import signal
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from diagrams.run_folder import (
    finished_summary,
    open_run_folder,
    write_run,
    write_text,
)
from diagrams.scenario import Scenario, load_scenario
from diagrams.yaml_schema import ScenarioError, one_line, suggestion

_MARKER = "evaluation.json"
_ERROR_FILE = "error.txt"


@dataclass(kw_only=True)
class Experiment:
    """A scenario to be repeated, and what is known to compare its figures with.

    Attributes:
        scenario: Name of the scenario.
        description: One line.
        references: By the title of a row of the table, what the paper or a peer reached.
    """

    scenario: str
    description: str
    references: dict[str, str] = field(default_factory=dict)


_TICK_BUDGET = {"tick": "66.7 ms budget"}

EXPERIMENTS = {
    "drawer": Experiment(
        scenario="drawer",
        description="a robot pulls an unknown drawer open, in light",
        references={"task done": "works (one run)", **_TICK_BUDGET},
    ),
    "drawer-lights-off": Experiment(
        scenario="drawer-lights-off",
        description="the same, and the lights go off on the way (the paper's first experiment)",
        references={
            "task done": "works (one run)",
            "opening error at the end": "vision lost, proprioception 5 mm, cross-modal 2 mm"
            " (one run)",
            "joint type right at the end": "right (one run)",
            **_TICK_BUDGET,
        },
    ),
}


def find_experiment(name: str) -> Experiment:
    if name not in EXPERIMENTS:
        raise ScenarioError(f"unknown experiment '{name}'; {suggestion(name, EXPERIMENTS)}")
    return EXPERIMENTS[name]


def parse_seeds(text: str) -> list[int]:
    """Seeds as '100:120' (120 left out), '7' or a comma between several of these."""
    seeds: list[int] = []
    for part in text.split(","):
        first, colon, last = part.strip().partition(":")
        try:
            seeds += range(int(first), int(last)) if colon else [int(first)]
        except ValueError:
            raise ScenarioError(f"--seeds {text}: expected numbers like 100:120 or 3,5,8") from None
    if not seeds or min(seeds) < 0:
        raise ScenarioError(f"--seeds {text}: names no seed, or a negative one")
    return list(dict.fromkeys(seeds))


def open_evaluation_folder(folder: Path, experiment: str) -> Path:
    """Makes or resumes the folder of an experiment; refuses one that holds something else."""
    marker = folder / _MARKER
    if marker.is_file():
        try:
            known = json.loads(marker.read_text()).get("experiment")
        except (OSError, ValueError, AttributeError):
            known = None
        if known != experiment:
            raise ScenarioError(f"{folder}: holds the experiment '{known}'; choose another --out")
        return open_run_folder(folder, force=True)
    open_run_folder(folder)
    write_text(marker, json.dumps({"experiment": experiment}) + "\n")
    return folder


def run_episode_into(scenario: Scenario, folder: Path) -> dict[str, Any]:
    """Runs one episode unless its folder has it already; never raises for a failed episode."""
    done = finished_summary(folder, scenario)
    if done is not None:
        return done
    try:
        from diagrams.episode import run_episode
        from diagrams.process_memory import reset_peak_memory

        reset_peak_memory()  # A worker runs many episodes, each counts for itself.
        open_run_folder(folder, force=True)
        result = run_episode(scenario, scenario.seed)
        write_run(folder, result)
        if result.interrupted:
            raise KeyboardInterrupt  # An episode keeps what it has, but the others must not start.
        (folder / _ERROR_FILE).unlink(missing_ok=True)
        summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
        assert isinstance(summary, dict)
        return summary
    except Exception as error:
        # Whatever went wrong in one episode, be it a handle out of reach, is its result.
        write_text(folder / _ERROR_FILE, traceback.format_exc())
        reason = f"{type(error).__name__}: {one_line(error)}"
        return {
            "scenario": scenario.name,
            "seed": scenario.seed,
            "success": False,
            "failure": reason,
            "modalities": {},
            "phases": {},
        }


def _in_worker(scenario: Scenario, folder: Path, parent: int) -> dict[str, Any]:
    logging.getLogger("drake").setLevel(logging.ERROR)
    if os.getpid() != parent:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # The parent decides what an interrupt means.
    return run_episode_into(scenario, folder)


def run_episodes(
    experiment: Experiment,
    seeds: Sequence[int],
    folder: Path,
    *,
    jobs: int = 1,
    backend: str = "loky",
    overrides: Sequence[str] = (),
) -> Iterator[dict[str, Any]]:
    """Yields the summary of each seed's episode as it ends.

    Args:
        jobs: Processes at a time.
        backend: Of joblib; processes on this machine unless another one is registered.
    """
    from joblib import Parallel, delayed, parallel_config

    scenarios = [load_scenario(experiment.scenario, overrides) for _ in seeds]
    for scenario, seed in zip(scenarios, seeds, strict=True):
        scenario.seed = seed
    tasks = [(scenario, folder / f"seed-{scenario.seed:04d}") for scenario in scenarios]
    waiting = []
    for scenario, place in tasks:
        done = finished_summary(place, scenario)
        if done is None:
            waiting.append((scenario, place))
        else:
            yield done
    threads = max(1, (os.cpu_count() or 1) // max(jobs, 1))
    with parallel_config(backend=backend, n_jobs=jobs, **_thread_limit(backend, threads)):
        yield from Parallel(return_as="generator_unordered")(
            delayed(_in_worker)(scenario, place, os.getpid()) for scenario, place in waiting
        )


def _thread_limit(backend: str, threads: int) -> dict[str, Any]:
    return {"inner_max_num_threads": threads} if backend == "loky" else {}


def evaluate(
    name: str,
    seeds: Sequence[int],
    folder: Path,
    *,
    jobs: int = 1,
    backend: str = "loky",
    overrides: Sequence[str] = (),
    progress: Callable[[dict[str, Any]], None] = lambda summary: None,
) -> tuple[list[dict[str, Any]], list[Path], bool]:
    """Runs an experiment, resuming what is there, and writes its table.

    Returns:
        The summaries in order of their seeds, the files written and whether it was interrupted.
    """
    from diagrams.experiment_table import write_results

    experiment = find_experiment(name)
    open_evaluation_folder(folder, name)
    summaries: list[dict[str, Any]] = []
    interrupted = False
    try:
        for summary in run_episodes(
            experiment, seeds, folder, jobs=jobs, backend=backend, overrides=overrides
        ):
            summaries.append(summary)
            progress(summary)
    except KeyboardInterrupt:
        interrupted = True
        _stop_workers()
    summaries.sort(key=lambda summary: summary["seed"])
    return summaries, write_results(folder, name, experiment.references, summaries), interrupted


def _stop_workers() -> None:
    from joblib.externals.loky import get_reusable_executor

    get_reusable_executor().shutdown(wait=True, kill_workers=True)
