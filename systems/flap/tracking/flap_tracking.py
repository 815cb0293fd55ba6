"""Where the flap's surface is, in a depth image."""

from dataclasses import dataclass, replace

import numpy as np
from pydrake.systems.framework import Context
from pydrake.systems.sensors import ImageDepth32F, ImageGrey8U

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array, Mask
from crossmodal.maths.immutable import Immutable
from crossmodal.systems.depth_camera import (
    DepthCamera,
    at_image,
    plane_jacobian,
    seen_covariance,
)
from crossmodal.systems.flap.tracking.flap_region import ahead, crop
from crossmodal.systems.flap.tracking.flap_tracking_config import (
    FlapTrackingConfig,
    check_flap_tracking,
)
from crossmodal.systems.flap.tracking.free_edge import EdgeFit, free_edge
from crossmodal.systems.flap.tracking.plane_fit import (
    PlaneFit,
    fit_plane,
    plane_covariance,
    refine_plane,
    world_plane,
)
from crossmodal.systems.flap.tracking.tool_segmentation import (
    Parts,
    angle_between,
    interior,
    measured_scale,
    segment,
)
from crossmodal.systems.port_values import (
    UNKNOWN_END_EFFECTOR,
    UNKNOWN_FINGERTIP,
    EndEffectorBelief,
    FingertipContact,
    FlapPlane,
    StampedImage,
    unseen,
)
from crossmodal.systems.recursive_filter import RecursiveFilter

# The edge is looked for so many lengths of the flap ahead of a pad that is still away from it.
_BEFORE_TOUCH = 2.5


@dataclass(frozen=True, kw_only=True)
class FlapTrack(Immutable):
    """What is remembered between two images.

    Attributes:
        plane: Of the flap in the last image.
        rest_W: Normal (3,) of the part that does not move, from when there was one surface only;
            None before.
        p_WC: Where the flap was touched last (3,), [m]; None before.
        y_W: Where the pad pointed then (3,).
        noise_scale: How much larger the depth's noise is than the config's sensor says, as the
            planes' residuals have shown; None before there was one.
        images: That have shown it.
    """

    plane: FlapPlane
    rest_W: Array | None = None
    p_WC: Array | None = None
    y_W: Array | None = None
    noise_scale: float | None = None
    images: int = 0


def choose_flap(
    parts: Parts,
    track: FlapTrack,
    camera: DepthCamera,
    config: FlapTrackingConfig,
    *,
    is_touched: bool,
    is_ahead: bool,
) -> PlaneFit | str:
    """The flap among the tool's flat parts, or why it is not known.

    Of two parts it is the one that is seen ahead of the pad, which pushes the flap's edge; once
    that was lost the flap may be anywhere, and it is the one that faces elsewhere than what was
    seen at rest. A single one is the flap if it does; else both parts are parallel still, and what
    lies ahead of the pad is the flap.

    Args:
        is_touched: Whether the pad touches the flap.
        is_ahead: Whether the flap is ahead of the pad: it is touched, or has not been yet.
    """
    if not parts.fits:
        return "no flat surface"
    if track.p_WC is None or track.y_W is None:
        return "where the finger is is not known"
    R = camera.X_WC[:3, :3]
    p_CQ = R.T @ (track.p_WC - camera.X_WC[:3, 3])
    length = config.region.flap_length * (1.0 if is_touched else _BEFORE_TOUCH)
    near = [ahead(parts.image, fit.m_C, p_CQ, R.T @ track.y_W, length) for fit in parts.fits]
    rest = None if track.rest_W is None else -R.T @ track.rest_W
    if len(parts.fits) == 2 and (is_ahead or rest is None):
        seen = [int(np.sum(fit.pixels & own)) for fit, own in zip(parts.fits, near, strict=True)]
        return parts.fits[int(np.argmax(seen))] if max(seen) > 0 else "hidden by the finger"
    fit = parts.fits[0]
    if rest is not None:
        fit = max(parts.fits, key=lambda fit: angle_between(fit.m_C, rest))
        if angle_between(fit.m_C, rest) > config.least_angle:
            return fit
    if not is_ahead:
        return "one surface only"
    return _ahead_of_pad(parts, fit, near[0], config) or "too few points"


