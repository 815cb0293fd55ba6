"""Counts episodes per hour by workers: how well episodes side by side share the machine.

    python -m benchmarks.evaluation [--jobs 1,2] [--episodes 4] [--duration 6]

Run it where nothing else runs. One episode goes ahead, so that everything is compiled.
"""

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path
from time import perf_counter

from tqdm import tqdm

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.evaluation.campaign import Workers, run_episodes
from crossmodal.diagrams.run.application import Application
from crossmodal.diagrams.run.scenario import Scenario

Episodes = tuple[Application, list[Scenario]]


def episodes(name: str, duration: float, seeds: range) -> Episodes:
    """The application of a scenario, and the scenario with each seed."""
    application, scenario = load_scenario(name, [f"duration={duration}"])
    return application, [replace(scenario, seed=seed) for seed in seeds]


def run(chosen: Episodes, jobs: int) -> float:
    """Episodes per hour."""
    application, scenarios = chosen
    with tempfile.TemporaryDirectory() as folder:
        began = perf_counter()
        summaries = run_episodes(application, scenarios, Path(folder), Workers(jobs=jobs))
        bar = tqdm(summaries, total=len(scenarios), desc=f"{jobs} workers", disable=None)
        broken = [summary["failure"] for summary in bar if not summary["modalities"]]
        if broken:
            raise SystemExit(f"an episode broke off: {broken[0]}")
        return 3600.0 * len(scenarios) / (perf_counter() - began)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenario", default="drawer")
    parser.add_argument("--jobs", default="1,2", help="numbers of workers; the first is compared")
    parser.add_argument("--episodes", type=int, default=4, help="per worker")
    parser.add_argument("--duration", type=float, default=6.0, help="simulated, [s]")
    arguments = parser.parse_args()
    run(episodes(arguments.scenario, 0.5, range(1)), 1)
    workers = [int(number) for number in arguments.jobs.split(",")]
    rates: dict[int, float] = {}
    for jobs in workers:
        seeds = range(arguments.episodes * jobs)
        rates[jobs] = run(episodes(arguments.scenario, arguments.duration, seeds), jobs)
    print(f"\nEpisodes of {arguments.duration:g} s ({arguments.scenario}):\n")
    print(f"| workers | episodes per hour | against {workers[0]} |")
    print("|---|---|---|")
    for jobs, rate in rates.items():
        print(f"| {jobs} | {rate:.0f} | {rate / rates[workers[0]]:.2f} |")


if __name__ == "__main__":
    main()
