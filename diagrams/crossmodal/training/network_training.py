"""Simulates the interactions that a network learns from, trains it and writes weights and card."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from crossmodal.diagrams.crossmodal.training.hand_bending_data import simulate_interaction
from crossmodal.diagrams.crossmodal.training.hand_bending_training import Interaction, train
from crossmodal.diagrams.drawing.table import Table
from crossmodal.diagrams.evaluation.campaign_report import made_by
from crossmodal.diagrams.run.folder.written_files import write_atomically, write_text
from crossmodal.diagrams.run.process import ending_with_this_process
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

    one = delayed(ending_with_this_process(simulate_interaction))
    yield from Parallel(n_jobs=jobs, return_as="generator")(
        one(1000 * seed + number) for number in range(count)
    )


def train_hand_bending(
    interactions: Sequence[Interaction],
    *,
    seed: int = 0,
    folder: Path | None = None,
) -> tuple[list[Path], str]:
    """Trains MLPR1 and MLPR2 and writes them.

    Args:
        folder: For weights and card; models/weights by default.

    Returns:
        The files written, and the card.
    """
    folder = folder or WEIGHTS_DIR
    command = f"crossmodal train hand-bending --seed {seed}"
    network, facts = train(interactions, seed=seed, command=made_by(command))
    card = hand_bending_card(facts)
    return [
        write_atomically(folder / FILES[0], lambda path: save_network(path, network)),
        write_text(folder / FILES[1], card),
    ], card


def hand_bending_card(facts: dict[str, Any]) -> str:
    """What the networks learned from and how wrong they are, in Markdown."""
    errors = list(facts["unseen"])
    lines = ["# Hand bending: MLPR1 and MLPR2", ""]
    lines += [f"- {key}: {facts[key]}" for key in ("data", "split", "metric", "command", "hidden")]
    share = 100.0 * facts["unseen_within_2_sigma"]
    lines += [f"- unseen errors within two predicted standard deviations: {share:.0f} %", ""]
    table = Table(header=["root mean square error", *map(_title, errors)])
    table.rows = [
        [title, *(f"{facts[row][key]:.2f}" for key in errors)] for row, title in _CARD_ROWS.items()
    ]
    return "\n".join([*lines, table.markdown(), ""])


def _title(key: str) -> str:
    quantity, _, unit = key.rpartition("_")
    return f"{quantity.replace('_', ' ')} [{unit}]"
