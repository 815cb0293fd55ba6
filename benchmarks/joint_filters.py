"""Joint filters on the nine synthetic streams, beside OMIP's figures and the batch limit.

    python -m benchmarks.joint_filters --seeds 20

Errors are those at the last frame, medians over seeds, p90 behind the slash, followed by their
ratios to OMIP's and to the batch fit's medians. OMIP's are those of its better column, with the
reference frame moved to the body's start; ours is the sensor's. NEES columns are the shares of all
frames after the first inside the two-sided 95 % bounds. A time is that of one update of all types
of a pair; below the table, too, in units of a matrix product (`matrix_product.py`), timed before
each stream. The streams are defined in `robustness_streams.py`.

The batch fit is the limit for any filter: maximum likelihood, from the truth, over the reference
pose, the axis and a constant rate, q = rate t. No filter knows that the rate is constant, and none
sees the whole stream before its end.
"""

import time
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import typer
from joblib import Parallel, delayed
from scipy.optimize import least_squares
from tqdm import tqdm

from benchmarks.matrix_product import NAME, product_time
from benchmarks.robustness_streams import (
    RATE,
    Case,
    RobustnessStream,
    joint_pose,
    moved_joint,
    plain_cases,
    simulate_case,
)
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.consistency import is_consistent
from crossmodal.maths.vectors import normal_basis
from crossmodal.systems.kinematics.joint_filters import JointFilters, JointFiltersConfig
from crossmodal.systems.port_values import JointModelBelief, JointType

FIRST_SEED = 100
_PRODUCTS = 5  # Timed before each stream.
# Median q error [mm or deg], axis direction [deg], axis position [mm] and its settling time [s].
OMIP_NEAR = {
    "drawer 1 mm": (1.1, 0.43, np.nan, 1.6),
    "drawer 3 mm": (3.3, 0.97, np.nan, 1.6),
    "drawer 1 cm": (10.9, 2.2, np.nan, 1.6),
    "door 1 mm": (0.37, 0.32, 1.7, 6.1),
    "door 3 mm": (0.87, 0.97, 4.2, 6.3),
    "door 1 cm": (2.6, 2.5, 13.0, 6.7),
    "lid 1 mm": (0.25, 0.20, 1.4, 3.3),
    "lid 3 mm": (0.77, 0.75, 3.6, 3.5),
    "lid 1 cm": (1.7, 2.2, 10.5, 4.1),
}


@dataclass(kw_only=True)
class Outcome:
    """One stream: errors at the end as (q, axis direction, axis position) in table units.

    Attributes:
        errors: Of the filter, (3,).
        limit: Of the batch fit, (3,).
        right: Whether the type is right at the end.
        settled: Since when it has been right, [s].
        q_inside: Share of frames whose configuration's NEES is inside its bounds.
        axis_inside: The same for the axis direction.
        update_times: Of each update of all types, [s].
        product_time: Of the `matrix_product`, [s].
    """

    errors: Array
    limit: Array
    right: bool
    settled: float
    q_inside: float
    axis_inside: float
    update_times: Array
    product_time: float


def batch_fit(case: Case, stream: RobustnessStream) -> tuple[float, Array, Array]:
    """The final configuration [m or rad], the axis (3,) and a point of it (3,) [m]."""
    rate = float(stream.configuration[-1] / stream.times[-1])
    scale = np.sqrt(np.diag(case.covariance))

    def residuals(d: Array) -> Array:
        X0, axis, point = moved_joint(case, stream, d[:-1])
        rows = [
            se3.log(se3.inverse(joint_pose(case, axis, point, (rate + d[-1]) * t) @ X0) @ Z) / scale
            for t, Z in zip(stream.times, stream.X_PB_measured, strict=True)
        ]
        return np.concatenate(rows)

    unmoved = np.zeros(9 if case.joint == "prismatic" else 11)
    d = least_squares(residuals, unmoved, jac="3-point", method="lm").x
    return (rate + d[-1]) * float(stream.times[-1]), *moved_joint(case, stream, d[:-1])[1:]


def _errors(case: Case, stream: RobustnessStream, q: float, axis: Array, p_PA: Array) -> Array:
    revolute = case.joint == "revolute"
    q_error = abs(q - float(stream.configuration[-1])) * (180.0 / np.pi if revolute else 1e3)
    angle = np.arctan2(np.linalg.norm(np.cross(axis, stream.axis_P)), axis @ stream.axis_P)
    distance = np.linalg.norm(np.cross(p_PA - stream.p_PA, stream.axis_P)) if revolute else np.nan
    return np.array([q_error, np.rad2deg(angle), 1e3 * distance])


def _frame_inside(model: JointModelBelief, q: float, axis_P: Array) -> tuple[bool, bool]:
    B = normal_basis(model.axis_P)
    sideways = B @ axis_P
    angle = np.arctan2(np.linalg.norm(sideways), model.axis_P @ axis_P)
    return (
        is_consistent(model.configuration[:1] - q, model.configuration_covariance[:1, :1]),
        is_consistent(angle * sideways / np.linalg.norm(sideways), B @ model.axis_covariance @ B.T),
    )


