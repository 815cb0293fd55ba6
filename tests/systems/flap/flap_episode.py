"""A synthetic episode through an estimator, with its errors and what it reports of them.

    python tests/systems/flap/flap_episode.py 0 100 [filtered]

prints medians over seeds.
"""

import sys
from dataclasses import dataclass, field

import numpy as np
from synthetic_flap import P_WE, PERIOD, Laboratory

from crossmodal.maths.arrays import Array
from crossmodal.maths.gaussian import nees
from crossmodal.maths.vectors import normal_basis
from crossmodal.systems.flap.flap_angle import UNTOUCHED, FlapAngleConfig, read_angle, update_angle
from crossmodal.systems.flap.flap_geometry import HingeLimitsConfig
from crossmodal.systems.flap.hinge.hinge_estimator import (
    HingeEstimatorConfig,
    HingeState,
    update_hinge,
)
from crossmodal.systems.flap.joint.flap_joint import update_joint
from crossmodal.systems.flap.joint.flap_joint_model import (
    FlapJointConfig,
    FlapJointModel,
    FlapJointState,
    read_joint_angle,
    read_joint_hinge,
)
from crossmodal.systems.flap.tool_kinematics import tool_link
from crossmodal.systems.port_values import (
    DisplacementBelief,
    FingertipContact,
    FlapAngleBelief,
    FlapPlane,
    HingeBelief,
)

LIMITS = HingeLimitsConfig()
DEGREES = {"axis": 2, "point": 2, "theta": 1, "normal": 2, "L1": 3, "L2": 2}


@dataclass
class Episode:
    """What was believed at the ticks of one seed.

    Attributes:
        theta: True angle at each tick, [rad].
        seen: Whether the plane was.
        error: By quantity, length of the error at each tick; NaN while it is not known.
        nees: By quantity, normalised error squared.
    """

    theta: list[float] = field(default_factory=list)
    seen: list[bool] = field(default_factory=list)
    error: dict[str, list[float]] = field(default_factory=lambda: {k: [] for k in DEGREES})
    nees: dict[str, list[float]] = field(default_factory=lambda: {k: [] for k in DEGREES})

    def add(self, name: str, error: Array, covariance: Array) -> None:
        self.error[name].append(float(np.linalg.norm(error)))
        self.nees[name].append(nees(error, covariance))

    def rms(self, name: str, seen: bool) -> float:
        """Root mean square of an error where the flap was seen, or not."""
        chosen = np.array(self.error[name])[np.array(self.seen) == seen]
        return float(np.sqrt(np.nanmean(chosen**2)))

    def at(self, name: str, theta: float) -> float:
        """An error when the flap was first turned by theta."""
        return self.error[name][int(np.argmax(np.array(self.theta) >= theta))]


class Geometric:
    """The geometric estimators, by their pure functions."""

    def __init__(self, lab: Laboratory, displacements: DisplacementBelief) -> None:
        self._lab, self._displacements = lab, displacements
        self._hinge, self._angle = HingeState(), UNTOUCHED
        self._hinge_config, self._angle_config = HingeEstimatorConfig(), FlapAngleConfig()

    def __call__(
        self, plane: FlapPlane, contact: FingertipContact, time: float
    ) -> tuple[HingeBelief, FlapAngleBelief]:
        del time
        self._hinge = update_hinge(
            self._hinge,
            contact,
            plane,
            self._displacements,
            self._lab.camera,
            self._hinge_config,
            LIMITS,
        )
        belief = self._hinge.belief
        self._angle = update_angle(self._angle, plane, contact, belief, self._angle_config)
        return belief, read_angle(self._angle, self._lab.camera)


class Filtered:
    """The joint filters, likewise."""

    def __init__(self, lab: Laboratory, displacements: DisplacementBelief) -> None:
        self._state, self._displacements = FlapJointState(), displacements
        self._model = FlapJointModel(FlapJointConfig(), LIMITS, lab.camera)

    def __call__(
        self, plane: FlapPlane, contact: FingertipContact, time: float
    ) -> tuple[HingeBelief, FlapAngleBelief]:
        self._state = update_joint(
            self._state, plane, contact, self._displacements, time, self._model
        )
        return read_joint_hinge(self._state, LIMITS), read_joint_angle(self._state, self._model)


