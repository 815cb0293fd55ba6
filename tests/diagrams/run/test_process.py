"""An episode in a process of its own."""

import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.run import process
from crossmodal.diagrams.run.process import (
    EpisodeWarning,
    ending_with_this_process,
    peak_memory,
    run_apart,
    thread_limits,
)


def test_an_episode_whose_folder_cannot_be_made_is_a_failure(tmp_path: Path) -> None:
    (tmp_path / "seed-0000").write_text("a file")
    summary = run_apart(*load_scenario("drawer"), tmp_path / "seed-0000", {})
    assert not summary["success"]
    assert "seed-0000: cannot be written" in summary["failure"]


def test_an_episode_s_folder_that_is_a_link_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "seed-0000").symlink_to(tmp_path / "mine")
    summary = run_apart(*load_scenario("drawer"), tmp_path / "seed-0000", {})
    assert "seed-0000: is a link to somewhere else" in summary["failure"]
    assert list((tmp_path / "mine").iterdir()) == []


def test_a_process_that_is_killed_while_it_runs_is_reported(tmp_path: Path) -> None:
    def kill() -> None:
        while not process._RUNNING:
            time.sleep(0.01)
        process.stop_running()

    threading.Thread(target=kill).start()
    summary = run_apart(*load_scenario("drawer"), tmp_path / "seed-0000", {})
    assert summary["failure"] == "worker died (SIGKILL), see log.txt"
    assert not process._RUNNING


def test_what_an_episode_could_not_draw_is_told_and_its_summary_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    reason = "a.png: cannot be drawn: ValueError: no such colour"
    code = f"import pathlib, sys; pathlib.Path(sys.argv[1], 'error.txt').write_text({reason!r})"
    monkeypatch.setattr(process, "_COMMAND", (sys.executable, "-c", f"{code}; sys.exit(1)"))
    monkeypatch.setattr(process, "finished_summary", lambda *_: {"success": True})
    with pytest.warns(EpisodeWarning, match=reason):
        assert run_apart(*load_scenario("drawer"), tmp_path, {}) == {"success": True}


def test_an_episode_with_one_core_draws_in_the_thread_that_asks_for_it() -> None:
    assert thread_limits(4)["LP_NUM_THREADS"] == "4"
    assert thread_limits(1)["LP_NUM_THREADS"] == "0"
    assert thread_limits(1)["OPENCV_FOR_THREADS_NUM"] == "1"


def test_memory_is_counted_in_bytes() -> None:
    assert 1e7 < peak_memory() < 1e12


def test_an_episode_that_is_killed_after_its_summary_has_died(tmp_path: Path) -> None:
    (tmp_path / "summary.json").write_text("{}")
    assert process._reason(tmp_path, -9) == "worker died (SIGKILL), see log.txt"


BEATS = """
import sys, time
from pathlib import Path
from joblib import Parallel, delayed
from crossmodal.diagrams.run.process import ending_with_this_process

def beat(path):
    for _ in range(600):
        Path(path).write_text(str(time.time()))
        time.sleep(0.1)

if __name__ == "__main__":
    Parallel(n_jobs=2)(delayed(ending_with_this_process(beat))(path) for path in sys.argv[1:])
"""


def test_workers_end_with_whoever_started_them_however_that_ends(tmp_path: Path) -> None:
    script, paths = tmp_path / "beats.py", [tmp_path / "a", tmp_path / "b"]
    script.write_text(BEATS)
    with subprocess.Popen([sys.executable, str(script), *map(str, paths)]) as starter:
        _wait_until(lambda: all(path.exists() for path in paths))
        starter.kill()

    def is_over() -> bool:
        before = [path.read_text() for path in paths]
        time.sleep(0.5)
        return before == [path.read_text() for path in paths]

    _wait_until(is_over)


def test_in_the_same_process_nothing_is_watched() -> None:
    before = threading.active_count()
    assert ending_with_this_process(max)(3, 5) == 5
    assert threading.active_count() == before


def _wait_until(condition: Callable[[], bool]) -> None:
    for _ in range(600):
        if condition():
            return
        time.sleep(0.1)
    raise AssertionError("it took too long")
