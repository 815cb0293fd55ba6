"""Beliefs that a controller may be given."""

from typing import Any

from pydrake.systems.framework import Context, InputPort


def known_belief(port: InputPort, context: Context) -> Any:
    """The belief at a port; None where nothing is believed or the port is not connected."""
    belief: Any = port.Eval(context) if port.HasValue(context) else None
    return belief if belief is not None and belief.known else None
