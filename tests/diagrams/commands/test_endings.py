import os
import signal

import pytest

from diagrams.commands.endings import GentleInterrupt


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
