"""Writes what came out of experiments: CSV, Markdown, plots and a page that shows all of it."""

import base64
import datetime
import io
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import jinja2
import pandas as pd
from PIL import Image

from crossmodal.diagrams.drawing.plot_style import save
from crossmodal.diagrams.evaluation.campaign import Campaign, Summary, episode_folder
from crossmodal.diagrams.evaluation.metric_table import (
    HOW_TO_READ,
    Table,
    experiment_tables,
    markdown,
    overall_table,
    running_notes,
    tidy_metrics,
    title,
)
from crossmodal.diagrams.run.folder.fingerprint import versions
from crossmodal.diagrams.run.folder.run_folder import (
    PLOT_FOLDER,
    undrawn,
    write_atomically,
    write_text,
)
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError

CSV_FILE, TABLE_FILE, PAGE_FILE = "results.csv", "table.md", "report.html"
OVERVIEW_FILES = (CSV_FILE, TABLE_FILE, PAGE_FILE)
_THUMBNAIL = (480, 480)  # Largest width and height, [pixels].


@dataclass(kw_only=True)
class Picture:
    """An image inside the page, and what it shows."""

    data: str
    text: str


@dataclass(kw_only=True)
class EpisodeCard:
    """An episode on the page; a reason says that it failed.

    Its links lead to its pictures, by their names, the first to what the thumbnail shows.
    """

    seed: int
    reason: str
    thumbnail: str
    links: dict[str, str]


@dataclass(kw_only=True)
class Section:
    """An experiment on the page, or what is compared there."""

    name: str
    title: str
    description: str
    tables: list[Table]
    notes: list[str]
    pictures: list[Picture] = field(default_factory=list)
    episodes: list[EpisodeCard] = field(default_factory=list)
    side_by_side: bool = False


def made_by(command: str, *, complete: bool = True) -> str:
    """Command, version and date in one line, and whether the command has come to its end."""
    known = versions()
    program = f"crossmodal {known['crossmodal']} (source {known['source']})"
    today = datetime.datetime.now(datetime.UTC).date().isoformat()
    ending = "" if complete else ", interrupted"
    return f"`{command}`{ending}, {program}, Drake {known['drake']}, {today}."


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
    task = task_in_words(campaign)
    table = markdown(application, name, campaign.experiment, figures, origin, task, campaign.seeds)
    written = [
        write_atomically(folder / CSV_FILE, partial(figures.to_csv, index=False)),
        write_text(folder / TABLE_FILE, table),
    ]
    for file, plot in application.campaign_plots.items():
        place = folder / file
        place.unlink(missing_ok=True)
        try:
            figure = plot.draw(campaign)
            if figure is not None:
                written.append(write_atomically(place, partial(save, figure)))
        except ScenarioError:
            raise
        except Exception as error:
            campaign.missing.append(undrawn(place, error))
    section = _section(campaign, figures, folder)
    written.append(write_text(folder / PAGE_FILE, page(name, origin, [section])))
    return written


def write_overview(campaigns: Sequence[Campaign], folder: Path, origin: str) -> list[Path]:
    """Writes the files of several experiments together, from what each has written."""
    if not any(campaign.summaries for campaign in campaigns):
        return []
    figures = {
        one.name: tidy_metrics(one.application, one.name, one.summaries) for one in campaigns
    }
    applications = {one.application.name: one.application for one in campaigns}
    overall = [
        overall_table(
            application,
            {one.name: figures[one.name] for one in campaigns if one.application is application},
            {one.name: one.seeds for one in campaigns if one.application is application},
        )
        for application in applications.values()
    ]
    campaigns = [campaign for campaign in campaigns if campaign.summaries]
    sections = [_section(one, figures[one.name], folder) for one in campaigns]
    heading = "All experiments"
    parts = [f"# {heading}", origin, *(table.markdown() for table in overall)]
    parts += [
        markdown(
            one.application,
            one.name,
            one.experiment,
            figures[one.name],
            "",
            task_in_words(one),
            one.seeds,
        )
        .replace("# ", "## ", 1)
        .rstrip()
        for one in campaigns
    ]
    table = "\n\n".join(parts) + "\n"
    together = pd.concat(figures.values(), ignore_index=True)
    return [
        write_atomically(folder / CSV_FILE, partial(together.to_csv, index=False)),
        write_text(folder / TABLE_FILE, table),
        write_text(folder / PAGE_FILE, page(heading, origin, sections, overall)),
    ]


def page(
    heading: str, origin: str, sections: Sequence[Section], overall: Sequence[Table] = ()
) -> str:
    """The page, with every picture inside it."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent), autoescape=True, trim_blocks=True
    )
    template = environment.get_template("report.html.jinja")
    return template.render(
        heading=heading, made_by=origin.replace("`", ""), sections=sections, overall=overall
    )


def _section(campaign: Campaign, figures: pd.DataFrame, base: Path) -> Section:
    pictures = [
        Picture(data=inline(campaign.folder / file), text=plot.caption)
        for file, plot in campaign.application.campaign_plots.items()
        if (campaign.folder / file).is_file()
    ]
    cards = []
    for summary in campaign.summaries:
        plots = _plots(episode_folder(campaign.folder, summary["seed"]))
        shown = plots if summary["modalities"] else []
        cards.append(
            EpisodeCard(
                seed=summary["seed"],
                reason=_reason(summary),
                thumbnail=_thumbnail(shown[0]) if shown else "",
                links={
                    path.stem.replace("_", " "): Path(os.path.relpath(path, base)).as_posix()
                    for path in shown
                },
            )
        )
    return Section(
        name=campaign.name,
        title=title(campaign.name, figures, campaign.seeds),
        description=campaign.experiment.description,
        tables=experiment_tables(
            campaign.application, campaign.experiment, figures, campaign.seeds
        ),
        notes=[
            *filter(None, [task_in_words(campaign)]),
            *campaign.experiment.notes,
            HOW_TO_READ,
            *running_notes(figures),
        ],
        pictures=pictures,
        episodes=cards,
    )


def _plots(folder: Path) -> list[Path]:
    """An episode's pictures; the first one stands for it on the page."""
    return sorted((folder / PLOT_FOLDER).glob("*.png"))


def _reason(summary: Summary) -> str:
    """Why an episode's task was not done; nothing where it was."""
    if summary["success"] is None:
        return "not known whether it was done"
    return "" if summary["success"] else summary.get("failure") or "unknown"


def inline(path: Path) -> str:
    """A picture as an address that holds it."""
    return "data:image/png;base64," + base64.b64encode(path.read_bytes()).decode()


def _thumbnail(path: Path) -> str:
    with Image.open(path) as image:
        small = image.convert("RGB")
    small.thumbnail(_THUMBNAIL)
    buffer = io.BytesIO()
    small.save(buffer, "PNG", optimize=True)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()
