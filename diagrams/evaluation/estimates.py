"""The tidy table of estimates over time, and what an episode comes to by this table alone."""

import math
import warnings
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any, Literal

import numpy as np
import pandas as pd

from crossmodal.diagrams.run.application import Results
from crossmodal.diagrams.run.experiment import Metric
from crossmodal.diagrams.run.record import EpisodeRecord, Tick
from crossmodal.maths.arrays import Array

COLUMNS = ("time", "modality", "quantity", "component", "estimate", "std", "covariance", "truth")
_XYZ = ("x", "y", "z")
_ROUNDING = 1e-12  # Of a variance, in SI.
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
    """A row of each component of a vector (n,) with its covariance (n, n) and the true one (n,).

    Those of a vector of at most three are x, y and z, those of a longer one are numbered from 0.

    Raises:
        ValueError: if the shapes do not belong together, or a variance is negative.
    """
    size = len(value)
    for name, array, shape in (("covariance", covariance, (size, size)), ("truth", true, (size,))):
        if np.shape(array) != shape:
            text = f"'{quantity}' has {size} components and a {name} of shape {np.shape(array)}"
            raise ValueError(f"{text}; it is to be {shape}")
    variances = np.diag(covariance)
    if np.any(variances < -_ROUNDING):
        raise ValueError(f"'{quantity}' has a negative variance: {variances.min():g}")
    std = np.sqrt(np.maximum(variances, 0.0))
    components = _XYZ if len(value) <= len(_XYZ) else tuple(map(str, range(len(value))))
    return [
        (quantity, components[i], value[i], std[i], covariance[i].tolist(), true[i])
        for i in range(len(value))
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


class EvaluationWarning(UserWarning):
    """What an application leaves out of its evaluation."""


def evaluate_rows(
    record: EpisodeRecord,
    rows: Callable[[str, Tick, Tick], Iterable[Row]],
    units: Mapping[str, str],
    failure: Callable[[EpisodeRecord, pd.DataFrame], str | None] = lambda record, table: None,
) -> Results:
    """What an episode comes to by the table of its estimates alone.

    For each estimator the summary holds, by quantity and component: `final_error`, `rms_error`, and
    `inside_two_sigma`, the share of the ticks whose error lies within two reported deviations; what
    nobody can know, as no truth or no deviation is given, is left out. `estimated` is the share of
    its rows that are numbers. An episode that ends without a number for an estimator's quantity has
    failed: where there is nothing to be estimated, `rows` leaves the row out. A picture of each
    quantity shows estimate minus truth with the reported deviation, or the estimate where no truth
    is known.

    Args:
        rows: From an estimator's name, its tick and the station's at the same instant to rows of
            the table.
        units: Of the quantities, in SI; empty where one has none.
        failure: From the record and the table to why the task was not done; None if it was.
    """
    table = estimates_table(
        {
            name: [
                (tick.time, rows(name, tick, station))
                for tick, station in zip(estimator.ticks, record.station, strict=False)
            ]
            for name, estimator in record.estimators.items()
        }
    )
    error = table["estimate"] - table["truth"]
    bound = 2.0 * table["std"]
    inside = (error.abs() <= bound).astype(float).where(error.notna() & bound.notna())
    table_of_errors = table.assign(error=error, inside=inside)
    modalities: dict[str, Any] = {name: {"quantities": {}} for name in record.estimators}
    keys = ["modality", "quantity", "component"]
    for (name, quantity, component), found in table_of_errors.groupby(keys, observed=True):
        label = f"{quantity}_{component}" if component else str(quantity)
        facts = modalities[str(name)]["quantities"][label] = {
            "estimated": float(np.isfinite(found["estimate"].astype(float)).mean()),
            "unit": units.get(str(quantity), ""),
        }
        if found["truth"].notna().any():
            facts["final_error"] = float(found["error"].iloc[-1])
            facts["rms_error"] = float(np.sqrt(np.mean(found["error"] ** 2)))
            if found["std"].notna().any():
                facts["inside_two_sigma"] = float(found["inside"].mean())
    for quantity in table["quantity"].cat.categories:
        if quantity not in units:
            text = f"quantity '{quantity}' has no unit: name it in `units`, '' where there is none"
            warnings.warn(text, EvaluationWarning, stacklevel=2)
    plots = {
        f"{quantity}.png": partial(_draw, table, str(quantity), units.get(str(quantity), ""))
        for quantity in table["quantity"].cat.categories
    }
    return Results(
        failure=_lost(table) or failure(record, table),
        estimates=table,
        summary={"modalities": modalities},
        plots=plots,
        report=_report,
    )


def _lost(table: pd.DataFrame) -> str | None:
    """Which quantity is no number at the end, and since when."""
    is_number = table.assign(number=np.isfinite(table["estimate"].astype(float)))
    for (name, quantity), found in is_number.groupby(["modality", "quantity"], observed=True):
        numbers = found.groupby("time")["number"].all()
        if not numbers.any():
            return f"'{quantity}' of '{name}' is never a number"
        if not numbers.iloc[-1]:
            since = numbers.index[numbers.to_numpy().nonzero()[0][-1] + 1]
            return f"'{quantity}' of '{name}' is no number from {since:.2f} s on"
    return None


def _draw(table: pd.DataFrame, quantity: str, unit: str) -> Any:
    from crossmodal.diagrams.drawing.estimate_plots import draw_estimates
    from crossmodal.diagrams.evaluation.metric_table import readable

    chosen = table[table["quantity"] == quantity]
    components = list(dict.fromkeys(chosen["component"].astype(str)))
    scale, shown = readable(unit)
    known = bool(chosen["truth"].notna().any())
    return draw_estimates(table, quantity, components, scale=scale, unit=shown, errors=known)


def _report(summary: Mapping[str, Any]) -> list[str]:
    from crossmodal.diagrams.drawing.digits import fixed, written
    from crossmodal.diagrams.evaluation.metric_table import readable

    lines = []
    for name, record in summary["modalities"].items():
        for quantity, errors in record["quantities"].items():
            scale, unit = readable(errors["unit"])
            told = [] if "rms_error" in errors else ["no truth is given"]
            for key, words in (("final_error", "off at the end"), ("rms_error", "RMS")):
                if key in errors:
                    size = None if errors[key] is None else scale * errors[key]
                    told.append(f"{written(size, unit)} {words}")
            if (share := errors.get("inside_two_sigma")) is not None:
                inside = fixed(100.0 * share, 0)
                told.append(f"{inside} % of the ticks inside two reported deviations")
            if missing := 1.0 - errors["estimated"]:
                told.append(f"no number in {fixed(100.0 * missing, 0)} % of the ticks")
            lines.append(f"{name}: {quantity}: {', '.join(told)}")
    return lines


def error_metrics(units: Mapping[str, str]) -> list[Metric]:
    """Metrics of what `evaluate_rows` says of each quantity.

    Args:
        units: Of the quantities, in SI; a component stands as `quantity_component`.
    """
    from crossmodal.diagrams.evaluation.metric_table import mean_share, median_and_range, value_at

    inside = "inside two reported deviations, share of ticks"
    kinds: tuple[tuple[str, str, Any, Literal["less", "more"]], ...] = (
        ("final_error", "error at the end", median_and_range, "less"),
        ("rms_error", "RMS error", median_and_range, "less"),
        ("inside_two_sigma", inside, mean_share, "more"),
    )

    def value(name: str, key: str) -> Callable[[Mapping[str, Any]], Any]:
        def found(record: Mapping[str, Any]) -> Any:
            components = [known for known in record["quantities"] if known.startswith(f"{name}_")]
            if name not in record["quantities"] and components:
                text = f"there is no quantity '{name}'; its components are {', '.join(components)}"
                warnings.warn(text, EvaluationWarning, stacklevel=2)
            return value_at(f"quantities.{name}.{key}")(record)

        return found

    return [
        Metric(
            name=f"{name}_{key}",
            value=value(name, key),
            unit=unit if key.endswith("error") else "share",
            title=f"{name}, {title}",
            cell=cell,
            better=better,
        )
        for name, unit in units.items()
        for key, title, cell, better in kinds
    ]
