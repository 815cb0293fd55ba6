"""Assignment of whole arrays within compiled functions."""

from crossmodal.maths.arrays import Array
from crossmodal.maths.compiled import hot


@hot
def assign(out: Array, values: Array) -> None:
    """Overwrites `out` by `values`, an array of the same size.

    `out[:] = values` does the same, but brings the text of its error, and with it all that makes
    text of numbers, into every function that calls the caller: a quarter of the time of compiling.
    """
    for i in range(out.size):
        out.flat[i] = values.flat[i]
