"""Runs the episodes of an experiment, and goes on where it was stopped."""

import json
import logging
import os
import socket
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from diagrams.run import process
from diagrams.run.application import Application
from diagrams.run.experiment import Experiment
from diagrams.run.run_folder import (
    fingerprint,
    finished_summary,
    open_run_folder,
    versions,
    write_text,
)
from diagrams.run.scenario import Scenario
from diagrams.run.yaml_schema import ScenarioError, one_line, suggestion

Summary = dict[str, Any]
_MARKER = "evaluation.json"
# joblib's threads only wait: each episode has a process of its own, on a cluster on any machine.
BACKENDS = ("processes", "ray")
_MOST_PER_CORE = 8  # Episodes at a time: each takes half a gigabyte of memory or more.
_MOST_ON_CLUSTER = 1000  # A thread of this process waits for each.


@dataclass(kw_only=True)
class Workers:
    """What runs the episodes.

    Attributes:
        jobs: Episodes at a time.
        backend: 'processes' on this machine, or 'ray'.
        address: Of the Ray cluster, whose machines share this one's files; empty: the one that
            runs here.
    """

    jobs: int = 1
    backend: str = "processes"
    address: str = ""


def connect(workers: Workers) -> None:
    """Makes the backend ready.

    Raises:
        ScenarioError: where it is unknown, not installed or does not answer, or is to run more
            episodes at a time than it can.
    """
    if workers.backend not in BACKENDS:
        hint = suggestion(workers.backend, BACKENDS)
        raise ScenarioError(f"--backend {workers.backend}: unknown; {hint}")
    on_cluster = workers.backend == "ray"
    cores = os.cpu_count() or 1
    most = _MOST_ON_CLUSTER if on_cluster else _MOST_PER_CORE * cores
    if workers.jobs > most:
        why = "on a cluster" if on_cluster else f"with this machine's {cores} cores"
        raise ScenarioError(f"--jobs {workers.jobs}: {why} it must be at most {most}")
    if not on_cluster:
        if workers.address:
            raise ScenarioError("--address is for --backend ray only")
        return
    try:
        import ray
    except ImportError:
        raise ScenarioError(
            "--backend ray: Ray is not installed; pip install 'crossmodal[cluster]'"
        ) from None
    root = str(Path(__file__).parents[2])
    try:
        _knock(workers.address)
        ray.init(
            address=workers.address or "auto",
            runtime_env={"env_vars": {"PYTHONPATH": root, **_own_applications()}},
            ignore_reinit_error=True,
            logging_level=logging.ERROR,
        )
    except (OSError, ValueError, RuntimeError) as error:
        where = workers.address or "this machine"
        raise ScenarioError(
            f"--backend ray: no Ray cluster answers at {where}; start one with 'ray start --head'"
            " or name it with --address"
        ) from error


def _own_applications() -> dict[str, str]:
    """What a worker's environment needs to find a user's own applications."""
    return {key: value for key, value in os.environ.items() if key.startswith("CROSSMODAL_")}


def _knock(address: str) -> None:
    """Raises an OSError where nobody listens, for which Ray itself would wait for minutes."""
    host, _, port = address.rpartition("://")[2].rpartition(":")
    if host and port.isdigit():
        socket.create_connection((host, int(port)), timeout=5.0).close()


def run_on_cluster(
    application: Application, scenario: Scenario, folder: Path, environment: Mapping[str, str]
) -> Summary:
    """As `run_apart`, on whichever machine of the cluster has a core to spare."""
    import ray

    run_there = ray.remote(num_cpus=1, max_retries=0)(process.run_apart)
    try:
        summary: Summary = ray.get(run_there.remote(application, scenario, folder, environment))
    except ray.exceptions.RayError as error:
        reason = one_line(error).partition(". ")[0]
        return process.failed_summary(scenario, f"worker died ({reason})")
    return summary


