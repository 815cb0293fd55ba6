"""What of a track, and of the joint that was found in it, looks like a mistake of the input."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from crossmodal.maths.arrays import Array
from crossmodal.systems.port_values import JointType
from crossmodal.systems.pose_tracks.joint_estimate import JointEstimate, estimate_track
from crossmodal.systems.pose_tracks.pose_track import PoseTrack, with_deviations

_TURNING = (JointType.REVOLUTE, JointType.SCREW)
_FEW = 10  # Poses.
_FAR = 20.0  # No robot and no person moves a joint so far, [m].
_SELDOM = 10.0  # A door may turn over between two poses, [s].
_MANY = 0.1  # Of the steps from one time to the next.
_COARSE = 0.1  # A deviation that hardly any tracker has, [rad] or [m].
_TENFOLD = 10.0  # What was given of the noise, beside how much neighbours differ.
_CERTAIN_FIT = 3.0  # A reduced chi-square that many times its bound is no chance.


def doubts(found: JointEstimate) -> list[str]:
    """Sentences for a person, none where nothing looks wrong.

    They tell of units, orders of columns and of times, noise that was given wrongly, and of poses
    that do not follow the joint.
    """
    return [*found.track.notes, *_of_times(found), *_of_poses(found)]


def _of_times(found: JointEstimate) -> Iterator[str]:
    times = found.track.times[np.isfinite(found.track.times)]
    steps = np.diff(times)
    if not len(steps):
        return
    if np.mean(steps == 0.0) > _MANY:
        yield (
            f"{np.sum(steps == 0.0)} poses have the time of the one before: was each sent several"
            " times, or have the times too few digits?"
        )
    if np.median(steps) > _SELDOM:
        yield (
            f"the poses are {np.median(steps):.3g} s apart; if the times are milliseconds,"
            " give --time-scale 0.001"
        )
    elif found.type in _TURNING and np.nanmedian(found.q_deviation) > 0.5 * np.pi:
        yield "by how many turns it has gone on is uncertain: poses come too seldom"


def _of_poses(found: JointEstimate) -> Iterator[str]:
    known = found.track.X_AB[np.isfinite(found.track.X_AB).all(axis=(1, 2))]
    if len(known) < _FEW:
        yield f"{len(known)} poses tell little about a joint"
    reach = float(np.ptp(known[:, :3, 3], axis=0).max())
    if reach > _FAR:
        yield f"the body moves by {reach:.3g} m; if these are millimetres, give --scale 0.001"
    given, shown = (
        np.median(track.deviations, axis=0)
        for track in (found.track, with_deviations(_of_unknown_noise(found.track)))
    )
    for k, what, unit in ((0, "rotations", "rad"), (3, "positions", "m")):
        if np.isfinite(given[k]) and given[k] > max(_COARSE, _TENFOLD * shown[k]):
            yield (
                f"deviations of {what} were given as {given[k]:.3g} {unit}, where neighbours differ"
                f" by {shown[k]:.2g}; they are rad and m in Python, deg and m for --deviations"
            )
    fit = found.belief.fit
    if fit is not None and fit.wander > 0.0 and found.moves:
        yield (
            f"rotations are taken to err smoothly by some {np.rad2deg(fit.wander):.1f} deg, as"
            " fiducials' do: rotations and positions do not show the same joint. If those of this"
            " tracker err less, the body leaves the joint's path, and the axis is another one:"
            " see --no-wander"
        )
    if fit is not None and fit.reduced_chi_square > _CERTAIN_FIT * fit.bounds[1]:
        yield "the poses do not follow this joint: do not trust its deviations"
    if found.type == JointType.DISCONNECTED and (jump := _jump(known[:, :3, 3])):
        yield jump
    if found.type == JointType.DISCONNECTED and found.track.has_rotations:
        other = estimate_track(_with_w_first(found.track))
        if other.type != JointType.DISCONNECTED:
            yield (
                f"read with w first, as qw, qx, qy, qz, the quaternions show a joint, {other.type}"
                f" with p = {other.probability:.3f}"
            )


def _jump(positions: Array) -> str:
    """What tells of a step between two positions (N, 3) that is longer than all others together."""
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    k = int(np.argmax(steps))
    if steps[k] <= 0.5 * steps.sum():
        return ""
    return (
        f"after pose {k} the body jumps by {steps[k]:.3g} m, farther than it moves in all other"
        " steps: if the tracker had not found it before, leave out the poses until then"
    )


def _with_w_first(track: PoseTrack) -> PoseTrack:
    """The track where x, y, z, w of its quaternions were w, x, y, z."""
    known = np.isfinite(track.X_AB).all(axis=(1, 2))
    X_AB: Array = track.X_AB.copy()
    q = Rotation.from_matrix(X_AB[known, :3, :3]).as_quat()
    X_AB[known, :3, :3] = Rotation.from_quat(np.roll(q, -1, axis=1)).as_matrix()
    return _of_unknown_noise(replace(track, X_AB=X_AB))


def _of_unknown_noise(track: PoseTrack) -> PoseTrack:
    unknown = np.where(np.isinf(track.deviations), np.inf, np.nan)
    return replace(track, deviations=unknown)
