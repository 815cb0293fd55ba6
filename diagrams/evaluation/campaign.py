"""Runs the episodes of an experiment, and goes on where it was stopped."""

import contextlib
import json
import logging
import os
import socket
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from crossmodal.diagrams.evaluation.folder_checksums import CHECKSUM_FILE, damage, write_checksums
from crossmodal.diagrams.run import process
from crossmodal.diagrams.run.application import Application
from crossmodal.diagrams.run.experiment import Experiment
from crossmodal.diagrams.run.folder.fingerprint import fingerprint, versions
from crossmodal.diagrams.run.folder.own_files import OwnFiles, held
from crossmodal.diagrams.run.folder.run_folder import SUMMARY_FILE, finished_summary, write_text
from crossmodal.diagrams.run.scenario import Scenario
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, one_line, suggestion

Summary = dict[str, Any]
_MARKER = "evaluation.json"
# joblib's threads only wait: each episode has a process of its own, on a cluster on any machine.
BACKENDS = ("processes", "ray")
_MOST_PER_CORE = 8  # Episodes at a time: each takes some gigabyte of memory.
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
    try:
        _knock(workers.address)
        ray.init(
            address=workers.address or "auto",
            runtime_env={"env_vars": _own_applications()},
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


class DamageWarning(UserWarning):
    """A file of an evaluation is missing or not what it was when it was written."""


def held_campaign(folder: Path, *, force: bool = False) -> AbstractContextManager[OwnFiles]:
    """Holds the folder of an experiment, so that no other evaluation writes there meanwhile.

    Args:
        force: As for `open_campaign_folder`.

    Raises:
        ScenarioError: where another one does, or where it holds something else.
    """
    return held(folder, (_MARKER, CHECKSUM_FILE), force=force, shared=_is_campaign(folder))


def _is_campaign(folder: Path) -> bool:
    return any(map(os.path.exists, (folder / _MARKER, folder / CHECKSUM_FILE)))


def open_campaign_folder(
    folder: Path,
    name: str,
    application: Application,
    scenario: Scenario,
    *,
    force: bool = False,
) -> None:
    """Begins or resumes an experiment in a folder, which `held_campaign` holds.

    Where its own file is damaged, an episode of this scenario and program shows whose folder it is.

    Args:
        force: Start afresh where it holds other results; its episodes are removed.

    Raises:
        ScenarioError: where it holds anything but this experiment of this scenario and program.
    """
    own = OwnFiles(folder)
    wanted = {"experiment": name, **fingerprint(application, replace(scenario, seed=0))}
    is_campaign = _is_campaign(folder)
    if is_campaign and not force:
        damaged = damage(folder, _MARKER)
        if not damaged:
            _refuse_other_results(folder, wanted)
        elif not _has_episode_of(folder, application, scenario):
            raise ScenarioError(
                f"{folder}: {damaged}, and no whole episode there is of this scenario and program;"
                " choose another --out, or start afresh with --force"
            )
        else:
            text = f"{folder}: {damaged}; it is written anew, and whole episodes stay"
            warnings.warn(text, DamageWarning, stacklevel=2)
    if is_campaign and force:
        _remove_episodes(folder)
    text = json.dumps(wanted | {"versions": versions()}, indent=2) + "\n"
    own.place(CHECKSUM_FILE)
    write_checksums(folder, [write_text(own.place(_MARKER), text)])


def _refuse_other_results(folder: Path, wanted: Mapping[str, str]) -> None:
    found = json.loads((folder / _MARKER).read_text(encoding="utf-8"))
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
    for package, version in versions().items():
        before = found.get("versions", {}).get(package, version)
        if before != version:
            raise ScenarioError(
                f"{folder}: holds results of {package} {before}, not {version};"
                " choose another --out, or start afresh with --force"
            )


def _has_episode_of(folder: Path, application: Application, scenario: Scenario) -> bool:
    return any(
        not damage(place, SUMMARY_FILE)
        and finished_summary(place, application, replace(scenario, seed=int(place.name[5:])))
        for place in sorted(folder.glob("seed-[0-9]*"))
        if place.name[5:].isdecimal()
    )


def _remove_episodes(folder: Path) -> None:
    """Removes the files of episodes, and their folders where nothing else is in them."""
    for episode in folder.glob("seed-[0-9]*"):
        with held(episode, (), shared=True) as own:
            own.remove_all_but(())
            for name in (process.LOG_FILE, process.ERROR_FILE, CHECKSUM_FILE):
                (episode / name).unlink(missing_ok=True)
        with contextlib.suppress(OSError):
            episode.rmdir()


def episode_folder(folder: Path, seed: int) -> Path:
    return folder / f"seed-{seed:04d}"


def whole_summary(folder: Path, application: Application, scenario: Scenario) -> Summary | None:
    """The summary of an episode that has ended and whose files are as they were written.

    Warns of a file that is not.
    """
    place = episode_folder(folder, scenario.seed)
    if not any((place / name).exists() for name in (CHECKSUM_FILE, SUMMARY_FILE)):
        return None
    damaged = damage(place, SUMMARY_FILE)
    if not damaged:
        return finished_summary(place, application, scenario)
    warnings.warn(f"{place}: {damaged}; that seed runs again", DamageWarning, stacklevel=2)
    return None


def run_episodes(
    application: Application, scenarios: Sequence[Scenario], folder: Path, workers: Workers
) -> Iterator[Summary]:
    """Yields the summary of each episode as it ends."""
    from joblib import Parallel, delayed

    from crossmodal.systems.compile_ahead import compile_ahead

    compile_ahead()  # Once, and not in each of the episodes' processes.
    folder = folder.resolve()
    on_cluster = workers.backend == "ray"
    run_one = run_on_cluster if on_cluster else process.run_apart
    cores = 1 if on_cluster else max(1, (os.cpu_count() or 1) // workers.jobs)
    limits = process.thread_limits(cores)

    def run_and_list(scenario: Scenario) -> Summary:
        place = episode_folder(folder, scenario.seed)
        try:
            (place / CHECKSUM_FILE).unlink(missing_ok=True)
            summary = run_one(application, scenario, place, limits)
            if summary["modalities"]:
                write_checksums(place, _files_of_episode(place))
        except (OSError, ScenarioError) as error:
            return process.failed_summary(scenario, one_line(error))
        return summary

    parallel = Parallel(
        n_jobs=workers.jobs,
        backend="threading",
        return_as="generator_unordered",
        pre_dispatch="n_jobs",
    )
    yield from parallel(delayed(run_and_list)(scenario) for scenario in scenarios)


def _files_of_episode(place: Path) -> list[Path]:
    """What it has written and what belongs to its result, which its log does not."""
    beside = {process.LOG_FILE, CHECKSUM_FILE}
    return [path for path in place.rglob("*") if path.is_file() and path.name not in beside]


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
    """Opens the folder of an experiment, which `held_campaign` holds, before all is computed.

    Args:
        name: Of the experiment, one of the application's.
        scenario: The experiment's, of any seed.

    An episode with a file that is missing or damaged counts as one that is still to run.

    Raises:
        ScenarioError: where the folder holds something else.
    """
    scenarios = [replace(scenario, seed=seed) for seed in seeds]
    open_campaign_folder(folder, name, application, scenario, force=force)
    done = [whole_summary(folder, application, one) for one in scenarios]
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
