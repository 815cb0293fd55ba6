"""The tidy table of estimates over time, and what an episode comes to by this table alone."""

import math
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from diagrams.drawing.estimate_plots import draw_estimates
from diagrams.run.application import Results
from diagrams.run.record import EpisodeRecord, Tick
from maths.arrays import Array

COLUMNS = ("time", "modality", "quantity", "component", "estimate", "std", "covariance", "truth")
_XYZ = ("x", "y", "z")
# Quantity, component, estimate, its standard deviation, row of the covariance, and truth.
Row = tuple[str, str, float, float, list[float], float]


def scalar(
    quantity: str,
    value: float,
    component: str = "",
    *,
    std: float = math.nan,
    true: float = math.nan,
) -> Row:
    """A row of one number; what is not known is NaN."""
    return quantity, component, value, std, [std**2], true


def vector(quantity: str, value: Array, covariance: Array, true: Array) -> list[Row]:
    """Three rows, of a vector (3,) with its covariance (3, 3) and the true one (3,)."""
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return [
        (quantity, component, value[i], std[i], covariance[i].tolist(), true[i])
        for i, component in enumerate(_XYZ)
    ]


def estimates_table(rows: Mapping[str, Iterable[tuple[float, Iterable[Row]]]]) -> pd.DataFrame:
    """All beliefs over time, one row per instant, estimator, quantity and component.

    Columns: `time` [s], `modality` (the estimator), `quantity`, `component`, `estimate`, its `std`,
    `covariance` (this component's row of the quantity's covariance) and `truth`.

    Args:
        rows: By estimator: instants and the rows of each.
    """
    table = pd.DataFrame(
        [
            (time, name, *row)
            for name, ticks in rows.items()
            for time, found in ticks
            for row in found
        ],
        columns=list(COLUMNS),
    )
    return table.astype({"modality": "category", "quantity": "category", "component": "category"})


def evaluate_rows(record: EpisodeRecord, rows: Callable[[Tick, Tick], Iterable[Row]]) -> Results:
    """What an episode comes to by the table of its estimates alone.

    For each estimator the summary holds, by quantity and component: `final_error`, `rms_error`, and
    `inside_two_sigma`, the share of the ticks whose error lies within two claimed deviations.

    Args:
        rows: From an estimator's tick and the station's at the same instant to rows of the table.
    """
    table = estimates_table(
        {
            name: (
                (tick.time, rows(tick, station))
                for tick, station in zip(estimator.ticks, record.station, strict=False)
            )
            for name, estimator in record.estimators.items()
        }
    )
    error = table["estimate"] - table["truth"]
    table_of_errors = table.assign(error=error, inside=error.abs() <= 2.0 * table["std"])
    modalities: dict[str, Any] = {name: {"quantities": {}} for name in record.estimators}
    keys = ["modality", "quantity", "component"]
    for (name, quantity, component), found in table_of_errors.groupby(keys, observed=True):
        label = f"{quantity}_{component}" if component else str(quantity)
        modalities[str(name)]["quantities"][label] = {
            "final_error": float(found["error"].iloc[-1]),
            "rms_error": float(np.sqrt(np.mean(found["error"] ** 2))),
            "inside_two_sigma": float(found["inside"].mean()),
        }
    plots = {
        f"{quantity}.png": partial(_draw, table, str(quantity))
        for quantity in table["quantity"].cat.categories
    }
    return Results(
        failure=None,
        estimates=table,
        summary={"modalities": modalities},
        plots=plots,
        report=_report,
    )


def _draw(table: pd.DataFrame, quantity: str) -> Any:
    rows = table[table["quantity"] == quantity]
    return draw_estimates(table, quantity, list(dict.fromkeys(rows["component"].astype(str))))


def _report(summary: Mapping[str, Any]) -> list[str]:
    lines = []
    for name, record in summary["modalities"].items():
        for quantity, errors in record["quantities"].items():
            numbers = ", ".join(
                f"{key.replace('_', ' ')} {value:.3g}"
                for key, value in errors.items()
                if value is not None
            )
            lines.append(f"{name}: {quantity}: {numbers}")
    return lines
