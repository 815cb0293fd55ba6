"""Compares one metric of two evaluations seed by seed: how often it is better, and whether by luck.

crossmodal evaluate touches --seeds 0:60
crossmodal evaluate touches --seeds 0:60 --set touches.criterion=random --out runs/by-lot
python -m benchmarks.paired_trials runs/evaluate/touches runs/by-lot
"""

from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd
import typer
from scipy.stats import binomtest, wilcoxon


def by_seed(folder: Path, metric: str, estimator: str) -> pd.Series:
    """The metric's values by seed, of an evaluation's folder."""
    rows = pd.read_csv(folder / "results.csv")
    rows = rows[(rows["metric"] == metric) & (rows["modality"] == estimator)]
    if rows.empty:
        raise typer.BadParameter(f"{folder / 'results.csv'} has no {metric} of {estimator}")
    return rows.set_index("seed")["value"].astype(float).dropna()


def main(
    first: Annotated[Path, typer.Argument(help="Folder of an evaluation.")],
    second: Annotated[Path, typer.Argument(help="Folder of the one to compare it with.")],
    metric: Annotated[str, typer.Option(help="Of results.csv; less is better.")] = "adi",
    estimator: Annotated[str, typer.Option(help="Of results.csv.")] = "density",
) -> None:
    """Prints mean, median and 90 % of both, in how many seeds the first one is better, and p."""
    values = [by_seed(folder, metric, estimator) for folder in (first, second)]
    pairs = pd.concat(values, axis=1, join="inner").to_numpy()
    for folder, column in zip((first, second), pairs.T, strict=True):
        some = f"{column.mean():.3g}, {np.median(column):.3g}, {np.quantile(column, 0.9):.3g}"
        print(f"{folder}: mean, median, 90 %: {some}")
    better = int(np.sum(pairs[:, 0] < pairs[:, 1]))
    signs, ranks = binomtest(better, len(pairs)).pvalue, wilcoxon(pairs[:, 0], pairs[:, 1]).pvalue
    print(
        f"the first is less in {better} of {len(pairs)}; p {signs:.1e} (signs), {ranks:.1e} (ranks)"
    )


if __name__ == "__main__":
    typer.run(main)
