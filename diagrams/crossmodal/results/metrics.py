"""The metrics of the cross-modal application and their pictures over many episodes."""

from collections.abc import Callable, Mapping
from typing import Any

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


def _unit(record: Mapping[str, Any]) -> str:
    return unit_of(_joint(record)["type_true"])


def _force_unit(record: Mapping[str, Any]) -> str:
    return "N" if _unit(record) == "m" else "N m"


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
    cell: Callable[..., str] = median_and_range,
) -> Metric:
    """A figure that stands in the joint's summary.

    Args:
        path: Where, if not under its name.
        kinds: True types of joints that have it; none: all of them.
    """
    value = value_at(f"joints.0.{path or name}")

    def value_of_kind(record: Mapping[str, Any]) -> Any:
        if _joint(record)["type_true"] not in kinds:
            raise KeyError(f"only {kinds} have a {name}")
        return value(record)

    chosen = value_of_kind if kinds else value
    return Metric(name=name, value=chosen, unit=unit, title=title, cell=cell)


def _reached_stops(record: Mapping[str, Any]) -> bool:
    stops = [value_at(f"joints.0.mechanics.{side}")(record) for side in ("lower", "upper")]
    reached = [stop["inside_two_sigma"] for stop in stops if stop["reached"]]
    if not reached:
        raise KeyError("no end stop is reported to have been reached")
    return all(reached)


METRICS = (
    *(
        _of_phase(phase, key)
        for phase in ("exploration", "exploitation")
        for key in ("target", "reached")
    ),
    _of_phase("exploration", "error", title="exploration error", cell=mean_and_deviation),
    _of_phase("exploitation", "error", title="exploitation error", cell=mean_and_deviation),
    Metric(
        name="joint_found",
        value=lambda record: _joint(record)["type_estimated"] in MOVING_TYPES,
        title="joint found",
        cell=count,
    ),
    Metric(
        name="type_right",
        value=lambda record: _joint(record)["type_estimated"] == _joint(record)["type_true"],
        title="joint type right at the end",
        cell=count,
        totals=True,
    ),
    Metric(name="configuration_true", value=value_at("joints.0.configuration_true"), unit=_unit),
    _of_joint("configuration_error", "configuration error at the end", _unit),
    _of_joint("configuration_std", "configuration's reported deviation at the end", _unit),
    _of_joint("configuration_error_at_turn", "configuration error at the turning point", _unit),
    _of_joint("configuration_rms_moving", "configuration error while moving, RMS", _unit),
    _of_joint("configuration_error_last_seen", "configuration error when last seen", _unit),
    _of_joint("axis_angle_error", "axis direction error", "rad"),
    _of_joint("axis_angle_error_at_turn", "axis direction error at the turning point", "rad"),
    _of_joint("axis_angle_std", "axis' reported deviation at the end", "rad"),
    *(
        _of_joint(
            f"{key}_inside_two_sigma",
            f"final {key} inside two reported deviations",
            cell=count_of_known,
        )
        for key in ("configuration", "axis")
    ),
    _of_joint("axis_distance_error", "axis distance error", "m", kinds=_TURNING),
    _of_joint("pitch_error", "pitch error at the end", "m/rad", kinds=("screw",)),
    _of_joint("pitch_std", "pitch's reported deviation at the end", "m/rad", kinds=("screw",)),
    *(
        _of_joint(f"resistance_{key}", title, unit, path=f"mechanics.resistance.{key}", cell=cell)
        for key, title, unit, cell in (
            ("error", "friction error at the motion's speed", _force_unit, median_and_range),
            ("std", "friction's reported deviation there", _force_unit, median_and_range),
            ("inside_two_sigma", "friction inside two reported deviations", "", count_of_known),
        )
    ),
    Metric(
        name="end_stops_inside_two_sigma",
        value=_reached_stops,
        title="end stops reported as reached, inside two reported deviations",
        cell=count_of_known,
    ),
    _of_joint("type_settled_at", "type settled after motion of", "s"),
    *(
        _of_joint(
            f"consistency_{key}",
            f"{whose} NEES inside 95 % bounds",
            path=f"consistency.{key}",
            cell=mean_share,
        )
        for key, whose in (("configuration", "configuration's"), ("axis", "axis'"))
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
