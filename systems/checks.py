"""The checks of configuration values; they are in `maths.validation`."""

from maths.validation import require, require_fields

__all__ = ["require", "require_fields"]
