"""One episode of a campaign in a process of its own, and what this process takes of the machine.

Memory that an episode keeps ends with its process, and so does whatever kills it.
"""

import os
import resource
import signal
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable, Mapping
from functools import cache, partial
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from crossmodal.diagrams.run.application import Application
from crossmodal.diagrams.run.folder.run_folder import (
    LOG_FILE,
    SUMMARY_FILE,
    finished_summary,
    make_folder,
    remove_run,
    write_scenario,
)
from crossmodal.diagrams.run.scenario import Scenario
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, one_line

P = ParamSpec("P")
R = TypeVar("R")

ERROR_FILE = "error.txt"  # The reason in its first line, then the traceback.
# Runs the scenario in the folder that it is given, and ends when its standard input is closed.
_COMMAND = (sys.executable, "-m", "crossmodal.diagrams.commands.episode")
_STATUS = Path("/proc/self/status")
_RUNNING: set[subprocess.Popen[bytes]] = set()


class EpisodeWarning(UserWarning):
    """An episode has ended, but not all of its files are there."""


def thread_limits(cores: int) -> dict[str, str]:
    """Environment that keeps an episode to so many cores."""
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")
    limits = dict.fromkeys(names, "1")
    # Mesa's software renderer draws in the calling thread when told to use none of its own.
    limits["LP_NUM_THREADS"] = "0" if cores == 1 else str(cores)
    limits["OPENCV_FOR_THREADS_NUM"] = str(cores)
    return limits


def run_apart(
    application: Application, scenario: Scenario, folder: Path, environment: Mapping[str, str]
) -> dict[str, Any]:
    """Runs an episode in a process of its own; whatever goes wrong there is its result.

    Args:
        folder: Where the episode is written.
        environment: Added to this process' own.

    Returns:
        The episode's summary, or that of a failure with its reason.
    """
    try:
        if folder.is_symlink():
            raise ScenarioError(f"{folder}: is a link to somewhere else; remove it")
        make_folder(folder)
        remove_run(folder)
        for name in (ERROR_FILE, LOG_FILE):  # They may be links.
            (folder / name).unlink(missing_ok=True)
        write_scenario(folder, application, scenario)
        log = (folder / LOG_FILE).open("wb")
    except (OSError, ScenarioError) as error:
        return failed_summary(scenario, one_line(error))
    with log:
        process = subprocess.Popen(
            [*_COMMAND, str(folder.resolve())],
            stdin=subprocess.PIPE,
            stdout=log,
            stderr=log,
            env={**os.environ, **environment},
            start_new_session=True,  # A Ctrl-C is for the one who started it.
        )
    _RUNNING.add(process)
    with process:
        try:
            process.wait()
        finally:
            _RUNNING.discard(process)
    summary = finished_summary(folder, application, scenario)
    if summary and process.returncode > 0:
        warnings.warn(_reason(folder, process.returncode), EpisodeWarning, stacklevel=2)
    return summary or failed_summary(scenario, _reason(folder, process.returncode))


def ending_with_this_process(function: Callable[P, R]) -> Callable[P, R]:
    """The same function; a process that runs it for this one ends when this one does.

    However this one ends: joblib's workers would finish their work first.
    """
    return partial(_run_and_watch, os.getpid(), function)


def _run_and_watch(caller: int, function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
    if os.getpid() != caller:
        _end_with(caller)
    return function(*args, **kwargs)


@cache
def _end_with(caller: int) -> None:
    def watch() -> None:
        while os.getppid() == caller:  # Who has none any more gets another one.
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def stop_running() -> None:
    """Ends the episodes that this process has started."""
    for process in list(_RUNNING):
        process.kill()


def failed_summary(scenario: Scenario, reason: str) -> dict[str, Any]:
    """The summary of an episode that has none of its own."""
    return {
        "scenario": scenario.name,
        "seed": scenario.seed,
        "success": False,
        "failure": reason,
        "modalities": {},
    }


def _reason(folder: Path, status: int) -> str:
    try:
        return (folder / ERROR_FILE).read_text(encoding="utf-8").splitlines()[0]
    except (OSError, IndexError):
        pass
    if status == 0 and (folder / SUMMARY_FILE).is_file():
        return "the program's files have changed since the evaluation began"
    how = signal.Signals(-status).name if status < 0 else f"exit status {status}"
    return f"worker died ({how}), see {LOG_FILE}"


def peak_memory() -> int:
    """Peak resident memory, [bytes]."""
    try:
        for line in _STATUS.read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    except OSError:
        pass
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
