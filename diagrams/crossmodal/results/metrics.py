"""The metrics of the cross-modal application and their pictures over many episodes."""

from collections.abc import Callable, Mapping
from typing import Any, Literal

from matplotlib.figure import Figure

from crossmodal.diagrams.evaluation.campaign import Campaign
from crossmodal.diagrams.evaluation.campaign_plots import common_events, draw_metrics, draw_spreads
from crossmodal.diagrams.evaluation.metric_table import (
    count,
    count_of_known,
    mean_and_deviation,
    mean_share,
    median_and_range,
    tidy_metrics,
    value_at,
)
from crossmodal.diagrams.joints.joint_errors import error_panels, read_errors
from crossmodal.diagrams.joints.joint_metrics import unit_of
from crossmodal.diagrams.run.experiment import CampaignPlot, Column, Metric
from crossmodal.systems.port_values import MOVING_TYPES

_TURNING = ("revolute", "screw")
_joint = value_at("joints.0")


def _type(record: Mapping[str, Any]) -> str | None:
    """The true joint's; the estimated one's where the truth is not known."""
    joint = _joint(record)
    found: str | None = joint["type_true"] or joint["type_estimated"]
    return found


def _unit(record: Mapping[str, Any]) -> str:
    return unit_of(_type(record))


def _force_unit(record: Mapping[str, Any]) -> str:
    return "N" if _unit(record) == "m" else "N m"


def _type_is_right(record: Mapping[str, Any]) -> bool | None:
    joint = _joint(record)
    known = joint["type_true"] is not None
    return joint["type_estimated"] == joint["type_true"] if known else None


def _unit_of_episode(summary: Mapping[str, Any]) -> str:
    return next((_unit(record) for record in summary["modalities"].values()), "")


def _of_phase(phase: str, key: str, **shown: Any) -> Metric:
    return Metric(
        name=f"{phase}_{key}",
        value=value_at(f"phases.{phase}.{key}"),
        unit=_unit_of_episode,
        by_estimator=False,
        **shown,
    )


def _of_joint(
    name: str,
    title: str,
    unit: str | Callable[[Mapping[str, Any]], str] = "",
    *,
    path: str = "",
    kinds: tuple[str, ...] = (),
    of_type: str = "type_true",
    cell: Callable[..., str] = median_and_range,
    better: Literal["", "less", "more"] = "",
) -> Metric:
    """A figure that stands in the joint's summary.

    Args:
        path: Where, if not under its name.
        kinds: True types of joints that have it; none: all of them.
        of_type: Where the type stands whose unit it has. Where that is another unit than the true
            type's, there is no figure, which could not be compared.
    """
    value, its_type = value_at(f"joints.0.{path or name}"), value_at(f"joints.0.{of_type}")

    def value_of_kind(record: Mapping[str, Any]) -> Any:
        if kinds and _joint(record)["type_true"] not in kinds:
            raise KeyError(f"only {kinds} have a {name}")
        found = value(record)
        return found if unit_of(its_type(record) or _type(record)) == _unit(record) else None

    return Metric(name=name, value=value_of_kind, unit=unit, title=title, cell=cell, better=better)


def _reached_stops(record: Mapping[str, Any]) -> bool:
    stops = [value_at(f"joints.0.mechanics.{side}")(record) for side in ("lower", "upper")]
    reached = [stop["inside_two_sigma"] for stop in stops if stop["reached"]]
    if not reached:
        raise KeyError("no end stop is reported to have been reached")
    return all(reached)


