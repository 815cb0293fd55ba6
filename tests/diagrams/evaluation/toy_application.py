"""An application of two estimators and two metrics, of which nothing is ever run."""

from pathlib import Path
from typing import Any

from crossmodal.diagrams.evaluation.metric_table import count, median_and_range
from crossmodal.diagrams.run.application import Application, Station
from crossmodal.diagrams.run.experiment import Column, Experiment, Metric, Reference
from crossmodal.diagrams.run.scenario import Scenario


def _nothing(*_: Any) -> Any:
    raise AssertionError("nothing of the toy is ever run")


def _station(scenario: Scenario, calibration: Any) -> Station:
    return Station(diagram=_nothing())


TOY = Application(
    name="toy",
    description="two eyes measure a distance",
    scenario=Scenario,
    scenarios=Path(__file__).parent,
    make_station=_station,
    make_estimators=_nothing,
    quantities=lambda scenario: (),
    evaluate=_nothing,
    labels={"left": "the left eye"},
    colors={"left": "#AA0000"},
    metrics=(
        Metric(
            name="distance_error",
            value=lambda record: record["distance_error"],
            unit="m",
            title="error of the distance",
            better="less",
            cell=median_and_range,
        ),
        Metric(
            name="score",
            value=lambda summary: summary["score"] > 3,
            by_estimator=False,
            title="scored",
            cell=count,
            better="more",
            totals=True,
        ),
    ),
    experiments={
        "near": Experiment(
            scenario="near",
            description="something near",
            references={
                "distance_error": Reference(paper="3 mm", goal="1 mm"),
                "score": Reference(goal="all"),
            },
            notes=("It is near.",),
        ),
        "far": Experiment(scenario="far", description="something far", without=("score",)),
    },
    overview=(
        Column(header="done", metric="success"),
        Column(header="left", metric="distance_error", estimator="left"),
        Column(header="scored", metric="score"),
    ),
)


def toy_summary(
    seed: int, left: float | None, right: float | None, score: int = 5
) -> dict[str, Any]:
    """An episode of the toy, by its estimators' errors, [m]."""
    return {
        "scenario": "near",
        "seed": seed,
        "success": True,
        "failure": None,
        "score": score,
        "duration": 20.0,
        "wall_time": 10.0,
        "real_time_factor": 2.0,
        "peak_memory": 1e9,
        "modalities": {
            name: {"distance_error": error, "tick": {"median": 0.02, "p95": 0.03}}
            for name, error in (("right", right), ("left", left))
        },
    }
