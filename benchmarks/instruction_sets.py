"""How far the replays move on a processor with other instructions.

    python -m benchmarks.instruction_sets ["AVX2, as Zen 3"]

Perceives the recordings of tests/recordings once with all that this processor can do and once for
each set below, in a process of its own, and prints the largest differences: of estimates and
standard deviations in standard deviations, of what has none (probabilities, counts, ages) as it is,
rows that only one of both has, and rows that the test of the recordings would name. Compiling the
filters for each set takes minutes.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Annotated

import pandas as pd
import typer

from tests.recordings.outputs import KEYS, differences

_NO_AVX512 = {
    "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
    "OPENCV_CPU_DISABLE": "AVX512-SKX",
}
# Environments in which NumPy, OpenBLAS, OpenCV, Numba and the C library leave instructions out.
SETS: dict[str, dict[str, str]] = {
    "AVX2, as Zen 3": {
        **_NO_AVX512,
        "OPENBLAS_CORETYPE": "Zen",
        "NUMBA_CPU_NAME": "znver3",
    },
    "AVX2, as Haswell": {
        **_NO_AVX512,
        "OPENBLAS_CORETYPE": "Haswell",
        "NUMBA_CPU_NAME": "haswell",
    },
    "SSE4.2 alone": {
        "NPY_DISABLE_CPU_FEATURES": "X86_V4 X86_V3 AVX512_ICL AVX512_SPR",
        "OPENCV_CPU_DISABLE": "AVX,AVX2,FMA3,FP16,AVX512-SKX",
        "OPENBLAS_CORETYPE": "Nehalem",
        "NUMBA_CPU_NAME": "generic",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX,-AVX2,-FMA,-AVX512F",
    },
}
_PERCEIVE = """
import sys
from tests.recordings.outputs import RECORDINGS, perceive
for folder in RECORDINGS:
    perceive(folder).to_pickle(f"{sys.argv[1]}/{folder.name}.pkl")
"""


def _perceive_with(environment: dict[str, str]) -> dict[str, pd.DataFrame]:
    """Outputs of all recordings by name, perceived in a process with these variables."""
    with tempfile.TemporaryDirectory() as folder:
        variables = {**os.environ, "NUMBA_CACHE_DIR": f"{folder}/compiled", **environment}
        subprocess.run([sys.executable, "-c", _PERCEIVE, folder], env=variables, check=True)
        return {path.stem: pd.read_pickle(path) for path in sorted(Path(folder).glob("*.pkl"))}


def moved(expected: pd.DataFrame, came: pd.DataFrame) -> str:
    """The largest differences between two tables of outputs, as a line."""
    both = expected.merge(came, on=KEYS, how="outer", suffixes=("", "_came"), indicator="where")
    estimates = (both["estimate"] - both["estimate_came"]).abs()
    stds = (both["std"] - both["std_came"]).abs()
    only_one = (both["where"] != "both").sum()
    return (
        f"{(estimates / both['std']).max():12.1e}{(stds / both['std']).max():12.1e}"
        f"{estimates[both['std'].isna()].max():12.1e}{only_one:12d}"
        f"{max(len(differences(expected, came)) - 1, 0):12d}"
    )


def main(
    chosen: Annotated[
        str, typer.Argument(metavar="[SET]", help=f"One of {', '.join(map(repr, SETS))}.")
    ] = "",
) -> None:
    """Prints how far the replays move with each set, or with the chosen one."""
    if chosen and chosen not in SETS:
        raise typer.BadParameter(f"{chosen!r} is none of {', '.join(map(repr, SETS))}.")
    headings = ("estimate", "deviation", "without", "missing", "too far")
    print(f"{'':36s}" + "".join(f"{heading:>12s}" for heading in headings))
    expected = _perceive_with({})
    for name in [chosen] if chosen else SETS:
        came = _perceive_with(SETS[name])
        for recording, outputs in expected.items():
            print(f"{name:18s}{recording:18s}{moved(outputs, came[recording])}", flush=True)


if __name__ == "__main__":
    typer.run(main)