def _ahead_of_pad(
    parts: Parts, common: PlaneFit, near: Mask, config: FlapTrackingConfig
) -> PlaneFit | None:
    """The plane of what lies ahead of the pad, which may have turned out of the common plane."""
    image, least = parts.image, config.least_near
    limit = config.pixel_gate * parts.sigma
    turned = np.tan(config.least_angle) * config.region.flap_length * image.w**2
    may_be = near & (np.abs(image.residuals(common.m_C)) < limit + turned)
    start = fit_plane(image, may_be, least)
    if start is None:
        return None
    around = refine_plane(image, start, near, limit, least)
    if around is None:
        return None
    return refine_plane(image, around, interior(around.pixels, near), limit, least)


def describe(
    fit: PlaneFit, parts: Parts, camera: DepthCamera, p_WC: Array | None, config: FlapTrackingConfig
) -> FlapPlane:
    """The flap's plane in the world, or why the image does not show it well enough.

    Args:
        fit: The plane in the camera's frame.
        p_WC: Where the flap is touched (3,), [m]; None while it is not.
    """
    noise = plane_covariance(parts.image, fit, parts.sigma, config.sensor.correlation)
    n_W, d, covariance = world_plane(fit, noise, camera.X_WC)
    p_CF = parts.image.points(fit.pixels).mean(axis=0)
    p_WF = camera.X_WC[:3, :3] @ p_CF + camera.X_WC[:3, 3]
    ray_W = (camera.X_WC[:3, 3] - p_WF) / np.linalg.norm(p_CF)
    if angle_between(n_W, ray_W) > config.largest_incidence:
        return unseen("grazing view")
    if np.sqrt(np.linalg.eigvalsh(covariance[:3, :3])[-1]) > config.largest_error:
        return unseen("its direction is not certain")
    if p_WC is not None and abs(n_W @ p_WC - d) > config.region.contact_distance:
        return unseen("it is not where the finger touches")
    J = plane_jacobian(n_W, d, p_WF)
    return FlapPlane(
        seen=True,
        n_W=n_W,
        d=d,
        covariance=covariance,
        common_covariance=J @ seen_covariance(camera, p_WF) @ J.T,
        p_WF=p_WF,
        points=fit.size,
    )


def _unit(v: Array) -> Array:
    return np.asarray(v / np.linalg.norm(v))


def track_flap(
    track: FlapTrack,
    depth: Array,
    excluded: Array | None,
    p_WE: Array,
    contact: FingertipContact,
    camera: DepthCamera,
    config: FlapTrackingConfig,
) -> FlapTrack:
    """The track after an image.

    Args:
        depth: (H, W), [m]; 0, NaN and infinity are no return.
        excluded: Nonzero on the robot (H, W); None if that is not known.
        p_WE: The holder's end-effector (3,), [m]; NaN if not known.
    """
    touched = contact.contact.touching
    if touched:
        track = replace(track, p_WC=contact.p_WC, y_W=contact.X_WS[:3, 1])
    centre = p_WE if track.p_WC is None else track.p_WC
    radius = config.region.reach if track.p_WC is None else config.region.radius
    if not np.all(np.isfinite(centre)):
        return replace(track, plane=unseen("where the tool is is not known"))
    image = crop(depth, excluded, camera, centre, radius)
    if image is None:
        return replace(track, plane=unseen("the camera does not look there"))
    sensor = config.sensor
    scale = sensor.first_scale if track.noise_scale is None else track.noise_scale
    parts = segment(image, camera.intrinsics.focal_x, config, scale)
    measured = measured_scale(parts, sensor)
    if np.isfinite(measured):
        images = min(track.images + 1, sensor.images)
        before = 0.0 if track.noise_scale is None else track.noise_scale
        track = replace(track, images=images, noise_scale=before + (measured - before) / images)
    if track.rest_W is None and len(parts.fits) == 1:
        track = replace(track, rest_W=-camera.X_WC[:3, :3] @ _unit(parts.fits[0].m_C))
    pointing = track
    if track.p_WC is None and np.isfinite(contact.X_WS).all():
        pointing = replace(track, p_WC=contact.X_WS[:3, 3], y_W=contact.X_WS[:3, 1])
    is_ahead = touched or track.p_WC is None
    flap = choose_flap(parts, pointing, camera, config, is_touched=touched, is_ahead=is_ahead)
    if isinstance(flap, str):
        return replace(track, plane=unseen(flap))
    edge = None
    if track.p_WC is None:
        X_CS = se3.inverse(camera.X_WC) @ contact.X_WS
        edge = _edge_before(X_CS, flap, parts, excluded, camera, config)
        if edge is not None and len(parts.fits) == 1:
            # What lies farther from the edge need not be the flap's.
            length = float((edge.p_CE - X_CS[:3, 3]) @ X_CS[:3, 1]) + config.region.flap_length
            near = ahead(parts.image, flap.m_C, X_CS[:3, 3], X_CS[:3, 1], length)
            flap = _ahead_of_pad(parts, flap, near, config) or flap
    plane = describe(flap, parts, camera, track.p_WC if touched else None, config)
    if plane.seen and edge is not None:
        R, p_WC = camera.X_WC[:3, :3], camera.X_WC[:3, 3]
        plane = replace(plane, edge_W=R @ edge.direction_C, p_WG=R @ edge.p_CE + p_WC)
    return replace(track, plane=plane)


