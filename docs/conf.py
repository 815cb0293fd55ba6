"""How Sphinx makes the guide of these pages and of the docstrings: `make docs`."""

import dataclasses
import re
from importlib.metadata import version as version_of
from typing import Any

from crossmodal.diagrams.run.yaml_input.values_table import comments
from crossmodal.maths.validation import declared

project = "crossmodal"
author = "The crossmodal authors"
version = release = version_of("crossmodal")

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
]
templates_path = ["_templates"]
exclude_patterns = ["_build"]
html_theme = "alabaster"
html_theme_options = {"font_family": "sans-serif", "head_font_family": "sans-serif"}
html_theme_options |= {"page_width": "75rem", "sidebar_width": "16rem"}
html_title = project
# Links to headings are made as they are where the pages are read as plain files.
myst_heading_anchors = 4
myst_enable_extensions = ["colon_fence"]

default_role = "code"
suppress_warnings = ["ref.python"]  # Two classes may have a field of the same name.
# `make test` builds the pages alone, with -t pages.
if tags.has("pages"):  # type: ignore[name-defined]  # noqa: F821
    exclude_patterns.append("reference")
    suppress_warnings.append("toc.not_readable")
autosummary_generate = True
autosummary_ignore_module_all = False
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_default_options = {"members": True, "show-inheritance": True}
autodoc_preserve_defaults = True
add_module_names = False
napoleon_use_ivar = True
napoleon_use_rtype = False
napoleon_custom_sections = [("Input ports", "notes_style"), ("Output ports", "notes_style")]

_SPOKEN = re.compile(r"(`[^`]*`)")  # Code, in which nothing is marked up.
# What `crossmodal.maths.arrays.Array` stands for.
_ARRAY = re.compile(
    r"~?numpy\.ndarray\[tuple\[~?typing\.Any, \.\.\.\], ~?numpy\.dtype\[~?numpy\.float64\]\]"
)
_ITEM = re.compile(r"^\s*(- |\d+\. )")


def escaped(line: str) -> str:
    """A line of plain text, in which stars, bars and last underscores are no mark-up."""
    parts = _SPOKEN.split(line)
    parts[::2] = [re.sub(r"([*|]|_(?=\W|$))", r"\\\1", part) for part in parts[::2]]
    # Code ends before what is no letter; an escaped space is none, and is not shown.
    parts[2::2] = [f"\\ {part}" if part[:1].isalnum() else part for part in parts[2::2]]
    return "".join(parts)


def marked_up(lines: list[str]) -> list[str]:
    """Plain text as reStructuredText, which wants an empty line before a list.

    Lines that stand deeper than a line with a colon, and apart from it, are shown as they are.
    """
    result: list[str] = []
    in_list, shown = False, ""
    for number, line in enumerate(lines):
        if shown and (line.startswith(shown) or not line.strip()):
            result.append(line)
            continue
        depth = re.match(r" *", line)[0] + "  "  # type: ignore[index]
        shown = depth if line.endswith(":") and _is_shown(lines[number + 1 :], depth) else ""
        if _ITEM.match(line) and not in_list and result and result[-1].strip():
            result.append("")
        in_list = bool(line.strip()) and (bool(_ITEM.match(line)) or in_list)
        result.append(escaped(line) + ":" * bool(shown))
    return result


def _is_shown(following: list[str], depth: str) -> bool:
    return len(following) > 1 and not following[0].strip() and following[1].startswith(depth)


def fields(config: type) -> list[str]:
    """A list of a configuration's values: what each is, may be, and means."""
    lines = []
    meanings = comments(config)
    for field in dataclasses.fields(config):
        found = declared(field)
        if found is None:
            continue
        meaning = escaped(meanings.get(field.name, ""))
        lines.append(f"- `{field.name}`: {escaped(str(found))}. {meaning}".rstrip())
    return ["", "Values:", "", *lines, ""] if lines else []


def read_docstring(
    app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]
) -> None:
    """Turns a docstring, which is plain text with code between backticks, into mark-up."""
    lines[:] = marked_up(lines)
    if what == "class" and dataclasses.is_dataclass(thing):
        lines += fields(thing)


def read_signature(
    app: Any,
    what: str,
    name: str,
    thing: Any,
    options: Any,
    arguments: str | None,
    result: str | None,
) -> tuple[str | None, str | None]:
    """Names arrays as the source does."""
    return tuple(text and _ARRAY.sub("Array", text) for text in (arguments, result))  # type: ignore[return-value]


def setup(app: Any) -> None:
    app.connect("autodoc-process-signature", read_signature)
    # Before napoleon, which reads the sections.
    app.connect("autodoc-process-docstring", read_docstring, priority=400)
