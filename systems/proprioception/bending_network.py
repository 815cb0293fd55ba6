"""The two small networks that read the hand's bending from wrench and pressures, in NumPy.

Inputs u (10,): the load that the object puts on the hand, in the wrist sensor's frame S without
the hand's weight, torque [N m] then force [N]; then four chamber pressures, gauge [Pa]. Closing the
hand already loads it, and sensors have biases, so both networks see how the reading has changed
since the first instant of the grasp, u - u_0: the preload and the biases cancel, and
log X_EH = f(u - u_0) - f(0) is zero there by construction. The networks are trained in the same way
(`diagrams/crossmodal/training/hand_bending_training.py`).
"""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from crossmodal.maths.arrays import Array

Layers = list[tuple[Array, Array]]

INPUTS = 10


@dataclass(kw_only=True)
class BendingNetwork:
    """Weights and standardisation of both networks.

    Attributes:
        input_mean: (10,), with input_scale (10,): v = (u - u_0 - mean) / scale
            enters the networks.
        input_low: (10,), with input_high (10,): the range of v in training; v is clipped to it.
        pose_layers: (W (n_out, n_in), b (n_out,)) of MLPR1, tanh between layers.
        pose_scale: (6,) of MLPR1's outputs, [rad, m].
        deviation_layers: The same of MLPR2, whose outputs are logarithms.
        deviation_scale: (6,) of exp(output), [rad, m].
        deviation_factor: (6,) from the spread of partial networks to the error on unseen data.
    """

    input_mean: Array
    input_scale: Array
    input_low: Array
    input_high: Array
    pose_layers: Layers
    pose_scale: Array
    deviation_layers: Layers
    deviation_scale: Array
    deviation_factor: Array


def mlp(layers: Layers, v: Array) -> Array:
    """Outputs (..., n_out) of a perceptron with tanh units for inputs (..., n_in)."""
    for W, b in layers[:-1]:
        v = np.tanh(v @ W.T + b)
    W, b = layers[-1]
    return v @ W.T + b


def mlp_jacobian(layers: Layers, v: Array) -> Array:
    """Derivative (n_out, n_in) of `mlp` at one input (n_in,)."""
    J = np.eye(v.size)
    for W, b in layers[:-1]:
        v = np.tanh(W @ v + b)
        J = (1.0 - v**2)[:, None] * (W @ J)
    return layers[-1][0] @ J


def standardise(network: BendingNetwork, change: Array) -> tuple[Array, Array]:
    """Changes of the reading (..., 10) within the training range, and how far outside (...,)."""
    v = (change - network.input_mean) / network.input_scale
    inside = np.clip(v, network.input_low, network.input_high)
    return inside, np.abs(v - inside).sum(axis=-1)


def predict_bending(network: BendingNetwork, u: Array, u_reference: Array) -> Array:
    """log X_EH (..., 6), [rad, m], at readings u (..., 10) after the reference (10,)."""
    v, _ = standardise(network, u - u_reference)
    v_none, _ = standardise(network, np.zeros(INPUTS))
    return network.pose_scale * (mlp(network.pose_layers, v) - mlp(network.pose_layers, v_none))


def predict_deviation(network: BendingNetwork, u: Array, u_reference: Array) -> Array:
    """Standard deviation (..., 6) of `predict_bending`; grows outside the training range."""
    v, outside = standardise(network, u - u_reference)
    spread = network.deviation_scale * np.exp(mlp(network.deviation_layers, v))
    return network.deviation_factor * spread * (1.0 + outside[..., None])


def bending_jacobian(network: BendingNetwork, u: Array, u_reference: Array) -> Array:
    """Derivative (6, 10) of log X_EH with respect to the reading u (10,)."""
    v, _ = standardise(network, u - u_reference)
    J = mlp_jacobian(network.pose_layers, v)
    return network.pose_scale[:, None] * J / network.input_scale


def save_network(path: Path, network: BendingNetwork) -> None:
    """Writes plain arrays into an npz file."""
    arrays: dict[str, Any] = {}
    for field in fields(network):
        value = getattr(network, field.name)
        if isinstance(value, list):
            for i, (W, b) in enumerate(value):
                arrays[f"{field.name}_{i}_W"], arrays[f"{field.name}_{i}_b"] = W, b
        else:
            arrays[field.name] = value
    np.savez(path, **arrays)


def load_network(path: Path) -> BendingNetwork:
    """Reads what `save_network` wrote."""
    if not path.is_file():
        raise ValueError(
            f"HandBending: no weights at {path}; `crossmodal train hand-bending` makes them"
        )
    with np.load(path) as file:
        arrays = {name: np.asarray(file[name], dtype=float) for name in file}

    def layers(name: str) -> Layers:
        depth = sum(key.startswith(name) and key.endswith("_W") for key in arrays)
        return [(arrays[f"{name}_{i}_W"], arrays[f"{name}_{i}_b"]) for i in range(depth)]

    names = [field.name for field in fields(BendingNetwork)]
    values = {n: layers(n) if n.endswith("_layers") else arrays.get(n) for n in names}
    missing = {name for name, value in values.items() if value is None}
    if missing or np.shape(arrays["input_mean"]) != (INPUTS,):
        raise ValueError(
            f"HandBending: {path} does not hold the networks; missing {missing or '{}'}"
        )
    return BendingNetwork(**values)  # type: ignore[arg-type]
