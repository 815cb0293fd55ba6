"""By how much a camera and the arms that it sees are displaced against each other."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from pydrake.systems.framework import Context
from pydrake.systems.sensors import ImageDepth32F

from crossmodal.maths.arrays import Array
from crossmodal.maths.gaussian import MEDIAN_TO_SIGMA
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.validation import check, number
from crossmodal.systems.arm_pose import joints_at, offset_variances
from crossmodal.systems.depth_camera import DepthCamera
from crossmodal.systems.port_values import (
    DisplacementBelief,
    SampleWindow,
    StampedImage,
    no_samples,
    unknown_displacements,
)
from crossmodal.systems.recursive_filter import RecursiveFilter
from crossmodal.systems.registration.registration_solver import (
    CalibratedArm,
    Matches,
    displacement_rows,
    match,
    match_weights,
    place_unknowns,
    prior_covariance,
    readout,
    surface,
)
from crossmodal.systems.registration.robot_view import Joints, RobotView
from crossmodal.systems.ticks import Ticked

CAMERA = "camera"


@dataclass(kw_only=True)
class ArmRegistrationConfig(Ticked):
    """Configuration of `ArmRegistration`."""

    # Between two images that are looked at.
    interval: float = number(2.0, at_least=0.0, at_most=3600.0, unit="s")
    # Gauss-Newton steps for the first image; later ones need one.
    rounds: int = number(4, at_least=1, at_most=100)
    # By how much a link's surface lies off its model: uniform within 0.5 mm, ISO 2768-1 medium.
    surface: float = number(3e-4, at_least=1e-6, at_most=0.1, unit="m")
    # Depth noise before any residual was seen.
    first_noise: float = number(3e-3, at_least=1e-6, at_most=0.1, unit="m")
    # Side of the square over which neighbours share their noise.
    correlation: int = number(9, at_least=1, at_most=99, unit="px")
    # Largest second difference of a rendered surface's depth; more is an edge.
    bend: float = number(5e-4, at_least=1e-6, at_most=1.0, unit="m")
    # Deviations of what is expected, beyond which something else is seen.
    gate: float = number(3.0, above=0.0, at_most=100.0)
    # Points that an image has to show.
    least_points: int = number(100, at_least=10, at_most=10**6)


@dataclass(frozen=True, kw_only=True)
class RegistrationState(Immutable):
    """What is known at one tick.

    Attributes:
        p_WQ: About which the displacements are (3,), [m]; None before the first joint angles.
        images: How many were looked at.
        time: Of the last, [s].
        noise: Standard deviation of a residual, [m].
        information: Mean over the images (D, D).
        moment: Likewise (D,).
        mean: Of the unknowns (D,).
        covariance: (D, D).
        belief: What is reported of it.
    """

    p_WQ: Array | None = None
    images: int = 0
    time: float = -np.inf
    noise: float = 0.0
    information: Array
    moment: Array
    mean: Array
    covariance: Array
    belief: DisplacementBelief = field(default_factory=lambda: unknown_displacements(()))


class ArmRegistration(RecursiveFilter):
    """Finds by how much camera and arms are displaced, where the camera sees the arms.

    At the measured joints the robot's own model says where its links' surfaces are; the depth
    image says where they are seen. A robust point-to-plane fit of all images compares both: the
    calibrations' declared errors are its prior, so that what no surface shows stays as uncertain
    as it was. Images in which an arm moves by more than the links' tolerance within the camera's
    latency are left out. All images have one displacement of the camera in common, which assumes
    a camera that stands still.

    Input ports:
    - `depth_measured`: `StampedImage` of an `ImageDepth32F`, [m]; 0, NaN or inf is no return.
    - `<arm>_joint_state_window`: for each arm `SampleWindow` of (2 n,) positions [rad], velocities
      [rad/s].

    Output ports:
    - `displacements_estimated`: `DisplacementBelief` of the camera and the arms at this tick, about
      where the first arm's end-effector was at first.
    - `displacements_latest`: the one of the last tick, from the state.

    Source: of the point-to-plane fit with projective association, G. Blais and M. Levine,
    "Registering multiview range data to create 3D computer objects", PAMI 1995; of the calibration
    by it, T. Schmidt, R. Newcombe and D. Fox, "DART: Dense articulated real-time tracking",
    RSS 2014.

    Args:
        view: Renders the robot's own model from the camera's believed pose.
        arms: Likewise, by their names in the view.

    Raises:
        ValueError: for an impossible config value.
    """

    def __init__(
        self,
        config: ArmRegistrationConfig,
        view: RobotView,
        camera: DepthCamera,
        arms: Mapping[str, CalibratedArm],
    ) -> None:
        super().__init__()
        check(config, "ArmRegistration")
        self._config, self._view, self._camera = config, view, camera
        self._arms = dict(arms)
        counts = {name: len(arm.joint_offset_std) for name, arm in arms.items()}
        self._unknowns = place_unknowns(counts)
        size = self._unknowns.size
        image = ImageDepth32F(camera.intrinsics.width, camera.intrinsics.height)
        self._depth = self._declare_value_input(
            "depth_measured", StampedImage(time=0.0, image=image)
        )
        self._windows = {
            name: self._declare_value_input(f"{name}_joint_state_window", no_samples(2 * n))
            for name, n in counts.items()
        }
        initial = replace(
            before_images(np.zeros(3), size, config),
            p_WQ=None,
            belief=unknown_displacements((CAMERA, *arms)),
        )
        self._declare_recursion(initial, self._calc_state, config.period)
        self._declare_estimated("displacements_estimated", lambda state: state.belief)
        self._declare_latest("displacements_latest", lambda state: state.belief)

    def _calc_state(self, context: Context, state: RegistrationState) -> RegistrationState:
        time = context.get_time()
        windows = {name: self._read(port, context) for name, port in self._windows.items()}
        if any(len(window.times) == 0 for window in windows.values()):
            return state
        if state.p_WQ is not None and time - state.time < self._config.interval:
            return state
        q = {
            name: joints_at(window.times - time, window.values, 0.0, 0.0)[0]
            for name, window in windows.items()
        }
        joints = self._view.Pose(q)
        if state.p_WQ is None:
            state = self._start(state, joints)
        if self._is_still(windows, joints):
            depth = self._read(self._depth, context).image.data[:, :, 0]
            state = self._look(state, q, joints, depth, time)
        return state

    def _is_still(self, windows: Mapping[str, SampleWindow], joints: Mapping[str, Joints]) -> bool:
        for name, window in windows.items():
            jacobian = joints[name].jacobian
            rates = window.values.mean(axis=0)[jacobian.shape[1] :]
            moved = self._camera.latency_std * np.linalg.norm(jacobian[3:] @ rates)
            if moved > self._config.surface or np.any(offset_variances(window) > 0.0):
                return False
        return True

    def _start(self, state: RegistrationState, joints: Mapping[str, Joints]) -> RegistrationState:
        p_WQ = next(iter(joints.values())).p_WE
        covariance = prior_covariance(self._unknowns, p_WQ, self._camera, self._arms)
        state = replace(state, p_WQ=p_WQ, covariance=covariance)
        return replace(state, belief=self._tell(state, joints))

    def _look(
        self,
        state: RegistrationState,
        q: Mapping[str, Array],
        joints: Mapping[str, Joints],
        depth: Array,
        time: float,
    ) -> RegistrationState:
        found = after_image(
            state, q, joints, depth, self._view, self._camera, self._arms, self._config
        )
        if found is None:
            return replace(state, time=time)
        state = replace(found, time=time)
        return replace(state, belief=self._tell(state, joints))

    def _tell(self, state: RegistrationState, joints: Mapping[str, Joints]) -> DisplacementBelief:
        assert state.p_WQ is not None
        J = readout(self._unknowns, state.p_WQ, self._view.X_WC, joints)
        return replace(
            state.belief,
            p_WQ=state.p_WQ,
            mean=J @ state.mean,
            covariance=J @ state.covariance @ J.T,
        )


def before_images(p_WQ: Array, size: int, config: ArmRegistrationConfig) -> RegistrationState:
    """The state before any image, for so many unknowns."""
    return RegistrationState(
        p_WQ=p_WQ,
        noise=config.first_noise,
        information=np.zeros((size, size)),
        moment=np.zeros(size),
        mean=np.zeros(size),
        covariance=np.zeros((size, size)),
    )


def after_image(
    state: RegistrationState,
    q: Mapping[str, Array],
    joints: Mapping[str, Joints],
    depth: Array,
    view: RobotView,
    camera: DepthCamera,
    arms: Mapping[str, CalibratedArm],
    config: ArmRegistrationConfig,
) -> RegistrationState | None:
    """The state after one more image; None if that shows too little of the arms.

    Args:
        state: Before.
        q: Joint positions (n,) of each arm, [rad].
        joints: Likewise, by `RobotView.Pose`.
        depth: Measured (H, W), [m]; 0, NaN and infinity are no return.
        view: Of the robot's own model.
        camera: As believed.
        arms: Likewise.
        config: Of the registration.
    """
    assert state.p_WQ is not None
    unknowns = place_unknowns({name: len(arm.joint_offset_std) for name, arm in arms.items()})
    image = view.Render(q)
    points = surface(image, view.X_WC, config.bend)
    own = np.any([view.bodies(name) for name in arms], axis=0)[points.body]
    points = type(points)(*[values[own] for values in points])
    rows = displacement_rows(points, view, joints, unknowns, state.p_WQ)
    known = prior_covariance(unknowns, state.p_WQ, camera, arms)
    prior = np.asarray(np.linalg.inv(known), dtype=float)
    before, state = state, replace(state, covariance=known) if state.images == 0 else state
    for _ in range(config.rounds if before.images == 0 else 1):
        seen = match(points, rows, state.mean, depth, camera.intrinsics.vector(), view.X_WC)
        seen = gated(seen, state, config.gate)
        if len(seen.residual) < config.least_points:
            return None
        share = depth.size / image.depth.size
        state = fit(before, state, seen, prior, share, config)
    return replace(state, images=before.images + 1)


def gated(seen: Matches, state: RegistrationState, gate: float) -> Matches:
    """The matches whose residuals are within `gate` deviations of what is expected."""
    spread = np.einsum("nd,de,ne->n", seen.A, state.covariance, seen.A) + state.noise**2
    near = (seen.residual - seen.A @ state.mean) ** 2 < gate**2 * spread
    return Matches(seen.residual[near], seen.A[near], seen.body[near])


def fit(
    before: RegistrationState,
    state: RegistrationState,
    seen: Matches,
    prior: Array,
    share: float,
    config: ArmRegistrationConfig,
) -> RegistrationState:
    """The state after a step with the matches of one image.

    Args:
        before: After the last image.
        state: The linearisation.
        prior: Information (D, D).
        share: The measured image's pixels per match.
    """
    e = seen.residual - seen.A @ state.mean
    noise = MEDIAN_TO_SIGMA * float(np.median(np.abs(e)))
    images = before.images + 1
    share = min(share / config.correlation**2, 1.0)
    weights = match_weights(seen.body, e, noise, images, config.surface, share)
    weighted = seen.A * weights[:, None]
    information = before.information + (weighted.T @ seen.A - before.information) / images
    moment = before.moment + (weighted.T @ seen.residual - before.moment) / images
    covariance = np.linalg.inv(prior + information)
    covariance = 0.5 * (covariance + covariance.T)
    return replace(
        state,
        noise=noise,
        information=information,
        moment=moment,
        mean=covariance @ moment,
        covariance=covariance,
    )
