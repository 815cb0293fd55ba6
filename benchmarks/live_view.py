"""What a live view costs: the time of an episode with it, beside that without it.

    python -m benchmarks.live_view [--scenario drawer] [--seconds 8] [--watch]

Both episodes are simulated in turns, tick by tick, so that what else the machine does slows both
alike. The ratio of each quarter says whether drawing grows with the episode's length.
"""

import time
from typing import Annotated

import numpy as np
import typer
from tqdm import tqdm

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.drawing.meshcat import start_meshcat
from crossmodal.diagrams.run.episode import Episode
from crossmodal.systems.compile_ahead import compile_ahead

PARTS = 4


def main(
    scenario: Annotated[str, typer.Option(help="Its name.")] = "drawer",
    seed: Annotated[int, typer.Option(help="Of the episode.")] = 0,
    seconds: Annotated[float, typer.Option(min=1.0, help="That are simulated.")] = 8.0,
    watch: Annotated[bool, typer.Option("--watch", help="Wait until a page is open.")] = False,
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
    while watch and meshcat.GetNumActiveConnections() == 0:
        time.sleep(0.1)
    simulators = [episode.Start() for episode in episodes]
    between = [episode.between_ticks() for episode in episodes]
    ticks = int(seconds / chosen.network_period)
    wall, processor = np.zeros((2, ticks)), np.zeros((2, ticks))
    for tick in tqdm(range(ticks), desc="ticks", disable=None):
        now = (tick + 1) * chosen.network_period
        order = (0, 1) if tick % 2 else (1, 0)
        for which in order:
            began = time.perf_counter(), time.process_time()
            simulators[which].AdvanceTo(now)
            between[which](now)
            wall[which, tick] = time.perf_counter() - began[0]
            processor[which, tick] = time.process_time() - began[1]
    for name, times in (("wall", wall), ("processor", processor)):
        plain, live = times.sum(axis=1) / seconds
        print(f"{name:9s} {plain:6.2f} s/s without, {live:6.2f} s/s with it: {live / plain:.3f}")
        parts = np.array_split(times, PARTS, axis=1)
        ratios = ", ".join(f"{np.divide(*part.sum(axis=1)[::-1]):.3f}" for part in parts)
        print(f"{'':9s} in each of {PARTS} parts: {ratios}")


if __name__ == "__main__":
    typer.run(main)