# Key, title, unit, cell, and what is better.
_FRICTION: tuple[tuple[str, str, Any, Callable[..., str], Literal["", "less", "more"]], ...] = (
    ("error", "friction error at the motion's speed", _force_unit, median_and_range, "less"),
    ("std", "friction's reported deviation there", _force_unit, median_and_range, ""),
    ("inside_two_sigma", "friction inside two reported deviations", "", count_of_known, "more"),
)
_NEES: tuple[tuple[str, str, Literal["", "less", "more"]], ...] = (
    ("", "inside 95 % bounds", "more"),
    ("_too_sure", "above them: too sure of itself", "less"),
)
METRICS = (
    *(
        _of_phase(phase, key)
        for phase in ("exploration", "exploitation")
        for key in ("target", "reached")
    ),
    _of_phase(
        "exploration", "error", title="exploration error", cell=mean_and_deviation, better="less"
    ),
    _of_phase(
        "exploitation", "error", title="exploitation error", cell=mean_and_deviation, better="less"
    ),
    Metric(
        name="joint_found",
        value=lambda record: _joint(record)["type_estimated"] in MOVING_TYPES,
        title="joint found",
        cell=count,
        better="more",
    ),
    Metric(
        name="type_right",
        value=_type_is_right,
        title="joint type right at the end",
        cell=count,
        better="more",
        totals=True,
    ),
    Metric(name="configuration_true", value=value_at("joints.0.configuration_true"), unit=_unit),
    _of_joint("configuration_error", "configuration error at the end", _unit, better="less"),
    _of_joint(
        "configuration_std",
        "configuration's reported deviation at the end",
        _unit,
        of_type="type_estimated",
    ),
    _of_joint(
        "configuration_error_at_turn",
        "configuration error at the turning point",
        _unit,
        better="less",
    ),
    _of_joint(
        "configuration_rms_moving", "configuration error while moving, RMS", _unit, better="less"
    ),
    _of_joint(
        "configuration_error_last_seen", "configuration error when last seen", _unit, better="less"
    ),
    _of_joint("axis_angle_error", "axis direction error", "rad", better="less"),
    _of_joint(
        "axis_angle_error_at_turn",
        "axis direction error at the turning point",
        "rad",
        better="less",
    ),
    _of_joint("axis_angle_std", "axis' reported deviation at the end", "rad"),
    *(
        _of_joint(
            f"{key}_inside_two_sigma",
            f"final {key} inside two reported deviations",
            cell=count_of_known,
            better="more",
        )
        for key in ("configuration", "axis")
    ),
    _of_joint("axis_distance_error", "axis distance error", "m", kinds=_TURNING, better="less"),
    _of_joint("pitch_error", "pitch error at the end", "m/rad", kinds=("screw",), better="less"),
    _of_joint("pitch_std", "pitch's reported deviation at the end", "m/rad", kinds=("screw",)),
    *(
        _of_joint(
            f"resistance_{key}",
            title,
            unit,
            path=f"mechanics.resistance.{key}",
            of_type="mechanics.type",
            cell=cell,
            better=better,
        )
        for key, title, unit, cell, better in _FRICTION
    ),
    Metric(
        name="end_stops_inside_two_sigma",
        value=_reached_stops,
        title="end stops reported as reached, inside two reported deviations",
        cell=count_of_known,
        better="more",
    ),
    _of_joint("type_settled_at", "type settled after motion of", "s", better="less"),
    *(
        _of_joint(
            f"consistency_{key}{side}",
            f"{whose} NEES {where}",
            "share",
            path=f"consistency.{key}{side}",
            cell=mean_share,
            better=better,
        )
        for key, whose in (("configuration", "configuration's"), ("axis", "axis'"))
        for side, where, better in _NEES
    ),
)

OVERVIEW = (
    Column(header="done", metric="success"),
    Column(header="type right, vision", metric="type_right", estimator="vision"),
    Column(header="type right, proprioception", metric="type_right", estimator="proprioception"),
    Column(header="type right, cross-modal", metric="type_right", estimator="crossmodal"),
    Column(
        header="error at the end, cross-modal",
        metric="configuration_error",
        estimator="crossmodal",
    ),
    Column(header="exploration error", metric="exploration_error"),
    Column(header="exploitation error", metric="exploitation_error"),
)


def _draw_over_time(campaign: Campaign) -> Figure | None:
    application, scenario = campaign.application, campaign.scenarios[0]
    panels = error_panels(read_errors(campaign.episode_folders()), application.labels)
    if not panels:
        return None
    events = common_events(campaign.summaries)
    return draw_spreads(application, panels, scenario.network_period, scenario.disturbances, events)


def _draw_at_end(campaign: Campaign) -> Figure | None:
    figures = tidy_metrics(campaign.application, campaign.name, campaign.summaries)
    titles = {
        "configuration_error": "configuration error at the end",
        "axis_angle_error": "axis direction error at the end",
    }
    return draw_metrics(campaign.application, figures, titles)


CAMPAIGN_PLOTS = {
    "errors_over_time.png": CampaignPlot(
        caption="errors over time, median and 5 to 95 % of the seeds", draw=_draw_over_time
    ),
    "errors_at_end.png": CampaignPlot(
        caption="errors at the end of every episode", draw=_draw_at_end
    ),
}
