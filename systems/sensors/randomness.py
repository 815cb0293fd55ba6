"""Random numbers that depend on a seed, a name and a count, and on nothing else."""

import zlib

import numpy as np
import numpy.typing as npt

from crossmodal.maths.arrays import Array

_BLOCK = 1024


def make_generator(seed: int, name: str, *counts: int) -> np.random.Generator:
    """A generator for one purpose: other names, counts or seeds give independent numbers."""
    return np.random.Generator(np.random.SFC64([seed, zlib.crc32(name.encode()), *counts]))


def random_bytes(rng: np.random.Generator, size: int) -> npt.NDArray[np.uint8]:
    """Independent uniform bytes (size,)."""
    words = rng.integers(0, 2**64, dtype=np.uint64, size=(size + 7) // 8)
    return words.view(np.uint8)[:size]


class WhiteNoise:
    """Standard normal vectors (n,), a pure function of seed, name and index.

    Drawn in blocks, because a generator takes longer to seed than to draw a block; only the last
    block is kept.
    """

    def __init__(self, seed: int, name: str, size: int) -> None:
        self._seed, self._name, self._size = seed, name, size
        self._block_index = -1
        self._block = np.empty((0, size))

    def __call__(self, index: int) -> Array:
        block_index, row = divmod(index, _BLOCK)
        if block_index != self._block_index:
            rng = make_generator(self._seed, self._name, block_index)
            self._block = rng.standard_normal((_BLOCK, self._size))
            self._block_index = block_index
        return np.asarray(self._block[row])
