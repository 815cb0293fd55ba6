"""What a live view costs: the time of an episode with it, beside that without it.

    python -m benchmarks.live_view [--scenario drawer] [--seconds 8] [--watch | --page]

Both episodes are simulated in turns, tick by tick, so that what else the machine does slows both
alike. The ratio of each quarter says whether drawing grows with the episode's length. Processor
time is that of this process alone; what a browser takes on the same machine shows in wall time.
"""

import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from tempfile import TemporaryDirectory
from typing import Annotated

import numpy as np
import typer
from tqdm import tqdm

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.drawing.meshcat import start_meshcat
from crossmodal.diagrams.run.episode import Episode
from crossmodal.systems.compile_ahead import compile_ahead

PARTS = 4
_FLAGS = ["--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
_FLAGS += ["--window-size=640,480", "--remote-debugging-port=0"]  # By which it stays open.


def main(
    scenario: Annotated[str, typer.Option(help="Its name.")] = "drawer",
    seed: Annotated[int, typer.Option(help="Of the episode.")] = 0,
    seconds: Annotated[float, typer.Option(min=1.0, help="That are simulated.")] = 8.0,
    watch: Annotated[bool, typer.Option("--watch", help="Wait until a page is open.")] = False,
    page: Annotated[
        bool,
        typer.Option("--page", help="Open it in a Chromium without a window or graphics card."),
    ] = False,
) -> None:
    """Prints wall and processor time of both, and their ratios."""
    application, chosen = load_scenario(scenario, [f"seed={seed}"])
    compile_ahead(application.name)
    meshcat = start_meshcat()
    episodes = [
        Episode(application, chosen),
        Episode(application, chosen, meshcat, is_live=True),
    ]
    print(f"The page is at {meshcat.web_url()}")
    with opened_page(meshcat.web_url()) if page else no_page() as let_it_run:
        while (watch or page) and meshcat.GetNumActiveConnections() == 0:
            time.sleep(0.1)
        times_of = timed(episodes, chosen.network_period, seconds, let_it_run)
    for name, times in times_of.items():
        plain, live = times.sum(axis=1) / seconds
        print(f"{name:9s} {plain:6.2f} s/s without, {live:6.2f} s/s with it: {live / plain:.3f}")
        parts = np.array_split(times, PARTS, axis=1)
        ratios = ", ".join(f"{np.divide(*part.sum(axis=1)[::-1]):.3f}" for part in parts)
        print(f"{'':9s} in each of {PARTS} parts: {ratios}")


def timed(
    episodes: list[Episode], period: float, seconds: float, let_it_run: Callable[[bool], None]
) -> dict[str, np.ndarray]:
    """Wall and processor time (2, ticks) of both episodes, tick by tick, [s].

    Args:
        episodes: Without and with a view.
        period: Of the ticks, [s].
        seconds: That are simulated.
        let_it_run: Lets the browser run or stops it, which only the second episode has.
    """
    simulators = [episode.Start() for episode in episodes]
    between = [episode.between_ticks() for episode in episodes]
    ticks = int(seconds / period)
    wall, processor = np.zeros((2, ticks)), np.zeros((2, ticks))
    for tick in tqdm(range(ticks), desc="ticks", disable=None):
        now = (tick + 1) * period
        for which in (0, 1) if tick % 2 else (1, 0):
            let_it_run(which == 1)
            began = time.perf_counter(), time.process_time()
            simulators[which].AdvanceTo(now)
            between[which](now)
            wall[which, tick] = time.perf_counter() - began[0]
            processor[which, tick] = time.process_time() - began[1]
    return {"wall": wall, "processor": processor}


@contextmanager
def no_page() -> Iterator[Callable[[bool], None]]:
    """Nobody looks."""
    yield lambda runs: None


@contextmanager
def opened_page(url: str) -> Iterator[Callable[[bool], None]]:
    """The page in a browser without a window; gives what lets the browser run or stops it.

    Raises:
        FileNotFoundError: where no Chromium is installed.
    """
    with TemporaryDirectory() as profile:
        browser = subprocess.Popen(
            ["chromium", *_FLAGS, f"--user-data-dir={profile}", url],
            start_new_session=True,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            yield lambda runs: os.killpg(browser.pid, signal.SIGCONT if runs else signal.SIGSTOP)
        finally:
            os.killpg(browser.pid, signal.SIGKILL)
            browser.wait()


if __name__ == "__main__":
    typer.run(main)
