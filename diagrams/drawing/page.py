"""Pages that a browser opens without a server."""

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import jinja2

from crossmodal.diagrams.drawing.table import Table


@dataclass(kw_only=True)
class Section:
    """A run or an experiment on a page, or what is compared there.

    Attributes:
        outcome: What became of it, in a line.
        tone: Whether that is good.
        portrait: A picture in which one sees what was done: its address and what it shows.
        what: What was done, a sentence each.
        columns: What the titles of columns mean, by word.
        words: What else of words means something, by word.
        printed: Lines whose words stand below each other.
        made: How it was made, in notes at the end.
        pictures: Their addresses, and what each shows.
        links: Addresses of what else there is, by name.
        episodes: Seed, reason of a failure, thumbnail, and links to its pictures by their names.
        side_by_side: Whether the pictures are compared, and begin the section.
    """

    title: str
    name: str = ""
    outcome: str = ""
    tone: Literal["", "good", "mixed", "bad"] = ""
    portrait: tuple[str, str] | None = None
    what: Sequence[str] = ()
    tables: Sequence[Table] = ()
    columns: Mapping[str, str] = field(default_factory=dict)
    words: Mapping[str, str] = field(default_factory=dict)
    notes: Sequence[str] = ()
    printed: Sequence[str] = ()
    made: Sequence[str] = ()
    pictures: Sequence[tuple[str, str]] = ()
    links: Mapping[str, str] = field(default_factory=dict)
    episodes: Sequence[tuple[int, str, str, dict[str, str]]] = ()
    side_by_side: bool = False


def page(
    heading: str, origin: str, sections: Sequence[Section], overall: Sequence[Table] = ()
) -> str:
    """A page of sections.

    Args:
        origin: How the page was made.
        overall: Tables that stand before the sections.
    """
    return render(
        Path(__file__).with_name("page.html.jinja"),
        heading=heading,
        made_by=origin.replace("`", ""),
        sections=sections,
        overall=overall,
    )


def render(template: Path, **values: Any) -> str:
    """A page from a Jinja template, which may include `page_style.html` from this folder."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader([template.parent, Path(__file__).parent]),
        autoescape=True,
        trim_blocks=True,
    )
    return environment.get_template(template.name).render(**values)


def png_address(png: bytes) -> str:
    """A picture as an address that holds it."""
    return "data:image/png;base64," + base64.b64encode(png).decode()
