"""`crossmodal train`, with one command for each network."""

from pathlib import Path
from typing import Annotated

import typer

from crossmodal.diagrams.commands.endings import one_line_errors

EXAMPLES = "Example:  crossmodal train hand-bending --jobs 2 --out runs/weights"


def train_hand_bending_command(
    seed: Annotated[int, typer.Option(min=0, help="Of data and weights.")] = 0,
    jobs: Annotated[int, typer.Option(min=1, help="Interactions simulated at a time.")] = 1,
    out: Annotated[
        Path | None, typer.Option(help="Folder of weights and card. [default: models/weights]")
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Replace the weights and the card that are there.")
    ] = False,
) -> None:
    """Train the networks that read the soft hand's bending from wrench and air pressure."""
    with one_line_errors():
        from importlib.util import find_spec

        from tqdm import tqdm

        from crossmodal.diagrams.crossmodal.training.network_training import (
            FILES,
            INTERACTIONS,
            simulate_interactions,
            train_hand_bending,
        )
        from crossmodal.diagrams.run.folder.run_folder import make_folder
        from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
        from crossmodal.models import WEIGHTS_DIR

        folder = out or WEIGHTS_DIR
        if find_spec("torch") is None:
            raise ScenarioError("train: PyTorch is not installed; pip install 'crossmodal[train]'")
        make_folder(folder)
        there = [folder / name for name in FILES if (folder / name).exists()]
        if there and not force:
            raise ScenarioError(
                f"{there[0]}: exists already; replace it with --force or choose another folder"
                " with --out"
            )
        simulated = tqdm(
            simulate_interactions(seed, jobs=jobs),
            total=INTERACTIONS,
            desc="interactions",
            disable=None,
        )
        interactions = list(simulated)
        typer.echo("Training ...")
        written, card = train_hand_bending(interactions, seed=seed, folder=folder)
        typer.echo(f"\n{card}")
        for path in written:
            typer.echo(f"  {path}")
