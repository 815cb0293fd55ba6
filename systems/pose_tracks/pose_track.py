"""Poses over time as a tracker gives them, and how well it measures them."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation, Slerp

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable

# Least deviations that are estimated: streams without noise are simulated or were smoothed.
_LEAST = np.repeat([1e-3, 1e-4], 3)  # [rad], [m]
# Variance of the distance of a measurement from the mean of its two neighbours, by that of one.
_SECOND_DIFFERENCE = 1.5
# Seconds since 1970 are about 1.7e9; stamps that are a thousand times as large are milliseconds.
_UNITS = ((1e17, 1e-9), (1e14, 1e-6), (1e11, 1e-3))
_SAME = 1.0 + 1e-9  # Ratio of two lengths that are the same but for rounding.
_STAMPS = 1e8  # Larger times are stamps since 1970, [s].
_UNIT = 0.1  # Largest error of a quaternion's norm.
_COLUMNS = ("time", "x", "y", "z", "qx", "qy", "qz", "qw")
_MEDIAN_OF_TWO = 2.0 * np.log(2.0)  # Median of the sum of two squared standard normal variables.


@dataclass(frozen=True, kw_only=True)
class PoseTrack(Immutable):
    """Poses X_AB of a body B in a frame A.

    Attributes:
        times: (N,), [s], in any order; a clock that jumps is found by the joint filters.
        X_AB: (N, 4, 4), [m]. NaN where a pose is missing; the rotation is any where none is
            measured.
        deviations: (N, 6) standard deviations in B, rotation [rad] before translation [m]; infinite
            where nothing is measured. NaN where they are not known.
        notes: Sentences about how it was read.
    """

    times: Array
    X_AB: Array
    deviations: Array
    notes: tuple[str, ...] = ()

    @property
    def has_rotations(self) -> bool:
        """Whether any rotation was measured."""
        return not bool(np.isinf(self.deviations[:, :3]).all())


def pose_track(times: Array, poses: Array, deviations: Array | None = None) -> PoseTrack:
    """A track from arrays.

    Args:
        times: (N,), [s], or stamps since 1970 in milli-, micro- or nanoseconds, or `datetime64`.
        poses: (N, 4, 4) matrices, (N, 7) positions with quaternions (x, y, z, qx, qy, qz, qw), or
            (N, 3) positions alone, [m].
        deviations: Of each pose (N, 6), or of all: (6,), or (2,) for rotation [rad] and translation
            [m]. Estimated from the track if None.

    Raises:
        ValueError: for arrays of other shapes, for less than two positions or quaternions that can
            be used, and for deviations that are not positive.
    """
    times, poses = in_seconds(times), np.asarray(poses, dtype=float)
    count = len(times) if times.ndim == 1 else -1
    shapes = {(count, 4, 4): True, (count, 7): True, (count, 3): False}
    if poses.shape not in shapes or not count:
        raise ValueError(
            f"poses have shape {poses.shape} and times {times.shape}; need times (N,) and poses"
            " (N, 4, 4), (N, 7) with quaternions qx, qy, qz, qw, or positions (N, 3)"
        )
    if poses.ndim == 2:
        refuse_unusable(times, poses)
    has_rotations = shapes[poses.shape]
    X_AB = poses.copy() if poses.ndim == 3 else _matrices(poses)
    sigma = np.full((count, 6), np.nan)
    if deviations is not None:
        given = np.asarray(deviations, dtype=float)
        if given.shape == (2,):
            given = np.repeat(given, 3)
        if given.shape not in ((6,), (count, 6)):
            raise ValueError(
                f"deviations have shape {given.shape}; need (2,), (6,) or ({count}, 6),"
                " rotation [rad] before translation [m]"
            )
        if not (given > 0.0).all():
            raise ValueError("deviations need to be above zero; rotation [rad], translation [m]")
        sigma[:] = given
    if not has_rotations:
        sigma[:, :3] = np.inf
    return PoseTrack(times=times, X_AB=X_AB, deviations=sigma)


def in_seconds(times: ArrayLike, unit: float = 1.0) -> Array:
    """Times (N,) [s].

    Args:
        times: Numbers, or NumPy's `datetime64`.
        unit: Of the numbers, [s], unless their size shows that they are stamps since 1970.
    """
    times = np.asarray(times)
    if times.dtype.kind == "M":
        missing = np.isnat(times)
        stamps = times.astype("datetime64[ns]").astype(np.int64)
        return np.where(missing, np.nan, 1e-9 * stamps)
    times = times.astype(float)
    largest = float(np.nanmax(np.abs(times), initial=0.0))
    return times * next((unit for least, unit in _UNITS if largest > least), unit)


def refuse_unusable(
    times: Array, poses: Array, source: str = "", lines: Sequence[int] = ()
) -> None:
    """Says what is wrong with most poses where less than two can be used.

    Args:
        times: (N,), [s].
        poses: Positions (N, 3), or positions with quaternions (N, 7).
        source: What the message begins with, such as a file's name.
        lines: In that file (N,), if it is a text.

    Raises:
        ValueError: where less than two have a time, a position and, if any has one, a rotation.
    """
    columns = dict(zip(_COLUMNS, np.column_stack([times, poses]).T, strict=False))
    wrong = {f"{name} is no number": ~np.isfinite(each) for name, each in columns.items()}
    norms = np.linalg.norm(poses[:, 3:], axis=1)
    if poses.shape[1] == 7:
        wrong["norm"] = np.abs(norms - 1.0) > _UNIT
    count = len(poses)
    if count - np.any(list(wrong.values()), axis=0).sum() >= 2:
        return
    reason, where = max(wrong.items(), key=lambda item: item[1].sum())
    first = int(np.argmax(where))
    if reason == "norm":
        reason = (
            f"the quaternion has norm {norms[first]:.3g} instead of 1; divide quaternions by their"
            " norm, or leave them out and give positions alone"
        )
    elif lines:
        reason += "; write it with a decimal point, or name another column"
    place = f"line {lines[first]}" if lines else f"pose {first}"
    start = f"{source}: " if source else ""
    if not where.any():
        raise ValueError(f"{start}one pose shows no joint; give two or more")
    raise ValueError(
        f"{start}less than two poses can be used: in {where.sum()} of {count}, first in {place},"
        f" {reason}"
    )


def _matrices(poses: Array) -> Array:
    """(N, 4, 4) of positions (N, 3), or of positions with quaternions (N, 7)."""
    X = np.tile(np.eye(4), (len(poses), 1, 1))
    X[:, :3, 3] = poses[:, :3]
    if poses.shape[1] == 7:
        norm = np.linalg.norm(poses[:, 3:], axis=1)
        known = np.isfinite(poses).all(axis=1) & (np.abs(norm - 1.0) < _UNIT)
        X[~known] = np.nan
        if known.any():
            X[known, :3, :3] = Rotation.from_quat(poses[known, 3:]).as_matrix()
    return X


def in_order_of_time(track: PoseTrack) -> PoseTrack:
    """The track as it is, or where its times go back, sorted or without the clock's jumps.

    In whichever order the body's path is shorter, so it went. Where that is the order in which the
    poses came, and the times stay back, the clock has been set back.
    """
    if not (np.diff(track.times) < 0.0).any():
        return track
    order = np.argsort(track.times, kind="stable")
    if _way(track.X_AB[order]) <= _SAME * _way(track.X_AB):
        return PoseTrack(
            times=track.times[order],
            X_AB=track.X_AB[order],
            deviations=track.deviations[order],
            notes=(*track.notes, "the poses were not in the order of their times, and were sorted"),
        )
    times, notes = track.times.copy(), list(track.notes)
    usual = float(np.median(np.abs(np.diff(times[np.isfinite(times)]))))
    for k in np.flatnonzero(np.diff(times) < 0.0):
        back = times[k] - times[k + 1]
        if (times[k + 1 : k + 3] < times[k]).all():
            times[k + 1 :] += back + usual
            notes.append(
                f"after pose {k} the times go back by {back:.3g} s and go on from there; the clock"
                " is taken to have been set back between two poses"
            )
    return replace(track, times=times, notes=tuple(notes))


def _way(X: Array) -> float:
    """Length of the way by poses (N, 4, 4), one after the other; of rotations as at a metre."""
    known = X[np.isfinite(X).all(axis=(1, 2)), :3]
    return float(np.linalg.norm(np.diff(known, axis=0), axis=(1, 2)).sum())


def with_given(track: PoseTrack, deviations: Array) -> PoseTrack:
    """The track with the same deviations (2,) of all poses, rotation [rad] and translation [m].

    Raises:
        ValueError: for deviations that are not positive.
    """
    poses = track.X_AB if track.has_rotations else track.X_AB[:, :3, 3]
    return replace(pose_track(track.times, poses, deviations), notes=track.notes)


def from_its_start(track: PoseTrack) -> PoseTrack:
    """The track with times since its first pose, where they are stamps since 1970."""
    known = track.times[np.isfinite(track.times)]
    if not len(known) or np.abs(known).max() < _STAMPS:
        return track
    return replace(track, times=track.times - known[0])


def with_deviations(track: PoseTrack) -> PoseTrack:
    """The track with its unknown deviations estimated from how much neighbours differ.

    A pose is compared with the mean of its two neighbours, across the way from one to the other:
    along it they differ by how the body speeds up. The median leaves outliers out.
    """
    unknown = np.isnan(track.deviations)
    if not unknown.any():
        return track
    X = track.X_AB[np.isfinite(track.X_AB).all(axis=(1, 2))]
    sigma = np.zeros(6)
    if len(X) >= 3:
        before = [se3.log(se3.inverse(b) @ a) for a, b in itertools.pairwise(X)][:-1]
        after = [se3.log(se3.inverse(b) @ c) for b, c in itertools.pairwise(X)][1:]
        sigma = np.repeat([_across(np.array(before), np.array(after), n) for n in (0, 3)], 3)
    sigma = np.maximum(sigma, _LEAST)
    return replace(track, deviations=np.where(unknown, sigma, track.deviations))


def _across(before: Array, after: Array, first: int) -> float:
    """Standard deviation of one component, by both neighbours' displacements (N, 6) from a pose."""
    part = slice(first, first + 3)
    error = 0.5 * (before + after)[:, part]
    way = (after - before)[:, part]
    length = np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-12)
    across = error - way / length * np.sum(error * way / length, axis=1, keepdims=True)
    squared = float(np.median(np.sum(across**2, axis=1)))
    return float(np.sqrt(squared / (_SECOND_DIFFERENCE * _MEDIAN_OF_TWO)))


