"""Runs the episodes of an experiment, and goes on where it was stopped."""

import contextlib
import logging
import os
import socket
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from crossmodal.diagrams.evaluation.metric_table import is_summary
from crossmodal.diagrams.run import process
from crossmodal.diagrams.run.application import Application
from crossmodal.diagrams.run.experiment import Experiment
from crossmodal.diagrams.run.folder.fingerprint import fingerprint
from crossmodal.diagrams.run.folder.run_folder import (
    FILES,
    SUMMARY_FILE,
    finished_summary,
    make_folder,
    read_summary,
    remove_run,
)
from crossmodal.diagrams.run.scenario import Scenario
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, one_line, suggestion

Summary = dict[str, Any]
# joblib's threads only wait: each episode has a process of its own, on a cluster on any machine.
BACKENDS = ("processes", "ray")


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
        ScenarioError: where it is unknown, not installed or does not answer.
    """
    if workers.backend not in BACKENDS:
        hint = suggestion(workers.backend, BACKENDS)
        raise ScenarioError(f"--backend {workers.backend}: unknown; {hint}")
    if workers.backend != "ray":
        if workers.address:
            raise ScenarioError("--address is for --backend ray only")
        return
    try:
        import ray
    except ImportError:
        raise ScenarioError(
            "--backend ray: Ray is not installed; .venv/bin/pip install --editable '.[cluster]'"
        ) from None
    # By these a worker finds a user's own applications.
    own = {key: value for key, value in os.environ.items() if key.startswith("CROSSMODAL_")}
    try:
        _knock(workers.address)
        ray.init(
            address=workers.address or "auto",
            runtime_env={"env_vars": own},
            ignore_reinit_error=True,
            logging_level=logging.ERROR,
        )
    except (OSError, ValueError, RuntimeError) as error:
        where = workers.address or "this machine"
        raise ScenarioError(
            f"--backend ray: no Ray cluster answers at {where}; start one with 'ray start --head'"
            " or name it with --address"
        ) from error


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


def episode_folder(folder: Path, seed: int) -> Path:
    return folder / f"seed-{seed:04d}"


def check_folder(folder: Path, *, force: bool = False) -> None:
    """Makes the folder of an evaluation, or removes the episodes there where it starts afresh.

    Raises:
        ScenarioError: where it cannot be written, or holds something else.
    """
    make_folder(folder)
    episodes = [*folder.glob("seed-[0-9]*"), *folder.glob("*/seed-[0-9]*")]
    if any(folder.iterdir()) and not episodes:
        raise ScenarioError(
            f"{folder}: already holds files, but no evaluation; choose another folder with --out"
        )
    for episode in folder.glob("seed-[0-9]*") if force else ():
        if episode.is_symlink():  # What it leads to is not this evaluation's.
            episode.unlink()
            continue
        remove_run(episode)
        for name in (*FILES, process.ERROR_FILE):
            with contextlib.suppress(OSError):
                (episode / name).unlink()
        with contextlib.suppress(OSError):
            episode.rmdir()


def _refuse_other_results(folder: Path, application: Application, scenario: Scenario) -> None:
    """All episodes in a folder are of one scenario and program, so that one tells which."""
    for path in sorted(folder.glob(f"seed-[0-9]*/{SUMMARY_FILE}")):
        found = read_summary(path.parent)
        if type(found.get("seed")) is not int:  # It is damaged.
            continue
        current = fingerprint(application, replace(scenario, seed=found["seed"]))
        for key, wanted in current.items():
            if key in found and found[key] != wanted:
                raise ScenarioError(
                    f"{path}: holds results of another scenario or program: {key} is {found[key]},"
                    f" not {wanted}; choose another --out, or start afresh with --force"
                )
        return


def run_episodes(
    application: Application, scenarios: Sequence[Scenario], folder: Path, workers: Workers
) -> Iterator[Summary]:
    """Yields the summary of each episode as it ends."""
    from joblib import Parallel, delayed

    from crossmodal.systems.compile_ahead import compile_ahead

    compile_ahead(application.name)  # Once, and not in each of the episodes' processes.
    folder = folder.resolve()
    on_cluster = workers.backend == "ray"
    run_one = run_on_cluster if on_cluster else process.run_apart
    cores = 1 if on_cluster else max(1, (os.cpu_count() or 1) // workers.jobs)
    limits = process.thread_limits(cores)

    parallel = Parallel(
        n_jobs=max(1, min(workers.jobs, len(scenarios))),
        backend="threading",
        return_as="generator_unordered",
        pre_dispatch="n_jobs",
    )
    yield from parallel(
        delayed(run_one)(application, scenario, episode_folder(folder, scenario.seed), limits)
        for scenario in scenarios
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
        missing: What of its results could not be drawn, and why, a line each.
    """

    name: str
    application: Application
    experiment: Experiment
    scenarios: list[Scenario]
    folder: Path
    summaries: list[Summary]
    missing: list[str] = field(default_factory=list)

    @property
    def seeds(self) -> list[int]:
        """Those that were asked for."""
        return [scenario.seed for scenario in self.scenarios]

    @property
    def is_complete(self) -> bool:
        """Whether all episodes have ended."""
        return len(self.summaries) == len(self.scenarios)

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
    """Opens the folder of an experiment and reads the episodes that have ended there.

    Args:
        name: Of the experiment, one of the application's.
        scenario: The experiment's, of any seed.
        force: Start afresh: what is there of episodes is removed.

    Raises:
        ScenarioError: where the folder cannot be written or holds something else.
    """
    check_folder(folder, force=force)
    _refuse_other_results(folder, application, scenario)
    scenarios = [replace(scenario, seed=seed) for seed in seeds]
    done = [
        finished_summary(episode_folder(folder, one.seed), application, one) for one in scenarios
    ]
    return Campaign(
        name=name,
        application=application,
        experiment=application.experiments[name],
        scenarios=scenarios,
        folder=folder,
        summaries=[one for one in done if one is not None and is_summary(application, one)],
    )


def run(
    campaign: Campaign,
    workers: Workers,
    progress: Callable[[Summary], None] = lambda summary: None,
) -> bool:
    """Runs the episodes that are missing; returns False if a KeyboardInterrupt ended it early."""
    seeds = {summary["seed"] for summary in campaign.summaries}
    waiting = [scenario for scenario in campaign.scenarios if scenario.seed not in seeds]
    try:
        for summary in campaign.summaries:
            progress(summary)
        for summary in run_episodes(campaign.application, waiting, campaign.folder, workers):
            campaign.summaries.append(summary)
            progress(summary)
    except KeyboardInterrupt:
        return False
    finally:
        process.stop_running()
        campaign.summaries.sort(key=lambda summary: int(summary["seed"]))
    return True
