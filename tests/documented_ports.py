"""Reads the names of ports from the docstring of a system."""

import inspect
import re

_SAME = r"^- those of `(\w+)`\.\n"  # As another class.


def documented_ports(docstring: str | None, kind: str) -> list[str]:
    """Names in the list "Input ports:" or "Output ports:", each of which is explained there.

    What stands in <...> or (...) may vary, what stands in [...] may be missing too.

    Args:
        docstring: Of a system or of a function that makes a Diagram.
        kind: "input" or "output".
    """
    heads = re.findall(
        r"^- ([^:]+):\s", re.sub(_SAME, "", _section(docstring, kind), flags=re.M), re.M
    )
    return [name for head in heads for name in re.findall(r"`([^`]+)`", head)]


def documented_of(system: type, kind: str) -> list[str]:
    """Likewise of a class, with the ports that it says are those of a class that it extends."""
    names = documented_ports(system.__doc__, kind)
    bases = {base.__name__: base for base in system.__mro__[1:]}
    for base in re.findall(_SAME, _section(system.__doc__, kind), re.M):
        names += documented_of(bases[base], kind)
    return names


def _section(docstring: str | None, kind: str) -> str:
    text = inspect.cleandoc(docstring or "") + "\n"
    section = re.search(rf"^{kind.capitalize()} ports:\n((?:- .*\n(?:  .*\n)*)*)", text, re.M)
    return section[1] if section else ""
