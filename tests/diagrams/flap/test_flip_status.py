"""What the robot says that it does with flap and tool."""

from crossmodal.controllers.servoing.flip_decisions import FlipPhase
from crossmodal.controllers.servoing.tool_line_decisions import LinePhase
from crossmodal.diagrams.flap.flip_status import DONE, FLIPPING, ON_LINE, TO_TABLE, flip_status


def test_only_the_last_phases_end_the_episode():
    done = {
        (flip, line)
        for flip in FlipPhase
        for line in LinePhase
        if flip_status([flip], "", [line], "").done
    }
    failed = {(FlipPhase.FAILED, line) for line in LinePhase}
    assert done == failed | {(FlipPhase.DONE, LinePhase.DONE), (FlipPhase.DONE, LinePhase.FAILED)}


def test_each_phase_has_its_name():
    assert flip_status([FlipPhase.FLIP], "", [LinePhase.WAIT], "").phase == FLIPPING
    names = [flip_status([FlipPhase.DONE], "", [line], "").phase for line in LinePhase]
    assert names == ["retreating", TO_TABLE, TO_TABLE, ON_LINE, DONE, "stopped"]


def test_a_line_that_is_not_begun_is_told_once_the_finger_is_away():
    why = "the tool is not known"
    away = flip_status([FlipPhase.RETREAT], "", [LinePhase.FAILED], why)
    assert not away.done
    assert flip_status([FlipPhase.DONE], "", [LinePhase.FAILED], why).event == why


def test_a_failure_says_why():
    status = flip_status([FlipPhase.FAILED], "contact lost", [LinePhase.WAIT], "")
    assert status.event == "contact lost"
