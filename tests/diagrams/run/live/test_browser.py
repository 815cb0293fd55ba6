"""The live page in a real browser: its controls act, and it outlives the episode."""

import json
import os
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from chromium import PATIENCE, browser, page_at

from crossmodal.diagrams.applications import OWN
from crossmodal.diagrams.run.live.controls import page_name
from crossmodal.diagrams.run.live.session import END, NEXT, PAUSE, TICK, TRUTH

ROD = "['drake', 'visualizer', 'rod']"
TORQUE = "torque [N m]"


@pytest.fixture(scope="module")
def page_of() -> Iterator[Callable[[str], Any]]:
    """Opens a page; skips where there is no browser."""
    with browser() as opened:
        yield partial(page_at, opened)


@pytest.fixture
def run(tmp_path: Path, page_of: Any) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A live run that waits for its first tick, and its address."""
    with socket.socket() as probe:
        probe.bind(("localhost", 0))
        port = probe.getsockname()[1]
    own = Path(__file__).with_name("swinging.py")
    command = [sys.executable, "-m", "crossmodal.diagrams.command_line", "run", "push"]
    command += ["--meshcat", "--paused", "--port", str(port), "--out", "run"]
    process = subprocess.Popen(
        command,
        cwd=tmp_path,
        env=os.environ | {OWN: str(own), "PYTHONUNBUFFERED": "1"},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    for line in process.stdout:
        if "Watch it at" in line:
            break
    yield process, f"http://localhost:{port}"
    process.kill()
    process.wait()


def press(page: Any, name: str) -> None:
    page.get_by_text(name, exact=True).click()


def angle(page: Any) -> float:
    """By which the pendulum hangs on the page, the sine of it."""
    return float(page.evaluate(f"viewer.scene_tree.find({ROD}).object.matrix.elements[8]"))


def wait_for(page: Any, condition: str) -> None:
    page.wait_for_function(condition, polling=200)


def test_a_person_moves_a_control_and_the_page_stays_when_the_episode_has_ended(
    run: tuple[subprocess.Popen[str], str], page_of: Callable[[str], Any], tmp_path: Path
) -> None:
    process, url = run
    page = page_of(url)
    page.get_by_text(TRUTH, exact=True).wait_for(state="attached")
    press(page, "Open Controls")
    wait_for(page, f"viewer.scene_tree.find({ROD}).object.children.length > 0")
    assert angle(page) == 0.0  # It waits, and hangs.
    slider = page.locator("li", has_text=TORQUE).locator("input")
    slider.fill("2")
    slider.press("Enter")
    for _ in range(3):
        press(page, TICK)
    moved = f"Math.abs(viewer.scene_tree.find({ROD}).object.matrix.elements[8])"
    wait_for(page, f"{moved} > 1e-3")
    shown = "viewer.scene_tree.find(['truth']).object.visible"
    assert not page.evaluate(shown)
    press(page, TRUTH)
    wait_for(page, shown)
    press(page, page_name("Show the right one's"))
    wait_for(page, "!viewer.scene_tree.find(['perception', 'left']).object.visible")
    assert page.evaluate("viewer.scene_tree.find(['perception', 'right']).object.visible")
    press(page, PAUSE)
    wait_for(page, f"{moved} > 0.05")
    press(page, END)
    assert process.stdout is not None
    for line in process.stdout:
        if "The page stays" in line:
            break
    page.get_by_text(END, exact=True).wait_for(state="detached")
    assert page.get_by_text(NEXT, exact=True).is_visible()
    wait_for(page_of(url), f"{moved} > 1e-3")  # Whoever opens it now sees where it ended.
    assert process.stdin is not None
    process.stdin.write("\n")
    process.stdin.close()
    assert process.wait(1e-3 * PATIENCE) == 130
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert "by hand: torque 2 N m" in [event["name"] for event in summary["events"]]
