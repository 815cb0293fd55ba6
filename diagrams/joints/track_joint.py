"""What is told, drawn and written of a joint that was estimated from a track."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib import rc_context
from matplotlib.figure import Figure

from crossmodal.diagrams.drawing.plot_style import STYLE, new_figure
from crossmodal.diagrams.joints.joint_palette import JOINT
from crossmodal.maths.arrays import Array
from crossmodal.systems.port_values import JointType
from crossmodal.systems.pose_tracks.joint_estimate import JointEstimate


def in_units(found: JointEstimate) -> tuple[str, float]:
    """Unit of the configuration as it is shown, and by what q is multiplied."""
    return ("cm", 100.0) if found.type == JointType.PRISMATIC else ("deg", float(np.rad2deg(1.0)))


def described(found: JointEstimate) -> list[str]:
    """The joint in words, a line each."""
    belief, model = found.belief, found.model
    others = sorted(belief.probabilities.items(), key=lambda item: -item[1])[1:]
    rest = ", ".join(f"{joint} {p:.3f}" for joint, p in others if p >= 5e-4)
    lines = [f"{found.type}, p = {found.probability:.3f}{f'  ({rest})' if rest else ''}"]
    if found.type in (JointType.REVOLUTE, JointType.SCREW):
        lines.append(f"a door or lid, p = {belief.hinge_probability():.3f} (climbs < 5 mm/rad)")
    if found.moves:
        unit, factor = in_units(found)
        low, high = (
            f"{factor * limit:.2f} +- {factor * deviation:.2g}"
            for limit, deviation in zip(found.limits, found.limits_deviation, strict=True)
        )
        lines.append(
            f"axis {_vector(found.axis_P)} +- {np.rad2deg(found.axis_deviation):.2g} deg, in P"
        )
        if found.type != JointType.PRISMATIC:
            deviation = 1e3 * float(np.sqrt(np.trace(model.p_PA_covariance)))
            lines.append(f"through {_vector(model.p_PA)} m +- {deviation:.2g} mm")
        if found.type == JointType.SCREW:
            spread = 1e3 * float(np.sqrt(model.pitch_variance))
            lines.append(f"pitch {1e3 * model.pitch:.3g} +- {spread:.2g} mm/rad")
        lines.append(f"seen from {low} to {high} {unit}; the first pose is zero")
    fit = belief.fit
    if fit is not None and np.isfinite(fit.reduced_chi_square):
        outliers = 100.0 * fit.outlier_share
        lines.append(f"fit: chi-square {fit.reduced_chi_square:.2f} per degree, {outliers:.1f} %"
                     " outliers")  # fmt: skip
    if belief.skipped:
        counts = ", ".join(f"{reason} {count}" for reason, count in belief.skipped.items())
        lines.append(f"not used: {counts}")
    return lines


def _vector(vector: Array) -> str:
    return "(" + ", ".join(f"{value:+.4f}" for value in vector) + ")"


def as_values(found: JointEstimate, notes: Sequence[str]) -> dict[str, Any]:
    """The joint as plain values for YAML, and notes on it; SI units."""
    belief, model = found.belief, found.model

    def plain(array: Array) -> Any:
        return np.asarray(array, dtype=float).tolist()

    values: dict[str, Any] = {
        "type": str(found.type),
        "probabilities": {str(joint): float(p) for joint, p in belief.probabilities.items()},
        "poses": {
            "used": int(belief.updates),
            "skipped": {str(reason): int(count) for reason, count in belief.skipped.items()},
        },
        "deviations": plain(np.median(found.track.deviations, axis=0)),
        "notes": list(notes),
    }
    if belief.fit is not None:
        values["fit"] = {
            "reduced_chi_square": float(belief.fit.reduced_chi_square),
            "bounds": plain(np.array(belief.fit.bounds)),
            "outlier_share": float(belief.fit.outlier_share),
            "noise_scale": plain(np.array(belief.fit.noise_scale)),
        }
    if found.type != JointType.DISCONNECTED:
        values["X_PB_zero"] = plain(found.X_PB_zero)
    if not found.moves:
        return values
    values |= {
        "axis": plain(found.axis_P),
        "axis_covariance": plain(model.axis_covariance),
        "limits_seen": plain(np.array(found.limits)),
        "limits_seen_deviation": plain(np.array(found.limits_deviation)),
        "screw": plain(found.S_P),
    }
    if found.type != JointType.PRISMATIC:
        values |= {
            "point": plain(model.p_PA),
            "point_covariance": plain(model.p_PA_covariance),
            "hinge_probability": float(belief.hinge_probability()),
        }
    if found.type == JointType.SCREW:
        values |= {"pitch": model.pitch, "pitch_variance": model.pitch_variance}
    return values


def as_table(found: JointEstimate) -> pd.DataFrame:
    """A row for each pose: time, q with its deviation, and the pose's distance from the path."""
    return pd.DataFrame(
        {
            "time_s": found.track.times,
            "q": found.q,
            "q_deviation": found.q_deviation,
            "distance_rad": found.distance[:, 0],
            "distance_m": found.distance[:, 1],
        }
    )


def drawn(found: JointEstimate, title: str, files: Sequence[str] = ()) -> Figure:
    """The configuration over time with two deviations, and the poses' distances from the path.

    Args:
        files: That each pose is from (N,), each with a band of its own; none where all are of one.
    """
    unit, factor = in_units(found)
    color, times = JOINT[found.type], found.track.times
    with rc_context(STYLE):
        figure = new_figure(8.0, 5.0)
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
        q, spread = factor * found.q, 2.0 * factor * found.q_deviation
        low, high, origin = q - spread, q + spread, np.array(files or [""] * len(times))
        for file in np.unique(origin):
            own = np.flatnonzero(origin == file)
            own = own[np.argsort(times[own], kind="stable")]
            above.fill_between(times[own], low[own], high[own], color=color, alpha=0.25, lw=0)
        above.plot(times, q, ".", color=color, ms=3)
        above.set(title=f"{title}: {found.type}, p = {found.probability:.3f}")
        above.set_ylabel(f"configuration, ± 2σ [{unit}]")
        below.plot(times, 1e3 * found.distance[:, 1], ".", color="#444444", ms=3)
        below.set(xlabel="time [s]", ylabel="off the path [mm]")
        if np.isfinite(found.distance[:, 0]).any():
            turned = below.twinx()
            turned.grid(False)
            turned.plot(times, np.rad2deg(found.distance[:, 0]), ".", color="#CC8800", ms=3)
            turned.set_ylabel("turned off it [deg]", color="#CC8800")
    return figure


def write_results(
    found: JointEstimate, notes: Sequence[str], folder: Path, title: str, files: Sequence[str]
) -> list[Path]:
    """`joint.yaml`, `configuration.csv` and `configuration.png` in a folder.

    Args:
        files: That each pose is from (N,), for the table.
    """
    import yaml

    from crossmodal.diagrams.drawing.plot_style import save
    from crossmodal.diagrams.run.folder.written_files import write_atomically, write_text

    text = yaml.safe_dump(as_values(found, notes), sort_keys=False, default_flow_style=None)
    figure = drawn(found, title, files)
    table = as_table(found).assign(file=files)
    return [
        write_text(folder / "joint.yaml", text),
        write_atomically(
            folder / "configuration.csv", lambda file: table.to_csv(file, index=False)
        ),
        write_atomically(folder / "configuration.png", lambda file: save(figure, file)),
    ]
