"""Impossible configuration values are refused, and the message names what is possible."""

from dataclasses import dataclass

import numpy as np
import pytest

from maths.validation import require, require_fields, require_not_negative, require_positive


@dataclass(kw_only=True)
class Config:
    period: float = 0.01


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_what_must_be_positive_is_a_finite_number_above_zero(value: float) -> None:
    with pytest.raises(ValueError, match=r"Arm: period = .*, need > 0 s, finite"):
        require_positive("Arm", Config(period=value), {"period": "s"})
    require_positive("Arm", Config(), {"period": "s"})


@pytest.mark.parametrize("value", [-1e-9, np.nan, np.inf])
def test_what_must_not_be_negative_may_be_zero(value: float) -> None:
    with pytest.raises(ValueError, match=r"Arm: period = .*, need >= 0 s, finite"):
        require_not_negative("Arm", Config(period=value), {"period": "s"})
    require_not_negative("Arm", Config(period=0.0), {"period": "s"})


def test_the_message_names_system_field_value_and_what_is_allowed() -> None:
    with pytest.raises(ValueError, match=r"^Arm: period = 3\.0, need <= 1 s$"):
        require(Config(period=3.0).period <= 1, "Arm", Config(period=3.0), "period", "<= 1 s")
    with pytest.raises(ValueError, match=r"^Arm: period = 3\.0, need <= 1 s, finite$"):
        require_fields("Arm", Config(period=3.0), ["period"], "<= 1 s", lambda value: value <= 1)
