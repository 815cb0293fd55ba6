"""How well q can be known at all in the fast motions of `joint_robustness`: Cramér-Rao bounds.

    python -m benchmarks.configuration_bound

The bound at each frame is that of one who has seen the frames up to it and knows the joint's type,
the noise, the axis to within the filters' priors, and when the motion begins and ends. "Even rate":
also that the body rests before and after it and that its rate is even in between; "rests": only
that it rests; "even rates": only that each of the three rates is even. Root mean square over all
frames after 2 s and over seeds, against one raw frame's noise, as q in `joint_robustness`.
"""

from itertools import pairwise
from typing import Annotated

import numpy as np
import typer

from benchmarks.joint_robustness import SETTLING
from benchmarks.robustness_streams import Case, all_cases, simulate_case
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.vectors import normal_basis
from crossmodal.systems.kinematics.joint_filters import JointFiltersConfig
from crossmodal.systems.kinematics.solver.joint_models import AXIS_SPREAD

CASES = ("door, 90 deg in 1 s", "drawer, 0.3 m in 0.5 s")
_STEP = 1e-6


def _jacobians(case: Case, seed: int) -> tuple[Array, Array]:
    """Of the poses by reference pose, axis and its place (N, 6, n), and by q (N, 6)."""
    stream = simulate_case(case, seed)
    X0, B = stream.X_PB[0], normal_basis(stream.axis_P)
    turns = case.joint == "revolute"

    def pose(d: Array, q: float) -> Array:
        axis = stream.axis_P + d[6:8] @ B
        axis /= np.linalg.norm(axis)
        X = np.eye(4)
        if turns:
            point = stream.p_PA + d[8:10] @ B
            X = se3.exp(q * np.concatenate([axis, np.cross(point, axis)]))
        else:
            X[:3, 3] = q * axis
        return X @ X0 @ se3.exp(d[:6])

    n = 10 if turns else 8
    J, Jq, still = (
        np.empty((stream.times.size, 6, n)),
        np.empty((stream.times.size, 6)),
        np.zeros(n),
    )
    for k, q in enumerate(stream.configuration):
        back = se3.inverse(pose(still, q))
        for i in range(n):
            d = _STEP * np.eye(n)[i]
            J[k, :, i] = se3.log(back @ pose(d, q)) - se3.log(back @ pose(-d, q))
        Jq[k] = se3.log(back @ pose(still, q + _STEP)) - se3.log(back @ pose(still, q - _STEP))
    return J / (2.0 * _STEP), Jq / (2.0 * _STEP)


def motion_bases(q: Array) -> dict[str, Array]:
    """Sets of motions (N, m) of which q (N,) is one, zero at first: see the module."""
    last = int(np.argmax(q == q[-1]))
    first = int(np.argmax(q > 0.0))
    rests = np.zeros((q.size, last - first + 1))
    for k in range(first, q.size):
        rests[k, min(k, last) - first] = 1.0
    frame, knots = np.arange(float(q.size)), (0, first - 1, last, q.size)
    slopes = [np.clip(frame - a, 0.0, b - a) for a, b in pairwise(knots)]
    return {
        "even rate": (q / q[-1])[:, None],
        "rests": rests,
        "even rates": np.column_stack(slopes),
    }


def bound(case: Case, seed: int, basis: Array, config: JointFiltersConfig) -> Array:
    """Least standard deviation (N,) of q at each frame, along the path, [m]."""
    J, Jq = _jacobians(case, seed)
    n, m = J.shape[2], basis.shape[1]
    W = np.diag(1.0 / np.repeat([case.rotation_noise**2, case.translation_noise**2], 3))
    prior = [0.0] * 6 + [AXIS_SPREAD**-2] * 2 + [config.axis_distance**-2] * (n - 8) + [1e-9] * m
    information, sigma = np.diag(prior), np.zeros(len(J))
    for k in range(len(J)):
        rows = np.column_stack([J[k], np.outer(Jq[k], basis[k])])
        information = information + rows.T @ W @ rows
        direction = np.concatenate([np.zeros(n), basis[k]])
        sigma[k] = np.sqrt(direction @ np.linalg.lstsq(information, direction, rcond=None)[0])
    return sigma * (case.radius if case.joint == "revolute" else 1.0)


def main(
    seeds: Annotated[int, typer.Option(min=1, help="Streams of each kind.")] = 10,
    first_seed: Annotated[int, typer.Option(help="The first seed.")] = 0,
) -> None:
    """Prints a line per motion."""
    config = JointFiltersConfig()
    print("| motion | known | q / raw | first half of it | second half | at rest after it |")
    print("|---|---|---|---|---|---|")
    for case in (c for c in all_cases() if c.name in CASES):
        times = simulate_case(case, first_seed).times
        q = case.motion(times)
        moves = np.flatnonzero((q > 0.0) & (q < q[-1]))
        half = moves[: moves.size // 2], moves[moves.size // 2 :]
        parts = (times >= SETTLING, *half, np.arange(moves[-1] + 1, times.size))
        for name, basis in motion_bases(q).items():
            squares = [
                bound(case, s, basis, config) ** 2 for s in range(first_seed, first_seed + seeds)
            ]
            mean = np.mean(squares, axis=0) / case.translation_noise**2
            cells = " | ".join(f"{np.sqrt(mean[part].mean()):.2f}" for part in parts)
            print(f"| {case.name} | {name} | {cells} |")


if __name__ == "__main__":
    typer.run(main)
