"""The page of one run: what was done, what came of it, and what its words mean."""

from collections.abc import Mapping, Sequence
from pathlib import PurePosixPath
from typing import Any

from crossmodal.diagrams.drawing.page import Section, page
from crossmodal.diagrams.drawing.table import Table
from crossmodal.diagrams.evaluation.metric_table import (
    OF_THE_MACHINE,
    Summary,
    label,
    metrics_of,
    one_figure,
)
from crossmodal.diagrams.evaluation.words import columns_of, words_of
from crossmodal.diagrams.run.application import Application
from crossmodal.diagrams.run.experiment import Metric
from crossmodal.diagrams.run.folder.fingerprint import program
from crossmodal.diagrams.run.folder.run_folder import (
    ESTIMATES_FILE,
    LOG_FILE,
    MESHCAT_FILE,
    PLOT_FOLDER,
    SCENARIO_FILE,
    SENSORS_FILE,
    SUMMARY_FILE,
    VIDEO_FILE,
)
from crossmodal.diagrams.run.scenario import Scenario

_FILES = {
    "the scene in 3D": MESHCAT_FILE,
    "video": VIDEO_FILE,
    "all figures": SUMMARY_FILE,
    "what was estimated, as a table": ESTIMATES_FILE,
    "the scenario": SCENARIO_FILE,
    "the sensor streams": SENSORS_FILE,
    "what happened when": LOG_FILE,
}
_HOW_TO_READ = (
    "A figure is a magnitude, of this one run; another seed gives another one. '-' is what is not"
    " known."
)
_HOW_TO_SHOW = "crossmodal show FOLDER, with the folder of this page, shows the run over time."


def portrait_of(application: Application, pictures: Sequence[str]) -> str:
    """The picture that stands for an episode: the application's choice, or else the first."""
    chosen = [name for name in pictures if PurePosixPath(name).name == application.portrait]
    return next(iter([*chosen, *pictures]), "")


def run_page(
    application: Application,
    scenario: Scenario,
    summary: Summary,
    printed: Sequence[str],
    files: Sequence[str],
) -> str:
    """The page of a run, which finds its pictures in the folder.

    Args:
        printed: What a person reads in the terminal.
        files: What is in the folder.
    """
    pictures = [name for name in files if name.startswith(f"{PLOT_FOLDER}/")]
    first = portrait_of(application, pictures)
    tables = figures_tables(application, scenario.name, summary)
    words = words_of(application, tables, printed)
    columns = columns_of(words, tables)
    outcome, tone = _outcome(summary)
    heading = f"{scenario.name}, seed {scenario.seed}"
    section = Section(
        title=heading,
        outcome=outcome,
        tone=tone,
        portrait=(first, f"{name_of(first)}: {scenario.description or heading}") if first else None,
        what=_what_was_done(application, scenario, summary),
        tables=[*tables, _events(summary)],
        columns=columns,
        words={word: meaning for word, meaning in words.items() if word not in columns},
        notes=[_HOW_TO_READ] if tables else [],
        printed=printed,
        pictures=[(name, name_of(name)) for name in pictures if name != first],
        links={text: name for text, name in _FILES.items() if name in files},
        made=[_HOW_TO_SHOW],
    )
    return page(heading, f"{program()}.", [section])


def figures_tables(application: Application, experiment: str, summary: Summary) -> list[Table]:
    """The metrics of the whole run and of each estimator that have a title and a value."""
    known = application.experiments.get(experiment)
    hidden = {*OF_THE_MACHINE, "success", *(known.without if known else ())}
    parts: Mapping[str, Any] = summary["modalities"]
    names = [label(application, name) for name in parts]
    tables = []
    for by_estimator, records, header in (
        (False, [summary], ["the whole run"]),
        (True, list(parts.values()), names),
    ):
        table = Table(header=["", *header])
        for metric in metrics_of(application).values():
            if metric.by_estimator == by_estimator and metric.title and metric.name not in hidden:
                _add_row(table, metric, records)
        if table.rows:
            tables.append(table)
    return tables


def _add_row(table: Table, metric: Metric, records: Sequence[Mapping[str, Any]]) -> None:
    """Adds the metric's figures where any is known; what is true or false is good or bad."""
    values = [_value(metric, record) for record in records]
    if all(value is None for value in values):
        return
    for column, value in enumerate(values, start=1):
        if isinstance(value, bool) and metric.better:
            tone = "good" if value == (metric.better == "more") else "bad"
            table.tones[len(table.rows), column] = tone
    figures = [
        "-" if value is None else one_figure(value, metric.unit_in(record))
        for value, record in zip(values, records, strict=True)
    ]
    table.rows.append([metric.title, *figures])


def _value(metric: Metric, record: Mapping[str, Any]) -> Any:
    try:
        return metric.value(record)
    except KeyError:
        return None


def _outcome(summary: Summary) -> tuple[str, Any]:
    """What became of the task, and whether that is good."""
    if summary["interrupted"]:
        after = f"{summary['duration']:.1f} s"
        return f"Stopped by hand after {after}: this page says what was so until then.", "mixed"
    if summary["success"] is None:
        return "It is not known whether the task was done.", ""
    if summary["success"]:
        return "The task was done.", "good"
    return f"The task was not done: {summary['failure']}.", "bad"


def _what_was_done(application: Application, scenario: Scenario, summary: Summary) -> list[str]:
    """The run in sentences, for someone who has not read anything else."""
    names = [label(application, name) for name in summary["modalities"]]
    many = f"{len(names)} estimators side by side: " if len(names) > 1 else "the estimator "
    by = f" by {many}{', '.join(names)}" if names else ""
    return [
        *([f"Scenario: {scenario.description}."] if scenario.description else []),
        f"System: {application.description}.",
        f"What happened in {summary['duration']:.1f} s was perceived{by}.",
        *filter(None, [application.task_in_words(scenario)]),
    ]


def _events(summary: Summary) -> Table:
    rows = [[f"{event['time']:.1f} s", event["name"]] for event in summary["events"]]
    return Table(header=["time", "event"], rows=rows, fold=0, title="events, in order of time")


def name_of(picture: str) -> str:
    """What a picture is called on a page, by its path."""
    return PurePosixPath(picture).stem.replace("_", " ")
