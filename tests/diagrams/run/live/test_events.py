"""The newest events are lines on the page."""

from unittest.mock import Mock

from crossmodal.diagrams.run.live.events import EventText
from crossmodal.diagrams.run.record import Event, Tick
from crossmodal.diagrams.run.recorder import EpisodeRecorder
from crossmodal.diagrams.run.scenario import Interval
from crossmodal.systems.port_values import StreamHealth


def shown(board: Mock) -> list[str]:
    title, *lines = board.show.call_args.args[0]
    assert title == "door"
    return [line.split("s  ")[1] for line in lines]


def test_phases_disturbances_and_reported_faults_appear_once_and_in_order() -> None:
    board, recorder = Mock(), EpisodeRecorder(0.1, ["vision", "crossmodal"], [])
    text = EventText(board, recorder, [("lights off", Interval(start=1.0, end=2.0))], "door")
    text.begin()
    text.update(0.0)
    assert shown(board) == []
    recorder.events.append(Event(time=0.9, name="closing"))
    dark = {"camera_health_latest": StreamHealth(age=0.2, fault="dark")}
    for record in recorder.estimators.values():
        record.ticks.append(Tick(time=1.1, values=dark))
    text.update(1.2)
    assert shown(board) == ["closing", "lights off", "camera: dark"]
    for record in recorder.estimators.values():
        record.ticks.append(Tick(time=2.1, values={"camera_health_latest": StreamHealth()}))
    text.update(2.2)
    assert shown(board)[3:] == ["lights off: over", "camera: no more dark"]
    text.update(2.3)
    assert board.show.call_count == 3


def test_only_the_newest_lines_stay() -> None:
    board, recorder = Mock(), EpisodeRecorder(0.1, [], [])
    text = EventText(board, recorder, [], "door")
    recorder.events.extend(Event(time=float(k), name=f"phase {k}") for k in range(20))
    text.update(20.0)
    assert shown(board) == [f"phase {k}" for k in range(13, 20)]
