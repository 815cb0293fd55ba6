"""`crossmodal evaluate`."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from crossmodal.diagrams.commands.completion import complete_experiment
from crossmodal.diagrams.commands.endings import FAILED, INTERRUPTED, one_line_errors
from crossmodal.diagrams.commands.options import QuietOption, SetOption, VerboseOption
from crossmodal.diagrams.commands.run_log import RunLog

if TYPE_CHECKING:
    from crossmodal.diagrams.evaluation.campaign import Campaign, Workers

ALL = "all"
EXAMPLES = (
    "Examples:  crossmodal evaluate drawer --seeds 40:60 --jobs 2   |"
    "   crossmodal evaluate all --seeds 20.  Run it again to go on where it was stopped."
)


def evaluate_command(
    experiment: Annotated[
        str,
        typer.Argument(
            help="See 'crossmodal list'; 'all' for all.", autocompletion=complete_experiment
        ),
    ],
    seeds: Annotated[
        str, typer.Option(help="Like 20 (from 0 on), 40:60 (without 60) or 1,4,9.")
    ] = "20",
    jobs: Annotated[int, typer.Option(min=1, help="Episodes at a time, one process each.")] = 1,
    out: Annotated[
        Path | None, typer.Option(help="Folder of the results. [default: runs/evaluate/NAME]")
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Start afresh where the folder has other results.")
    ] = False,
    backend: Annotated[
        str, typer.Option(help="'processes' on this machine, or 'ray' for a cluster.")
    ] = "processes",
    address: Annotated[
        str, typer.Option(help="Of the Ray cluster. [default: the one on this machine]")
    ] = "",
    duration: Annotated[
        float | None, typer.Option(help="Longest simulated time of an episode, [s].")
    ] = None,
    overrides: SetOption = None,
    verbose: VerboseOption = False,
    quiet: QuietOption = False,
) -> None:
    """Repeat an experiment over seeds and write tables and plots beside the paper's figures."""
    log = RunLog(verbose=verbose, quiet=quiet)
    with one_line_errors(log):
        log.note("Loading Drake and the scenarios")
        from crossmodal.diagrams.applications import experiments, load_scenario, own_suggestion
        from crossmodal.diagrams.evaluation import campaign_report as reports
        from crossmodal.diagrams.evaluation.campaign import Workers, check_folder, connect, prepare
        from crossmodal.diagrams.evaluation.seeds import parse_seeds
        from crossmodal.diagrams.run.yaml_input.schema import ScenarioError

        known = experiments()
        if experiment not in (ALL, *known):
            hint = own_suggestion(experiment, [*known, ALL])
            raise ScenarioError(f"unknown experiment '{experiment}'; {hint}")
        numbers = parse_seeds(seeds)
        assignments = list(overrides or [])
        if duration is not None:
            assignments.append(f"duration={duration}")
        together = experiment == ALL
        top = out or Path("runs", "evaluate", "" if together else experiment)
        folders = {name: top / name for name in known} if together else {experiment: top}
        workers = Workers(jobs=jobs, backend=backend, address=address)
        connect(workers)
        command = " ".join(
            ["crossmodal evaluate", experiment, f"--seeds {seeds} --jobs {jobs}"]
            + [f"--set {assignment}" for assignment in assignments]
        )
        campaigns, written, finished = [], list[Path](), True
        if together:
            check_folder(top)
        for name, folder in folders.items():
            chosen = known[name].experiments[name]
            application, scenario = load_scenario(chosen.scenario, assignments)
            campaigns.append(prepare(name, application, scenario, numbers, folder, force=force))
        for campaign in campaigns:
            finished = finished and _run_campaign(campaign, workers, log)
            origin = reports.made_by(command, complete=campaign.is_complete)
            written = reports.write_campaign(campaign, origin) or written
        if together:
            origin = reports.made_by(command, complete=finished)
            written = reports.write_overview(campaigns, top, origin)
    _finish_evaluation(campaigns, written, log)


def _run_campaign(campaign: "Campaign", workers: "Workers", log: RunLog) -> bool:
    """Runs an experiment behind a progress bar; returns False where it was interrupted."""
    from tqdm import tqdm

    from crossmodal.diagrams.evaluation.campaign import run

    total = len(campaign.scenarios)
    there = len(campaign.summaries)
    log.note(f"{campaign.name}: {there} of {total} episodes are there, the others are run")
    hidden = True if log.is_quiet or log.is_verbose else None
    with tqdm(total=total, desc=campaign.name, unit="episode", disable=hidden) as bar:
        done = 0

        def progress(summary: dict[str, Any]) -> None:
            nonlocal done
            done += bool(summary["success"])
            log.note(f"{campaign.name}, seed {summary['seed']}: has ended")
            bar.update()
            bar.set_postfix_str(f"{done} of {bar.n} done")
            if summary["success"] is False:
                reason = f"{campaign.name}, seed {summary['seed']}: {summary['failure']}"
                bar.write(reason, file=sys.stderr)

        return run(campaign, workers, progress)


def _finish_evaluation(campaigns: "list[Campaign]", written: list[Path], log: RunLog) -> None:
    from crossmodal.diagrams.evaluation.metric_table import interrupted

    for path in written:
        if path.suffix == ".md":
            log.say(path.read_text(encoding="utf-8"))
    for path in written:
        log.say(f"  {path}")
    for campaign in campaigns:
        for line in campaign.missing:
            typer.echo(f"crossmodal: {line}", err=True)
    summaries = [summary for campaign in campaigns for summary in campaign.summaries]
    asked = sum(len(campaign.scenarios) for campaign in campaigns)
    if len(summaries) < asked:
        stopped = interrupted(len(summaries), asked)
        typer.echo(f"crossmodal: {stopped}; the same command goes on", err=True)
        raise typer.Exit(INTERRUPTED)
    failed = any(summary["success"] is False for summary in summaries)
    failed = failed or any(campaign.missing for campaign in campaigns)
    raise typer.Exit(FAILED if failed else 0)
