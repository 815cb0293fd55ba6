"""One tick for all that a scenario configures: it is chosen in one place only."""

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import TypeVar

from crossmodal.diagrams.run.yaml_input.schema import ScenarioError

C = TypeVar("C")

SENSOR_TICKS = ("tick", "exposure_period")  # How sensors call it; their period is of samples.


def with_common_tick(config: C, keys: Sequence[str], period: float, source: str) -> C:
    """The parts of a config with the scenario's tick.

    Args:
        config: A dataclass whose fields are the configs of one system each, or anything else.
        keys: How the tick is called in those that have one.
        period: The scenario's `network_period`, [s].
        source: What the parts belong to, for the message, such as `my.yaml: sensors`.

    Raises:
        ScenarioError: for a part that is given another tick than its usual one or this.
    """
    changed = {}
    for item in fields(config):  # type: ignore[arg-type]
        part = getattr(config, item.name)
        for key in keys:
            if not hasattr(part, key):
                continue
            usual, value = getattr(type(part)(), key), getattr(part, key)
            if value not in (usual, period):
                raise ScenarioError(
                    f"{source}.{item.name}.{key} = {value!r} s, but all sensors and estimators"
                    f" tick at network_period = {period!r} s"
                )
            part = replace(part, **{key: period})
        changed[item.name] = part
    return replace(config, **changed)  # type: ignore[type-var]
