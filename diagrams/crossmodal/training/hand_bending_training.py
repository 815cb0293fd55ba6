"""Trains the networks of `HandBending` on interactions with an object fixed to the world.

An interaction is (inputs (T, 10), labels (T, 6)): the readings that
`crossmodal.systems.proprioception.bending_network` describes, one row per tick from the first
instant of the grasp, and log X_EH. The object is fixed and held, so the bent hand stays where it
was when the grasp closed: X_EH(t) = X_WE(t)^-1 X_WE(0). Labels that do not start at zero are made
relative to their first row, and the networks learn f(u_t - u_0) - f(0), as they are used.

All networks of a run (the full one and the partial ones) are trained together as one batch.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array, Ids
from crossmodal.systems.proprioception.bending_network import BendingNetwork, Layers, mlp

Interaction = tuple[Array, Array]

ROWS_PER_INTERACTION = 80  # Neighbouring ticks are alike: more rows cost time and improve nothing.
STEPS = 1500
LEARNING_RATE = 0.01
WEIGHT_DECAY = 1e-3
LEAST_SPREAD = 0.02  # Of the partial networks, as a share of a label's size.


def relative_to_first(labels: Array) -> Array:
    """Labels log X_EH (T, 6) relative to the first of them, which becomes zero."""
    start = se3.inverse(se3.exp(labels[0]))
    return np.array([se3.log(start @ se3.exp(label)) for label in labels])


class _Data:
    """Standardised rows of all interactions, thinned; readings are relative to the first."""

    def __init__(self, interactions: Sequence[Interaction]) -> None:
        chosen = [
            np.unique(np.linspace(0, len(u) - 1, ROWS_PER_INTERACTION).astype(int))
            for u, _ in interactions
        ]
        u = np.vstack([(u - u[0])[rows] for (u, _), rows in zip(interactions, chosen, strict=True)])
        self.mean = u.mean(axis=0)
        scale = u.std(axis=0)
        self.scale = np.where(scale > 1e-9 * (1.0 + np.abs(self.mean)), scale, 1.0)
        self.v = (u - self.mean) / self.scale
        self.owner = np.repeat(np.arange(len(chosen)), [len(rows) for rows in chosen])
        self.v_reference = (-self.mean / self.scale)[None]
        self.labels = np.vstack(
            [relative_to_first(y)[rows] for (_, y), rows in zip(interactions, chosen, strict=True)]
        )
        self.label_scale = np.maximum(np.sqrt((self.labels**2).mean(axis=0)), 1e-9)
        self.weight = _linear_weight(self.v - self.v_reference, self.labels / self.label_scale)


def _linear_weight(v: Array, y: Array) -> Array:
    """Weights (6,) of the labels: one over the mean square error that a linear map leaves.

    Some directions of bending show in the readings, others hardly; in units of the labels' own
    size, the hopeless ones would rule the loss. They are limited to a hundredfold.
    """
    gram = v.T @ v + 1e-3 * len(v) * np.eye(v.shape[1])
    left = ((y - v @ np.linalg.solve(gram, v.T @ y)) ** 2).mean(axis=0)
    weight = 1.0 / np.maximum(left, 0.01)
    return np.asarray(weight / weight.mean())


def _fit(
    v: Array,
    v_reference: Array | None,
    y: Array,
    weight: Array,
    masks: Array,
    hidden: Sequence[int],
    seed: int,
    steps: int,
) -> list[Layers]:
    """Trains one perceptron per row of `masks` (B, rows) by Adam on full batches.

    With a reference, the difference of the outputs at `v` and `v_reference` is fitted to `y`.
    `weight` (n_out,) weighs the squared errors.
    """
    import torch

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    generator = torch.Generator().manual_seed(seed)
    sizes = [v.shape[1], *hidden, y.shape[1]]
    weights, biases = [], []
    for n_in, n_out in pairwise(sizes):
        start = torch.randn(1, n_in, n_out, generator=generator) / np.sqrt(n_in)
        weights.append(start.repeat(len(masks), 1, 1).requires_grad_())
        biases.append(torch.zeros(len(masks), 1, n_out).requires_grad_())

    def forward(x: Any) -> Any:
        for W, b in zip(weights[:-1], biases[:-1], strict=True):
            x = torch.tanh(torch.matmul(x, W) + b)
        return torch.matmul(x, weights[-1]) + biases[-1]

    inputs = torch.as_tensor(v, dtype=torch.float32)
    reference = None if v_reference is None else torch.as_tensor(v_reference, dtype=torch.float32)
    target = torch.as_tensor(y, dtype=torch.float32)
    scale = torch.as_tensor(weight, dtype=torch.float32)
    share = torch.as_tensor(masks / masks.sum(axis=1, keepdims=True), dtype=torch.float32)
    optimiser = torch.optim.Adam([*weights, *biases], lr=LEARNING_RATE)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    for _ in range(steps):
        optimiser.zero_grad()
        output = forward(inputs) if reference is None else forward(inputs) - forward(reference)
        loss = (share * (scale * (output - target) ** 2).sum(dim=-1)).sum()
        loss = loss + WEIGHT_DECAY * sum((W**2).sum() for W in weights)
        loss.backward()
        optimiser.step()
        schedule.step()
    torch.set_num_threads(threads)
    trained = [
        (W.detach().numpy().astype(float), b.detach().numpy().astype(float))
        for W, b in zip(weights, biases, strict=True)
    ]
    return [[(W[k].T, b[k, 0]) for W, b in trained] for k in range(len(masks))]


def _difference(layers: Layers, data: _Data) -> Array:
    """What a network says about every row, relative to the row's reference, (rows, 6)."""
    return data.label_scale * (mlp(layers, data.v) - mlp(layers, data.v_reference))


