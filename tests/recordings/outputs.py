"""What perception makes of a recording, as a table that is kept beside it and compared."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from crossmodal.diagrams.applications import load_recorded
from crossmodal.diagrams.run.replay import replay

FOLDER = Path(__file__).parent
SOURCES = sorted(FOLDER.glob("*.yaml"))  # What was simulated.
RECORDINGS = [source.with_suffix("") for source in SOURCES]  # Folders.
OUTPUTS_FILE = "outputs.csv"
COMMAND = "make replays"  # Writes the outputs of all recordings anew.
KEYS = ["time", "modality", "quantity", "component"]
INSTANTS = 5  # At which the outputs are kept: evenly spaced, the last tick among them.

# With other instructions of the processor (`python -m benchmarks.instruction_sets`) an estimate
# changes by up to 3.6e-4 of its standard deviation, a standard deviation by 1.8e-4 of itself, a
# probability by 8.9e-6. What is allowed is ten times that and more.
SHARE_OF_STD = 0.005
WITHOUT_STD = 1e-3  # Probabilities, counts, ages [s].


def perceive(folder: Path, changes: Sequence[str] = ()) -> pd.DataFrame:
    """Perceives a recording again.

    Args:
        folder: Of the recording.
        changes: Assignments as for `crossmodal replay --set`.

    Returns:
        Rows of `KEYS`, `estimate` and `std` at a few ticks; an event is a row without numbers.
    """
    application, scenario = load_recorded(folder, changes)
    record = replay(application, folder, scenario)
    results = application.evaluate(record)
    table = results.estimates
    times = sorted(table.time.unique())
    chosen = [times[(len(times) - 1) * (k + 1) // INSTANTS] for k in range(INSTANTS)]
    rows = table.loc[table.time.isin(chosen), [*KEYS, "estimate", "std"]]
    events = pd.DataFrame(
        [(event.time, "", "event", event.name) for event in [*record.events, *results.events]],
        columns=KEYS,
    )
    both = pd.concat([rows, events]).round({"time": 4})
    return both.sort_values(["time", "modality"], kind="stable", ignore_index=True)


def write_outputs(folder: Path, outputs: pd.DataFrame) -> Path:
    """Keeps what `perceive` gave beside its recording."""
    path = folder / OUTPUTS_FILE
    outputs.to_csv(path, index=False, float_format="%.7g")
    return path


def kept_outputs(folder: Path) -> pd.DataFrame:
    """What `write_outputs` kept."""
    return pd.read_csv(folder / OUTPUTS_FILE, dtype=dict.fromkeys(KEYS[1:], str)).fillna(
        dict.fromkeys(KEYS[1:], "")
    )


def differences(expected: pd.DataFrame, came: pd.DataFrame) -> list[str]:
    """Rows that differ by more than is allowed: a table's heading and lines, or nothing."""
    both = expected.merge(came, on=KEYS, how="outer", suffixes=("", "_came"), indicator="where")
    allowed = (SHARE_OF_STD * both["std"]).fillna(WITHOUT_STD)
    estimates = _differ(both["estimate"], both["estimate_came"], allowed)
    stds = _differ(both["std"], both["std_came"], allowed)
    changed = both[estimates | stds | (both["where"] != "both")]
    rows: Any = changed.itertuples()
    lines = [
        f"{row.time:8.4f}  {' '.join((row.modality, row.quantity, row.component)).strip():48s}"
        f"  {_said(row.where != 'right_only', row.estimate, row.std):26s}"
        f"  {_said(row.where != 'left_only', row.estimate_came, row.std_came)}"
        for row in rows
    ]
    heading = f"{'time [s]':8s}  {'of what':48s}  {'expected':26s}  came"
    return [heading, *lines] if lines else []


def _differ(expected: pd.Series, came: pd.Series, allowed: pd.Series) -> pd.Series:
    return ((expected - came).abs() > allowed) | (expected.isna() != came.isna())


def _said(there: bool, estimate: float, std: float) -> str:
    if not there:
        return "nothing"
    if pd.isna(estimate):
        return "said"
    return f"{estimate:.6g}" if pd.isna(std) else f"{estimate:.6g} ± {std:.3g}"
