"""How well each target's pose is known after each stage, in one evaluation or in several.

crossmodal evaluate clutter --seeds 0:20
crossmodal evaluate clutter --seeds 0:20 --set sequence.clear=false --out runs/not-cleared
python -m benchmarks.stages_by_target runs/evaluate/clutter runs/not-cleared

An episode in which the target was not found counts as an infinite error.
"""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

STAGES = {"first guess": "guess", "views": "view", "touches": "touch"}


def after(stages: list[Mapping[str, Any]], kind: str, error: str) -> float:
    """An error after the last stage of a kind, or before it if there was none; else infinite."""
    kinds = list(STAGES.values())
    found = [s for s in stages if kinds.index(s["stage"]) <= kinds.index(kind)]
    return float(found[-1][error]) if found else np.inf


def episodes(folder: Path, estimator: str) -> dict[str, list[list[Mapping[str, Any]]]]:
    """The stages of all episodes, by their targets.

    Raises:
        BadParameter: for a folder without episodes, or without this estimator.
    """
    found: dict[str, list[list[Mapping[str, Any]]]] = {}
    for file in sorted(folder.glob("seed-*/summary.json")):
        summary = json.loads(file.read_text())
        if estimator not in summary["modalities"]:
            raise typer.BadParameter(f"{file} has no estimator {estimator}")
        stages = summary["modalities"][estimator]["stages"]
        found.setdefault(summary["pose"]["target"], []).append(stages)
    if not found:
        raise typer.BadParameter(f"{folder} has no seed-*/summary.json")
    return found


def rows(folder: Path, estimator: str) -> Iterator[str]:
    """Of the table, one for each target and one for all."""
    by_target = episodes(folder, estimator)
    everything = [stages for group in by_target.values() for stages in group]
    for target, group in [*sorted(by_target.items()), ("all", everything)]:
        medians = [np.median([after(s, kind, "adi") for s in group]) for kind in STAGES.values()]
        last = np.array([after(s, "touch", "translation_error") for s in group])
        claims = [stage["inside_claim"] for stages in group for stage in stages]
        inside = f"{100.0 * np.mean(claims):.0f} %" if claims else "-"
        cells = [
            f"{folder}: {target}",
            str(len(group)),
            *(f"{1e3 * median:.2f}" for median in medians),
            f"{1e3 * last.mean():.2f}",
            f"{1e3 * last.max():.2f}",
            inside,
        ]
        yield "| " + " | ".join(cells) + " |"


def main(
    folders: Annotated[list[Path], typer.Argument(help="Of evaluations.")],
    estimator: Annotated[str, typer.Option(help="Of summary.json.")] = "density",
) -> None:
    """Prints median ADI after each stage and the translation error at the end, by target, [mm]."""
    head = ["target", "episodes", *(f"ADI, {stage}" for stage in STAGES)]
    head += ["translation, mean", "translation, largest", "stages inside their claim"]
    print("| " + " | ".join(head) + " |")
    print("|" + "---|" * len(head))
    for folder in folders:
        for row in rows(folder, estimator):
            print(row)


if __name__ == "__main__":
    typer.run(main)
