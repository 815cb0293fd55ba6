"""The metrics of the flap application."""

from crossmodal.diagrams.evaluation.metric_table import (
    count,
    mean_share,
    median_and_range,
    value_at,
)
from crossmodal.diagrams.run.experiment import Column, Metric

# Name in the part of the summary that is about the flap, unit and title.
_OF_EPISODE = (
    ("turned", "rad", "flap turned by"),
    ("longest_loss", "s", "longest loss of contact"),
    ("contact_reestablished", "", "contact that was jerked away re-established"),
    ("reestablished_after", "s", "re-established after"),
    ("contact_position_rms", "m", "contact position, RMS about its mean"),
    ("contact_position_offset", "m", "its mean, from the pad's centre along x"),
    ("force_rms", "N", "contact force error, RMS"),
    ("misaligned_at_first", "rad", "angle between pad's normal and flap at first"),
    ("aligned_after", "s", "pad's normal in the flap, to 6 deg, within"),
    ("edge_slide", "m", "contact slides along the edge by"),
    ("edge_force", "N", "friction along the edge, RMS"),
)
_OF_ESTIMATOR = (
    ("axis_angle_error", "rad", "axis direction error after 30 deg of turning"),
    ("axis_angle_error_at_end", "rad", "axis direction error at the end"),
    ("theta_rmse_visible", "rad", "θ error while the flap is seen, RMS"),
    ("theta_rmse_hidden", "rad", "θ error while it is not, RMS"),
    ("L1_error", "m", "L1, mean error"),
    ("L2_error", "m", "L2, mean error"),
    ("tip_line_rms", "m", "tip from its line on the table, RMS"),
    ("tip_link_rms", "m", "the same, were the arm's own pose known exactly"),
)
# What is as it is, neither good nor bad; of what is only true or false, more is better.
_NEITHER = ("turned", "misaligned_at_first", "edge_slide", "edge_force")
METRICS = (
    *(
        Metric(
            name=name,
            value=value_at(f"flap.{name}"),
            unit=unit,
            by_estimator=by_estimator,
            title=title,
            cell=median_and_range if unit else count,
            better="" if name in _NEITHER else "less" if unit else "more",
        )
        for by_estimator, figures in ((False, _OF_EPISODE), (True, _OF_ESTIMATOR))
        for name, unit, title in figures
    ),
    *(
        Metric(
            name=f"{key}_inside_two_sigma",
            value=value_at(f"flap.inside_two_sigma.{key}"),
            title=f"{title} inside two reported deviations, share of ticks",
            unit="share",
            cell=mean_share,
            better="more",
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
