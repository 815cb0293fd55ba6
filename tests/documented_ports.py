"""Reads the names of ports from the docstring of a system."""

import inspect
import re


def documented_ports(docstring: str | None, kind: str) -> list[str]:
    """Names in the list "Input ports:" or "Output ports:", each of which is explained there.

    What stands in <...> or (...) may vary, what stands in [...] may be missing too.

    Args:
        docstring: Of a system or of a function that makes a Diagram.
        kind: "input" or "output".
    """
    text = inspect.cleandoc(docstring or "") + "\n"
    section = re.search(rf"^{kind.capitalize()} ports:\n((?:- .*\n(?:  .*\n)*)*)", text, re.M)
    heads = re.findall(r"^- ([^:]+):\s", section[1] if section else "", re.M)
    return [name for head in heads for name in re.findall(r"`([^`]+)`", head)]
