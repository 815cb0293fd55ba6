"""Reads YAML into config dataclasses and says in one line what is wrong with it."""

import dataclasses
import difflib
import reprlib
import types
import typing
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import yaml
from pydrake.common.yaml import yaml_dump, yaml_dump_typed, yaml_load_typed

from crossmodal.diagrams.run.yaml_input.loader import MOST_LEVELS, load_yaml

T = TypeVar("T")
_MOST_BYTES = 1_000_000  # Of a file: what comes with the program has some thousand.
_SHOWN = reprlib.Repr()  # How a value stands in a message.
_SHOWN.maxstring = _SHOWN.maxother = 100


class ScenarioError(Exception):
    """What a user gave cannot be run; the message is one line that says what to change."""

    def __init__(self, message: str) -> None:
        super().__init__("".join(c if c.isprintable() else " " for c in message))


def one_line(error: BaseException | str) -> str:
    """The message on one line, without runs of blanks."""
    return " ".join(str(error).split())


def suggestion(word: str, allowed: Iterable[str]) -> str:
    """Says which of `allowed` was probably meant, and lists them all."""
    names = sorted(allowed)
    near = difflib.get_close_matches(word, names, n=1, cutoff=0.5)
    near += [name for name in names if word and name.startswith(word)]
    hint = f"did you mean '{near[0]}'? " if near else ""
    return f"{hint}allowed: {', '.join(names) or 'none'}"


def read_yaml(path: Path) -> dict[str, Any]:
    """The mapping in a YAML file; an empty file holds an empty one."""
    try:
        document = load_yaml(_read_text(path))
    except yaml.YAMLError as error:
        raise ScenarioError(f"{path}: is not valid YAML: {_position(error)}") from None
    if document is None:
        return {}
    if not isinstance(document, dict):
        raise ScenarioError(
            f"{path}: must hold a mapping of keys to values, not a {type(document).__name__}"
        )
    return document


def _read_text(path: Path) -> str:
    try:
        if path.exists() and not path.is_file():
            raise ScenarioError(f"{path}: is no file")
        if (size := path.stat().st_size) > _MOST_BYTES:
            raise ScenarioError(
                f"{path}: has {size} bytes; a scenario has at most {_MOST_BYTES} bytes"
            )
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise ScenarioError(f"{path}: there is no such file") from None
    except (OSError, ValueError) as error:
        raise ScenarioError(f"{path}: cannot be read: {one_line(error)}") from None


def _position(error: yaml.YAMLError) -> str:
    if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark is not None:
        mark = error.problem_mark
        return f"line {mark.line + 1}, column {mark.column + 1}: {error.problem}"
    return one_line(error)


def apply_override(document: dict[str, Any], assignment: str) -> None:
    """Sets `key.path=value` in a nested mapping in place; the value is YAML.

    A number in the path names an element of a list that exists.
    """
    path, equals, text = assignment.partition("=")
    keys = path.strip().split(".")
    if not equals or not all(keys):
        raise ScenarioError(f"--set {assignment}: expected key.path=value")
    if len(keys) > MOST_LEVELS:
        raise ScenarioError(f"--set {_SHOWN.repr(path)}=...: more than {MOST_LEVELS} levels")
    try:
        value = load_yaml(text)
    except yaml.YAMLError as error:
        raise ScenarioError(f"--set {assignment}: {_position(error)}") from None
    node: Any = document
    for key in keys[:-1]:
        node = _child(node, key, assignment)
    if isinstance(node, list):
        node[_list_index(node, keys[-1], assignment)] = value
    elif isinstance(node, dict):
        node[keys[-1]] = value
    else:
        raise ScenarioError(f"--set {assignment}: '{keys[-1]}' is inside a plain value")


def _child(node: Any, key: str, assignment: str) -> Any:
    if isinstance(node, list):
        return node[_list_index(node, key, assignment)]
    if isinstance(node, dict):
        return node.setdefault(key, {})
    raise ScenarioError(f"--set {assignment}: '{key}' is inside a plain value")


def _list_index(node: list[Any], key: str, assignment: str) -> int:
    if key in map(str, range(len(node))):
        return int(key)
    raise ScenarioError(f"--set {assignment}: '{key}' is not one of the {len(node)} elements")


