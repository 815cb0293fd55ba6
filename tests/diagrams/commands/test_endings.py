import os
import signal
import sys

import pytest
import typer

from crossmodal.diagrams.command_line import main
from crossmodal.diagrams.commands.endings import BAD_INPUT, GentleInterrupt, one_line_errors


def test_an_interrupt_waits_for_the_step_to_end_and_a_second_one_does_not() -> None:
    before = signal.getsignal(signal.SIGINT)
    with GentleInterrupt() as interrupt:
        interrupt.check()
        os.kill(os.getpid(), signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            interrupt.check()
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before


def test_what_may_not_be_written_is_said_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(typer.Exit) as caught, one_line_errors():
        raise PermissionError(13, "set NUMBA_CACHE_DIR to a folder")
    assert caught.value.exit_code == BAD_INPUT
    assert capsys.readouterr().err == "crossmodal: set NUMBA_CACHE_DIR to a folder\n"


@pytest.mark.parametrize("interrupt", [signal.default_int_handler, signal.SIG_IGN])
def test_being_terminated_is_being_interrupted(
    interrupt: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also in a shell's background, where interrupts are ignored."""
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)}
    monkeypatch.setattr(sys, "argv", ["crossmodal", "--version"])
    try:
        signal.signal(signal.SIGINT, interrupt)
        assert main() == 0
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGTERM)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
