"""The tables of docs/results/evaluation.md, from the folders of finished evaluations.

Each experiment has a folder of its own in one that is named:

    crossmodal evaluate drawer --seeds 20 --jobs 2 --out results/drawer
    python -m benchmarks.nine_experiments results
"""

import json
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
import typer

from crossmodal.diagrams.crossmodal.modalities import MODALITIES
from crossmodal.diagrams.drawing.table import Table
from crossmodal.diagrams.evaluation.metric_table import (
    count,
    count_of_known,
    mean_and_deviation,
    median_and_range,
    quantile,
)
from crossmodal.diagrams.joints.joint_metrics import unit_of
from crossmodal.maths.arrays import Array

Summary = dict[str, Any]
FUSED, PARTS = "crossmodal", ("vision", "proprioception")


def figures(episodes: list[Summary], modality: str, *keys: str) -> Array:
    """The first of some figures of the task's joint that an episode has, else NaN."""
    joints = [episode["modalities"][modality]["joints"][0] for episode in episodes]
    found = [next((j[key] for key in keys if j.get(key) is not None), np.nan) for j in joints]
    return np.array(found, dtype=float)


def beside_the_better_part(episodes: list[Summary], *keys: str) -> Array:
    """Cross-modal error over the smaller one of vision's and proprioception's."""
    fused, *parts = (np.abs(figures(episodes, name, *keys)) for name in (FUSED, *PARTS))
    return fused / np.fmin(*parts)


def row(episodes: list[Summary], unit: str) -> list[str]:
    """An experiment's cells of the main table."""
    types = []
    for name in MODALITIES:
        joints = [episode["modalities"][name]["joints"][0] for episode in episodes]
        types.append(count([joint["type_estimated"] == joint["type_true"] for joint in joints]))
    keys = (("configuration_rms_moving",), ("configuration_error_at_turn", "configuration_error"))
    ratios = [float(quantile(beside_the_better_part(episodes, *key), 0.5)) for key in keys]
    return [
        count([episode["success"] for episode in episodes]),
        ", ".join(types),
        median_and_range(figures(episodes, FUSED, "configuration_error"), unit),
        median_and_range(figures(episodes, FUSED, "axis_angle_error"), "rad"),
        ", ".join(
            count_of_known(figures(episodes, FUSED, f"{key}_inside_two_sigma"))
            for key in ("configuration", "axis")
        ),
        ", ".join(f"{ratio:.2g}" for ratio in ratios),
    ]


def ticks_inside(folders: list[Path]) -> list[str]:
    """Share of each modality's ticks whose configuration is inside two reported deviations.

    There is no deviation where the body is believed not to move, and no truth where the believed
    joint has another unit than the true one. The share of such ticks is in brackets.
    """
    cells = []
    for name in MODALITIES:
        ticks, inside = 0, []
        for folder in folders:
            table = pd.read_parquet(folder / "estimates.parquet")
            rows = table[(table.modality == name) & (table.quantity == "configuration")]
            known = rows[rows.truth.notna() & rows["std"].notna()]
            inside.append((known.estimate - known.truth).abs() <= 2.0 * known["std"])
            ticks += len(rows)
        claims = np.concatenate(inside)
        without = ticks - len(claims)
        remark = f" ({without / ticks:.0%} without)" if without else ""
        cells.append(f"{np.mean(claims):.0%}{remark}" if len(claims) else "-")
    return cells


def main(
    folder: Annotated[Path, typer.Argument(help="One folder of 'crossmodal evaluate' in it each.")],
) -> None:
    """Print the tables of all experiments in a folder."""
    header = "done; type right; configuration error at the end; axis direction error"
    header += "; inside two reported deviations; beside its better part: moving, end"
    main_table = Table(header=["experiment", *header.split("; ")])
    returns = Table(header=["experiment", "exploration", "return"])
    ticks = Table(header=["ticks inside two deviations", *MODALITIES])
    failures = []
    for experiment in sorted(path for path in folder.iterdir() if path.is_dir()):
        folders = sorted(path.parent for path in experiment.glob("seed-*/summary.json"))
        episodes = [json.loads((path / "summary.json").read_text()) for path in folders]
        if not episodes:
            continue
        kind = episodes[0]["modalities"][FUSED]["joints"][0]["type_true"]
        unit = unit_of(kind)
        main_table.rows.append([experiment.name, *row(episodes, unit)])
        ticks.rows.append([experiment.name, *ticks_inside(folders)])
        if all("exploitation" in episode["phases"] for episode in episodes):
            phases = [
                [episode["phases"][phase]["error"] for episode in episodes]
                for phase in ("exploration", "exploitation")
            ]
            cells = [mean_and_deviation(np.array(errors, dtype=float), unit) for errors in phases]
            returns.rows.append([experiment.name, *cells])
        failures += [
            f"{experiment.name} {episode['seed']}: {episode['failure']}, {episode['phases']}"
            for episode in episodes
            if not episode["success"]
        ]
    print(*(table.markdown() for table in (main_table, returns, ticks)), *failures, sep="\n\n")


if __name__ == "__main__":
    typer.run(main)
