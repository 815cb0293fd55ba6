"""Units of measurement as text, such as `N s/m`, and values in other units of the same dimension.

A unit is a product of names, each with a power and perhaps after a `/`. A name that is not known
here, such as `px`, is a dimension of its own.
"""

import math
import re
from fractions import Fraction

_PI = Fraction(math.pi)
# How many of the product of base units, and their powers.
_KNOWN: dict[str, tuple[Fraction, dict[str, int]]] = {
    "m": (Fraction(1), {"m": 1}),
    "cm": (Fraction(1, 100), {"m": 1}),
    "mm": (Fraction(1, 1000), {"m": 1}),
    "um": (Fraction(1, 10**6), {"m": 1}),
    "rad": (Fraction(1), {"rad": 1}),
    "mrad": (Fraction(1, 1000), {"rad": 1}),
    "deg": (_PI / 180, {"rad": 1}),
    "s": (Fraction(1), {"s": 1}),
    "ms": (Fraction(1, 1000), {"s": 1}),
    "min": (Fraction(60), {"s": 1}),
    "h": (Fraction(3600), {"s": 1}),
    "Hz": (Fraction(1), {"s": -1}),
    "kHz": (Fraction(1000), {"s": -1}),
    "kg": (Fraction(1), {"kg": 1}),
    "g": (Fraction(1, 1000), {"kg": 1}),
    "N": (Fraction(1), {"kg": 1, "m": 1, "s": -2}),
    "mN": (Fraction(1, 1000), {"kg": 1, "m": 1, "s": -2}),
    "kN": (Fraction(1000), {"kg": 1, "m": 1, "s": -2}),
    "Pa": (Fraction(1), {"kg": 1, "m": -1, "s": -2}),
    "hPa": (Fraction(100), {"kg": 1, "m": -1, "s": -2}),
    "kPa": (Fraction(1000), {"kg": 1, "m": -1, "s": -2}),
    "bar": (Fraction(10**5), {"kg": 1, "m": -1, "s": -2}),
    "mbar": (Fraction(100), {"kg": 1, "m": -1, "s": -2}),
}
_FACTOR = re.compile(r"([/ ·*]*)([A-Za-z]+)(?:\^(-?\d(?:\.\d+)?))?")


def in_unit(value: float, unit: str, wanted: str) -> float:
    """A measured value in another unit of the same dimension.

    Args:
        value: In `unit`.
        unit: Such as `cm`, `m/s^0.5` or `N m`.
        wanted: Another one, or several with ` or ` between them.

    Raises:
        ValueError: where none of the wanted has the unit's dimension, or one is no unit.
    """
    factor, dimension = _measure(unit)
    for choice in wanted.split(" or "):
        one, other = _measure(choice)
        if dimension == other:
            return float(Fraction(value) * factor / one)
    raise ValueError(f"{unit} is not a measure of what {wanted} is")


def _measure(unit: str) -> tuple[Fraction, dict[str, Fraction]]:
    """How many of the product of base units a unit is, and their powers, none of them zero."""
    text = unit.strip().removeprefix("1")
    found = list(_FACTOR.finditer(text))
    if "".join(match.group() for match in found) != text:
        raise ValueError(f"'{unit}' is no unit")
    total, powers = Fraction(1), dict[str, Fraction]()
    for separator, name, power in (match.groups() for match in found):
        factor, parts = _KNOWN.get(name, (Fraction(1), {name: 1}))
        exponent = Fraction(power or 1) * (-1 if "/" in separator else 1)
        total *= Fraction(factor**exponent)
        for base, count in parts.items():
            powers[base] = powers.get(base, Fraction(0)) + exponent * count
    return total, {base: power for base, power in powers.items() if power}
