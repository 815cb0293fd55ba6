"""Figures of an episode of the flap, each from arrays over time; SI and rad."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from crossmodal.diagrams.flap.results.flap_episode import FlapSeries, TrueFlap
from crossmodal.maths.arrays import Array, Mask
from crossmodal.maths.consistency import chi_square_quantile
from crossmodal.plants.tools.flap_jerk import FlapJerk

JUDGED_FROM = float(np.deg2rad(30.0))  # From this angle on the hinge and the vectors count.
SETTLING = 2.0  # After the flipping began, [s].
ALIGNED = 0.1  # |n · n_f| that is near zero: 6 deg.
KEPT = 1.0  # A contact that lasts so long has come back, [s].
_TWO_SIGMA = 0.9545  # Probability of two deviations of one dimension.


@dataclass(frozen=True, kw_only=True)
class Servoing:
    """How the fingertip turned the flap; NaN for what did not come about.

    Attributes:
        turned: The flap's angle when the flipping ended, [rad].
        longest_loss: Longest time without contact while flipping, [s].
        contact_position_rms: Of the contact on the fingertip about its mean, after settling, [m].
        contact_position_offset: That mean's distance from the centre of the pad along x, [m].
        force_rms: Error of the normal force after settling, [N].
        edge_slide: How far the contact moves along the axis while flipping, from end to end, [m].
        edge_force: Friction along the axis after settling, RMS, [N].
        misaligned_at_first: How far the pad's normal is from lying in the flap as the flipping
            begins, [rad].
        aligned_after: From then until it lies in it, to 6 deg, [s].
    """

    turned: float
    longest_loss: float = float("nan")
    contact_position_rms: float = float("nan")
    contact_position_offset: float = float("nan")
    force_rms: float = float("nan")
    edge_slide: float = float("nan")
    edge_force: float = float("nan")
    misaligned_at_first: float = float("nan")
    aligned_after: float = float("nan")


@dataclass(frozen=True, kw_only=True)
class Estimation:
    """How good one estimator is; NaN for what it never believed.

    Attributes:
        axis_angle_error: When the flap has truly turned by 30 deg, [rad].
        axis_angle_error_at_end: [rad]
        theta_rmse_visible: While the camera saw the flap, [rad].
        theta_rmse_hidden: While it did not, from 30 deg on, [rad].
        L1_error: Mean length of the error from 30 deg on, [m].
        L2_error: Likewise, [m].
        inside_two_sigma: Shares of the ticks from 30 deg on by quantity.
    """

    axis_angle_error: float
    axis_angle_error_at_end: float
    theta_rmse_visible: float
    theta_rmse_hidden: float
    L1_error: float
    L2_error: float
    inside_two_sigma: dict[str, float]


def longest_run(times: Array, flags: Mask) -> float:
    """The longest time that `flags` (T,) stay true, [s]; a single tick counts one period."""
    if not flags.any():
        return 0.0
    period = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    steps = np.diff(np.concatenate([[0], flags.astype(int), [0]]))
    lengths = np.flatnonzero(steps == -1) - np.flatnonzero(steps == 1)
    return float(lengths.max()) * period


def lasting_from(times: Array, flags: Mask, duration: float, first: int = 0) -> int | None:
    """The first index, not before `first`, from which `flags` (T,) stay true for `duration` [s]."""
    for k in first + np.flatnonzero(flags[first:]):
        following = (times >= times[k]) & (times <= times[k] + duration)
        if flags[following].all() and times[-1] >= times[k] + duration:
            return int(k)
    return None


def aligned_after(times: Array, cosine: Array) -> float:
    """When |cosine| (T,) comes near zero and stays for a second, since the first time; NaN never.

    A second that the contact breaks off (NaN) does not count as near.
    """
    start = lasting_from(times, np.abs(cosine) < ALIGNED, 1.0)
    return float("nan") if start is None else float(times[start] - times[0])


def rms(values: Array) -> float:
    """Root of the mean square of what is known; NaN for nothing."""
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else float("nan")


def mean(values: Array) -> float:
    """Mean of what is known; NaN for nothing."""
    known = values[np.isfinite(values)]
    return float(np.mean(known)) if len(known) else float("nan")


def angles_between(a: Array, b: Array) -> Array:
    """Angles (T,) between unit vectors (T, 3), [rad]; exact for small ones."""
    return np.asarray(
        np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.sum(a * b, axis=1)), dtype=float
    )


def share_inside(errors: Array, covariances: Array) -> float:
    """Share of errors (T, n) within two deviations, as reported; NaN for none.

    In n dimensions that is the ellipsoid that holds as much as two deviations of one do; along
    directions without any variance, such as an axis' own, nothing is asked.
    """
    inside = []
    for error, covariance in zip(errors, covariances, strict=True):
        if not (np.isfinite(error).all() and np.isfinite(covariance).all()):
            continue
        variances, axes = np.linalg.eigh(covariance)
        spread = variances > 1e-9 * max(variances[-1], 1e-300)
        squared = np.sum((axes.T @ error)[spread] ** 2 / variances[spread])
        inside.append(bool(squared <= chi_square_quantile(_TWO_SIGMA, int(spread.sum()))))
    return float(np.mean(inside)) if inside else float("nan")


def measure_servoing(truth: TrueFlap, force_desired: float) -> Servoing:
    """How the fingertip turned the flap.

    Args:
        truth: Of the episode.
        force_desired: Normal force that was asked for, [N].
    """
    flipping = np.flatnonzero(truth.flipping)
    theta = truth.theta[: flipping[-1] + 1] if len(flipping) else truth.theta
    known = theta[np.isfinite(theta)]
    turned = float(known[-1]) if len(known) else 0.0
    if len(flipping) == 0:
        return Servoing(turned=turned)
    times = truth.times[flipping]
    touching = truth.touching[flipping]
    settled = (times >= times[0] + SETTLING) & touching
    p_SC = truth.p_SC[flipping][settled][:, [0, 2]]  # Across the pad's normal.
    centre = p_SC.mean(axis=0) if len(p_SC) else np.full(2, np.nan)
    cosine = np.sum(truth.Sy_W * truth.n_W, axis=1)[flipping]
    along = np.sum((truth.p_WC - truth.p_WE) * truth.k_W, axis=1)[flipping]
    along = along[np.isfinite(along)]
    return Servoing(
        turned=turned,
        longest_loss=longest_run(times, ~touching),
        contact_position_rms=rms(np.linalg.norm(p_SC - centre, axis=1)),
        contact_position_offset=float(centre[0]),
        force_rms=rms(truth.force[flipping][settled] - force_desired),
        edge_slide=float(np.ptp(along)) if len(along) else float("nan"),
        edge_force=rms(truth.edge_force[flipping][settled]),
        misaligned_at_first=float(abs(np.arcsin(np.clip(cosine[0], -1.0, 1.0)))),
        aligned_after=aligned_after(times, cosine),
    )


def measure_estimation(truth: TrueFlap, series: FlapSeries) -> Estimation:
    """How good an estimator is while the robot flips the flap."""
    count = min(len(truth.times), len(series.times))
    flipping, theta = truth.flipping[:count], truth.theta[:count]
    judged = flipping & (theta >= JUDGED_FROM)
    k_W, k_true, seen = series.k_W[:count], truth.k_W[:count], series.seen[:count]
    axis_error = angles_between(k_W, k_true)
    theta_error = series.theta[:count] - theta
    theta_variance = series.theta_std[:count, None, None] ** 2
    L1_error = series.L1_W[:count] - truth.L1_W[:count]
    L2_error = series.L2_W[:count] - truth.L2_W[:count]
    first = np.flatnonzero(judged)
    nothing = float("nan")
    return Estimation(
        axis_angle_error=float(axis_error[first[0]]) if len(first) else nothing,
        axis_angle_error_at_end=float(axis_error[first[-1]]) if len(first) else nothing,
        theta_rmse_visible=rms(theta_error[flipping & seen]),
        theta_rmse_hidden=rms(theta_error[judged & ~seen]),
        L1_error=mean(np.linalg.norm(L1_error[judged], axis=1)),
        L2_error=mean(np.linalg.norm(L2_error[judged], axis=1)),
        inside_two_sigma={
            name: share_inside(errors[judged], covariances[:count][judged])
            for name, errors, covariances in (
                ("axis", np.cross(k_true, np.cross(k_W, k_true)), series.k_covariance),
                ("theta", theta_error[:, None], theta_variance),
                ("L1", L1_error, series.L1_covariance),
                ("L2", L2_error, series.L2_covariance),
            )
        },
    )


def recovery(truth: TrueFlap, jerk: FlapJerk) -> dict[str, Any] | None:
    """What became of the contact after one jerk of the flap; None where the flip was over before.

    Returns:
        `start` of the jerk, [s]; the `displacement` of the contact's place on the flap in it, as it
        truly came about, [m], NaN where it was not touched before; `contact_lost`, whether the
        contact broke off before the finger left the flap for good; `reestablished_after`, since the
        jerk began, until a contact that lasted, [s]: 0 where none was lost, NaN where it did not
        come back.
    """
    times = truth.times[truth.times < truth.retreated_at]
    after = np.flatnonzero(times > jerk.start)
    if len(after) == 0:
        return None
    index = int(after[0])
    before, end = max(index - 1, 0), min(int(np.searchsorted(times, jerk.end)), len(times) - 1)
    lever = float(np.linalg.norm(truth.L2_W[before]))
    displacement = lever * float(truth.theta[end] - truth.theta[before])
    lost = np.flatnonzero(~truth.touching[index : len(times)])
    touching = truth.touching[: len(times)]
    back = lasting_from(times, touching, KEPT, index + int(lost[0])) if len(lost) else None
    reestablished = float("nan") if back is None else float(times[back] - jerk.start)
    return {
        "start": jerk.start,
        "displacement": displacement,
        "contact_lost": len(lost) > 0,
        "reestablished_after": reestablished if len(lost) else 0.0,
    }


def summarise_recoveries(truth: TrueFlap, jerks: Sequence[FlapJerk]) -> dict[str, Any]:
    """What the jerks of an episode came to, for its summary; nothing where there were none."""
    found = [recovery(truth, jerk) for jerk in jerks]
    seen = [item for item in found if item is not None]
    if not jerks:
        return {}
    times = [item["reestablished_after"] for item in seen]
    back = len(seen) == len(jerks) and bool(np.isfinite(times).all())
    return {
        "contact_reestablished": back,
        "reestablished_after": max(times) if back else float("nan"),
        "jerks": seen,
    }
