"""What monitors told of streams becomes spans, events, rows and lines."""

from dataclasses import asdict

from crossmodal.diagrams.evaluation.stream_faults import (
    FaultSpan,
    fault_events,
    fault_lines,
    fault_spans,
    health_rows,
)
from crossmodal.diagrams.run.calibration import Calibration
from crossmodal.diagrams.run.record import EpisodeRecord, EstimatorRecord, Tick
from crossmodal.diagrams.run.scenario import Scenario
from crossmodal.systems.port_values import StreamHealth

HEALTH = ["", "silent", "silent", "", "stuck"]


def estimator(faults: list[str]) -> EstimatorRecord:
    return EstimatorRecord(
        ticks=[
            Tick(
                time=float(k),
                values={"wrench_health_latest": StreamHealth(age=0.1 * k, fault=fault)},
            )
            for k, fault in enumerate(faults)
        ]
    )


def record(estimators: dict[str, EstimatorRecord]) -> EpisodeRecord:
    return EpisodeRecord(
        scenario=Scenario(name="a"),
        calibration=Calibration(),
        station=[],
        estimators=estimators,
        duration=5.0,
        wall_time=1.0,
    )


SPANS = [
    FaultSpan(stream="wrench", fault="silent", start=1.0, end=3.0),
    FaultSpan(stream="wrench", fault="stuck", start=4.0, end=None),
]


def test_spans_reach_from_the_first_tick_to_the_one_after_the_last() -> None:
    assert fault_spans(record({"one": estimator(HEALTH)})) == SPANS


def test_what_two_estimators_tell_alike_is_told_once() -> None:
    both = {"one": estimator(HEALTH), "two": estimator(HEALTH), "three": estimator([""] * 5)}
    assert fault_spans(record(both)) == SPANS


def test_a_fault_that_becomes_another_is_two() -> None:
    spans = fault_spans(record({"one": estimator(["a", "b"])}))
    assert [(span.fault, span.start, span.end) for span in spans] == [
        ("a", 0.0, 1.0),
        ("b", 1.0, None),
    ]


def test_spans_are_events_and_lines() -> None:
    events = [(event.time, event.name) for event in fault_events(SPANS)]
    assert events == [(1.0, "wrench: silent"), (4.0, "wrench: stuck")]
    assert fault_lines([asdict(span) for span in SPANS]) == [
        "wrench: silent, from 1.0 s to 3.0 s",
        "wrench: stuck, from 4.0 s to the end",
    ]


def test_rows_tell_age_and_fault_by_stream() -> None:
    rows = health_rows(estimator(HEALTH).ticks[1])
    assert [(quantity, component, value) for quantity, component, value, *_ in rows] == [
        ("stream_age", "wrench", 0.1),
        ("stream_fault", "wrench", 1.0),
    ]
