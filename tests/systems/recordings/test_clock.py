"""Stamps count as long as their clock goes on."""

from crossmodal.systems.recordings.clock import StampClock

S, START = 1_000_000_000, 1_700_000_000_000_000_000


def times(pairs: list[tuple[int, int]]) -> list[int]:
    clock = StampClock()
    return [clock.time(stamp, logged) - START for stamp, logged in pairs]


def test_stamps_near_the_log_are_taken_as_they_are() -> None:
    assert times([(START, START + S // 10), (START + S, START + S + S // 2)]) == [0, S]


def test_without_a_stamp_the_log_counts() -> None:
    assert times([(0, START), (0, START + S)]) == [0, S]


def test_another_computers_clock_keeps_its_intervals() -> None:
    rows = [(5 * S, START), (6 * S, START + S + 3), (7 * S, START + 2 * S - 4)]
    assert times(rows) == [0, S, 2 * S]


def test_a_clock_that_is_set_goes_on_from_the_log() -> None:
    clock = StampClock()
    pairs = [(START, 0), (START + S, S), (100 * S, 2 * S), (101 * S, 3 * S)]
    found = [clock.time(stamp, START + logged) - START for stamp, logged in pairs]
    assert found == [0, S, 2 * S, 3 * S]
    assert clock.jumps == 1


def test_a_log_whose_times_stand_still_is_not_believed() -> None:
    assert times([(START + k * S, START) for k in range(3)]) == [0, S, 2 * S]
