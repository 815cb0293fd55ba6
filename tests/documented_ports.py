"""Reads the names of ports from the docstring of a system."""

import re


def documented_ports(docstring: str | None, kind: str) -> list[str]:
    """Names in the list "Input ports:" or "Output ports:", each of which is explained there.

    What stands in <...> or (...) may vary, what stands in [...] may be missing too.

    Args:
        docstring: Of a system or of a function that makes a Diagram.
        kind: "input" or "output".
    """
    section = re.search(
        rf"^( +){kind.capitalize()} ports:\n((?:\1- .*\n(?:\1  .*\n)*)*)", docstring or "", re.M
    )
    if section is None:
        return []
    heads = re.findall(r"^ +- ([^:]+):\s", section[2], re.M)
    return [name for head in heads for name in re.findall(r"`([^`]+)`", head)]
