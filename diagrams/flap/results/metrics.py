"""The metrics of the flap application."""

from collections.abc import Callable, Mapping
from typing import Any

from crossmodal.diagrams.evaluation.metric_table import count, mean_share, median_and_range
from crossmodal.diagrams.run.experiment import Column, Metric


def _flap(key: str) -> Callable[[Mapping[str, Any]], Any]:
    return lambda record: record["flap"][key]


def _share(key: str) -> Callable[[Mapping[str, Any]], Any]:
    return lambda record: record["flap"]["inside_two_sigma"][key]


def _of_episode(key: str, unit: str, title: str) -> Metric:
    return Metric(
        name=key,
        value=_flap(key),
        unit=unit,
        by_estimator=False,
        title=title,
        cell=median_and_range,
    )


def _of_estimator(key: str, unit: str, title: str) -> Metric:
    return Metric(name=key, value=_flap(key), unit=unit, title=title, cell=median_and_range)


METRICS = (
    _of_episode("turned", "rad", "flap turned by"),
    _of_episode("longest_loss", "s", "longest loss of contact"),
    Metric(
        name="contact_reestablished",
        value=_flap("contact_reestablished"),
        by_estimator=False,
        title="contact that was jerked away re-established",
        cell=lambda values, unit: count(values),
    ),
    _of_episode("reestablished_after", "s", "re-established after"),
    _of_episode("contact_position_rms", "m", "contact position, RMS about its mean"),
    _of_episode("contact_position_offset", "m", "its mean, from the pad's centre along x"),
    _of_episode("force_rms", "N", "contact force error, RMS"),
    _of_episode("normals_aligned_after", "s", "n · n_f near 0 within"),
    _of_estimator("axis_angle_error", "rad", "axis direction error after 30 deg of turning"),
    _of_estimator("axis_angle_error_at_end", "rad", "axis direction error at the end"),
    _of_estimator("theta_rmse_visible", "rad", "θ error while the flap is seen, RMS"),
    _of_estimator("theta_rmse_hidden", "rad", "θ error while it is not, RMS"),
    _of_estimator("L1_error", "m", "L1, mean error"),
    _of_estimator("L2_error", "m", "L2, mean error"),
    _of_estimator("tip_line_rms", "m", "tip from its line on the table, RMS"),
    _of_estimator("tip_link_rms", "m", "the same, were the arm's own pose known exactly"),
    *(
        Metric(
            name=f"{key}_inside_two_sigma",
            value=_share(key),
            title=f"{title} inside its 2σ claim, share of ticks",
            cell=lambda values, unit: mean_share(values),
        )
        for key, title in (("axis", "axis"), ("theta", "θ"), ("L1", "L1"), ("L2", "L2"))
    ),
)
OVERVIEW = (
    Column(header="done", metric="success"),
    Column(
        header="axis after 30 deg, joint filters", metric="axis_angle_error", estimator="filtered"
    ),
    Column(header="L2, joint filters", metric="L2_error", estimator="filtered"),
)