def evaluate_stream(case: Case, seed: int, filters: JointFilters) -> Outcome:
    """Runs the filters over one stream."""
    unit = float(np.median([product_time() for _ in range(_PRODUCTS)]))
    stream, joint = simulate_case(case, seed), JointType(case.joint)
    state = filters.start(stream.X_PB_measured[0], case.covariance, stream.times[0])
    inside, wrong_until, times = [], 0.0, []
    belief = filters.belief(state)
    for t, X, q in zip(stream.times, stream.X_PB_measured, stream.configuration, strict=True):
        if t == stream.times[0]:
            continue
        started = time.perf_counter()
        state = filters.update(state, X, case.covariance, float(t))
        times.append(time.perf_counter() - started)
        belief = filters.belief(state)
        inside.append(_frame_inside(belief.models[joint], float(q), stream.axis_P))
        if belief.type != joint:
            wrong_until = float(t) + 1.0 / RATE
    model = belief.models[joint]
    q_inside, axis_inside = np.mean(inside, axis=0)
    return Outcome(
        errors=_errors(case, stream, model.configuration[0], model.axis_P, model.p_PA),
        limit=_errors(case, stream, *batch_fit(case, stream)),
        right=belief.type == joint,
        settled=wrong_until,
        q_inside=float(q_inside),
        axis_inside=float(axis_inside),
        update_times=np.array(times),
        product_time=unit,
    )


def _pair(values: Array) -> str:
    return f"{np.median(values):.2g}/{np.quantile(values, 0.9):.2g}"


def _error_cells(errors: Array, omip: float, limit: float) -> list[str]:
    """The errors (N,) and their ratios to OMIP and to the batch limit."""
    if np.isnan(omip):
        return ["-", "-", "-"]
    median = float(np.median(errors))
    return [_pair(errors), f"{median / omip:.2f}", f"{median / limit:.2f}"]


def table_row(case: Case, outcomes: list[Outcome]) -> str:
    """One line of the table."""
    errors = np.array([o.errors for o in outcomes])
    limit = np.median([o.limit for o in outcomes], axis=0)
    omip = OMIP_NEAR[case.name]
    name = case.name + (" *" if limit[1] > omip[1] / 3.0 else "")
    cells = [name, f"{sum(o.right for o in outcomes)}/{len(outcomes)}"]
    for i in range(3):
        cells += _error_cells(errors[:, i], omip[i], limit[i])
    settled = np.array([o.settled for o in outcomes])
    times = np.concatenate([o.update_times for o in outcomes]) * 1e6
    cells += [
        f"{np.median(settled):.1f}/{settled.max():.1f}",
        f"{omip[3]:g}",
        f"{100 * np.mean([o.q_inside for o in outcomes]):.0f} %",
        f"{100 * np.mean([o.axis_inside for o in outcomes]):.0f} %",
        f"{np.median(times):.0f}/{np.quantile(times, 0.95):.0f}",
    ]
    return "| " + " | ".join(cells) + " |"


HEADER = (
    "| stream | right type | q mm or deg | / OMIP | / batch | axis deg | / OMIP | / batch "
    "| axis position mm | / OMIP | / batch | settled s med/max | OMIP | NEES q | NEES axis "
    "| update µs med/p95 |"
)


def main(
    seeds: Annotated[int, typer.Option(min=1, help="Streams of each kind.")] = 20,
    first_seed: Annotated[int, typer.Option(help="The first seed.")] = FIRST_SEED,
    jobs: Annotated[int, typer.Option(help="Processes; more than one disturbs the timing.")] = 1,
) -> None:
    """Prints the table, one line per stream."""
    filters = JointFilters(JointFiltersConfig())
    cases = plain_cases()
    evaluate_stream(replace(cases[-1], duration=4.0), 0, filters)  # Compiles.
    tasks = [(c, s) for c in cases for s in range(first_seed, first_seed + seeds)]
    results = Parallel(n_jobs=jobs, return_as="generator")(
        delayed(evaluate_stream)(c, s, filters) for c, s in tasks
    )
    outcomes = list(tqdm(results, total=len(tasks), unit="stream", disable=None))
    print(HEADER)
    print("|---" * 16 + "|")
    rows = [table_row(c, outcomes[i * seeds : (i + 1) * seeds]) for i, c in enumerate(cases)]
    print("\n".join(rows))
    if any(" * " in row for row in rows):
        print("\n\\* A third of OMIP's axis error is below the batch limit.")
    share = np.concatenate([o.update_times / o.product_time for o in outcomes])
    print(
        f"\nAn update: {np.median(share):.3f} of a {NAME} in the median, {share.mean():.3f} mean."
    )


if __name__ == "__main__":
    typer.run(main)
