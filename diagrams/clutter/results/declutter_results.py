"""What clearing the way comes to: the actions, what they did, and what moved besides."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from crossmodal.diagrams.clutter.results.graph_picture import graph_picture
from crossmodal.diagrams.clutter.scenario import object_names, target_name
from crossmodal.diagrams.clutter.start import true_offset
from crossmodal.diagrams.run.experiment import Metric
from crossmodal.diagrams.run.record import EpisodeRecord
from crossmodal.maths.gaussian import chi_square_gate
from crossmodal.plants.goods.clutter_density import nearer_than
from crossmodal.systems.declutter.declutter_sequence import LEFT_ALONE, UNREACHABLE
from crossmodal.systems.port_values import (
    NO_PROGRESS,
    ArmOffset,
    DeclutterAction,
    DeclutterGraph,
    DeclutterProgress,
    DeclutterStep,
    ObjectMasks,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_TITLES = {
    DeclutterAction.GRASP: "grasps that held until the object was put down",
    DeclutterAction.PUSH: "pushes that went all the way",
}
_MOVED = 0.02  # A target that was moved by more is to be noticed, [m].

# What one does, and how the other ends, where all goes well.
_DONE = {DeclutterAction.GRASP: "placed", DeclutterAction.PUSH: "pushed"}


def declutter_summary(record: EpisodeRecord) -> dict[str, Any]:
    """What `summary.json` says of it, SI: the objects, the actions in order, why it ended.

    An action worked if its object is not where it was any more, and all went well; it is
    `out_of_the_way` if it hangs on the target no more in the next image. `graphs` are those of the
    images, an edge for each object that hangs together with the target, and `image` of an action
    is the number of that by which it was chosen. `in_the_way` is
    how many objects hung together with the target in the first image that showed it, `is_free`
    whether none does at the end. `near_before` and `near_after` are the names of those that truly
    were nearer to it than `declutter.near`. `target_moved` is how far the target was truly moved
    by all actions, `target_noticed` whether an image showed that it was. `staying` is what nothing
    could be done with in the last image, and why. `arm_offset` is by how much the arm meets objects
    beside where the camera sees them.
    """
    progress = _progress(record)
    graphs = _graphs(record)
    with_target = [graph for graph in graphs if graph.vertices and not graph.is_guess]
    targets = {graph.vertices[0].segment.number for graph in with_target}
    density = record.station_values("cheat_clutter_density")
    return {
        "objects": object_names(record.scenario),
        "density": asdict(density[0]) if density else None,
        "actions": [_action(progress, graphs, k) for k in range(len(progress.steps))],
        "graphs": [_graph(graph) for graph in graphs],
        "in_the_way": next((len(graph.vertices) - 1 for graph in with_target), None),
        "near_before": _truly_near(record, 0),
        "near_after": _truly_near(record, cleared_at(record) if progress.done else -1),
        "target_found": progress.found,
        "is_free": progress.done and not progress.why,
        "ended": progress.why or ("the target is free" if progress.done else "not yet"),
        "staying": [
            {"object": v.segment.name or "unknown", "number": v.segment.number, "why": v.why}
            for graph in graphs[-1:]
            for v in graph.vertices[1:]
            if v.action is None
        ],
        "target_moved": _target_moved(record),
        "target_noticed": any(targets & set(step.others) for step in progress.steps),
        "arm_offset": _arm_offset(record),
    }


def clearing_failure(record: EpisodeRecord, note: str) -> str | None:
    """Why something is still in the way; None where nothing is, or nothing was to be taken away.

    Args:
        record: Of the episode.
        note: The station's last one, which says what stopped it.
    """
    progress = _progress(record)
    if not progress.done:
        return note or "the time was over while something was in the way"
    return progress.why if progress.why not in ("", LEFT_ALONE) else None


def cleared_at(record: EpisodeRecord) -> int:
    """Index of the tick from which on no more is cleared away; zero where nothing was."""
    for k, tick in enumerate(record.station):
        if tick.values.get("declutter_progress", NO_PROGRESS).done:
            return k
    return 0


def succeeded(step: DeclutterStep) -> bool:
    """Whether an action did what it was to do."""
    return step.worked and step.outcome == _DONE[step.action]


def step_pictures(record: EpisodeRecord) -> dict[str, "Callable[[], Figure]"]:
    """A picture of each image by which something was decided, by file name."""
    masks: dict[int, ObjectMasks] = {m.number: m for m in record.station_values("object_masks")}
    steps = {step.image: step for step in _progress(record).steps}
    pictures: dict[str, Callable[[], Figure]] = {}
    for graph in _graphs(record):
        step = steps.get(graph.number)
        title = graph.why or "looked at again from elsewhere"
        if step is not None:
            title = _in_words(step)
        draw = partial(_picture, graph, masks.get(graph.number), title)
        pictures[f"step-{len(pictures) + 1:02d}.png"] = draw
    return pictures


def _progress(record: EpisodeRecord) -> DeclutterProgress:
    values: list[DeclutterProgress] = record.station_values("declutter_progress")
    return values[-1] if values else NO_PROGRESS


def _graphs(record: EpisodeRecord) -> list[DeclutterGraph]:
    """All that were made until the target was free."""
    end = cleared_at(record) + 1 if _progress(record).done else None
    graphs = record.station_values("declutter_graph")[:end]
    return list({graph.number: graph for graph in graphs if graph.number > 0}.values())


def _action(
    progress: DeclutterProgress, graphs: Sequence[DeclutterGraph], k: int
) -> dict[str, Any]:
    step = progress.steps[k]
    kind = (step.object, step.action)
    alike = [s for s in progress.steps[: k + 1] if (s.object, s.action) == kind]
    gone = not np.isfinite(step.displacement)
    after = next((g for g in graphs if g.number > step.image), None)
    left = None if after is None else {v.segment.number for v in after.vertices}
    return {
        "object": step.name or "unknown",
        "number": step.object,
        "image": step.image,
        "kind": str(step.action),
        "outcome": step.outcome,
        "tries": len(alike),
        "success": succeeded(step),
        "out_of_the_way": None if left is None else step.object not in left,
        "displacement": None if gone else step.displacement,
        "others_moved": list(step.others),
    }


def _graph(graph: DeclutterGraph) -> dict[str, Any]:
    """A graph, its edges from the target outwards, and the best push where one was chosen."""
    chosen = graph.next if graph.next >= 0 else None
    edges = [
        {
            "object": v.segment.name or "unknown",
            "number": v.segment.number,
            "hangs_on": v.parent,
            "weight": v.weight,
            "grasp_quality": v.quality,
            "action": None if v.action is None else str(v.action),
            "why": v.why,
        }
        for v in graph.vertices[1:]
    ]
    return {
        "image": graph.number,
        "target": graph.vertices[0].segment.number if graph.vertices else None,
        "target_seen": bool(graph.vertices) and not graph.is_guess,
        "edges": edges,
        "apart": [segment.name or "unknown" for segment in graph.apart],
        "next": chosen,
        "is_covered": graph.is_covered,
        "push": [
            {"length": push.length, "meets": list(push.meets), "topples": push.topples}
            for push in graph.pushes[:1]
        ],
        "why": graph.why,
    }


def _truly_near(record: EpisodeRecord, tick: int) -> list[str] | None:
    """Names of the objects that are in the target's way; None where the truth is not known."""
    scenario = record.scenario
    ports = {target_name(scenario): "cheat_object_pose"}
    ports |= {name: f"cheat_{name}_pose" for name in object_names(scenario)}
    values = record.station[tick].values
    if not all(port in values for port in ports.values()):
        return None
    poses = {name: values[port] for name, port in ports.items()}
    return nearer_than(poses, target_name(scenario), scenario.declutter.near)


