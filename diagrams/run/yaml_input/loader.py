"""Reads YAML files into mappings, and assignments of single values."""

import os
from collections.abc import Hashable, Mapping
from pathlib import Path
from typing import Any

import yaml

from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, one_line

_DEEPEST = 50  # Lists and mappings within each other.
_MOST_VALUES = 100_000
# The one in C is ten times as fast; it is not everywhere.
_Base: type[yaml.SafeLoader] = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class _Loader(_Base):
    """Refuses a key that a mapping has twice, of which otherwise the last one would count."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        lines: dict[str, int] = {}
        for key in (key for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
            if key.value in lines:
                problem = f"the key '{key.value}' is there already, in line {lines[key.value]}"
                raise yaml.MarkedYAMLError(problem=problem, problem_mark=key.start_mark)
            lines[key.value] = key.start_mark.line + 1
        return super().construct_mapping(node, deep)


def _check_size(text: str, source: str) -> None:
    """Refuses what nests or repeats itself so much that it would fill the memory."""
    sizes: dict[str, int] = {}  # Of what has a name, by that.
    within: list[tuple[str | None, int]] = [(None, 0)]  # Names and sizes so far.
    for event in yaml.parse(text, Loader=_Base):
        if isinstance(event, yaml.CollectionStartEvent):
            within.append((event.anchor, 1))
            if len(within) > _DEEPEST:
                many = f"more than {_DEEPEST} lists or mappings stand within each other"
                raise ScenarioError(f"{source}: {many}")
            continue
        if isinstance(event, yaml.ScalarEvent):
            name, size = event.anchor, 1
        elif isinstance(event, yaml.AliasEvent):
            if event.anchor in (anchor for anchor, _ in within):
                raise ScenarioError(f"{source}: '*{event.anchor}' stands within itself")
            name, size = None, sizes.get(event.anchor, 0)
        elif isinstance(event, yaml.CollectionEndEvent):
            name, size = within.pop()
        else:
            continue
        if name is not None:
            sizes[name] = size
        within[-1] = within[-1][0], within[-1][1] + size
        if within[-1][1] > _MOST_VALUES:
            raise ScenarioError(f"{source}: holds more than {_MOST_VALUES} values")


def _load(text: str, source: str) -> Any:
    try:
        _check_size(text, source)
        return yaml.load(text, Loader=_Loader)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        problem = one_line(getattr(error, "problem", None) or error)
        raise ScenarioError(f"{source}: is not valid YAML: {where}{problem}") from None


def read_yaml(path: Path) -> dict[str, Any]:
    """The mapping in a YAML file; an empty file holds an empty one."""
    try:
        if os.path.exists(path) and not os.path.isfile(path):  # Nobody may ever write to a pipe.
            raise ScenarioError(f"{path}: cannot be read: it is no file")
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise ScenarioError(f"{path}: there is no such file") from None
    except (OSError, ValueError) as error:
        raise ScenarioError(f"{path}: cannot be read: {one_line(error)}") from None
    return parse_yaml(text, str(path))


def parse_yaml(text: str, source: str) -> dict[str, Any]:
    """The mapping that a text says; an empty one says an empty one.

    Args:
        text: In YAML.
        source: Where it is from, the beginning of every error message.
    """
    document = _load(text, source)
    if document is None:
        return {}
    if not isinstance(document, dict):
        kind = type(document).__name__
        raise ScenarioError(f"{source}: must hold a mapping of keys to values, not a {kind}")
    return document


def merged(document: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """A nested mapping with changes; mappings in both are merged, all else is replaced."""
    found = dict(document)
    for key, value in changes.items():
        before = found.get(key)
        if isinstance(before, dict) and isinstance(value, dict):
            found[key] = merged(before, value)
        else:
            found[key] = value
    return found


def apply_override(document: dict[str, Any], assignment: str) -> None:
    """Sets `key.path=value` in a nested mapping in place; the value is YAML.

    A number in the path names an element of a list that exists.
    """
    path, equals, text = assignment.partition("=")
    *parents, last = path.strip().split(".")
    if not equals or not all([*parents, last]):
        raise ScenarioError(f"--set {assignment}: expected key.path=value")
    value = _load(text, f"--set {assignment}")
    node: Any = document
    for key in parents:
        if isinstance(node, dict):
            node = node.setdefault(key, {})
        else:
            node = node[_index(node, key, assignment)]
    if isinstance(node, dict):
        node[last] = value
    else:
        node[_index(node, last, assignment)] = value


def _index(node: Any, key: str, assignment: str) -> int:
    if not isinstance(node, list):
        raise ScenarioError(f"--set {assignment}: '{key}' is inside a plain value")
    if key not in map(str, range(len(node))):
        raise ScenarioError(f"--set {assignment}: '{key}' is not one of the {len(node)} elements")
    return int(key)
