"""Joint filters on the nine plain streams with outliers: type, wrong reports and the axis' error.

    python -m benchmarks.outlier_streams --seeds 20

An outlier is 5 cm and 20 deg off, as in `robustness_streams`: more than fifteen deviations of most
of these streams, and five to seven of those that are seen to 1 cm. Right and wrong as in
`joint_robustness`; the axis is that at the end, median, and against the streams without outliers.
"""

from typing import Annotated

import numpy as np
import typer
from tqdm import tqdm

from benchmarks.joint_robustness import evaluate_case
from benchmarks.joint_streams import StreamConfig, stream_configs
from benchmarks.robustness_streams import Case
from crossmodal.systems.kinematics.joint_filters import JointFilters, JointFiltersConfig

SHARES = (0.0, 0.02, 0.1)


def as_case(config: StreamConfig, share: float) -> Case:
    """A plain stream with a share of outliers."""
    joint = config.joint_type.value
    return Case(
        name=config.name,
        joint=joint,
        accepted=(joint,),
        motion=lambda t: config.final_configuration * t / config.duration,
        duration=config.duration,
        radius=config.radius or 1.0,
        translation_noise=config.translation_noise,
        rotation_noise=config.rotation_noise,
        outliers=share,
    )


def main(
    seeds: Annotated[int, typer.Option(min=1, help="Streams of each kind.")] = 20,
    first_seed: Annotated[int, typer.Option(help="The first seed.")] = 0,
) -> None:
    """Prints the table, one line per stream and share."""
    filters = JointFilters(JointFiltersConfig())
    rows = ["| stream | outliers | right type | wrong | axis deg | / none |", "|---" * 6 + "|"]
    for config in tqdm(stream_configs(), unit="stream", disable=None):
        clean = np.nan
        for share in SHARES:
            case = as_case(config, share)
            outcomes = [
                evaluate_case(case, s, filters) for s in range(first_seed, first_seed + seeds)
            ]
            axis = float(np.rad2deg(np.median([o.axis_error for o in outcomes])))
            clean = axis if share == 0.0 else clean
            right = sum(o.type in case.accepted for o in outcomes)
            wrong = sum(o.wrong for o in outcomes)
            rows.append(
                f"| {config.name} | {100 * share:.0f} % | {right}/{seeds} | {wrong}"
                f" | {axis:.2g} | {axis / clean:.2f} |"
            )
    print("\n".join(rows))


if __name__ == "__main__":
    typer.run(main)
