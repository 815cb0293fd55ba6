"""Joint filters on real tracks: what type they believe, whatever noise is reported.

    python -m benchmarks.real_tracks

The tracks are example data of J. Sturm's articulation models (BSD-2-Clause, see `tracks/LICENSE`;
J. Sturm, C. Stachniss and W. Burgard, "A probabilistic framework for learning kinematic models of
articulated objects", JAIR 2011): a marker on a real door and a real drawer as a camera sees it, and
the hand of a robot arm that opens a dishwasher, two doors and a drawer, three times each, of which
only the position is known.

Residual: root mean square distance of the measured positions from the believed path, without the
worst tenth. Innovations: share of the positions within two standard deviations per direction of
what the believed type predicted, noise and path deviations as large as they are believed to
be, after the first second. Axis: angle to the mean over repeats, and the same of a least-squares
fit of a line or a circle to all positions of each track.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from tqdm import tqdm

from crossmodal.maths.arrays import Array
from crossmodal.systems.kinematics.joint_filters import JointFilters, JointFiltersConfig
from crossmodal.systems.port_values import JointBelief, JointType

TRACKS = Path(__file__).parent / "tracks"
MARKER_ROTATION = np.deg2rad(5.0)  # Reported of a marker's rotation, [rad].
CLAIMS = (1e-3, 3e-3, 1e-2)  # Standard deviation of the position that is reported, [m].
CERTAIN = 0.9


@dataclass(kw_only=True)
class Track:
    """Poses (N, 4, 4) at a rate [Hz]; where the rotation is unknown it is the identity."""

    name: str
    joint: JointType
    poses: Array
    rate: float
    has_rotation: bool

    def covariance(self, sigma: float) -> Array:
        """Reported of each pose (6, 6), in B: positions to `sigma` [m]."""
        rotation = MARKER_ROTATION**2 if self.has_rotation else np.inf
        return np.diag(np.repeat([rotation, sigma**2], 3))


def read_tracks(folder: Path = TRACKS) -> list[Track]:
    """All tracks of a folder, by name."""
    tracks = []
    for file in sorted(folder.glob("*.txt")):
        rows = np.loadtxt(file)
        poses = np.tile(np.eye(4), (len(rows), 1, 1))
        poses[:, :3, 3] = rows[:, :3]
        has_rotation = rows.shape[1] >= 7
        if has_rotation:
            poses[:, :3, :3] = Rotation.from_quat(rows[:, 3:7]).as_matrix()
        tracks.append(
            Track(
                name=file.stem,
                joint=JointType.PRISMATIC if "drawer" in file.stem else JointType.REVOLUTE,
                poses=poses,
                rate=15.0 if has_rotation else 50.0,
                has_rotation=has_rotation,
            )
        )
    return tracks


def believe(track: Track, sigma: float, filters: JointFilters) -> tuple[JointBelief, float]:
    """The last belief, and the share of innovations inside two standard deviations."""
    R = track.covariance(sigma)
    state = filters.start(track.poses[0], R, 0.0)
    inside = []
    for k in range(1, len(track.poses)):
        t = k / track.rate
        p = filters.probabilities(state)
        predicted = filters.predict(state, max(p, key=lambda j: p[j]), 1.0 / track.rate)
        if t > 1.0:
            e = predicted.X[:3, :3].T @ (track.poses[k, :3, 3] - predicted.X[:3, 3])
            variance = np.diag(predicted.covariance)[3:] + (state.scale[3] * sigma) ** 2
            variance += np.diag(state.keyframes.floor)[3:]
            inside.append(np.abs(e) < 2.0 * np.sqrt(variance))
        state = filters.update(state, track.poses[k], R, t)
    return filters.belief(state), float(np.mean(inside)) if inside else np.nan


def residual(track: Track, belief: JointBelief) -> float:
    """Of the positions from the path through the first one [m]; see the module."""
    m, d = belief.model, track.poses[:, :3, 3]
    if belief.type == JointType.PRISMATIC:
        d = d - np.median(d, axis=0)
        off = np.linalg.norm(d - np.outer(d @ m.axis_P, m.axis_P), axis=1)
    elif belief.type == JointType.REVOLUTE:
        d = d - m.p_PA
        along = d @ m.axis_P
        radius = np.linalg.norm(d - np.outer(along, m.axis_P), axis=1)
        off = np.hypot(along - np.median(along), radius - np.median(radius))
    else:
        return np.nan
    best = np.sort(off)[: int(0.9 * len(off))]
    return float(np.sqrt(np.mean(best**2)))


def batch_axis(track: Track) -> Array:
    """The axis (3,) of the line or circle nearest to all positions, by least squares."""
    p = track.poses[:, :3, 3]
    d = p - p.mean(axis=0)
    along, across, normal = np.linalg.svd(d, full_matrices=False)[2]
    if track.joint == JointType.PRISMATIC:
        return np.asarray(along)
    u, v = d @ along, d @ across
    # |x - c|^2 = r^2 is linear in c and r^2 - |c|^2.
    rows = np.column_stack([2.0 * u, 2.0 * v, np.ones(len(p))])
    x, y, rest = np.linalg.lstsq(rows, u**2 + v**2, rcond=None)[0]
    centre = p.mean(axis=0) + x * along + y * across

    def off(circle: Array) -> Array:
        """Along the axis and radially; the axis (3,), the centre (3,) and the radius are free."""
        a = circle[:3] / np.linalg.norm(circle[:3])
        e = p - circle[3:6]
        height = e @ a
        radial = np.linalg.norm(e - np.outer(height, a), axis=1)
        return np.concatenate([height, radial - circle[6]])

    start = np.concatenate([normal, centre, [np.sqrt(rest + x**2 + y**2)]])
    found = least_squares(off, start).x[:3]
    return np.asarray(found / np.linalg.norm(found))


def _spread(axes: list[Array]) -> float:
    """Median angle [rad] of axes to their mean direction."""
    A = np.array([a if a @ axes[0] > 0.0 else -a for a in axes])
    mean = A.mean(axis=0) / np.linalg.norm(A.mean(axis=0))
    return float(np.median(np.arccos(np.clip(A @ mean, -1.0, 1.0))))


def main(
    claims: Annotated[
        list[float], typer.Option(help="Standard deviations of positions to report, [m].")
    ] = list(CLAIMS),  # noqa: B006
    folder: Annotated[Path, typer.Option(help="Of the tracks.")] = TRACKS,
) -> None:
    """Prints a line per track and reported noise, and the repeats' axes."""
    filters, tracks = JointFilters(JointFiltersConfig()), read_tracks(folder)
    print("| track | joint | reported mm | believed | p | residual mm | innovations inside |")
    print("|---" * 7 + "|")
    axes: dict[tuple[str, float], list[Array]] = {}
    batch: dict[str, list[Array]] = {}
    right = wrong = 0
    for track in tqdm(tracks, unit="track", disable=None):
        batch.setdefault(track.name[:-4], []).append(batch_axis(track))
        for sigma in claims:
            belief, inside = believe(track, sigma, filters)
            p = belief.probabilities[belief.type]
            right += belief.type == track.joint
            wrong += belief.type != track.joint and p > CERTAIN
            print(
                f"| {track.name} | {track.joint} | {1e3 * sigma:g} | {belief.type} | {p:.3f} "
                f"| {1e3 * residual(track, belief):.1f} | {100 * inside:.0f} % |"
            )
            if belief.type == track.joint and track.name[-1].isdigit():
                key = (track.name[:-4], sigma)
                axes.setdefault(key, []).append(belief.model.axis_P)
    print(f"\n{right} of {len(tracks) * len(claims)} right, {wrong} wrong with p > {CERTAIN:g}")
    for (name, sigma), found in axes.items():
        ours, theirs = np.rad2deg(_spread(found)), np.rad2deg(_spread(batch[name]))
        print(
            f"{name}, {1e3 * sigma:g} mm: axes of {len(found)} repeats {ours:.2f} deg apart,"
            f" of a batch fit {theirs:.2f}"
        )


if __name__ == "__main__":
    typer.run(main)