def _target_moved(record: EpisodeRecord) -> float | None:
    """From the begin to when no more is cleared away, [m]; None where the truth is not known."""
    poses = record.station_values("cheat_object_pose")
    if not poses:
        return None
    end = poses[cleared_at(record)] if _progress(record).done else poses[-1]
    return float(np.linalg.norm(end.translation() - poses[0].translation()))


def _arm_offset(record: EpisodeRecord) -> dict[str, Any] | None:
    """What was learned of it, where the target was at first; None where nothing was seen."""
    poses = record.station_values("cheat_object_pose")
    masks: list[ObjectMasks] = [m for m in record.station_values("object_masks") if m.number > 0]
    offsets: list[ArmOffset] = record.station_values("arm_offset")
    if not (poses and masks and offsets):
        return None
    p, last = poses[0].translation(), offsets[-1]
    true = true_offset(record.scenario, record.calibration, masks[0].X_WC, p)
    mean, covariance = last.mean, last.covariance
    error = true - mean
    distance = float(error @ np.linalg.solve(covariance, error))
    return {
        "true": true.tolist(),
        "believed": mean.tolist(),
        "deviation": np.sqrt(np.diag(covariance)).tolist(),
        "error_before": float(np.linalg.norm(true)),
        "error": float(np.linalg.norm(error)),
        "inside_claim": distance < chi_square_gate(0.05, len(error)),
    }


def _in_words(step: DeclutterStep) -> str:
    moved = "is not seen any more"
    if np.isfinite(step.displacement):
        moved = f"went {100.0 * step.displacement:.0f} cm"
    others = f", moved {', '.join(map(str, step.others))}, too" if step.others else ""
    return f"{step.action} of {step.object} {step.name}: {step.outcome}; {moved}{others}"


def _picture(graph: DeclutterGraph, masks: ObjectMasks | None, title: str) -> "Figure":
    figure = graph_picture(graph, None if masks is None else masks.colour)
    figure.suptitle(title)
    return figure


