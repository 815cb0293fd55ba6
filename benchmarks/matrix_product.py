"""The time of a matrix product: the unit in which times of different machines are compared."""

import time

import numpy as np

SIZE = 600
_A = np.random.default_rng(0).normal(size=(SIZE, SIZE))
NAME = f"{SIZE} x {SIZE} matrix product"


def product_time() -> float:
    """Of one product of float64 on as many cores as the library takes, [s].

    It empties the caches, so that what is timed right after it is slower.
    """
    start = time.perf_counter()
    _A @ _A
    return time.perf_counter() - start
