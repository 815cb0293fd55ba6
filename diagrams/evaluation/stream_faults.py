"""When the sensor streams could not be trusted, as the estimators' monitors reported."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from crossmodal.diagrams.evaluation.estimates import Row, scalar
from crossmodal.diagrams.run.record import EpisodeRecord, Event, Tick
from crossmodal.systems.port_values import StreamHealth

_PORT = "_health_latest"


@dataclass(frozen=True, kw_only=True)
class FaultSpan:
    """One fault of one stream, from `start` to `end` [s]; `end` is None where it lasted."""

    stream: str
    fault: str
    start: float
    end: float | None


def healths(tick: Tick) -> dict[str, StreamHealth]:
    """What an estimator's monitors said of their streams, by the stream's name."""
    return {
        port.removesuffix(_PORT): value
        for port, value in tick.values.items()
        if port.endswith(_PORT)
    }


def health_rows(tick: Tick) -> list[Row]:
    """Rows `stream_age` [s] and `stream_fault` (0 or 1), one component per stream."""
    rows = []
    for stream, health in healths(tick).items():
        rows.append(scalar("stream_age", health.age, stream))
        rows.append(scalar("stream_fault", float(bool(health.fault)), stream))
    return rows


def fault_spans(record: EpisodeRecord) -> list[FaultSpan]:
    """All reported faults in order of time; of estimators that report the same, one."""
    found: dict[FaultSpan, None] = {}
    for estimator in record.estimators.values():
        found |= dict.fromkeys(_spans(estimator.ticks))
    return sorted(found, key=lambda span: (span.start, span.stream))


def _spans(ticks: Iterable[Tick]) -> list[FaultSpan]:
    spans: list[FaultSpan] = []
    current: dict[str, tuple[str, float]] = {}
    for tick in ticks:
        for stream, health in healths(tick).items():
            fault, start = current.get(stream, ("", 0.0))
            if health.fault == fault:
                continue
            if fault:
                spans.append(FaultSpan(stream=stream, fault=fault, start=start, end=tick.time))
            current[stream] = (health.fault, tick.time)
    spans += [
        FaultSpan(stream=stream, fault=fault, start=start, end=None)
        for stream, (fault, start) in current.items()
        if fault
    ]
    return spans


def fault_events(spans: Iterable[FaultSpan]) -> list[Event]:
    """The beginning of each fault."""
    return [Event(time=span.start, name=f"{span.stream}: {span.fault}") for span in spans]


def fault_lines(spans: Iterable[Mapping[str, Any]]) -> list[str]:
    """A line for people for each fault, as a summary holds it."""
    lines = []
    for span in spans:
        until = "to the end" if span["end"] is None else f"to {span['end']:.1f} s"
        lines.append(f"{span['stream']}: {span['fault']}, from {span['start']:.1f} s {until}")
    return lines
