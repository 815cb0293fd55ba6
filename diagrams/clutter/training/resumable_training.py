"""Training of a network that may be interrupted after any epoch, and goes on there."""

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

from crossmodal.diagrams.run.folder.written_files import write_atomically


def train_epochs(
    network: Any,
    optimiser: Any,
    steps: int,
    epochs: int,
    losses_of: Callable[[int], Iterator[tuple[Any, float]]],
    checkpoint: Path | None,
) -> Iterator[float]:
    """Trains a network in one cycle of the learning rate and yields the mean loss of each epoch.

    Args:
        network: Of PyTorch.
        optimiser: Of its weights, with the largest learning rate.
        steps: In an epoch.
        epochs: How many there are, those included that a checkpoint has.
        losses_of: Gives for each step of an epoch the loss, and by how much it counts in the mean.
            The weights are changed between two steps.
        checkpoint: File from which it goes on, and that is written after each epoch.
    """
    import torch

    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, optimiser.defaults["lr"], total_steps=epochs * steps
    )
    parts = {"network": network, "optimiser": optimiser, "schedule": schedule}
    losses: list[float] = []
    if checkpoint is not None and checkpoint.is_file():
        kept = torch.load(checkpoint, weights_only=True)
        losses = kept["losses"]
        for name, part in parts.items():
            part.load_state_dict(kept[name])
    yield from losses
    for epoch in range(len(losses), epochs):
        network.train()
        total = 0.0
        for loss, share in losses_of(epoch):
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            schedule.step()
            total += share * loss.item()
        losses.append(total)
        if checkpoint is not None:
            states = {name: part.state_dict() for name, part in parts.items()}
            write_atomically(checkpoint, partial(torch.save, {**states, "losses": losses}))
        yield total
