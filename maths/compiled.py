"""How the innermost loops are compiled; where the code is kept is in `compiled_cache`."""

import errno
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

import numba
from numba.core.event import Event, TimingListener, install_listener

from crossmodal.maths.arrays import Array

# Without fast maths: a function is optimised differently within each caller, and which copy runs
# depends on what was on the disk. What may be reordered then has other last digits.
# Nobody calls it from C.
_compiled = numba.njit(  # type: ignore[call-overload]
    cache=True, error_model="numpy", no_cfunc_wrapper=True
)
F = TypeVar("F", bound=Callable[..., Any])


def hot(function: F) -> F:
    """Compiles a function when it is first called, and keeps its code on the disk.

    Raises:
        PermissionError: where there is no place for it.
    """
    try:
        compiled: Any = _compiled(function)
    except RuntimeError as error:
        if "no locator available" not in str(error):
            raise
        raise PermissionError(
            errno.EACCES,
            "neither this program's folder nor the user's cache folder can be written, where"
            " compiled code is kept; set NUMBA_CACHE_DIR to a folder that can",
        ) from None
    return compiled


@hot
def assign(out: Array, values: Array) -> None:
    """Overwrites `out` by `values`, an array of the same size.

    `out[:] = values` does the same, but brings the text of its error, and with it all that makes
    text of numbers, into every function that calls the caller: a quarter of the time of compiling.
    """
    for i in range(out.size):
        out.flat[i] = values.flat[i]


class CompilationTime(TimingListener):
    """The wall time that has gone into compiling; what is read from the disk takes none."""

    def __init__(self, announce: Callable[[], None] | None) -> None:
        super().__init__()
        self._announce = announce

    def on_start(self, event: Event) -> None:
        if self._announce is not None:
            self._announce()
            self._announce = None
        super().on_start(event)

    @property
    def seconds(self) -> float:
        """So far, [s]."""
        return float(self.duration) if self.done else 0.0


# What a command says before it compiles.
COMPILING = "Compiling the filters' inner loops: a minute more, this first time."


@contextmanager
def compilation_timed(announce: Callable[[], None] | None = None) -> Iterator[CompilationTime]:
    """Measures what is compiled inside it.

    Args:
        announce: Called once, before the first function is compiled.
    """
    with install_listener("numba:compile", CompilationTime(announce)) as time:
        yield time