def relative_track(parent: PoseTrack, child: PoseTrack) -> PoseTrack:
    """X_PB of a child B in a parent P that moves too, at the child's times; both are given in A.

    The parent's pose is interpolated. Its errors move the child with their lever, so that the
    result's deviations are larger.

    Raises:
        ValueError: for a parent without rotations, or one that was not measured at two of the
            child's poses.
    """
    if not parent.has_rotations:
        raise ValueError("the parent's track has no rotations, which its frame needs")
    parent, child = with_deviations(parent), with_deviations(child)
    known = np.isfinite(parent.X_AB).all(axis=(1, 2))
    times, first = np.unique(parent.times[known], return_index=True)
    if len(times) < 2:
        raise ValueError("the parent's track has less than two poses without NaN")
    inside = (child.times >= times[0]) & (child.times <= times[-1])
    seen = inside & np.isfinite(child.X_AB).all(axis=(1, 2))
    if seen.sum() < 2:
        raise ValueError(
            "the parent's track and the child's have less than two times in common; their clocks"
            " need to be the same"
        )
    X_AP = np.tile(np.eye(4), (int(inside.sum()), 1, 1))
    at = child.times[inside]
    poses = parent.X_AB[known][first]
    X_AP[:, :3, :3] = Slerp(times, Rotation.from_matrix(poses[:, :3, :3]))(at).as_matrix()
    for axis in range(3):
        X_AP[:, axis, 3] = np.interp(at, times, poses[:, axis, 3])
    X_PB = np.array([se3.inverse(P) @ B for P, B in zip(X_AP, child.X_AB[inside], strict=True)])
    of_parent = np.median(parent.deviations, axis=0)
    deviations = np.empty((len(at), 6))
    for k, X in enumerate(X_PB):
        if not np.isfinite(X).all():
            deviations[k] = child.deviations[inside][k]
            continue
        Ad = se3.adjoint(se3.inverse(X))
        added = np.sqrt(np.diag(Ad @ np.diag(of_parent**2) @ Ad.T))
        deviations[k] = np.hypot(child.deviations[inside][k], added)
    notes = tuple(dict.fromkeys((*parent.notes, *child.notes)))
    return PoseTrack(times=at, X_AB=X_PB, deviations=deviations, notes=notes)
