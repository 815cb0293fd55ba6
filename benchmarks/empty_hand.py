"""Empties the hand at a random moment and asks who noticed, and what was claimed afterwards.

    python -m benchmarks.empty_hand [--seeds 40] [--out runs/empty-hand] [--jobs 2]

Every seed draws an object (drawer or cupboard door), a cause (the hand's chambers leak, or somebody
pushes the object shut with 250 N for a second) and a moment of the exploration. An episode that is
already in the folder is not run again; the table is of all that are there.
"""

import json
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from joblib import Parallel, delayed
from tqdm import tqdm

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.crossmodal.results.grasp_episode import grasp_episode
from crossmodal.diagrams.evaluation.seeds import parse_seeds
from crossmodal.diagrams.joints.joint_metrics import joint_episode
from crossmodal.diagrams.run.episode import run_episode

AFTERWARDS = 6.0  # How long an episode goes on, [s].
IN_TIME = 1.0  # [s]
OBJECTS = {"drawer": ("drawer", 14.0), "cupboard-door": ("door", 22.0)}  # Name, latest moment.
MODALITIES = ("proprioception", "crossmodal")


def draw_case(seed: int) -> tuple[str, str, float]:
    """Scenario, cause and moment [s] of a seed."""
    rng = np.random.default_rng((seed, 7))
    scenario = str(rng.choice(list(OBJECTS)))
    cause = str(rng.choice(["leak", "push"]))
    return scenario, cause, round(float(rng.uniform(4.0, OBJECTS[scenario][1])), 2)


def disturbance(scenario: str, cause: str, moment: float) -> str:
    """The override of a scenario that empties the hand."""
    if cause == "leak":
        return f"disturbances.hand_leaks=[{{start: {moment}}}]"
    frame = f"{OBJECTS[scenario][0]}::handle"
    force = f"{{frame: '{frame}', force: [-250, 0, 0], start: {moment}, end: {moment + 1.0}}}"
    return f"disturbances.forces=[{force}]"


def measure(seed: int) -> dict[str, Any]:
    """One episode: when the hand was emptied, when that was noticed, what was claimed then."""
    name, cause, moment = draw_case(seed)
    overrides = [
        f"seed={seed}",
        f"modalities=[{', '.join(MODALITIES)}]",
        f"duration={moment + AFTERWARDS}",
        disturbance(name, cause, moment),
    ]
    application, scenario = load_scenario(name, overrides)
    record = run_episode(application, scenario)
    grasp, results = grasp_episode(record), application.evaluate(record)
    emptied = moment if cause == "leak" else grasp.held_until
    row: dict[str, Any] = {
        "seed": seed,
        "scenario": name,
        "cause": cause,
        "moment": moment,
        "emptied": emptied if np.isfinite(emptied) else None,
        "success": results.success,
        "failure": results.failure,
    }
    for modality, series in joint_episode(record).series.items():
        noticed = grasp.noticed_at[modality]
        row[modality] = {"delay": max(noticed - emptied, 0.0) if np.isfinite(noticed) else None}
        claimed = np.isfinite(series.configuration_std)
        z = np.abs(series.error) / series.configuration_std
        late = series.times >= emptied + IN_TIME
        for when, ticks in (
            ("at once", (series.times >= emptied) & ~late & claimed),
            ("later", late & claimed),
        ):
            row[modality][when] = {
                "claims": int(ticks.sum()),
                "wrong": int(np.sum(z[ticks] > 3.0)),
                "largest": float(z[ticks].max()) if ticks.any() else None,
            }
    return row


def measured(seed: int, folder: Path) -> dict[str, Any]:
    """The episode of a seed, from the folder where it is there."""
    file = folder / f"{seed}.json"
    if not file.is_file():
        row = measure(seed)
        part = file.with_suffix(".part")
        part.write_text(json.dumps(row))
        part.replace(file)
    found: dict[str, Any] = json.loads(file.read_text())
    return found


def table(rows: list[dict[str, Any]]) -> list[str]:
    """The episodes and what they come to, as lines."""
    lines = ["seed, scenario, cause, emptied | noticed after, claims more than 3 sigma off"]
    for row in rows:
        emptied = "held on" if row["emptied"] is None else f"{row['emptied']:.1f} s"
        line = f"{row['seed']:5d} {row['scenario']:13s} {row['cause']:5s} {emptied:>8s}"
        for modality in MODALITIES:
            m = row[modality]
            delay = "never" if m["delay"] is None else f"{m['delay']:.2f} s"
            line += f" | {modality} {delay}"
            for when in ("at once", "later"):
                largest = m[when]["largest"]
                most = "" if largest is None else f" (at most {largest:.1f})"
                line += f", {when} {m[when]['wrong']} of {m[when]['claims']}{most}"
        lines.append(line)
    emptied_rows = [row for row in rows if row["emptied"] is not None]
    lines.append(f"{len(emptied_rows)} of {len(rows)} hands were emptied; of these")
    for modality in MODALITIES:
        ms = [row[modality] for row in emptied_rows]
        in_time = sum(m["delay"] is not None and m["delay"] <= IN_TIME for m in ms)
        at_once, later = (sum(m[w]["wrong"] > 0 for m in ms) for w in ("at once", "later"))
        lines.append(
            f"  {modality}: noticed within {IN_TIME:g} s: {in_time}; a claim more than 3 sigma off"
            f" within that second: {at_once}, later: {later}"
        )
    lines.append(f"  called a success: {sum(bool(row['success']) for row in emptied_rows)}")
    return lines


def main(
    seeds: Annotated[str, typer.Option(help="A count, or FIRST:END as in `evaluate`.")] = "40",
    out: Annotated[Path, typer.Option(help="Of the episodes.")] = Path("runs/empty-hand"),
    jobs: Annotated[int, typer.Option(min=1, help="Episodes at a time.")] = 1,
) -> None:
    """Prints the episodes and what they come to."""
    out.mkdir(parents=True, exist_ok=True)
    numbers = parse_seeds(seeds)
    parallel = Parallel(n_jobs=jobs, return_as="generator_unordered")
    runs = parallel(delayed(measured)(seed, out) for seed in numbers)
    rows = sorted(tqdm(runs, total=len(numbers)), key=lambda row: row["seed"])
    print("\n".join(table(rows)))


if __name__ == "__main__":
    typer.run(main)
