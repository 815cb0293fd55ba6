"""Refuses impossible configuration values with one clear line."""


def require(valid: bool, system: str, config: object, field: str, allowed: str) -> None:
    """Raises a ValueError that names system, field, value and what is allowed, with its unit.

    State `valid` so that NaN fails: `config.period > 0`, not `not config.period <= 0`.
    """
    if not valid:
        raise ValueError(f"{system}: {field} = {getattr(config, field)!r}, need {allowed}")
