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
)
from crossmodal.diagrams.joints.joint_errors import error_panels, read_errors
from crossmodal.diagrams.run.experiment import CampaignPlot, Column, Metric
from crossmodal.systems.port_values import MOVING_TYPES


def _joint(record: Mapping[str, Any]) -> Mapping[str, Any]:
    joint: Mapping[str, Any] = record["joints"][0]
    return joint


def _key_of_joint(key: str) -> Callable[[Mapping[str, Any]], Any]:
    return lambda record: _joint(record)[key]


def _unit(record: Mapping[str, Any]) -> str:
    return "rad" if _joint(record)["type_true"] in ("revolute", "screw") else "m"


def _unit_of_episode(summary: Mapping[str, Any]) -> str:
    return next((_unit(record) for record in summary["modalities"].values()), "")


def _axis_distance(record: Mapping[str, Any]) -> Any:
    joint = _joint(record)
    if joint["type_true"] not in ("revolute", "screw"):
        raise KeyError("a prismatic joint's axis has no place")
    return joint["axis_distance_error"]


def _of_screw(key: str, title: str) -> Metric:
    def value(record: Mapping[str, Any]) -> Any:
        joint = _joint(record)
        if joint["type_true"] != "screw":
            raise KeyError("only a screw has a pitch")
        return joint[key]

    return Metric(name=key, value=value, unit="m/rad", title=title, cell=median_and_range)


def _of_joint(key: str, unit: Any, title: str) -> Metric:
    return Metric(
        name=key,
        value=_key_of_joint(key),
        unit=unit,
        title=title,
        cell=median_and_range,
    )


def _known_share(name: str, value: Callable[[Mapping[str, Any]], Any], title: str) -> Metric:
    return Metric(name=name, value=value, title=title, cell=lambda v, _: count_of_known(v))


def _consistency(key: str, title: str) -> Metric:
    return Metric(
        name=f"consistency_{key}",
        value=lambda record: _joint(record)["consistency"][key],
        title=f"{title} NEES inside 95 % bounds",
        cell=lambda v, _: mean_share(v),
    )


def _of_phase(phase: str, key: str, **shown: Any) -> Metric:
    return Metric(
        name=f"{phase}_{key}",
        value=lambda summary: summary["phases"][phase][key],
        unit=_unit_of_episode,
        by_estimator=False,
        **shown,
    )


def _mechanics(record: Mapping[str, Any]) -> Mapping[str, Any]:
    found: Mapping[str, Any] | None = _joint(record)["mechanics"]
    if found is None:
        raise KeyError("an estimator without touch knows no forces")
    return found


def _force_unit(record: Mapping[str, Any]) -> str:
    return "N" if _unit(record) == "m" else "N m"


def _resistance(key: str) -> Callable[[Mapping[str, Any]], Any]:
    """Coulomb friction and damping together, at the speed of the motion."""
    return lambda record: (_mechanics(record).get("resistance") or {})[key]


def _of_resistance(key: str, title: str) -> Metric:
    return Metric(
        name=f"resistance_{key}",
        value=_resistance(key),
        unit=_force_unit,
        title=title,
        cell=median_and_range,
    )


def _reached_stops(record: Mapping[str, Any]) -> bool:
    found = _mechanics(record)
    reached = [found[side] for side in ("lower", "upper") if found[side]["reached"]]
    if not reached:
        raise KeyError("no end stop is claimed to have been reached")
    return all(stop["inside_two_sigma"] for stop in reached)


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
        cell=lambda v, _: count(v),
    ),
    Metric(
        name="type_right",
        value=lambda record: _joint(record)["type_estimated"] == _joint(record)["type_true"],
        title="joint type right at the end",
        cell=lambda v, _: count(v),
        totals=True,
    ),
    Metric(
        name="configuration_true",
        value=_key_of_joint("configuration_true"),
        unit=_unit,
    ),
    _of_joint("configuration_error", _unit, "configuration error at the end"),
    _of_joint("configuration_std", _unit, "configuration's claimed deviation at the end"),
    _of_joint("configuration_error_at_turn", _unit, "configuration error at the turning point"),
    _of_joint("configuration_rms_moving", _unit, "configuration error while moving, RMS"),
    _of_joint("configuration_error_last_seen", _unit, "configuration error when last seen"),
    _of_joint("axis_angle_error", "rad", "axis direction error"),
    _of_joint("axis_angle_error_at_turn", "rad", "axis direction error at the turning point"),
    _of_joint("axis_angle_std", "rad", "axis' claimed deviation at the end"),
    *(
        _known_share(
            f"{key}_inside_two_sigma",
            _key_of_joint(f"{key}_inside_two_sigma"),
            f"final {key} inside its 2σ claim",
        )
        for key in ("configuration", "axis")
    ),
    Metric(
        name="axis_distance_error",
        value=_axis_distance,
        unit="m",
        title="axis distance error",
        cell=median_and_range,
    ),
    _of_screw("pitch_error", "pitch error at the end"),
    _of_screw("pitch_std", "pitch's claimed deviation at the end"),
    _of_resistance("error", "friction error at the motion's speed"),
    _of_resistance("std", "friction's claimed deviation there"),
    _known_share(
        "resistance_inside_two_sigma",
        _resistance("inside_two_sigma"),
        "friction inside its 2σ claim",
    ),
    _known_share(
        "end_stops_inside_two_sigma",
        _reached_stops,
        "end stops claimed as reached, inside their 2σ claims",
    ),
    _of_joint("type_settled_at", "s", "type settled after motion of"),
    _consistency("configuration", "configuration's"),
    _consistency("axis", "axis'"),
)
# Of an experiment that only explores: where the object was to be brought is no target.
TRIAL_METRICS = ("exploration_error", "exploitation_error")

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
