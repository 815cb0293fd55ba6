"""What an episode comes to: how far the object is from where it is believed, stage by stage."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from crossmodal.diagrams.clutter.estimators import load_model
from crossmodal.diagrams.clutter.results.declutter_results import (
    cleared_at,
    clearing_failure,
    declutter_report,
    declutter_summary,
    step_pictures,
)
from crossmodal.diagrams.clutter.results.gains import (
    measurements,
    outcome,
    touch_gains,
    view_gains,
)
from crossmodal.diagrams.clutter.scenario import Scenario, target_name, wanted_touches
from crossmodal.diagrams.clutter.start import true_displacement
from crossmodal.diagrams.evaluation.estimates import Row, estimates_table, vector
from crossmodal.diagrams.run.application import Results
from crossmodal.diagrams.run.experiment import Metric
from crossmodal.diagrams.run.record import EpisodeRecord, EstimatorRecord
from crossmodal.diagrams.run.recorder import STATUS_PORT
from crossmodal.maths.arrays import Array
from crossmodal.maths.gaussian import chi_square_gate
from crossmodal.systems.active.touch_planner import SETTLED
from crossmodal.systems.port_values import ObjectPose, of_mesh, of_middle
from crossmodal.systems.pose.surface import nearest_distances
from crossmodal.systems.pose.target_model import TargetModel

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_CLAIMED = chi_square_gate(0.05, 6)  # Squared distance that 95 % of the poses do not exceed.

_SETTLED = 5  # Tick at which the object has come to rest on its table.


def average_distance(X: Array, Y: Array, model: TargetModel) -> float:
    """ADI: mean distance from the surface at the pose X (4, 4) to that at Y, symmetries apart, [m].

    Distances are those to the surface, not to its samples, so that they can be zero.
    """
    at_X = model.surface.points @ X[:3, :3].T + X[:3, 3]
    in_Y = np.ascontiguousarray((at_X - Y[:3, 3]) @ Y[:3, :3])
    return float(nearest_distances(in_Y, model.surface).mean())


def _true_poses(record: EpisodeRecord, model: TargetModel) -> Array:
    """X_WM (K, 4, 4) at each tick; NaN where it is not known."""
    poses = record.station_values("cheat_object_pose")
    if not poses:
        return np.full((len(record.station), 4, 4), np.nan)
    return np.array([of_middle(X_WO.GetAsMatrix4(), model.middle) for X_WO in poses])


def _claimed_radius(belief: ObjectPose) -> float:
    """Of the ball about the reported translation that holds 95 % of the samples', [m]."""
    away = np.linalg.norm(belief.samples[:, :3, 3] - belief.X[:3, 3], axis=1)
    return float(np.quantile(away, 0.95)) if len(away) else np.nan


def _stages(
    record: EpisodeRecord, estimator: EstimatorRecord, true: Array, model: TargetModel
) -> list[dict[str, Any]]:
    measured = {one.number: one for one in measurements(record)}
    touches = [one.displaced for one in measured.values() if one.kind == "touch"]
    # What was not reached is not displaced.
    displaced = next((one for one in touches if one.any()), touches[0] if touches else None)
    X_arm = np.eye(4)
    if displaced is not None:
        X_arm = true_displacement(record.scenario, record.calibration)
    found: dict[int, dict[str, Any]] = {}
    for tick, X_WM in zip(estimator.ticks, true, strict=False):
        belief: ObjectPose = tick.values["object_pose_latest"]
        if not belief.known or belief.number in found:
            continue
        new = measured.get(belief.number)
        found[belief.number] = {
            "stage": "guess" if new is None else new.kind,
            "acquisitions": belief.number,
            "outcome": None if new is None else outcome(new),
            "translation_claimed": _claimed_radius(belief),
            **_errors(belief, X_WM, model),
        }
        if displaced is not None:
            # Where the touching arm has to go to meet the object, and where it would go.
            met = _errors(belief.as_met(displaced), np.linalg.inv(X_arm) @ X_WM, model)
            found[belief.number]["as_met"] = met
    return [found[number] for number in sorted(found)]


