"""Trains the segmentation network, scores it on scenes that it has not seen, and writes it."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import numpy.typing as npt

from crossmodal.diagrams.clutter.training.resumable_training import train_epochs
from crossmodal.diagrams.clutter.training.segmentation_data import Images, is_dense, is_held_out
from crossmodal.diagrams.drawing.table import Table
from crossmodal.diagrams.evaluation.campaign_report import made_by
from crossmodal.diagrams.run.folder.written_files import write_atomically, write_text
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array, Ids
from crossmodal.systems.onnx_network import OnnxNetwork
from crossmodal.systems.segmentation.network_input import (
    CLASSES,
    SHAPE,
    TRANSPARENT,
    network_input,
)
from crossmodal.systems.segmentation.objects import class_probabilities
from crossmodal.systems.sensors.randomness import make_generator

if TYPE_CHECKING:
    from crossmodal.diagrams.clutter.training.segmentation_network import SegmentationNetwork

FILES = ("segmentation.onnx", "segmentation.md")  # Weights and card.
_BATCH = 8
_RATE = 4e-3  # Largest learning rate.
_DECAY = 1e-2
_CROP = 160, 224  # Height and width of what is learned from at a time: half of an image.
_IGNORED = 255  # A label that nothing is learned from.
# Standard deviations of what is wrong with the believed pose of the camera and the table's height.
_ROTATION, _TRANSLATION = np.deg2rad(0.5), 5e-3  # [rad], [m]
_ROBOT = 0.3  # Share of images in which a robot hides something.
_TEXTURED = 0.3  # Share of images in which things are not of one colour.


def sample(
    images: Images, index: int, rng: np.random.Generator
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.uint8]]:
    """A part of an image as the network sees it, with faults by lot, and its labels."""
    colour, labels = (
        _retouched(images.colour[index], images.labels[index], rng),
        images.labels[index],
    )
    masked = _robot(rng) if rng.random() < _ROBOT else None
    wrong = rng.normal(scale=np.repeat([_ROTATION, _TRANSLATION], 3))
    X_WC = images.X_WC[index] @ se3.exp(wrong)
    depth = images.depth[index].astype(float)
    x = network_input(colour, depth, masked, images.intrinsics(index), X_WC, 0.0)
    if masked is not None:
        labels = np.where(masked, np.uint8(_IGNORED), labels)
    v, u = (int(rng.integers(all - part + 1)) for all, part in zip(SHAPE[1:], _CROP, strict=True))
    part = slice(v, v + _CROP[0]), slice(u, u + _CROP[1])
    x, labels = x[:, *part], labels[part]
    return (x[:, :, ::-1], labels[:, ::-1]) if rng.random() < 0.5 else (x, labels)


def _retouched(
    colour: npt.NDArray[np.uint8], labels: npt.NDArray[np.uint8], rng: np.random.Generator
) -> npt.NDArray[np.uint8]:
    """In another light, and some things with patches of other colours."""
    gain = np.exp(rng.normal(scale=0.15) + rng.normal(scale=0.05, size=3))
    changed = (colour / 255.0) ** np.exp(rng.normal(scale=0.15)) * gain
    if rng.random() < _TEXTURED:
        coarse = rng.normal(scale=0.15, size=(*rng.integers(4, 40, 2), 3))
        patches = cv2.resize(coarse, colour.shape[1::-1], interpolation=cv2.INTER_LINEAR)
        chosen = rng.random(len(CLASSES)) < 0.4
        changed = np.where(chosen[labels][..., None], changed + patches, changed)
    return np.asarray(255.0 * np.clip(changed, 0.0, 1.0), np.uint8)


def _robot(rng: np.random.Generator) -> npt.NDArray[np.bool_]:
    """The mask of an arm that comes into the image from somewhere."""
    height, width = SHAPE[1:]
    mask = np.zeros((height, width), np.uint8)
    start, end = (rng.uniform([0.0, 0.0], [width, height]) for _ in range(2))
    away = start + 400.0 * (start - end) / max(float(np.linalg.norm(start - end)), 1.0)
    thick = int(rng.integers(10, 60))
    cv2.line(mask, [int(c) for c in start], [int(c) for c in away], 1, thick)
    return mask.astype(bool)


def train(
    network: "SegmentationNetwork",
    images: Images,
    seed: int,
    epochs: int,
    checkpoint: Path | None = None,
    jobs: int = 1,
    batch: int = _BATCH,
) -> Iterator[float]:
    """Trains a network and yields the mean loss of each epoch.

    Args:
        network: As `make_network` gives it.
        images: To learn from.
        seed: Of the order of the images and of what is done to them.
        epochs: How often each image is seen.
        checkpoint: File from which it goes on, and that is written after each epoch.
        jobs: Cores.
        batch: How many images make one step.
    """
    import torch
    from torch.nn.functional import cross_entropy, interpolate

    torch.set_num_threads(jobs)
    steps = len(images.colour) // batch
    weights = torch.tensor(_class_weights(images.labels), dtype=torch.float32)

    def losses_of(epoch: int) -> Iterator[tuple[Any, float]]:
        rng = make_generator(seed, "segmentation training", epoch)
        order = rng.permutation(len(images.colour))[: steps * batch].reshape(steps, batch)
        for chosen in order:
            made = [sample(images, int(index), rng) for index in chosen]
            x, labels = (torch.from_numpy(np.stack(part)) for part in zip(*made, strict=True))
            logits = network(x.to(memory_format=torch.channels_last))
            logits = interpolate(logits, scale_factor=2.0, mode="bilinear")
            loss = cross_entropy(logits, labels.long(), weights, ignore_index=_IGNORED)
            yield loss, 1.0 / steps

    optimiser = torch.optim.AdamW(network.parameters(), _RATE, weight_decay=_DECAY)
    yield from train_epochs(network, optimiser, steps, epochs, losses_of, checkpoint)


def _class_weights(labels: npt.NDArray[np.uint8]) -> Array:
    """Of the loss: what is rare counts more, by the fourth root: more would widen what is thin."""
    share = np.bincount(labels.ravel(), minlength=len(CLASSES)) / labels.size
    weights = np.maximum(share, 1e-3) ** -0.25
    return np.asarray(weights / weights.mean())


def confusion(network: OnnxNetwork, images: Images) -> Ids:
    """How many pixels of each class (rows) are taken for which one (columns), (14, 14)."""
    size = len(CLASSES)
    counts = np.zeros((size, size), np.int64)
    for k, labels in enumerate(images.labels):
        depth, camera = images.depth[k].astype(float), images.intrinsics(k)
        x = network_input(images.colour[k], depth, None, camera, images.X_WC[k], 0.0)
        seen = class_probabilities(network, x).argmax(axis=0)
        counts += np.bincount(size * labels.ravel() + seen.ravel(), minlength=size**2).reshape(
            size, size
        )
    return counts


def class_ious(counts: Ids) -> Array:
    """IoU of each class (14,) by `confusion`; NaN for a class that no image shows."""
    shown = counts.sum(axis=1)
    union = counts.sum(axis=0) + shown - counts.diagonal()
    return np.where(shown > 0, counts.diagonal() / np.maximum(union, 1), np.nan)


def mean_ious(ious: Array) -> tuple[float, float]:
    """Of the opaque goods, and of the transparent ones."""
    goods = CLASSES[1:-1]
    values = dict(zip(CLASSES, ious, strict=True))
    opaque = [values[name] for name in goods if name not in TRANSPARENT]
    return float(np.nanmean(opaque)), float(np.nanmean([values[name] for name in TRANSPARENT]))


def write_segmentation(
    network: "SegmentationNetwork",
    images: Images,
    folder: Path,
    seed: int,
    scenes: int,
    epochs: int,
) -> tuple[list[Path], str]:
    """Writes weights and card; returns the files and the card.

    Args:
        network: Trained.
        images: All, also those that it learned from.
        folder: That is there.
        seed: Of data and weights.
        scenes: How many scenes there are.
        epochs: How long it was trained.
    """
    from crossmodal.diagrams.clutter.training.segmentation_network import export

    weights = write_atomically(folder / FILES[0], lambda path: export(network, path))
    unseen = images[is_held_out(images.scene)]
    card = _card(OnnxNetwork(weights, SHAPE), unseen, len(images.scene), seed, scenes, epochs)
    return [weights, write_text(folder / FILES[1], card)], card


def _card(
    network: OnnxNetwork, unseen: Images, images: int, seed: int, scenes: int, epochs: int
) -> str:
    dense = is_dense(unseen.scene)
    ious = {
        "dense clutter": class_ious(confusion(network, unseen[dense])),
        "dropped, with unknown shapes": class_ious(confusion(network, unseen[~dense])),
    }
    rows: list[list[Any]] = [
        [name, *("" if np.isnan(value) else f"{value:.2f}" for value in values)]
        for name, *values in zip(CLASSES, *ious.values(), strict=True)
    ]
    for k, kind in enumerate(("opaque", "transparent")):
        means = (mean_ious(values)[k] for values in ious.values())
        rows.append([f"mean, {kind} goods", *(f"{value:.3f}" for value in means)])
    table = Table(header=["IoU of class", *ious])
    table.rows = rows
    command = made_by(
        f"crossmodal train segmentation --seed {seed} --scenes {scenes} --epochs {epochs}"
    )
    lines = [
        "# Semantic segmentation of goods on a table",
        "",
        f"- data: {images} rendered images of {scenes} scenes, with light, colours, camera and the"
        " camera's faults by lot",
        f"- split: {len(np.unique(unseen.scene))} scenes with {len(unseen.scene)} images are held"
        f" out, {int(dense.sum())} images of them of dense clutter",
        "- metric: intersection over union of each class, over all pixels of the held-out images",
        f"- epochs: {epochs}",
        f"- command: {command}",
        "",
    ]
    return "\n".join([*lines, table.markdown(), ""])