def run(
    lab: Laboratory, filtered: bool = False, duration: float = 29.5, registered: bool = False
) -> Episode:
    """An episode: two seconds of rest, then the turn."""
    displacements = lab.displacements(registered)
    estimate = Filtered(lab, displacements) if filtered else Geometric(lab, displacements)
    episode, end_effector = Episode(), lab.end_effector()
    for i in range(round(duration / PERIOD)):
        t = i * PERIOD
        theta = lab.theta(t)
        rate = (lab.theta(t + 1e-6) - lab.theta(t - 1e-6)) / 2e-6
        contact, plane = lab.contact(theta, rate), lab.plane(theta)
        hinge, angle = estimate(plane, contact, t)
        episode.theta.append(theta)
        episode.seen.append(plane.seen)
        _compare(episode, lab, theta, hinge, angle)
        for name in DEGREES:
            if len(episode.error[name]) < i + 1 and not (name[0] == "L" and hinge.known):
                episode.error[name].append(np.nan)
                episode.nees[name].append(np.nan)
        if hinge.known:
            tool = tool_link(hinge, angle, contact, end_effector)
            B, p_WK = normal_basis(hinge.k_W).T, _nearest(lab)
            episode.add("L1", tool.L1_W - (p_WK - P_WE), tool.L1_covariance)
            e = B.T @ (tool.L2_W - (p_WK - lab.true_contact))
            episode.add("L2", e, B.T @ tool.L2_covariance @ B)
    return episode


def _nearest(lab: Laboratory) -> Array:
    k, p = lab.tool.k_W, lab.tool.p_WK
    return np.asarray(p + k * (k @ (lab.true_contact - p)))


def _compare(
    episode: Episode, lab: Laboratory, theta: float, hinge: HingeBelief, angle: FlapAngleBelief
) -> None:
    if hinge.known:
        B, P = normal_basis(hinge.k_W).T, hinge.covariance
        episode.add("axis", B.T @ (lab.tool.k_W - hinge.k_W), B.T @ P[:3, :3] @ B)
        episode.add("point", B.T @ (_nearest(lab) - hinge.p_WK), B.T @ P[3:, 3:] @ B)
    if angle.known:
        episode.add("theta", np.array([angle.theta - theta]), np.array([[angle.variance]]))
        B = normal_basis(angle.n_W).T
        e = B.T @ (lab.tool.frame(theta)[:, 1] - angle.n_W)
        episode.add("normal", e, B.T @ angle.n_covariance @ B)


def main() -> None:
    """Prints medians over seeds."""
    first, last, *rest = sys.argv[1:]
    episodes = [run(Laboratory(seed), bool(rest)) for seed in range(int(first), int(last))]
    degrees = [np.rad2deg(e.at("axis", np.deg2rad(30.0))) for e in episodes]
    print(f"axis after 30 deg: median {np.median(degrees):.2f}, max {np.max(degrees):.2f} deg")
    for seen, name in ((True, "visible"), (False, "hidden")):
        rms = np.rad2deg([e.rms("theta", seen) for e in episodes])
        print(f"theta RMS {name}: median {np.median(rms):.2f}, max {np.max(rms):.2f} deg")
    for name in ("L1", "L2"):
        end = 1e3 * np.array([e.error[name][-1] for e in episodes])
        mean = 1e3 * np.array([np.nanmean(e.error[name]) for e in episodes])
        print(
            f"{name}: mean over ticks, median {np.median(mean):.1f} mm;"
            f" at the end median {np.median(end):.2f}, max {np.max(end):.2f} mm"
        )
    two_sigma = {1: 4.0, 2: 6.18, 3: 8.02}  # Which 95.4 % of all errors are inside of.
    for name, degree in DEGREES.items():
        values = np.concatenate([e.nees[name] for e in episodes])
        values = values[np.isfinite(values)]
        last_ones = np.mean([e.nees[name][-1] for e in episodes])
        print(
            f"{name}: inside 2 sigma {np.mean(values < two_sigma[degree]):.3f} of ticks,"
            f" mean NEES at the end {last_ones:.2f} of {degree}"
        )


if __name__ == "__main__":
    main()