def _errors(belief: ObjectPose, X_WM: Array, model: TargetModel) -> dict[str, Any]:
    """How wrong a belief is; None for all of it where the true pose is not known."""
    if not np.isfinite(X_WM).all():
        names = ("translation_error", "rotation_error", "adi", "distance", "inside_claim")
        return dict.fromkeys(names)
    distance = belief.distance(of_mesh(X_WM, model.middle))
    turn = Rotation.from_matrix(X_WM[:3, :3].T @ belief.X[:3, :3]).magnitude()
    return {
        "translation_error": float(np.linalg.norm(belief.X[:3, 3] - X_WM[:3, 3])),
        "rotation_error": float(turn),
        "adi": average_distance(X_WM, belief.X, model),
        "distance": distance,
        "inside_claim": bool(distance <= _CLAIMED),
    }


def _moved(true: Array, first: int) -> float | None:
    """How far the object was moved from where it was at the tick `first`, [m]."""
    if len(true) <= first or not np.isfinite(true).all():
        return None
    return float(np.linalg.norm(true[-1, :3, 3] - true[first, :3, 3]))


def _fell(true: Array, first: int) -> bool:
    """Whether the object leans by 20 deg against how it stood then, or lies below its table."""
    if len(true) <= first or not np.isfinite(true).all():
        return False
    start, end = true[first], true[-1]
    leans = float(start[2, :3] @ end[2, :3]) < np.cos(np.deg2rad(20.0))
    return bool(leans or end[2, 3] < start[2, 3] - 0.1)


def _rows(estimator: EstimatorRecord, true: Array) -> Iterable[tuple[float, list[Row]]]:
    for tick, X_WM in zip(estimator.ticks, true, strict=False):
        belief: ObjectPose = tick.values["object_pose_latest"]
        if belief.known:
            yield (
                tick.time,
                vector("position", belief.X[:3, 3], belief.covariance[3:, 3:], X_WM[:3, 3]),
            )


def evaluate(record: EpisodeRecord) -> Results:
    """Stages and errors of each estimator; a failure is that not all touches were made."""
    # What only shows is imported here, so that it does not belong to `program_files`.
    from crossmodal.diagrams.clutter.results.plots import draw_claim, draw_stages

    scenario: Scenario = record.scenario
    model = load_model(scenario)
    true = _true_poses(record, model)
    # What counts begins when the object has come to rest on its table and all is cleared away.
    begin = max(_SETTLED, cleared_at(record))
    stages = {
        name: _stages(record, estimator, true, model)
        for name, estimator in record.estimators.items()
    }
    table = estimates_table(
        {name: _rows(estimator, true) for name, estimator in record.estimators.items()}
    )
    modalities = {name: {"stages": found} for name, found in stages.items()}
    first = scenario.modalities[0]
    pose = {
        "target": target_name(scenario),
        "estimator": first,
        "stages": stages[first],
        "object_moved": _moved(true, begin) if scenario.station == "robots" else None,
    }
    summary: dict[str, Any] = {"pose": pose, "modalities": modalities}
    if scenario.clutter.count:
        summary["clutter"] = {**declutter_summary(record), "stages": stages[first]}
    is_known = bool(np.isfinite(true).all())
    return Results(
        failure="the object fell over"
        if _fell(true, begin)
        else _task_failure(record, stages[first]),
        judged=is_known,
        estimates=table,
        summary=summary,
        plots={
            **step_pictures(record),
            "stages.png": partial(draw_stages, stages, scenario.seed),
            "gains.png": partial(_draw_gains, record, stages[first], model),
            "claim.png": partial(draw_claim, stages, scenario.seed, _CLAIMED),
        }
        if is_known
        else {},
        report=_report,
    )


def _task_failure(record: EpisodeRecord, stages: Sequence[Mapping[str, Any]]) -> str | None:
    """Why not all touches were made that were wanted, or none met the object; None otherwise.

    Where there is only something to be cleared away, why that was not done.
    """
    wanted = wanted_touches(record.scenario)
    made = [stage["outcome"] for stage in stages if stage["stage"] == "touch"]
    status = record.station_values(STATUS_PORT)
    why = status[-1].note if status else ""
    if len(made) < wanted and why != SETTLED:
        return f"{len(made)} of {wanted} touches were made: {why or 'the time was over'}"
    if made and "contact" not in made:
        return f"none of {len(made)} touches met the object"
    if record.scenario.clutter.count and not wanted and not record.scenario.views.count:
        return clearing_failure(record, why)
    return None


