"""Draws tables of estimates over time: of the modalities, or of one modality's wirings."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from diagrams.crossmodal.results.plots import STYLE, new_figure
from diagrams.crossmodal.scenario import Scenario
from diagrams.drawing import palette
from diagrams.run.replay import load_recorded_scenario
from diagrams.run.run_folder import ESTIMATES_FILE, SUMMARY_FILE
from diagrams.run.yaml_schema import ScenarioError

_OTHER_COLORS = ("#222255", "#66CCEE", "#CCBB44", "#228833", "#999999", "#663333")


@dataclass(kw_only=True)
class RecordedRun:
    """A run's folder with its sensor streams, as far as pictures need it.

    Attributes:
        folder: Where it is.
        scenario: As it was run.
        estimates: See `estimates_table`.
        summary: See `summarise`.
    """

    folder: Path
    scenario: Scenario
    estimates: pd.DataFrame
    summary: dict[str, Any]


def read_run(folder: Path | str) -> RecordedRun:
    """Reads the folder of a run with `--record-sensors`.

    Raises:
        ScenarioError: where a file is missing.
    """
    import json

    folder = Path(folder)
    scenario = load_recorded_scenario(folder)
    try:
        estimates = pd.read_parquet(folder / ESTIMATES_FILE)
        summary = json.loads((folder / SUMMARY_FILE).read_text(encoding="utf-8"))
    except OSError as error:
        raise ScenarioError(f"{error.filename}: is missing; run it again with --force") from None
    return RecordedRun(folder=folder, scenario=scenario, estimates=estimates, summary=summary)


def _color(name: str, index: int) -> str:
    return palette.MODALITY.get(name, _OTHER_COLORS[index % len(_OTHER_COLORS)])


def _label(name: str) -> str:
    return palette.MODALITY_LABEL.get(name, name)


def _names(estimates: pd.DataFrame) -> list[str]:
    return list(dict.fromkeys(estimates["modality"].astype(str)))


def _rows(estimates: pd.DataFrame, name: str, quantity: str, component: str) -> pd.DataFrame:
    """What one network believed, with NaN at the ticks at which it believed nothing."""
    chosen = estimates[
        (estimates["modality"] == name)
        & (estimates["quantity"] == quantity)
        & (estimates["component"] == component)
    ]
    if chosen.empty:
        return chosen
    ticks = pd.Index(np.unique(estimates["time"]), name="time")
    numbers = chosen.set_index("time")[["estimate", "std", "truth"]]
    return numbers.reindex(ticks).reset_index()


def _shade_darkness(axes: Axes, scenario: Scenario | None, end: float) -> None:
    if scenario is None:
        return
    disturbances = scenario.disturbances
    for span in disturbances.lights_off + disturbances.camera_covered:
        if span.start < end:
            axes.axvspan(span.start, min(span.end, end), color="#000000", alpha=0.07, lw=0)


def draw_estimates(
    estimates: pd.DataFrame,
    quantity: str,
    components: Sequence[str] = ("",),
    *,
    scale: float = 1.0,
    unit: str = "",
    errors: bool = False,
    scenario: Scenario | None = None,
) -> Figure:
    """A quantity over time with its 2 sigma band, one row per component, and the truth.

    Args:
        estimates: Table with the columns of `estimates_table`.
        quantity: One of those that it holds.
        components: Of the quantity.
        scale: From SI to `unit`.
        unit: For the axis' label.
        errors: Draws estimate minus truth instead of both.
        scenario: To shade the time in which the camera sees nothing.

    Raises:
        ValueError: for a quantity that the table does not hold.
    """
    known = sorted(set(estimates["quantity"].astype(str)))
    if quantity not in known:
        raise ValueError(f"no quantity '{quantity}'; there are {', '.join(known)}")
    with mpl.rc_context(STYLE):
        figure = new_figure(9.0, 1.2 + 1.9 * len(components))
        all_axes = np.atleast_1d(figure.subplots(len(components), 1, sharex=True))
        for axes, component in zip(all_axes, components, strict=True):
            _shade_darkness(axes, scenario, float(estimates["time"].max()))
            for index, name in enumerate(_names(estimates)):
                rows = _rows(estimates, name, quantity, component)
                if rows.empty:
                    continue
                offset = rows["truth"] if errors else 0.0
                value, band = scale * (rows["estimate"] - offset), 2.0 * scale * rows["std"]
                color = _color(name, index)
                axes.fill_between(
                    rows["time"], value - band, value + band, color=color, alpha=0.15, lw=0
                )
                axes.plot(rows["time"], value, color=color, lw=1.6, label=_label(name))
                if not errors and rows["truth"].notna().any():
                    axes.plot(rows["time"], scale * rows["truth"], color=palette.TRUTH, ls="--")
            axes.set_ylabel(f"{component} [{unit}]".strip() if unit else component)
        title = quantity.replace("_", " ")
        all_axes[0].set_title(f"{title}: estimate minus truth" if errors else title)
        all_axes[-1].set_xlabel("time [s]")
        handles, labels = max((axes.get_legend_handles_labels() for axes in all_axes), key=len)
        figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


def draw_probabilities(
    estimates: pd.DataFrame, quantity: str, scenario: Scenario | None = None
) -> Figure:
    """Probabilities of types over time, stacked to one; a row per modality that has them.

    Args:
        estimates: Table with the columns of `estimates_table`.
        quantity: `type_probability` or `grasp_probability`.
        scenario: To shade the time in which the camera sees nothing.
    """
    chosen = estimates[estimates["quantity"] == quantity]
    names = _names(chosen)
    with mpl.rc_context(STYLE):
        figure = new_figure(9.0, 1.0 + 1.6 * max(len(names), 1))
        all_axes = np.atleast_1d(figure.subplots(max(len(names), 1), 1, sharex=True))
        for axes, name in zip(all_axes, names, strict=False):
            table = chosen[chosen["modality"] == name].pivot_table(
                index="time", columns="component", values="estimate", observed=True
            )
            kinds = [str(kind) for kind in table.columns]
            colors = [
                palette.JOINT.get(kind, _OTHER_COLORS[i])  # type: ignore[call-overload]
                for i, kind in enumerate(kinds)
            ]
            axes.stackplot(table.index, table.to_numpy().T, labels=kinds, colors=colors, alpha=0.8)
            _shade_darkness(axes, scenario, float(table.index.max()))
            axes.set_ylim(0.0, 1.0)
            axes.set_title(_label(name))
        figure.suptitle(quantity.replace("_", " "))
        all_axes[-1].set_xlabel("time [s]")
        handles, labels = all_axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4)
    return figure


def final_beliefs(summary: dict[str, Any]) -> pd.DataFrame:
    """What each modality believes of the joint at the end of a run, in mm or deg.

    Args:
        summary: See `summarise`.
    """
    rows = {}
    for name, modality in summary["modalities"].items():
        joint = modality["joints"][0]
        scale, unit = (1e3, "mm") if joint["type_true"] == "prismatic" else (180.0 / np.pi, "deg")
        rows[_label(name)] = {
            "type": joint["type_estimated"],
            "probability": joint["probability"],
            f"opening error [{unit}]": _scaled(joint["configuration_error"], scale),
            f"its std [{unit}]": _scaled(joint["configuration_std"], scale),
            "axis error [deg]": _scaled(joint["axis_angle_error"], 180.0 / np.pi),
        }
    return pd.DataFrame.from_dict(rows, orient="index").round(2)


def _scaled(value: float | None, scale: float) -> float:
    return np.nan if value is None else scale * value
