"""Writes what perception makes of the committed recordings anew, after an intended change.

    python -m tests.recordings.write              # perceives them again (make replays)
    python -m tests.recordings.write --simulate   # records them anew before (make recordings)

Both say what has changed; nothing is written where all is as it was.
"""

import sys
from pathlib import Path

import yaml
from pydrake.common.yaml import yaml_dump_typed

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.run.episode import run_episode
from crossmodal.diagrams.run.folder.run_folder import SCENARIO_FILE, SENSORS_FILE
from tests.recordings.outputs import (
    OUTPUTS_FILE,
    SOURCES,
    differences,
    kept_outputs,
    perceive,
    write_outputs,
)


def simulate(source: Path) -> None:
    """Makes a recording anew.

    Its scenario says all that was simulated, so that another default needs no other recording, and
    nothing of what perceives, so that a default of a filter shows.
    """
    folder = source.with_suffix("")
    folder.mkdir(exist_ok=True)
    application, scenario = load_scenario(str(source))
    run_episode(application, scenario, sensors_file=folder / SENSORS_FILE)
    document = yaml.safe_load(yaml_dump_typed(scenario))
    del document["perception"], document["calibration"]["believed"], document["versions"]
    text = yaml.safe_dump(document, sort_keys=False, default_flow_style=None)
    (folder / SCENARIO_FILE).write_text(f"# Of ../{source.name}, by `make recordings`.\n{text}")
    size = (folder / SENSORS_FILE).stat().st_size
    print(f"{folder.name}: recorded, {size / 1e3:.0f} kB")


def write(folder: Path) -> None:
    """Writes a recording's outputs, unless they are as they were within the tolerances."""
    outputs = perceive(folder)
    kept = kept_outputs(folder) if (folder / OUTPUTS_FILE).exists() else outputs.iloc[:0]
    changed = differences(kept, outputs)
    if changed:
        write_outputs(folder, outputs)
    said = f"{len(changed) - 1} of {len(outputs)} rows changed" if changed else "as it was"
    print("\n".join([f"{folder.name}: {said}", *changed]))


if __name__ == "__main__":
    for source in SOURCES:
        if "--simulate" in sys.argv[1:]:
            simulate(source)
        write(source.with_suffix(""))
