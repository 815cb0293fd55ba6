"""`crossmodal train`, with one command for each network."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from crossmodal.diagrams.commands.endings import one_line_errors

EXAMPLES = "Example:  crossmodal train hand-bending --jobs 2 --out runs/weights"
SEGMENTATION_EXAMPLES = "Example:  crossmodal train segmentation --jobs 2 --out runs/weights"
GRASP_EXAMPLES = "Example:  crossmodal train grasp --jobs 2 --out runs/weights"

_JOBS = typer.Option(min=1, help="Cores that are free; with more, training mostly waits.")
_SEED = typer.Option(min=0, help="Of data and weights.")
_OUT = typer.Option(help="Folder of weights and card. [default: models/weights]")
_FORCE = typer.Option("--force", help="Replace the weights and the card that are there.")


def train_hand_bending_command(
    seed: Annotated[int, _SEED] = 0,
    jobs: Annotated[int, typer.Option(min=1, help="Interactions simulated at a time.")] = 1,
    out: Annotated[Path | None, _OUT] = None,
    force: Annotated[bool, _FORCE] = False,
) -> None:
    """Train the networks that read the soft hand's bending from wrench and air pressure."""
    with one_line_errors():
        from tqdm import tqdm

        from crossmodal.diagrams.crossmodal.training.network_training import (
            FILES,
            INTERACTIONS,
            simulate_interactions,
            train_hand_bending,
        )

        folder = _folder(out, FILES, force)
        simulated = tqdm(
            simulate_interactions(seed, jobs=jobs),
            total=INTERACTIONS,
            desc="interactions",
            disable=None,
        )
        interactions = list(simulated)
        typer.echo("Training ...")
        _tell(*train_hand_bending(interactions, seed=seed, folder=folder))


def train_segmentation_command(
    seed: Annotated[int, _SEED] = 0,
    jobs: Annotated[int, _JOBS] = 1,
    scenes: Annotated[
        int, typer.Option(min=40, help="Scenes, of six images each, or 18 of dense clutter.")
    ] = 320,
    epochs: Annotated[int, typer.Option(min=1, help="How often each image is learned from.")] = 24,
    data: Annotated[
        Path, typer.Option(help="Folder of the images and of how far it got: it goes on there.")
    ] = Path("runs/segmentation"),
    out: Annotated[Path | None, _OUT] = None,
    force: Annotated[bool, _FORCE] = False,
) -> None:
    """Train the network that says which object each pixel of an image shows."""
    with one_line_errors():
        from tqdm import tqdm

        from crossmodal.diagrams.clutter.training.segmentation_data import (
            is_held_out,
            read_scenes,
            write_scenes,
        )
        from crossmodal.diagrams.clutter.training.segmentation_training import (
            FILES,
            train,
            write_segmentation,
        )
        from crossmodal.diagrams.run.folder.run_folder import make_folder

        folder = _folder(out, FILES, force)
        # It imports PyTorch.
        from crossmodal.diagrams.clutter.training.segmentation_network import make_network

        make_folder(data)
        for _ in tqdm(
            write_scenes(data, seed, scenes, jobs), total=scenes, desc="scenes", disable=None
        ):
            pass
        images = read_scenes(data, seed, scenes)
        seen = images[~is_held_out(images.scene)]
        checkpoint = data / f"segmentation-{seed}-{scenes}-{epochs}.pt"
        network = make_network(seed)
        losses = train(network, seen, seed, epochs, checkpoint, jobs)
        progress = tqdm(losses, total=epochs, desc="epochs", disable=None)
        for loss in progress:
            progress.set_postfix(loss=f"{loss:.3f}")
        _tell(*write_segmentation(network, images, folder, seed, scenes, epochs))


def train_grasp_command(
    seed: Annotated[int, _SEED] = 0,
    jobs: Annotated[int, _JOBS] = 1,
    files: Annotated[int, typer.Option(min=8, help="Files of data, of 25 scenes each.")] = 80,
    epochs: Annotated[int, typer.Option(min=1, help="How often each view is learned from.")] = 16,
    data: Annotated[
        Path, typer.Option(help="Folder of the views and of how far it got: it goes on there.")
    ] = Path("runs/grasp"),
    out: Annotated[Path | None, _OUT] = None,
    force: Annotated[bool, _FORCE] = False,
) -> None:
    """Train the network that says where and how well objects can be grasped from above."""
    with one_line_errors():
        from tqdm import tqdm

        from crossmodal.diagrams.clutter.training.grasp_network_training import (
            FILES,
            load_views,
            make_data,
            seen_files,
            write_grasp,
        )
        from crossmodal.diagrams.clutter.training.grasp_training import make_network, train
        from crossmodal.diagrams.run.folder.run_folder import make_folder

        folder = _folder(out, FILES, force)
        make_folder(data)
        made = tqdm(make_data(data, files, seed, jobs), total=files, desc="files", disable=None)
        views = [view for path in seen_files(list(made)) for view in load_views(path)]
        checkpoint = data / f"grasp-{seed}-{files}-{epochs}.pt"
        network = make_network(seed)
        progress = tqdm(
            train(network, views, seed, epochs, checkpoint, jobs),
            total=epochs,
            desc="epochs",
            disable=None,
        )
        for loss in progress:
            progress.set_postfix(loss=f"{loss:.4f}")
        typer.echo("Testing ...")
        _tell(*write_grasp(network, folder, seed, files, epochs, len(views)))


def _folder(out: Path | None, files: Sequence[str], force: bool) -> Path:
    """The folder for weights and card, where they may be written."""
    from importlib.util import find_spec

    from crossmodal.diagrams.run.folder.run_folder import make_folder
    from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
    from crossmodal.models import WEIGHTS_DIR

    folder = out or WEIGHTS_DIR
    if find_spec("torch") is None:
        raise ScenarioError(
            "train: PyTorch is not installed; .venv/bin/pip install --editable '.[train]'"
        )
    make_folder(folder)
    there = [folder / name for name in files if (folder / name).exists()]
    if there and not force:
        raise ScenarioError(
            f"{there[0]}: exists already; replace it with --force or choose another folder"
            " with --out"
        )
    return folder


def _tell(written: Sequence[Path], card: str) -> None:
    typer.echo(f"\n{card}")
    for path in written:
        typer.echo(f"  {path}")