def error_summary(errors: Array, owner: Ids) -> dict[str, float]:
    """Root mean square and worst interaction of bending errors (rows, 6), [deg] and [mm]."""
    rotation = np.rad2deg(1.0) * np.linalg.norm(errors[:, :3], axis=1)
    translation = 1e3 * np.linalg.norm(errors[:, 3:], axis=1)

    def rms(values: Array) -> float:
        return float(np.sqrt((values**2).mean()))

    return {
        "rotation_rms_deg": rms(rotation),
        "translation_rms_mm": rms(translation),
        "worst_rotation_rms_deg": max(rms(rotation[owner == i]) for i in np.unique(owner)),
        "worst_translation_rms_mm": max(rms(translation[owner == i]) for i in np.unique(owner)),
    }


def _pairs(count: int, seed: int) -> list[tuple[int, int]]:
    """Groups of two interactions to leave out; every interaction is in two groups."""
    order = np.random.default_rng(seed).permutation(count)
    return [(int(order[i]), int(order[(i + 1) % count])) for i in range(count)]


def train(
    interactions: Sequence[Interaction],
    seed: int = 0,
    hidden: Sequence[int] = (10, 10, 10),
    command: str = "crossmodal train hand-bending",
    steps: int = STEPS,
) -> tuple[BendingNetwork, dict[str, Any]]:
    """Trains both networks.

    MLPR1 learns from all interactions; partial networks, each without two of them, give the spread
    that MLPR2 learns (Martín-Martín and Brock 2017, section IV-B). A partial network's errors on
    its own two interactions are errors on unseen data: they make the card, and they scale MLPR2,
    because networks that share most of their data agree better with each other than with the truth.

    Returns:
        The networks, and the card: data, split, metric, command and errors.
    """
    data = _Data(interactions)
    pairs = _pairs(len(interactions), seed)
    held_out = [np.isin(data.owner, pair) for pair in pairs]
    masks = np.vstack([np.ones(len(data.owner)), *(~rows for rows in held_out)])
    target = data.labels / data.label_scale
    fitted = _fit(data.v, data.v_reference, target, data.weight, masks, hidden, seed, steps)
    full = _difference(fitted[0], data)
    partial = np.array([_difference(layers, data) for layers in fitted[1:]])
    # MLPR2 learns the logarithm of the spread of the partial networks about the full one.
    spread = np.sqrt(((partial - full) ** 2).mean(axis=0)) / data.label_scale
    log_spread = np.log(np.maximum(spread, LEAST_SPREAD))
    deviation = _fit(data.v, None, log_spread, np.ones(6), masks[:1], hidden, seed + 1, steps)[0]
    sigma = data.label_scale * np.exp(mlp(deviation, data.v))
    unseen = np.vstack([(y - data.labels)[rows] for y, rows in zip(partial, held_out, strict=True)])
    labels, sigma, owner = (
        np.concatenate([values[rows] for rows in held_out])
        for values in (data.labels, sigma, data.owner)
    )
    factor = np.sqrt(((unseen / sigma) ** 2).mean(axis=0))
    network = BendingNetwork(
        input_mean=data.mean,
        input_scale=data.scale,
        input_low=data.v.min(axis=0),
        input_high=data.v.max(axis=0),
        pose_layers=fitted[0],
        pose_scale=data.label_scale,
        deviation_layers=deviation,
        deviation_scale=data.label_scale,
        deviation_factor=factor,
    )
    card = {
        "data": f"{len(interactions)} simulated interactions with an object fixed to the world, "
        f"{sum(len(u) for u, _ in interactions)} ticks",
        "split": f"{len(pairs)} partial networks, each tested on the two interactions left out",
        "metric": "norm of the error of log X_EH since the grasp, root mean square over ticks",
        "command": command,
        "seed": seed,
        "hidden": [int(width) for width in hidden],
        "unseen": error_summary(unseen, owner),
        "no_bending": error_summary(labels, owner),
        "seen": error_summary(full - data.labels, data.owner),
        "deviation_factor": [float(value) for value in factor],
        "unseen_within_2_sigma": float((np.abs(unseen) < 2.0 * sigma * factor).mean()),
    }
    return network, card
