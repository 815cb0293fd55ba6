"""Draws tables of estimates over time, of estimators side by side."""

from collections.abc import Mapping, Sequence

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from crossmodal.diagrams.drawing import palette
from crossmodal.diagrams.drawing.plot_style import STYLE, TIME, new_figure

Spans = Sequence[tuple[float, float]]  # Starts and ends, [s].


def _names(estimates: pd.DataFrame) -> list[str]:
    return list(dict.fromkeys(estimates["modality"].astype(str)))


def _shade(axes: Axes, spans: Spans, end: float) -> None:
    for start, stop in spans:
        if start < end:
            axes.axvspan(start, min(stop, end), color="#000000", alpha=0.07, lw=0)


def draw_estimates(
    estimates: pd.DataFrame,
    quantity: str,
    components: Sequence[str] = ("",),
    *,
    scale: float = 1.0,
    unit: str = "",
    errors: bool = False,
    shaded: Spans = (),
    labels: Mapping[str, str] | None = None,
    colors: Mapping[str, str] | None = None,
) -> Figure:
    """A quantity over time with its 2 sigma band, one row per component, and the truth.

    Args:
        estimates: Table with the columns of `estimates_table`.
        quantity: One of those that it holds.
        components: Of the quantity.
        scale: From SI to `unit`.
        unit: For the axis' label.
        errors: Draws estimate minus truth instead of both.
        shaded: Times in which the cameras see nothing.
        labels: What the estimators are called, by name.
        colors: Theirs, by name.

    Raises:
        ValueError: for a quantity that the table does not hold.
    """
    chosen, ticks = estimates[estimates["quantity"] == quantity], np.unique(estimates["time"])
    if chosen.empty:
        known = sorted(set(estimates["quantity"].astype(str)))
        raise ValueError(f"no quantity '{quantity}'; there are {', '.join(known)}")
    with mpl.rc_context(STYLE):
        figure = new_figure(9.0, 1.2 + 1.9 * len(components))
        all_axes = np.atleast_1d(figure.subplots(len(components), 1, sharex=True))
        for axes, component in zip(all_axes, components, strict=True):
            _shade(axes, shaded, float(estimates["time"].max()))
            truth: pd.Series | None = None
            for index, name in enumerate(_names(estimates)):
                rows = chosen[(chosen["modality"] == name) & (chosen["component"] == component)]
                if rows.empty:
                    continue
                # NaN at the ticks at which it believed nothing.
                rows = rows.set_index("time")[["estimate", "std", "truth"]].reindex(ticks)
                value = scale * (rows["estimate"] - (rows["truth"] if errors else 0.0))
                band = 2.0 * scale * rows["std"]
                color = palette.estimator_color(colors or {}, name, index)
                axes.fill_between(ticks, value - band, value + band, color=color, alpha=0.15, lw=0)
                axes.plot(ticks, value, color=color, lw=1.6, label=(labels or {}).get(name, name))
                truth = rows["truth"] if truth is None else truth.fillna(rows["truth"])
            if not errors and truth is not None and truth.notna().any():
                axes.plot(truth.index, scale * truth, color=palette.TRUTH, ls="--", label="truth")
            if errors:
                axes.axhline(0.0, color=palette.TRUTH, lw=0.8)
            axes.set_ylabel(f"{component} [{unit}]".strip() if unit else component)
        name = quantity.replace("_", " ")
        all_axes[0].set_title(f"{name}: estimate minus truth" if errors else name)
        all_axes[-1].set_xlabel(TIME)
        if ticks.size > 1:  # Also where nobody knew anything.
            all_axes[-1].set_xlim(ticks[0], ticks[-1])
        handles, labels = max((axes.get_legend_handles_labels() for axes in all_axes), key=len)
        title = "band: 2σ as reported; n = 1 episode"
        figure.legend(handles, labels, loc="outside lower center", ncols=4, title=title)
    return figure


def draw_probabilities(
    estimates: pd.DataFrame,
    quantity: str,
    *,
    shaded: Spans = (),
    labels: Mapping[str, str] | None = None,
    colors: Mapping[str, str] | None = None,
) -> Figure:
    """Probabilities of types over time, stacked to one; a row per estimator that has them.

    Args:
        estimates: Table with the columns of `estimates_table`.
        quantity: Whose components are the types.
        shaded: Times in which the cameras see nothing.
        labels: What the estimators are called, by name.
        colors: Of the types, by name.
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
            shades = [palette.estimator_color(colors or {}, k, i) for i, k in enumerate(kinds)]
            axes.stackplot(table.index, table.to_numpy().T, labels=kinds, colors=shades, alpha=0.8)
            _shade(axes, shaded, float(table.index.max()))
            axes.set_ylim(0.0, 1.0)
            axes.set_title((labels or {}).get(name, name))
        figure.suptitle(quantity.replace("_", " "))
        all_axes[-1].set_xlabel(TIME)
        handles, labels = all_axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4)
    return figure
