"""Writes what came out of experiments: CSV, Markdown, plots and a page that shows all of it."""

import contextlib
import datetime
import io
import os
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import pandas as pd
from PIL import Image

from crossmodal.diagrams.drawing.page import Section, page, png_address
from crossmodal.diagrams.drawing.plot_style import save
from crossmodal.diagrams.evaluation.campaign import Campaign, Summary, episode_folder
from crossmodal.diagrams.evaluation.metric_table import (
    HOW_TO_READ,
    experiment_tables,
    markdown,
    overall_table,
    running_notes,
    tidy_metrics,
    title,
)
from crossmodal.diagrams.evaluation.run_report import name_of, portrait_of
from crossmodal.diagrams.evaluation.words import columns_of, words_of
from crossmodal.diagrams.run.folder.fingerprint import program
from crossmodal.diagrams.run.folder.run_folder import PAGE_FILE, PLOT_FOLDER, undrawn
from crossmodal.diagrams.run.folder.written_files import write_atomically, write_text
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError

CSV_FILE, TABLE_FILE = "results.csv", "table.md"
OVERVIEW_FILES = (CSV_FILE, TABLE_FILE, PAGE_FILE)
_THUMBNAIL = (480, 480)  # Largest width and height, [pixels].


def made_by(command: str, *, complete: bool = True) -> str:
    """Command, version and date in one line, and whether the command has come to its end."""
    today = datetime.datetime.now(datetime.UTC).date().isoformat()
    ending = "" if complete else ", interrupted"
    return f"`{command}`{ending}, {program()}, {today}."


def task_in_words(campaign: Campaign) -> str:
    """What counts as done in the experiment, with its tolerances."""
    return campaign.application.task_in_words(campaign.scenarios[0])


def write_campaign(campaign: Campaign, origin: str) -> list[Path]:
    """Writes an experiment's files and returns them; nothing where no episode has ended.

    Args:
        origin: How the figures were made.
    """
    if not campaign.summaries:
        return []
    folder, name, application = campaign.folder, campaign.name, campaign.application
    figures = tidy_metrics(application, name, campaign.summaries)
    written = [
        write_atomically(folder / CSV_FILE, partial(figures.to_csv, index=False)),
        write_text(folder / TABLE_FILE, _markdown(campaign, figures, origin)),
    ]
    for file, plot in application.campaign_plots.items():
        place, figure = folder / file, None
        try:
            figure = plot.draw(campaign)
            if figure is not None:
                written.append(write_atomically(place, partial(save, figure)))
        except ScenarioError:
            raise
        except Exception as error:
            campaign.missing.append(undrawn(place, error))
            figure = None
        if figure is None:
            with contextlib.suppress(IsADirectoryError, PermissionError):
                place.unlink(missing_ok=True)
    section = _section(campaign, figures, folder)
    written.append(write_text(folder / PAGE_FILE, page(section.title, origin, [section])))
    return written


def _markdown(campaign: Campaign, figures: pd.DataFrame, origin: str) -> str:
    task, asked = task_in_words(campaign), campaign.seeds
    return markdown(
        campaign.application, campaign.name, campaign.experiment, figures, origin, task, asked
    )


def write_overview(campaigns: Sequence[Campaign], folder: Path, origin: str) -> list[Path]:
    """Writes the files of several experiments together, from what each has written."""
    if not any(campaign.summaries for campaign in campaigns):
        return []
    figures = {
        one.name: tidy_metrics(one.application, one.name, one.summaries) for one in campaigns
    }
    applications = {one.application.name: one.application for one in campaigns}
    overall = []
    for application in applications.values():
        own = [one for one in campaigns if one.application is application]
        asked = {one.name: one.seeds for one in own}
        overall.append(overall_table(application, {n: figures[n] for n in asked}, asked))
    campaigns = [campaign for campaign in campaigns if campaign.summaries]
    sections = [_section(one, figures[one.name], folder) for one in campaigns]
    heading = "All experiments"
    parts = [f"# {heading}", origin, *(table.markdown() for table in overall)]
    for one in campaigns:
        text = _markdown(one, figures[one.name], "")
        parts.append(text.replace("# ", "## ", 1).rstrip())
    table = "\n\n".join(parts) + "\n"
    together = pd.concat(figures.values(), ignore_index=True)
    return [
        write_atomically(folder / CSV_FILE, partial(together.to_csv, index=False)),
        write_text(folder / TABLE_FILE, table),
        write_text(folder / PAGE_FILE, page(heading, origin, sections, overall)),
    ]


