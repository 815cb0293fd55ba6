"""What a scenario needs and what does not come with the program, for a run's folder."""

import hashlib
import inspect
from dataclasses import replace
from pathlib import Path

from crossmodal.diagrams.run.application import Application
from crossmodal.diagrams.run.own_module import load_module
from crossmodal.diagrams.run.scenario import Scenario
from crossmodal.diagrams.run.variants import modules_of, with_files_kept


def kept_files(application: Application, scenario: Scenario) -> tuple[Scenario, dict[str, Path]]:
    """The scenario that names its files relative to a run's folder, and these files.

    Returns:
        The scenario, and by their places in the folder the files to be copied there.
    """
    said, files = application.keep_files(scenario)
    variants, filters = with_files_kept(scenario.variants)
    kept: Scenario = replace(said, variants=variants)
    return kept, {**files, **filters}


def sums(files: dict[str, Path], scenario: Scenario) -> dict[str, str]:
    """SHA-256 sums of those files, and of the modules with filters of the user's own."""
    found = dict(files)
    for name in modules_of(scenario.variants):
        found[name] = Path(inspect.getfile(load_module(name, f"module '{name}'")))
    return {name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in found.items()}
