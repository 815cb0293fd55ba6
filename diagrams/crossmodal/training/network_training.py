"""Simulates the interactions that a network learns from, trains it and writes weights and card."""

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from crossmodal.diagrams.crossmodal.training.hand_bending_data import simulate_interaction
from crossmodal.diagrams.crossmodal.training.hand_bending_training import (
    Interaction,
    search_topology,
    train,
)
from crossmodal.diagrams.evaluation.campaign_report import made_by
from crossmodal.diagrams.run.folder.run_folder import write_atomically, write_text
from crossmodal.models import WEIGHTS_DIR
from crossmodal.systems.proprioception.bending_network import save_network

INTERACTIONS = 15
FILES = ("hand_bending.npz", "hand_bending.md")  # Weights and card.
_CARD_ROWS = {
    "unseen": "unseen interactions",
    "no_bending": "the same, if there were no bending",
    "seen": "interactions trained on",
}


def simulate_interactions(
    seed: int, count: int = INTERACTIONS, jobs: int = 1
) -> Iterator[Interaction]:
    """Yields interactions in their order; the same seed gives the same ones for any `jobs`."""
    from joblib import Parallel, delayed

    yield from Parallel(n_jobs=jobs, return_as="generator")(
        delayed(simulate_interaction)(1000 * seed + number) for number in range(count)
    )


def train_hand_bending(
    interactions: Sequence[Interaction],
    *,
    seed: int = 0,
    search: bool = False,
    folder: Path | None = None,
) -> tuple[list[Path], str]:
    """Trains MLPR1 and MLPR2 and writes them.

    Args:
        search: Also compare topologies by leave-one-out and say so on the card; the paper's
            10-10-10 is trained in any case.
        folder: For weights and card; models/weights by default.

    Returns:
        The files written, and the card.
    """
    folder = folder or WEIGHTS_DIR
    command = f"crossmodal train hand-bending --seed {seed}" + (" --search" if search else "")
    network, facts = train(interactions, seed=seed, command=made_by(command))
    topologies = search_topology(interactions, seed=seed) if search else []
    card = hand_bending_card(facts, topologies)
    return [
        write_atomically(folder / FILES[0], partial(_save, network)),
        write_text(folder / FILES[1], card),
    ], card


def _save(network: Any, path: Path) -> None:
    save_network(path, network)


def hand_bending_card(facts: dict[str, Any], topologies: Sequence[dict[str, Any]]) -> str:
    """What the networks learned from and how wrong they are, in Markdown."""
    errors = list(facts["unseen"])
    lines = ["# Hand bending: MLPR1 and MLPR2", ""]
    lines += [f"- {key}: {facts[key]}" for key in ("data", "split", "metric", "command", "hidden")]
    share = 100.0 * facts["unseen_within_2_sigma"]
    lines += [f"- unseen errors within two predicted standard deviations: {share:.0f} %", ""]
    rows = [["root mean square error", *map(_title, errors)]]
    rows += [[title, *(_value(facts[row][k]) for k in errors)] for row, title in _CARD_ROWS.items()]
    lines += _table(rows)
    if topologies:
        lines += ["", "Topologies by leave-one-out, best first (1: as good as no bending):", ""]
        rows = [["neurons", "score", *map(_title, errors)]]
        for result in topologies:
            neurons = "-".join(map(str, result["hidden"]))
            rows.append([neurons, _value(result["score"]), *(_value(result[k]) for k in errors)])
        lines += _table(rows)
    return "\n".join(lines) + "\n"


def _table(rows: Sequence[Sequence[str]]) -> list[str]:
    lines = [f"| {' | '.join(row)} |" for row in rows]
    return [lines[0], f"|{'---|' * len(rows[0])}", *lines[1:]]


def _title(key: str) -> str:
    quantity, _, unit = key.rpartition("_")
    return f"{quantity.replace('_', ' ')} [{unit}]"


def _value(value: float) -> str:
    return f"{value:.2f}"