def open_campaign_folder(
    folder: Path,
    name: str,
    application: Application,
    scenario: Scenario,
    *,
    force: bool = False,
) -> None:
    """Makes or resumes the folder of an experiment.

    Args:
        force: Start afresh where it holds other results; its episodes are removed.

    Raises:
        ScenarioError: where it holds anything but this experiment of this scenario and program.
    """
    marker = folder / _MARKER
    wanted = {"experiment": name, **fingerprint(application, replace(scenario, seed=0))}
    found = _read(marker)
    if found is not None and not force:
        for key, what in (
            ("experiment", "the experiment"),
            ("scenario_hash", "results of the scenario with hash"),
            ("source_hash", "results of the program with source hash"),
        ):
            if found.get(key) != wanted[key]:
                raise ScenarioError(
                    f"{folder}: holds {what} '{found.get(key)}', not '{wanted[key]}';"
                    " choose another --out, or start afresh with --force"
                )
        for name, version in versions().items():
            before = found.get("versions", {}).get(name, version)
            if before != version:
                raise ScenarioError(
                    f"{folder}: holds results of {name} {before}, not {version};"
                    " choose another --out, or start afresh with --force"
                )
    open_run_folder(folder, force=force or found is not None)
    if found is not None and force:
        _remove_episodes(folder)
    write_text(marker, json.dumps(wanted | {"versions": versions()}, indent=2) + "\n")


def _read(marker: Path) -> dict[str, Any] | None:
    """None where there is no marker; an unreadable one is of no experiment."""
    try:
        found = json.loads(marker.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _remove_episodes(folder: Path) -> None:
    import shutil

    for episode in folder.glob("seed-[0-9]*"):
        shutil.rmtree(episode)


def episode_folder(folder: Path, seed: int) -> Path:
    return folder / f"seed-{seed:04d}"


def run_episodes(
    application: Application, scenarios: Sequence[Scenario], folder: Path, workers: Workers
) -> Iterator[Summary]:
    """Yields the summary of each episode: first what the folder has already, then as they end."""
    from joblib import Parallel, delayed

    folder = folder.resolve()
    waiting = []
    for scenario in scenarios:
        place = episode_folder(folder, scenario.seed)
        done = finished_summary(place, application, scenario)
        if done is None:
            waiting.append((scenario, place))
        else:
            yield done
    on_cluster = workers.backend == "ray"
    run_one = run_on_cluster if on_cluster else process.run_apart
    cores = 1 if on_cluster else max(1, (os.cpu_count() or 1) // workers.jobs)
    limits = process.thread_limits(cores)
    parallel = Parallel(
        n_jobs=workers.jobs,
        backend="threading",
        return_as="generator_unordered",
        pre_dispatch="n_jobs",
    )
    yield from parallel(
        delayed(run_one)(application, scenario, place, limits) for scenario, place in waiting
    )


@dataclass(kw_only=True)
class Campaign:
    """An experiment over seeds and what has come out of it so far.

    Attributes:
        name: Of the experiment.
        application: What runs it.
        experiment: What is repeated.
        scenarios: One for each seed.
        folder: Where it is.
        summaries: Of the episodes that have ended, in order of their seeds.
    """

    name: str
    application: Application
    experiment: Experiment
    scenarios: list[Scenario]
    folder: Path
    summaries: list[Summary]

    def episode_folders(self) -> list[Path]:
        """Of the episodes that came to an end."""
        return [
            episode_folder(self.folder, summary["seed"])
            for summary in self.summaries
            if summary["modalities"]
        ]


def prepare(
    name: str,
    application: Application,
    scenario: Scenario,
    seeds: Sequence[int],
    folder: Path,
    *,
    force: bool = False,
) -> Campaign:
    """Opens the folder of an experiment before anything is computed.

    Args:
        name: Of the experiment, one of the application's.
        scenario: The experiment's, of any seed.

    Raises:
        ScenarioError: where the folder holds something else.
    """
    scenarios = [replace(scenario, seed=seed) for seed in seeds]
    open_campaign_folder(folder, name, application, scenario, force=force)
    done = [
        finished_summary(episode_folder(folder, one.seed), application, one) for one in scenarios
    ]
    return Campaign(
        name=name,
        application=application,
        experiment=application.experiments[name],
        scenarios=scenarios,
        folder=folder,
        summaries=[summary for summary in done if summary is not None],
    )


def run(
    campaign: Campaign,
    workers: Workers,
    progress: Callable[[Summary], None] = lambda summary: None,
) -> bool:
    """Runs the episodes that are missing; returns False if a KeyboardInterrupt ended it early."""
    campaign.summaries.clear()
    try:
        for summary in run_episodes(
            campaign.application, campaign.scenarios, campaign.folder, workers
        ):
            campaign.summaries.append(summary)
            progress(summary)
    except KeyboardInterrupt:
        return False
    finally:
        process.stop_running()
        campaign.summaries.sort(key=lambda summary: int(summary["seed"]))
    return True