def _edge_before(
    X_CS: Array,
    fit: PlaneFit,
    parts: Parts,
    excluded: Array | None,
    camera: DepthCamera,
    config: FlapTrackingConfig,
) -> EdgeFit | None:
    """The free edge before which the fingertip (4, 4) waits, if that is seen."""
    y_C, z_C = X_CS[:3, 1], X_CS[:3, 2]
    near = ahead(parts.image, fit.m_C, X_CS[:3, 3], y_C, _BEFORE_TOUCH * config.region.flap_length)
    return free_edge(
        parts.image,
        fit,
        near,
        excluded,
        (y_C, z_C),
        camera.intrinsics,
        config.pixel_gate * parts.sigma,
        config.sensor.correlation,
    )


class FlapTracker(RecursiveFilter):
    """Finds the flap of a held tool in the depth image, as a plane.

    Of what lies in a region, without the robot, the normals' histogram shows one or two flat parts.
    The part that stands still is known from when there was one only; the other is the flap, also
    when its back is seen. While both are parallel, what is ahead of the pad is the flap's.

    Input ports:
    - `depth_measured`: `StampedImage` of an `ImageDepth32F`, [m]; 0, NaN or inf is no return.
      Nothing is seen while it does not say where the camera is.
    - `robot_mask`: `ImageGrey8U`, nonzero on the robot; none if not connected.
    - `end_effector_estimated`: `EndEffectorBelief` of the arm that holds the tool; not needed once
      the tool was touched.
    - `fingertip_contact_estimated`: `FingertipContact`.

    Output ports:
    - `flap_plane_estimated`: `FlapPlane` of this tick, in W.
    - `flap_plane_latest`: the one of the last tick, from the state.

    Frames: W world, C camera, E end-effector, F the flap's centre.

    Source: the paper on visuo-tactile servoing of articulated tools, section III-B (Q. Li et al.);
    the covariance and the use of touch are ours.

    Args:
        camera: As the robot knows it; where it is says each image.
    """

    def __init__(self, config: FlapTrackingConfig, camera: DepthCamera) -> None:
        super().__init__()
        check_flap_tracking(config)
        self._config = config
        self._camera = camera
        size = camera.intrinsics.width, camera.intrinsics.height
        self._depth = self._declare_value_input(
            "depth_measured", StampedImage(time=0.0, image=ImageDepth32F(*size))
        )
        self._mask = self._declare_value_input("robot_mask", ImageGrey8U(*size))
        self._end_effector = self._declare_value_input(
            "end_effector_estimated", UNKNOWN_END_EFFECTOR
        )
        self._contact = self._declare_value_input("fingertip_contact_estimated", UNKNOWN_FINGERTIP)
        initial = FlapTrack(plane=unseen("no image yet"))
        self._declare_recursion(initial, self._calc_track, config.period)
        self._declare_estimated("flap_plane_estimated", lambda track: track.plane)
        self._declare_latest("flap_plane_latest", lambda track: track.plane)

    def _calc_track(self, context: Context, track: FlapTrack) -> FlapTrack:
        mask = self._read_optional(self._mask, context)
        holder: EndEffectorBelief | None = self._read_optional(self._end_effector, context)
        measured: StampedImage = self._read(self._depth, context)
        return track_flap(
            track,
            measured.image.data[:, :, 0],
            None if mask is None else mask.data[:, :, 0],
            np.full(3, np.nan) if holder is None else holder.X[:3, 3],
            self._read(self._contact, context),
            at_image(self._camera, measured),
            self._config,
        )
