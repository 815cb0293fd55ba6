"""Trains the grasp network on views of objects and writes it as an ONNX file."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from crossmodal.diagrams.clutter.training.resumable_training import train_epochs
from crossmodal.maths.arrays import Array, Ids
from crossmodal.models.gripper_taxels import WIDTH
from crossmodal.systems.grasping.grasp_network import WIDTH_SCALE, network_input
from crossmodal.systems.grasping.height_map import CELL, CELLS
from crossmodal.systems.sensors.randomness import make_generator

LEARNING_RATE, BATCH = 2e-3, 16
# Of the part around a grasp's place in which it is as good: along and across the opening, [m].
_PAINTED = (0.012, 0.5 * WIDTH)
_UPRIGHT = 0.05  # By which angles near zero are liked better: of a round thing, one is right.


@dataclass(kw_only=True)
class View:
    """What the network learns from.

    Attributes:
        heights: (CELLS, CELLS), [m].
        grasps: (N, 4): column and row [cells], angle [rad], width [m].
        liking: Of each (N,).
    """

    heights: Array
    grasps: Array
    liking: Array


def make_network(seed: int) -> Any:
    """GG-CNN that has learned nothing yet: (N, 1, CELLS, CELLS) to (N, 4, CELLS, CELLS).

    Its four heads are the four channels of one convolution. What is turned up again is as wide as
    on the way down: 150, 50, 25, 13 cells.
    """
    import torch
    from torch import nn

    torch.manual_seed(seed)

    def up(n_in: int, n_out: int, kernel: int, stride: int, padding: int, rest: int) -> Any:
        return nn.ConvTranspose2d(n_in, n_out, kernel, stride, padding, rest)

    layers = [
        nn.Conv2d(1, 32, 9, 3, 3),
        nn.Conv2d(32, 16, 5, 2, 2),
        nn.Conv2d(16, 8, 3, 2, 1),
        up(8, 8, 3, 2, 1, 0),
        up(8, 16, 5, 2, 2, 1),
        up(16, 32, 9, 3, 3, 1),
    ]
    rectified = [part for layer in layers for part in (layer, nn.ReLU())]
    network: Any = nn.Sequential(*rectified, nn.Conv2d(32, 4, 2))
    return network.to(memory_format=torch.channels_last)


def turned(view: View, angle: float, mirrored: bool) -> View:
    """A view turned about the map's middle, and mirrored before."""
    middle = 0.5 * (CELLS - 1)
    c, s = np.cos(angle), np.sin(angle)
    A = np.array([[c, -s], [s, c]]) @ np.diag([-1.0 if mirrored else 1.0, 1.0])
    moved = np.column_stack([A, middle - A @ [middle, middle]])
    heights = cv2.warpAffine(view.heights, moved, (CELLS, CELLS), flags=cv2.INTER_NEAREST)
    grasps = view.grasps.copy()
    grasps[:, :2] = grasps[:, :2] @ A.T + moved[:, 2]
    grasps[:, 2] = angle + (np.pi - grasps[:, 2] if mirrored else grasps[:, 2])
    return View(heights=heights, grasps=grasps, liking=view.liking)


def targets(view: View) -> Array:
    """Quality, cos and sin of twice the angle, and width (4, CELLS, CELLS).

    Where several grasps are as good, the one that is liked best counts.
    """
    angle = (view.grasps[:, 2] + 0.5 * np.pi) % np.pi - 0.5 * np.pi
    along, across = 0.5 * np.array(_PAINTED) / CELL
    corners = np.array([[-along, -across], [along, -across], [along, across], [-along, across]])
    best = np.zeros((CELLS, CELLS), np.int32)  # Which grasp counts, from one on.
    for k in np.argsort(view.liking - _UPRIGHT * np.abs(angle), kind="stable"):
        c, s = np.cos(angle[k]), np.sin(angle[k])
        outline = np.round(corners @ [[c, s], [-s, c]] + view.grasps[k, :2]).astype(np.int32)
        cv2.fillConvexPoly(best, outline, int(k) + 1)
    of_each = np.column_stack(
        [
            np.ones(len(angle)),
            np.cos(2.0 * angle),
            np.sin(2.0 * angle),
            view.grasps[:, 3] / WIDTH_SCALE,
        ]
    )
    of_each = np.concatenate([np.zeros((1, 4)), of_each]).astype(np.float32)
    return np.moveaxis(of_each[best], -1, 0)


def loss_of(output: Any, target: Any) -> Any:
    """Mean square errors: of the quality everywhere, of the others where there are grasps.

    Args:
        output: Of the network (N, 4, CELLS, CELLS).
        target: See `targets` (N, 4, CELLS, CELLS).
    """
    square = (output - target) ** 2
    there = target[:, :1]
    return square[:, 0].mean() + (there * square[:, 1:]).sum(dim=1).mean()


def train(
    network: Any,
    views: Sequence[View],
    seed: int,
    epochs: int,
    checkpoint: Path | None = None,
    jobs: int = 1,
    batch: int = BATCH,
) -> Iterator[float]:
    """Trains a network and yields the mean loss of each epoch; views are turned anew each time.

    Args:
        network: As `make_network` gives it.
        views: To learn from.
        seed: Of the order of the views and of how they are turned.
        epochs: How often each view is seen.
        checkpoint: File from which it goes on, and that is written after each epoch.
        jobs: Cores.
        batch: How many views make one step.
    """
    import torch

    torch.set_num_threads(jobs)

    def losses_of(epoch: int) -> Iterator[tuple[Any, float]]:
        rng = make_generator(seed, "grasp training", epoch)
        order = rng.permutation(len(views))
        for start in range(0, len(order), batch):
            x, y = _batch(views, order[start : start + batch], rng)
            loss = loss_of(network(torch.as_tensor(x)), torch.as_tensor(y))
            yield loss, len(x) / len(views)

    optimiser = torch.optim.Adam(network.parameters(), LEARNING_RATE)
    steps = -(-len(views) // batch)
    yield from train_epochs(network, optimiser, steps, epochs, losses_of, checkpoint)


def _batch(views: Sequence[View], chosen: Ids, rng: np.random.Generator) -> tuple[Array, Array]:
    pairs = []
    for k in chosen:
        view = turned(views[k], rng.uniform(-np.pi, np.pi), bool(rng.random() < 0.5))
        pairs.append((network_input(view.heights), targets(view)))
    return np.stack([x for x, _ in pairs]), np.stack([y for _, y in pairs])


def export(network: Any, path: Path) -> None:
    """Writes the network as an ONNX file."""
    import torch

    x = torch.zeros(1, 1, CELLS, CELLS)
    torch.onnx.export(network.eval(), (x,), str(path), opset_version=17, dynamo=False)