def load_typed(schema: type[T], document: dict[str, Any], source: str) -> T:
    """The mapping as an instance of the dataclass `schema`; absent keys keep their defaults.

    Args:
        source: Where the mapping comes from, the beginning of every error message.
    """
    _check(document, schema, source, "")
    defaults = schema()
    try:
        document = _completed(document, defaults)
        return yaml_load_typed(
            schema=schema,
            data=yaml_dump(document),
            defaults=defaults,
            retain_map_defaults=False,
        )
    except (RuntimeError, TypeError, ValueError, yaml.YAMLError) as error:
        raise ScenarioError(f"{source}: {one_line(error)}") from None


def _completed(document: dict[str, Any], defaults: Any) -> dict[str, Any]:
    """A document whose named parts keep the defaults' values of what it does not say of them.

    A mapping of names to parts, such as the cameras, holds the parts that the document names. Drake
    would give those the values of their class, also where the defaults have a part of that name.
    """
    completed = dict(document)
    for name, said in document.items():
        default = getattr(defaults, name)
        if not isinstance(said, dict):
            continue
        if dataclasses.is_dataclass(default):
            completed[name] = _completed(said, default)
        elif isinstance(default, dict):
            completed[name] = {
                key: _merged(yaml.safe_load(yaml_dump_typed(default[key])), part)
                if dataclasses.is_dataclass(default.get(key))
                else part
                for key, part in said.items()
            }
    return completed


def _merged(default: Any, said: Any) -> Any:
    """`said`, and of `default` what it does not say."""
    if not isinstance(default, dict) or not isinstance(said, dict):
        return said
    return default | {key: _merged(default.get(key), value) for key, value in said.items()}


def _check(value: Any, schema: Any, source: str, path: str) -> None:
    """Compares a YAML value with the type it must have, recursively."""
    origin, arguments = typing.get_origin(schema), typing.get_args(schema)
    if dataclasses.is_dataclass(schema):
        _check_dataclass(value, schema, source, path)
    elif origin in (typing.Union, types.UnionType):
        if value is None and type(None) in arguments:
            return
        choices = [choice for choice in arguments if choice is not type(None)]
        if len(choices) == 1:
            _check(value, choices[0], source, path)
    elif origin is list:
        _require(isinstance(value, list), value, "a list", source, path)
        for index, item in enumerate(value):
            _check(item, arguments[0], source, f"{path}.{index}")
    elif origin is dict:
        _require(isinstance(value, dict), value, "a mapping", source, path)
        for key, item in value.items():
            _check(item, arguments[1], source, f"{path}.{key}")
    else:
        _check_leaf(value, origin or schema, source, path)


def _check_dataclass(value: Any, schema: Any, source: str, path: str) -> None:
    _require(isinstance(value, dict), value, "a mapping", source, path)
    hints = typing.get_type_hints(schema)
    names = [field.name for field in dataclasses.fields(schema)]
    for key, item in value.items():
        where = f"{path}.{key}".lstrip(".")
        if key not in names:
            raise ScenarioError(f"{source}: unknown key '{where}'; {suggestion(str(key), names)}")
        _check(item, hints[key], source, where)


def _check_leaf(value: Any, schema: Any, source: str, path: str) -> None:
    if schema is float:
        _require(is_number(value), value, "a number", source, path)
    elif schema is int:
        whole = isinstance(value, int) and not isinstance(value, bool)
        _require(whole, value, "a whole number", source, path)
    elif schema is bool:
        _require(isinstance(value, bool), value, "true or false", source, path)
    elif schema is str:
        _require(isinstance(value, str), value, "text", source, path)
    elif schema is np.ndarray:
        _require(_is_array(value), value, "numbers in a list", source, path)


def is_number(value: Any) -> bool:
    """YAML 1.1 reads 1e-3 as text; Drake's loader takes it as the number that was meant."""
    if not isinstance(value, int | float | str) or isinstance(value, bool):
        return False
    try:
        float(value)
    except (ValueError, OverflowError):
        return False
    return True


def _is_array(value: Any) -> bool:
    """Whether it is a list of numbers, or of equally long lists of them."""
    if not isinstance(value, list):
        return False
    rows = [item for item in value if isinstance(item, list)]
    if rows:
        even = len(rows) == len(value) and len(set(map(len, rows))) == 1
        return even and all(map(_is_array, rows))
    return all(map(is_number, value))


def _require(condition: bool, value: Any, expected: str, source: str, path: str) -> None:
    if not condition:
        raise ScenarioError(
            f"{source}: {path or 'the document'} = {_SHOWN.repr(value)}, but it must be {expected}"
        )
