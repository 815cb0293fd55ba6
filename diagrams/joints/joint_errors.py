"""Errors of the joint over time, read back from tables of estimates, and their panels."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from crossmodal.diagrams.evaluation.campaign_plots import Panel
from crossmodal.diagrams.evaluation.metric_table import readable
from crossmodal.diagrams.joints.joint_metrics import unit_of
from crossmodal.diagrams.run.folder.run_folder import ESTIMATES_FILE
from crossmodal.maths.arrays import Array

_QUANTITIES = ("configuration", "axis", "type_probability")


@dataclass(kw_only=True)
class ErrorsOverTime:
    """One estimator's errors in one episode; NaN where it has no estimate.

    Attributes:
        times: (T,), [s].
        joint_type: The true one.
        configuration: |estimate - truth| (T,), [m or rad]; only where the type is the true one or
            nothing has moved yet.
        axis: Angle to the true axis (T,), [rad].
        probability: Of the true type (T,).
    """

    times: Array
    joint_type: str
    configuration: Array
    axis: Array
    probability: Array


def errors_over_time(estimates: pd.DataFrame) -> dict[str, ErrorsOverTime]:
    """By estimator, from an episode's table of estimates."""
    errors = {}
    known = estimates[estimates["quantity"].isin(_QUANTITIES)]
    for modality, rows in known.groupby("modality", observed=True):
        keys = rows["quantity"].astype(str) + "/" + rows["component"].astype(str)
        wide = rows.assign(key=keys)
        estimate, truth = (
            wide.pivot(index="time", columns="key", values=values)
            for values in ("estimate", "truth")
        )
        one = _errors(estimate, truth)
        if one is not None:
            errors[str(modality)] = one
    return errors


def _errors(estimate: pd.DataFrame, truth: pd.DataFrame) -> ErrorsOverTime | None:
    types = [str(key) for key in estimate if str(key).startswith("type_probability/")]
    true_type = next((key for key in types if key in truth and (truth[key] == 1.0).any()), None)
    if true_type is None:
        return None
    likeliest = estimate[types].idxmax(axis=1)
    comparable = likeliest.isin([true_type, "type_probability/rigid"])

    def column(frame: pd.DataFrame, key: str) -> pd.Series:
        return frame[key] if key in frame else pd.Series(np.nan, index=estimate.index)

    difference = column(estimate, "configuration/") - column(truth, "configuration/")
    components = [f"axis/{name}" for name in "xyz"]
    axes, true_axes = (
        np.column_stack([column(frame, key).to_numpy(float) for key in components])
        for frame in (estimate, truth)
    )
    cross = np.linalg.norm(np.cross(axes, true_axes), axis=1)
    return ErrorsOverTime(
        times=estimate.index.to_numpy(float),
        joint_type=true_type.partition("/")[2],
        configuration=difference.abs().where(comparable).to_numpy(float),
        axis=np.arctan2(cross, np.abs(np.sum(axes * true_axes, axis=1))),
        probability=estimate[true_type].to_numpy(float),
    )


def read_errors(folders: Iterable[Path]) -> list[dict[str, ErrorsOverTime]]:
    """Of every episode among the folders that has its table of estimates."""
    columns = ["time", "modality", "quantity", "component", "estimate", "truth"]
    return [
        errors_over_time(pd.read_parquet(folder / ESTIMATES_FILE, columns=columns))
        for folder in folders
        if (folder / ESTIMATES_FILE).is_file()
    ]


def error_panels(
    episodes: Sequence[Mapping[str, ErrorsOverTime]], names: Iterable[str]
) -> list[Panel]:
    """Errors of configuration and axis, and the belief in the true type; none without episodes.

    Args:
        episodes: Errors by estimator.
        names: Of the estimators, in the order in which they are drawn.
    """
    known = [errors for episode in episodes for errors in episode.values()]
    if not known:
        return []
    scale, unit = readable(unit_of(known[0].joint_type))
    panels = (
        ("configuration", scale, f"configuration error [{unit}]"),
        ("axis", 180.0 / math.pi, "axis direction error [deg]"),
        ("probability", 1.0, f"probability of the true type ({known[0].joint_type})"),
    )
    return [
        Panel(
            title=title,
            series={
                name: [
                    (errors[name].times, factor * getattr(errors[name], quantity))
                    for errors in episodes
                    if name in errors
                ]
                for name in names
            },
            logarithmic=quantity != "probability",
        )
        for quantity, factor, title in panels
    ]
