"""Reads YAML as scenarios are written in it: plain values, each key once, and nothing unbounded."""

from collections.abc import Hashable
from typing import Any

import yaml

MOST_LEVELS = 40  # Of mappings and lists within each other.
_PREFIX = "tag:yaml.org,2002:"
_PLAIN = {_PREFIX + name for name in ("map", "seq", "str", "int", "float", "bool", "null")}


class _PlainLoader(yaml.SafeLoader):
    """YAML without what a scenario has no use for and what can grow without bound.

    Dates, binary data and the like are no types of their own: they stay text, and their tags are
    refused. So are aliases, for a change of one place would change another, and so are keys that
    are no text or that a mapping has twice.
    """

    yaml_implicit_resolvers = {  # noqa: RUF012 (as PyYAML declares it)
        first: [(tag, pattern) for tag, pattern in resolvers if tag in _PLAIN]
        for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }

    def __init__(self, stream: str) -> None:
        super().__init__(stream)
        self._level = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        event = self.peek_event()
        if isinstance(event, yaml.AliasEvent):
            raise _error(f"*{event.anchor}: aliases are not read, write the value out", event)
        if self._level == MOST_LEVELS:
            raise _error(f"more than {MOST_LEVELS} levels within each other", event)
        self._level += 1
        node = super().compose_node(parent, index)
        self._level -= 1
        return node

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        if node.tag not in _PLAIN:
            raise _error(f"{_tag(node)}: values of this type are not read", node)
        try:
            value = super().construct_object(node, deep)
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError):
            raise _error(f"cannot be read as {_tag(node)}", node) from None
        if isinstance(value, int) and abs(value) >= 2**63:
            raise _error("a whole number beyond 64 bits", node)
        if isinstance(value, str) and not _is_text(value):
            raise _error("text with a character that no text has", node)
        return value

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        lines: dict[str, int] = {}
        for key, _ in node.value:
            name = f"'{key.value}'" if isinstance(key, yaml.ScalarNode) else "of several values"
            if key.tag != _PREFIX + "str":
                raise _error(f"the key {name} is no text; put it into quotes if it is one", key)
            if key.value in lines:
                raise _error(f"the key {name} is there already, in line {lines[key.value]}", key)
            lines[key.value] = key.start_mark.line + 1
        return super().construct_mapping(node, deep)


def _error(problem: str, place: Any) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=problem, problem_mark=place.start_mark)


def _tag(node: yaml.Node) -> str:
    return str(node.tag).replace(_PREFIX, "!!")


def _is_text(value: str) -> bool:
    """Whether a string can be a file's name or be written to one."""
    return "\0" not in value and not any("\ud800" <= letter <= "\udfff" for letter in value)


def load_yaml(text: str) -> Any:
    """The value that a YAML document holds: None, a number, text, true, false, or of these lists
    and mappings by text.

    Raises:
        yaml.YAMLError: where it is no such document.
    """
    return yaml.load(text, Loader=_PlainLoader)
