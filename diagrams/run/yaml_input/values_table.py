"""What a scenario's values are, what they may be and what they mean, by their declarations."""

import ast
import dataclasses
import inspect
import io
import re
import textwrap
import tokenize
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, cast, get_args, get_origin, get_type_hints

import numpy as np

from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, suggestion
from crossmodal.maths.validation import declared

_ENTRY = re.compile(r"^    (\w+): (.*)$")


@dataclass(frozen=True, kw_only=True)
class ValueLine:
    """One value of a configuration.

    Attributes:
        key: Its path, as `--set` takes it.
        value: As it is written.
        possible: What it may be, with its unit; empty where nothing is declared.
        meaning: The comment at its declaration; empty without one.
    """

    key: str
    value: str
    possible: str
    meaning: str


def values_table(config: Any, key: str = "") -> list[ValueLine]:
    """The values at and below a key, in the order of their declarations.

    At and below an empty list of parts stand the defaults of one that would be in it.

    Args:
        config: A dataclass with all that is below it.
        key: Path of a value or of a part; all for none.

    Raises:
        ScenarioError: for a key that is not there, with those that are.
    """
    at: Any = config
    item: Any = None  # What would be in an empty list.
    meaning, possible, given = "", "", True
    for depth, name in enumerate(part for part in key.split(".") if part):
        below = _parts(at)
        if item is not None:
            below, given = {"0": item}, False
        if name not in below:
            before = ".".join(key.split(".")[:depth])
            where = f"'{key}'" if not before else f"'{key}': there is no '{name}' in '{before}'"
            raise ScenarioError(f"unknown key {where}; {suggestion(name, below)}")
        meaning, possible = _declaration(at, name, meaning)
        item = _missing_item(at, name)
        at = below[name]
    lines = list(_lines(at, key, possible, meaning))
    defaults = [] if item is None else list(_lines(item, f"{key}.0", "", ""))
    if not given:
        lines, defaults = [], lines + defaults
    said = (dataclasses.replace(line, value=f"{line.value} by default") for line in defaults)
    return [*lines, *said]


def unit_at(config: Any, key: str) -> str:
    """The unit that is declared for a value of a configuration; empty where none is.

    Args:
        config: A dataclass, a mapping to dataclasses, or an optional one, as a type.
        key: Path of the value.
    """
    name, _, below = key.partition(".")
    if not dataclasses.is_dataclass(config):
        held = next((kind for kind in get_args(config) if dataclasses.is_dataclass(kind)), None)
        path = below if get_origin(config) is dict else key
        return unit_at(held, path) if held is not None and path else ""
    field = next((field for field in dataclasses.fields(config) if field.name == name), None)
    if field is not None and below:
        return unit_at(get_type_hints(config)[name], below)
    found = None if field is None else declared(field)
    return "" if found is None else found.unit


def _parts(at: Any) -> Mapping[str, Any]:
    if dataclasses.is_dataclass(at):
        return {field.name: getattr(at, field.name) for field in dataclasses.fields(at)}
    if isinstance(at, list) and any(map(dataclasses.is_dataclass, at)):
        return {str(index): item for index, item in enumerate(at)}
    return at if isinstance(at, Mapping) else {}


def _missing_item(at: Any, name: str) -> Any:
    """What could be in a field that is an empty list of dataclasses; None for any other field."""
    value = getattr(at, name) if dataclasses.is_dataclass(at) else None
    if not isinstance(value, list) or value:
        return None
    kinds = get_args(get_type_hints(type(at))[name])
    return next((cast(type, kind)() for kind in kinds if dataclasses.is_dataclass(kind)), None)


def _declaration(at: Any, name: str, inherited: str) -> tuple[str, str]:
    """Meaning and possible values of one field; of a mapping's or list's item those of that."""
    if not dataclasses.is_dataclass(at):
        return inherited, ""
    field = next(field for field in dataclasses.fields(at) if field.name == name)
    found = declared(field)
    kind: type = type(at)
    return comments(kind).get(name, ""), "" if found is None else str(found)


def _lines(at: Any, key: str, possible: str, meaning: str) -> Iterator[ValueLine]:
    below = _parts(at)
    is_part = dataclasses.is_dataclass(at) or any(
        dataclasses.is_dataclass(value) for value in below.values()
    )
    if not is_part:
        yield ValueLine(key=key, value=_written(at), possible=possible, meaning=meaning)
        return
    for name, value in below.items():
        its_meaning, its_possible = _declaration(at, name, meaning)
        yield from _lines(value, f"{key}.{name}".lstrip("."), its_possible, its_meaning)


def _written(value: Any) -> str:
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_written, value)) + "]"
    return "''" if value == "" else str(value)


@cache
def comments(config: type) -> Mapping[str, str]:
    """What the comments beside a dataclass's fields say, or its docstring, by field."""
    found: dict[str, str] = {}
    for base in reversed(config.__mro__):
        if dataclasses.is_dataclass(base):
            found |= _own_comments(base)
    return found


def _own_comments(config: type) -> dict[str, str]:
    try:
        source = textwrap.dedent(inspect.getsource(config))
    except (OSError, TypeError):
        return {}
    found = _documented(inspect.getdoc(config) or "")
    said: dict[int, str] = {}
    alone: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            line = token.start[0]
            said[line] = token.string.lstrip("# ").strip()
            if not token.line[: token.start[1]].strip():
                alone.add(line)
    (tree,) = ast.parse(source).body
    assert isinstance(tree, ast.ClassDef)
    for node in tree.body:
        if not (isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)):
            continue
        above: list[str] = []
        line = node.lineno - 1
        while line in alone:
            above.insert(0, said[line])
            line -= 1
        last = node.end_lineno or node.lineno
        beside = [said[line] for line in range(node.lineno, last + 1) if line in said]
        if text := " ".join([*above, *beside]):
            found[node.target.id] = text
    return found


def _documented(docstring: str) -> dict[str, str]:
    """The entries below `Attributes:`."""
    found: dict[str, str] = {}
    name = ""
    _, _, text = docstring.partition("Attributes:\n")
    for line in text.splitlines():
        if entry := _ENTRY.match(line):
            name, found[entry[1]] = entry[1], entry[2]
        elif name and line.startswith("        "):
            found[name] += f" {line.strip()}"
        elif line.strip():
            break
    return found
