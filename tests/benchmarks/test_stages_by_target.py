"""The table of stages by target, from summaries that are made up."""

import json
from pathlib import Path
from typing import Any

import pytest
import typer

from benchmarks.stages_by_target import rows


def episode(folder: Path, seed: int, target: str, *stages: tuple[str, float, bool]) -> None:
    made = [
        {"stage": kind, "adi": adi, "translation_error": 2.0 * adi, "inside_claim": inside}
        for kind, adi, inside in stages
    ]
    summary: dict[str, Any] = {
        "pose": {"target": target},
        "modalities": {"density": {"stages": made}},
    }
    file = folder / f"seed-{seed:04d}" / "summary.json"
    file.parent.mkdir(parents=True)
    file.write_text(json.dumps(summary))


def test_an_episode_without_a_target_counts_as_infinitely_wrong(tmp_path: Path) -> None:
    stages = [("guess", 0.02, True), ("view", 0.003, True), ("touch", 0.001, False)]
    episode(tmp_path, 0, "can", *stages)
    episode(tmp_path, 1, "can")
    episode(tmp_path, 2, "can", *stages[:2])
    episode(tmp_path, 3, "oil", *stages)
    can, oil, everything = rows(tmp_path, "density")
    name = f"{tmp_path}: can"
    assert can == f"| {name} | 3 | 20.00 | 3.00 | 3.00 | inf | inf | 80 % |"
    assert oil == f"| {tmp_path}: oil | 1 | 20.00 | 3.00 | 1.00 | 2.00 | 2.00 | 67 % |"
    assert everything.startswith(f"| {tmp_path}: all | 4 | 20.00 |")


def test_a_folder_without_episodes_is_refused(tmp_path: Path) -> None:
    with pytest.raises(typer.BadParameter, match="has no seed-"):
        list(rows(tmp_path, "density"))
    episode(tmp_path, 0, "can", ("guess", 0.02, True))
    with pytest.raises(typer.BadParameter, match="has no estimator other"):
        list(rows(tmp_path, "other"))