def _section(campaign: Campaign, figures: pd.DataFrame, base: Path) -> Section:
    experiment, folder = campaign.experiment, campaign.folder
    episodes = []
    for summary in campaign.summaries:
        place = episode_folder(folder, summary["seed"])
        names = sorted(_pictures(summary))
        links = {
            name_of(name): Path(os.path.relpath(place / name, base)).as_posix() for name in names
        }
        first = portrait_of(campaign.application, names)
        thumbnail = _thumbnail(place / first) if first else ""
        episodes.append((summary["seed"], _reason(summary), thumbnail, links))
    tables = experiment_tables(campaign.application, experiment, figures, campaign.seeds)
    words = words_of(campaign.application, tables)
    columns = columns_of(words, tables)
    return Section(
        name=campaign.name,
        title=title(campaign.name, figures, campaign.seeds),
        portrait=_portrait(campaign),
        what=_what_was_done(campaign),
        tables=tables,
        columns=columns,
        words={word: meaning for word, meaning in words.items() if word not in columns},
        notes=[HOW_TO_READ],
        made=running_notes(figures),
        pictures=[
            (inline(folder / file), plot.caption)
            for file, plot in campaign.application.campaign_plots.items()
            if (folder / file).is_file()
        ],
        episodes=episodes,
    )


def _portrait(campaign: Campaign) -> tuple[str, str] | None:
    """A picture of the first episode that was done, or of the first one that ended."""
    for summary in sorted(campaign.summaries, key=lambda one: one["success"] is not True):
        place = episode_folder(campaign.folder, summary["seed"])
        name = portrait_of(campaign.application, _pictures(summary))
        if name and (place / name).is_file():
            outcome = _reason(summary) or "done"
            return inline(place / name), f"One of the episodes, seed {summary['seed']}: {outcome}."
    return None


def _pictures(summary: Summary) -> list[str]:
    """Of an episode, by their paths in its folder."""
    return [name for name in summary.get("files", []) if name.startswith(f"{PLOT_FOLDER}/")]


def _what_was_done(campaign: Campaign) -> list[str]:
    """The experiment in sentences, for someone who has not read anything else."""
    application, ended = campaign.application, len(campaign.summaries)
    done = sum(summary["success"] is True for summary in campaign.summaries)
    return [
        f"Simulated: {campaign.experiment.description}. The system: {application.description}.",
        f"{ended} episodes were run, which differ by a seed: it draws what differs from one to the"
        f" next, the sensors' noise among it. In {done} of {ended} the task was done.",
        *filter(None, [task_in_words(campaign)]),
        *campaign.experiment.notes,
    ]


def _reason(summary: Summary) -> str:
    """Why an episode's task was not done; nothing where it was."""
    if summary["success"] is None:
        return "not known whether it was done"
    return "" if summary["success"] else summary.get("failure") or "unknown"


def inline(path: Path) -> str:
    """A picture as an address that holds it."""
    return png_address(path.read_bytes())


def _thumbnail(path: Path) -> str:
    with Image.open(path) as image:
        small = image.convert("RGB")
    small.thumbnail(_THUMBNAIL)
    buffer = io.BytesIO()
    small.save(buffer, "PNG", optimize=True)
    return png_address(buffer.getvalue())
