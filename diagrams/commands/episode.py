"""One episode of a campaign, in the process that `run.process` starts.

    python -m crossmodal.diagrams.commands.episode FOLDER

It runs the scenario that FOLDER holds and writes the episode there. What happens it prints at once,
for `log.txt`, so that a process that is killed leaves it, too. It ends when its standard input is
closed, so that it never outlives who started it.
"""

import os
import sys
import threading
import traceback
from pathlib import Path

import typer

from crossmodal.diagrams.commands.endings import noted
from crossmodal.diagrams.commands.run_log import RunLog
from crossmodal.diagrams.evaluation.run_writer import evaluated, write_run
from crossmodal.diagrams.run.folder.run_folder import SCENARIO_FILE
from crossmodal.diagrams.run.folder.written_files import write_text
from crossmodal.diagrams.run.process import ERROR_FILE
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, one_line

_COMMAND = "python -m crossmodal.diagrams.commands.episode"


def run_here(folder: Path) -> int:
    """Runs the episode that `folder` describes and returns the exit status."""
    from crossmodal.diagrams.applications import load_scenario
    from crossmodal.diagrams.run.episode import run_episode

    log = RunLog(verbose=True, command=f"{_COMMAND} {folder}")
    log.note("Loading the scenario")
    try:
        with noted(log):
            application, scenario = load_scenario(str(folder / SCENARIO_FILE))
            log.note(f"Building the simulation of {scenario.name}, seed {scenario.seed}")
            record = run_episode(application, scenario)
            results = evaluated(application, record)
            if record.traceback:
                log.note(record.traceback)
            typer.echo("\n".join(log.ending(record)), err=True)
            write_run(folder, application, record, results)
    except Exception as error:
        name = "" if isinstance(error, ScenarioError) else f"{type(error).__name__}: "
        text = f"{name}{one_line(error)}\n\n{traceback.format_exc()}"
        write_text(folder / ERROR_FILE, text)
        return 1
    return 0


def _end_with_parent() -> None:
    # Not by sys.stdin: its lock would be missing when the interpreter ends.
    while os.read(0, 1024):
        pass
    os._exit(1)


if __name__ == "__main__":
    threading.Thread(target=_end_with_parent, daemon=True).start()
    sys.exit(run_here(Path(sys.argv[1])))