def task_in_words(scenario: Scenario) -> str:
    """What counts as done."""
    wanted, conditions = wanted_touches(scenario), []
    if wanted:
        conditions.append(f"{wanted} touches have been made, or fewer because the pose had settled")
        conditions.append("one of them has met the object")
    elif scenario.clutter.count and not scenario.views.count:
        conditions.append("an image shows nothing in the way of the target any more")
    if scenario.station == "robots":
        conditions.append("the object has truly not fallen over")
    done = f"Done: {', and '.join(conditions)}. " if conditions else ""
    return f"{done}How far the pose is off is a figure of its own."


def _draw_gains(
    record: EpisodeRecord, stages: Sequence[Mapping[str, Any]], model: TargetModel
) -> "Figure | None":
    from crossmodal.diagrams.clutter.results.plots import draw_gains

    return draw_gains(
        view_gains(record),
        touch_gains(record, stages, model),
        {measured.number: outcome(measured) for measured in measurements(record)},
        record.scenario.modalities[0],
        record.scenario.seed,
    )


def _report(summary: Mapping[str, Any]) -> list[str]:
    lines = declutter_report(summary["clutter"]) if "clutter" in summary else []
    lines.append(f"Pose of the {summary['pose']['target']}:")
    for name, found in summary["modalities"].items():
        for stage in found["stages"]:
            what = f"{stage['stage']} {stage['acquisitions'] or ''}".strip()
            if stage["translation_error"] is None:
                claimed = 1000.0 * stage["translation_claimed"]
                lines.append(
                    f"  {name:10s} {what:9s} translation within {claimed:6.2f} mm, claimed"
                )
                continue
            inside = "inside" if stage["inside_claim"] else "outside"
            lines.append(
                f"  {name:10s} {what:9s} translation {1000.0 * stage['translation_error']:6.2f} mm,"
                f" rotation {np.rad2deg(stage['rotation_error']):6.2f} deg,"
                f" ADI {1000.0 * stage['adi']:6.2f} mm, {inside} the claimed 95 % region"
            )
    return lines


def _last(key: str) -> Any:
    return lambda record: record["stages"][-1][key] if record["stages"] else None


def _last_as_met(record: Mapping[str, Any]) -> float | None:
    last = record["stages"][-1] if record["stages"] else {}
    return last["as_met"]["adi"] if "as_met" in last else None


def _before_choice(record: Mapping[str, Any]) -> float | None:
    """ADI before the last four measurements, which are those that were chosen."""
    stages = record["stages"]
    return stages[-5]["adi"] if len(stages) > 4 else None


def _inside(record: Mapping[str, Any]) -> float | None:
    stages = record["stages"][1:]
    return float(np.mean([stage["inside_claim"] for stage in stages])) if stages else None


def metrics() -> list[Metric]:
    """Of an episode, for the tables of evaluations."""
    from crossmodal.diagrams.evaluation.metric_table import (
        mean_and_deviation,
        mean_share,
        median_and_range,
    )

    def median_and_mean(values: Array, unit: str) -> str:
        return f"{median_and_range(values, unit)}, mean {mean_and_deviation(values, unit)}"

    def metric(
        name: str,
        title: str,
        value: Callable[[Mapping[str, Any]], Any],
        unit: str = "m",
        cell: Callable[[Array, str], str] = median_and_range,
    ) -> Metric:
        better: Literal["less", "more"] = "more" if unit == "share" else "less"
        return Metric(name=name, value=value, unit=unit, title=title, cell=cell, better=better)

    return [
        metric("adi", "ADI at the end", _last("adi"), cell=median_and_mean),
        metric("adi_before", "ADI before the last four measurements", _before_choice),
        metric("adi_as_met", "ADI at the end, as the touching arm meets it", _last_as_met),
        metric("translation", "translation error at the end", _last("translation_error")),
        metric("rotation", "rotation error at the end", _last("rotation_error"), "rad"),
        metric(
            "inside",
            "pose inside its claimed 95 % region, all stages",
            _inside,
            "share",
            mean_share,
        ),
    ]