def declutter_metrics() -> list[Metric]:
    """Of an episode, for the tables of evaluations."""
    from crossmodal.diagrams.evaluation.metric_table import mean_and_deviation, mean_share, total

    def share(kind: DeclutterAction) -> Callable[[Mapping[str, Any]], float | None]:
        def value(summary: Mapping[str, Any]) -> float | None:
            done = [a["success"] for a in begun(summary) if a["kind"] == kind]
            return float(np.mean(done)) if done else None

        return value

    def count(kind: DeclutterAction) -> Callable[[Mapping[str, Any]], float]:
        return lambda summary: float(sum(a["kind"] == kind for a in begun(summary)))

    def done(kind: DeclutterAction) -> Callable[[Mapping[str, Any]], float]:
        return lambda summary: float(sum(a["success"] for a in begun(summary) if a["kind"] == kind))

    def actions_per_object(summary: Mapping[str, Any]) -> float | None:
        count = summary["clutter"]["in_the_way"]
        return len(begun(summary)) / count if count else None

    def near(when: str) -> Callable[[Mapping[str, Any]], float | None]:
        def value(summary: Mapping[str, Any]) -> float | None:
            names = summary["clutter"][f"near_{when}"]
            return None if names is None else float(len(names))

        return value

    def unnoticed(summary: Mapping[str, Any]) -> bool:
        clutter = summary["clutter"]
        return bool((clutter["target_moved"] or 0.0) > _MOVED and not clutter["target_noticed"])

    def noticed_wrongly(summary: Mapping[str, Any]) -> bool | None:
        clutter = summary["clutter"]
        if clutter["target_moved"] is None:
            return None
        return bool(clutter["target_noticed"] and clutter["target_moved"] < 0.5 * _MOVED)

    def out_of_the_way(summary: Mapping[str, Any]) -> float | None:
        away = [bool(a["out_of_the_way"]) for a in begun(summary)]
        return float(np.mean(away)) if away else None

    def of_offset(key: str) -> Callable[[Mapping[str, Any]], Any]:
        return lambda summary: (summary["clutter"].get("arm_offset") or {}).get(key)

    def totals(kind: DeclutterAction) -> list[Metric]:
        return [
            Metric(name=name, value=value, by_estimator=False, title=title, cell=total)
            for name, value, title in (
                (f"{kind}_count", count(kind), f"{kind} actions that were begun, in all"),
                (f"{kind}_done", done(kind), f"{kind} actions that did what they should, in all"),
            )
        ]

    return [
        *(
            Metric(
                name=f"{kind}_success",
                better="more",
                value=share(kind),
                unit="share",
                by_estimator=False,
                title=_TITLES[kind],
                cell=mean_share,
            )
            for kind in DeclutterAction
        ),
        *(metric for kind in DeclutterAction for metric in totals(kind)),
        Metric(
            name="out_of_the_way",
            better="more",
            value=out_of_the_way,
            unit="share",
            by_estimator=False,
            title="actions after which the object was not in the way any more",
            cell=mean_share,
        ),
        Metric(
            name="actions_per_object",
            better="less",
            value=actions_per_object,
            by_estimator=False,
            title="actions for each object that was in the way",
            cell=mean_and_deviation,
        ),
        *(
            Metric(
                name=f"near_{when}",
                value=near(when),
                by_estimator=False,
                title=f"objects that truly were in the way {when}",
                cell=mean_and_deviation,
            )
            for when in ("before", "after")
        ),
        Metric(
            name="is_free",
            better="more",
            value=lambda summary: summary["clutter"]["is_free"],
            by_estimator=False,
            title="nothing in the way any more",
            cell=mean_share,
        ),
        Metric(
            name="hidden_above",
            value=lambda summary: (summary["clutter"]["density"] or {}).get("hidden_above"),
            by_estimator=False,
            unit="share",
            title="share of the target that was hidden from above",
            cell=mean_and_deviation,
        ),
        *(
            Metric(
                name=f"offset_{key}",
                better="less",
                value=of_offset(key),
                by_estimator=False,
                unit="m",
                title=f"error of where the arm meets what is seen, {when}",
                cell=mean_and_deviation,
            )
            for key, when in (("error_before", "at first"), ("error", "at the end"))
        ),
        Metric(
            name="offset_inside",
            better="more",
            value=of_offset("inside_claim"),
            by_estimator=False,
            title="the same at the end, inside its claimed 95 % region",
            cell=mean_share,
        ),
        Metric(
            name="moved_unnoticed",
            better="less",
            value=unnoticed,
            by_estimator=False,
            title="target moved by more than 2 cm, and no image showed it",
            cell=mean_share,
        ),
        Metric(
            name="noticed_wrongly",
            better="less",
            value=noticed_wrongly,
            by_estimator=False,
            title="target said to have moved, but it has by less than 1 cm",
            cell=mean_share,
        ),
    ]


def begun(summary: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The actions for which the arm has moved."""
    return [a for a in summary["clutter"]["actions"] if a["outcome"] != UNREACHABLE]


def declutter_report(clutter: Mapping[str, Any]) -> list[str]:
    """What a person reads of it after a run, from what `declutter_summary` gave."""
    lines = [f"{len(clutter['objects'])} objects around the target:"]
    for action in clutter["actions"]:
        how = "done" if action["success"] else "failed"
        lines.append(f"  {action['kind']} of the {action['object']}: {action['outcome']} ({how})")
    staying = [f"  the {each['object']} stays: {each['why']}" for each in clutter["staying"]]
    return [*lines, *staying, f"  {clutter['ended']}"]
