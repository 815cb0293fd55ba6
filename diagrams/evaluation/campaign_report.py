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

from diagrams.crossmodal.results.plots import save
from diagrams.evaluation.campaign import Evaluation, episode_folder
from diagrams.evaluation.campaign_plots import (
    common_events,
    draw_errors_at_end,
    draw_errors_over_time,
    read_errors,
)
from diagrams.evaluation.metric_table import (
    HOW_TO_READ,
    Table,
    experiment_tables,
    markdown,
    overall_table,
    running_notes,
    tidy_figures,
    title,
)
from diagrams.run.run_folder import versions, write_atomically, write_text

CSV_FILE, TABLE_FILE, PAGE_FILE = "results.csv", "table.md", "report.html"
SPREAD_FILE, END_FILE = "errors_over_time.png", "errors_at_end.png"
_THUMBNAIL = (480, 480)  # Largest width and height, [pixels].


@dataclass(kw_only=True)
class Picture:
    """An image inside the page, and what it shows."""

    data: str
    text: str


@dataclass(kw_only=True)
class EpisodeCard:
    """An episode on the page; a reason says that it failed."""

    seed: int
    reason: str
    thumbnail: str
    link: str


@dataclass(kw_only=True)
class Section:
    """An experiment on the page."""

    name: str
    title: str
    description: str
    tables: list[Table]
    notes: list[str]
    pictures: list[Picture] = field(default_factory=list)
    episodes: list[EpisodeCard] = field(default_factory=list)


def made_by(command: str) -> str:
    """Command, version and date in one line."""
    known = versions()
    program = f"crossmodal {known['crossmodal']} (source {known['source']})"
    today = datetime.datetime.now(datetime.UTC).date().isoformat()
    return f"`{command}`, {program}, Drake {known['drake']}, {today}."


def write_experiment(evaluation: Evaluation, origin: str) -> list[Path]:
    """Writes an experiment's files and returns them; nothing where no episode has ended.

    Args:
        origin: How the figures were made.
    """
    if not evaluation.summaries:
        return []
    folder, name = evaluation.folder, evaluation.name
    figures = tidy_figures(name, evaluation.summaries)
    table = markdown(name, evaluation.experiment, figures, origin)
    drawings = {
        SPREAD_FILE: draw_errors_over_time(
            read_errors(_episode_folders(evaluation)),
            evaluation.scenarios[0].network_period,
            evaluation.scenarios[0].disturbances,
            common_events(evaluation.summaries),
        ),
        END_FILE: draw_errors_at_end(figures),
    }
    written = [
        write_atomically(folder / CSV_FILE, partial(figures.to_csv, index=False)),
        write_text(folder / TABLE_FILE, table),
    ]
    for file, figure in drawings.items():
        (folder / file).unlink(missing_ok=True)
        if figure is not None:
            written.append(write_atomically(folder / file, partial(save, figure)))
    section = _section(evaluation, figures, folder)
    written.append(write_text(folder / PAGE_FILE, page(name, origin, [section])))
    return written


def write_overview(evaluations: Sequence[Evaluation], folder: Path, origin: str) -> list[Path]:
    """Writes the files of several experiments together, from what each has written."""
    evaluations = [evaluation for evaluation in evaluations if evaluation.summaries]
    if not evaluations:
        return []
    figures = {one.name: tidy_figures(one.name, one.summaries) for one in evaluations}
    overall = overall_table(figures)
    sections = [_section(one, figures[one.name], folder) for one in evaluations]
    heading = "All experiments"
    parts = [f"# {heading}", origin, overall.markdown()]
    parts += [
        markdown(one.name, one.experiment, figures[one.name], "").replace("# ", "## ", 1).rstrip()
        for one in evaluations
    ]
    table = "\n\n".join(parts) + "\n"
    together = pd.concat(figures.values(), ignore_index=True)
    return [
        write_atomically(folder / CSV_FILE, partial(together.to_csv, index=False)),
        write_text(folder / TABLE_FILE, table),
        write_text(folder / PAGE_FILE, page(heading, origin, sections, overall)),
    ]


def page(
    heading: str, origin: str, sections: Sequence[Section], overall: Table | None = None
) -> str:
    """The page, with every picture inside it."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent), autoescape=True, trim_blocks=True
    )
    template = environment.get_template("report.html.jinja")
    return template.render(
        heading=heading, made_by=origin.replace("`", ""), sections=sections, overall=overall
    )


def _episode_folders(evaluation: Evaluation) -> list[Path]:
    """Of the episodes that came to an end."""
    return [
        episode_folder(evaluation.folder, summary["seed"])
        for summary in evaluation.summaries
        if summary["modalities"]
    ]


def _section(evaluation: Evaluation, figures: pd.DataFrame, base: Path) -> Section:
    pictures = [
        Picture(data=_inline(evaluation.folder / file), text=text)
        for file, text in (
            (SPREAD_FILE, "errors over time, median and 5 to 95 % of the seeds"),
            (END_FILE, "errors at the end of every episode"),
        )
        if (evaluation.folder / file).is_file()
    ]
    cards = []
    for summary in evaluation.summaries:
        folder = episode_folder(evaluation.folder, summary["seed"])
        image = folder / "figures" / "errors.png"
        shown = bool(summary["modalities"]) and image.is_file()
        cards.append(
            EpisodeCard(
                seed=summary["seed"],
                reason="" if summary["success"] else summary.get("failure") or "unknown",
                thumbnail=_thumbnail(image) if shown else "",
                link=Path(os.path.relpath(image, base)).as_posix(),
            )
        )
    return Section(
        name=evaluation.name,
        title=title(evaluation.name, figures),
        description=evaluation.experiment.description,
        tables=experiment_tables(evaluation.experiment, figures),
        notes=[HOW_TO_READ, *running_notes(figures)],
        pictures=pictures,
        episodes=cards,
    )


def _inline(path: Path) -> str:
    return "data:image/png;base64," + base64.b64encode(path.read_bytes()).decode()


def _thumbnail(path: Path) -> str:
    with Image.open(path) as image:
        small = image.convert("RGB")
    small.thumbnail(_THUMBNAIL)
    buffer = io.BytesIO()
    small.save(buffer, "PNG", optimize=True)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()
