"""The live page's buttons and sliders act, by the messages that a browser sends."""

import struct
from collections.abc import Iterator

import pytest
from numpy.testing import assert_allclose
from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import PassThrough

from crossmodal.diagrams.drawing.layers import Layers
from crossmodal.diagrams.run.live.controls import (
    Control,
    ControlKind,
    ControlValues,
    connect_controls,
)
from crossmodal.diagrams.run.live.session import (
    END,
    NEXT,
    PAUSE,
    TICK,
    TRUTH,
    LiveSession,
    stay,
)

SPEED = Control(
    name="speed [cm/s]", port="speed", low=0.0, high=4.0, step=0.5, value=2.0, factor=0.01
)


@pytest.fixture(scope="module")
def meshcat() -> Meshcat:
    return Meshcat()


@pytest.fixture
def session(meshcat: Meshcat) -> Iterator[LiveSession]:
    estimators = {"vision": "/perception/vision", "touch": "/perception/touch"}
    layers = Layers(estimators=estimators, truth="/truth")
    session = LiveSession(meshcat=meshcat, layers=layers, shown="vision", controls=[SPEED])
    yield session
    meshcat.DeleteAddedControls()


def _text(value: str) -> bytes:
    return bytes([0xA0 + len(value)]) + value.encode() if len(value) < 32 else b""


def press(meshcat: Meshcat, name: str) -> None:
    """What a browser sends when a button is pressed, as MessagePack."""
    meshcat._InjectWebsocketMessage(
        message=b"\x82" + _text("type") + _text("button") + _text("name") + _text(name)
    )


def slide(meshcat: Meshcat, name: str, value: float) -> None:
    meshcat._InjectWebsocketMessage(
        message=b"\x83"
        + _text("type")
        + _text("slider")
        + _text("name")
        + _text(name)
        + _text("value")
        + b"\xcb"
        + struct.pack(">d", value)
    )


def test_nothing_pressed_means_go_on(session: LiveSession) -> None:
    session.between_ticks()
    assert not session.is_paused


@pytest.mark.parametrize(("button", "is_next"), [(END, False), (NEXT, True)])
def test_the_episode_is_ended(session: LiveSession, button: str, is_next: bool) -> None:
    press(session.meshcat, button)
    with pytest.raises(KeyboardInterrupt):
        session.between_ticks()
    assert session.wants_next == is_next


def press_later(monkeypatch: pytest.MonkeyPatch, meshcat: Meshcat, button: str) -> list[float]:
    """Presses a button while the session waits for the third time; Meshcat has one thread."""
    waits: list[float] = []

    def sleep(seconds: float) -> None:
        waits.append(seconds)
        if len(waits) == 3:
            press(meshcat, button)

    monkeypatch.setattr("crossmodal.diagrams.run.live.session.time.sleep", sleep)
    return waits


def test_it_waits_while_paused_and_makes_single_ticks(
    session: LiveSession, monkeypatch: pytest.MonkeyPatch
) -> None:
    press(session.meshcat, TICK)
    press(session.meshcat, TICK)
    session.between_ticks()  # The first of two ticks.
    assert session.is_paused
    session.between_ticks()  # The second one.
    waits = press_later(monkeypatch, session.meshcat, PAUSE)
    session.between_ticks()
    assert len(waits) == 3
    assert_allclose(session.waited, sum(waits))
    assert not session.is_paused


def test_one_estimator_is_shown_at_a_time(session: LiveSession) -> None:
    press(session.meshcat, "Show touch")
    session.between_ticks()
    assert session.shown == "touch"
    for path, value in (("touch", b"\xc3"), ("vision", b"\xc2")):  # MessagePack's true and false.
        packed = session.meshcat._GetPackedProperty(f"/perception/{path}", "visible")
        assert packed.endswith(value)


def test_the_truth_is_shown_on_demand(session: LiveSession) -> None:
    for is_shown, value in ((True, b"\xc3"), (False, b"\xc2")):
        press(session.meshcat, TRUTH)
        session.between_ticks()
        assert session.shows_truth == is_shown
        assert session.meshcat._GetPackedProperty("/truth", "visible").endswith(value)


def test_one_estimator_alone_needs_no_button(meshcat: Meshcat) -> None:
    LiveSession(meshcat=meshcat, layers=Layers(estimators={"vision": "/perception/vision"}))
    assert set(meshcat.GetButtonNames()) == {PAUSE, TICK, END, NEXT}


def test_a_change_by_hand_is_noted_once_when_the_slider_has_come_to_rest(
    session: LiveSession,
) -> None:
    assert session.changes() == []
    slide(session.meshcat, SPEED.name, 3.0)
    assert session.changes() == []
    slide(session.meshcat, SPEED.name, 3.5)
    assert session.changes() == []
    assert session.changes() == ["speed 3.5 cm/s"]
    assert session.changes() == []
    cover = Control(name="cover", port="cover", kind=ControlKind.SWITCH)
    assert [cover.written(value) for value in (0.0, 1.0)] == ["cover off", "cover on"]


def test_a_slider_is_an_input_of_the_station(session: LiveSession) -> None:
    station = DiagramBuilder()
    through = station.AddSystem(PassThrough(1))
    station.ExportInput(through.get_input_port(), "speed")
    station.ExportOutput(through.get_output_port(), "seen")
    builder = DiagramBuilder()
    inner = builder.AddSystem(station.Build())
    connect_controls(builder, inner, [SPEED], session.meshcat.GetSliderValue, 0.1)
    simulator = Simulator(builder.Build())

    def seen() -> float:
        context = inner.GetMyContextFromRoot(simulator.get_context())
        return float(inner.GetOutputPort("seen").Eval(context)[0])

    simulator.AdvanceTo(0.15)
    assert_allclose(seen(), 0.02)
    slide(session.meshcat, SPEED.name, 3.5)
    simulator.AdvanceTo(0.35)
    assert_allclose(seen(), 0.035)
    with pytest.raises(ValueError, match="'speed', which the station has not"):
        connect_controls(
            DiagramBuilder(), ControlValues([], lambda name: 0.0, 0.1), [SPEED], float, 1.0
        )


def test_the_page_stays_until_somebody_has_had_enough(
    session: LiveSession, monkeypatch: pytest.MonkeyPatch
) -> None:
    session.close()
    assert not stay(session.meshcat, lambda: True)
    press_later(monkeypatch, session.meshcat, NEXT)
    assert stay(session.meshcat, lambda: False)


def test_the_next_seed_may_be_asked_for_while_the_results_are_written(session: LiveSession) -> None:
    session.close()
    press(session.meshcat, NEXT)
    assert stay(session.meshcat, lambda: True)
