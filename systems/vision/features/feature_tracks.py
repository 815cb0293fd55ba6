"""Tracking of point features through one pair of colour and depth images: pure functions."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from maths import se3
from maths.arrays import Array, Ids
from maths.immutable import Immutable
from systems.port_values import FeatureBelief
from systems.vision import camera_geometry
from systems.vision.features import feature_detection, patch_registration
from systems.vision.features.feature_motion_config import FeatureMotionConfig
from systems.vision.features.patch_registration import Image, Mask, Templates

Byte = npt.NDArray[np.uint8]


@dataclass(kw_only=True)
class FeatureTracks(Immutable):
    """What the tracker remembers; never written after it is made, so a deep copy is the object.

    Attributes:
        ids: Numbers of the features (N,).
        uv: Pixels (N, 2), seen or, since the feature was last seen, predicted.
        p_WF: Positions (N, 3), seen or predicted likewise, [m].
        covariance: Covariance of the positions when last seen (N, 3, 3), [m^2].
        age: Ticks since birth (N,).
        missed: Ticks since the feature was last seen (N,); zero for those seen now. A tick of a
            blackout counts less.
        templates: Patches, cut when `tangents_C` was measured.
        tangents_C: Derivative of the surface point by the template's pixel (N, 3, 2), [m/px].
        shapes: Part of the patch's affine map that position and tangents do not predict, mostly
            from turning (N, 2, 2): map = predicted map @ shape.
        next_id: The id of the next feature.
        image: The last image in which most features were seen (H, W), blurred grey.
        uv_image: Pixels of the features in that image (N, 2); NaN where one was not seen in it.
        blackout: Whether nearly all features went unseen.
        failed: Pixels where tentative features failed, and the ticks for which none is born
            there (M, 3).
        since_birth: Ticks since the last search for new features.
    """

    ids: Ids
    uv: Array
    p_WF: Array
    covariance: Array
    age: Ids
    missed: Array
    templates: Templates
    tangents_C: Array
    shapes: Array
    next_id: int
    image: Image | None
    uv_image: Array
    blackout: bool
    failed: Array
    since_birth: int

    def select(self, keep: Mask) -> "FeatureTracks":
        if keep.all():
            return self
        return replace(
            self,
            ids=self.ids[keep],
            uv=self.uv[keep],
            p_WF=self.p_WF[keep],
            covariance=self.covariance[keep],
            age=self.age[keep],
            missed=self.missed[keep],
            templates=self.templates.select(keep),
            tangents_C=self.tangents_C[keep],
            shapes=self.shapes[keep],
            uv_image=self.uv_image[keep],
        )


def no_tracks(config: FeatureMotionConfig) -> FeatureTracks:
    n = (2 * config.registration.patch_radius + 1) ** 2
    return FeatureTracks(
        ids=np.zeros(0, np.int64),
        uv=np.zeros((0, 2)),
        p_WF=np.zeros((0, 3)),
        covariance=np.zeros((0, 3, 3)),
        age=np.zeros(0, np.int64),
        missed=np.zeros(0),
        templates=Templates(
            values=np.zeros((0, n), np.float32),
            gradients=np.zeros((0, 2, n), np.float32),
            overlaps=np.zeros((0, 6)),
            hessians=np.zeros((0, 6, 6)),
            contrast=np.zeros(0),
        ),
        tangents_C=np.zeros((0, 3, 2)),
        shapes=np.zeros((0, 2, 2)),
        next_id=0,
        image=None,
        uv_image=np.zeros((0, 2)),
        blackout=False,
        failed=np.zeros((0, 3)),
        since_birth=config.detection.interval,
    )


def belief(tracks: FeatureTracks) -> FeatureBelief:
    """The features that are seen now."""
    seen = tracks.missed == 0
    return FeatureBelief(
        ids=tracks.ids[seen],
        uv=tracks.uv[seen],
        p_WF=tracks.p_WF[seen],
        covariance=tracks.covariance[seen],
        age=tracks.age[seen],
    )


@dataclass(kw_only=True)
class Frame:
    """One tick's images and what is known about the camera.

    Attributes:
        image: Blurred grey image (H, W).
        noise: Standard deviation of the raw image's noise, [grey levels].
        depth: (H, W), [m].
        robot: Nonzero on the robot and its border (H, W).
        intrinsics: (fx, fy, cx, cy), [px].
        X_WC: Camera pose (4, 4).
    """

    image: Image
    noise: float
    depth: Image
    robot: Byte
    intrinsics: Array
    X_WC: Array


def locate(
    config: FeatureMotionConfig, frame: Frame, uv: Array, uv_covariance: Array
) -> tuple[Array, Array, Array, Mask]:
    """Positions p_WF (N, 3), covariances (N, 3, 3), tangents in C (N, 3, 2), validity (N,)."""
    noise = np.array(
        [
            config.depth.noise,
            config.depth.noise_growth,
            config.depth.noise_range,
            config.depth.floor,
        ]
    )
    planes, variances, valid = camera_geometry.fit_surfaces(
        frame.depth,
        uv,
        config.depth.radius,
        noise,
        config.depth.correlated_pixels,
        config.depth.min_share,
    )
    planes[~valid] = [1.0, 0.0, 0.0]
    p_CF, covariance, tangents = camera_geometry.surface_points(
        uv, uv_covariance, planes, variances, frame.intrinsics
    )
    valid &= camera_geometry.incidence_cosines(p_CF, tangents) > np.cos(config.depth.max_incidence)
    R_WC = frame.X_WC[:3, :3]
    return camera_geometry.transform(frame.X_WC, p_CF), R_WC @ covariance @ R_WC.T, tangents, valid


def _starts(tracks: FeatureTracks, frame: Frame, predicted: FeatureBelief) -> tuple[Array, Array]:
    """Pixels (N, 2) and affine maps (N, 2, 2), without shapes, to start from.

    Of the last position and the predicted one, the one where the template fits better.
    """
    X_CW = se3.inverse(frame.X_WC)
    uv = tracks.uv.copy()
    p_CF = camera_geometry.transform(X_CW, tracks.p_WF)
    warps = camera_geometry.patch_warps(p_CF, tracks.tangents_C, frame.intrinsics)
    _, mine, theirs = np.intersect1d(tracks.ids, predicted.ids, return_indices=True)
    p_CF = camera_geometry.transform(X_CW, predicted.p_WF[theirs])
    in_front = p_CF[:, 2] > 0.0
    mine, p_CF = mine[in_front], p_CF[in_front]
    if len(mine) == 0:
        return uv, warps
    uv_predicted = camera_geometry.project(p_CF, frame.intrinsics)
    # Where both agree there is nothing to choose.
    apart = np.max(np.abs(uv_predicted - uv[mine]), axis=1) > 0.5
    mine, p_CF, uv_predicted = mine[apart], p_CF[apart], uv_predicted[apart]
    warps_predicted = camera_geometry.patch_warps(p_CF, tracks.tangents_C[mine], frame.intrinsics)
    templates, shapes = tracks.templates.select(mine), tracks.shapes[mine]
    better = patch_registration.score_patches(
        frame.image, templates, warps_predicted @ shapes, uv_predicted
    ) > patch_registration.score_patches(frame.image, templates, warps[mine] @ shapes, uv[mine])
    # An unseen feature is where the body tracker says, whatever its last place looks like now.
    better |= tracks.missed[mine] > 0
    uv[mine[better]] = uv_predicted[better]
    warps[mine[better]] = warps_predicted[better]
    return uv, warps


def locally_normalised(image: Image, width: int = 31) -> Byte:
    """The image with its local mean and standard deviation removed, for changes of exposure."""
    mean = cv2.blur(image, (width, width))
    variance = cv2.blur(image * image, (width, width)) - mean * mean
    scaled = (image - mean) * (40.0 / np.sqrt(np.maximum(variance, 0.0) + 4.0)) + 128.0
    return np.asarray(np.clip(scaled, 0.0, 255.0).astype(np.uint8))


def flow(config: FeatureMotionConfig, before: Image, after: Image, uv: Array) -> tuple[Array, Mask]:
    """Pyramidal Lucas-Kanade from `before` to `after` and back; pixels (N, 2), success (N,)."""
    if len(uv) == 0:
        return uv, np.zeros(0, bool)
    images = locally_normalised(before), locally_normalised(after)
    window = (config.flow.window, config.flow.window)
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.03)
    start = uv.astype(np.float32).reshape(-1, 1, 2)
    forward, found, _ = cv2.calcOpticalFlowPyrLK(
        *images, start, None, winSize=window, maxLevel=config.flow.levels, criteria=criteria
    )
    back, returned, _ = cv2.calcOpticalFlowPyrLK(
        *images[::-1], forward, None, winSize=window, maxLevel=config.flow.levels, criteria=criteria
    )
    error = np.linalg.norm((back - start).reshape(-1, 2), axis=1)
    success = (found.ravel() > 0) & (returned.ravel() > 0) & (error < config.flow.max_error)
    return forward.reshape(-1, 2).astype(float), success


@dataclass(kw_only=True)
class Registration:
    """Where templates were found: pixels (N, 2), ZNCC (N,), affine maps and shapes (N, 2, 2)."""

    uv: Array
    scores: Array
    warps: Array
    shapes: Array


def search(
    config: FeatureMotionConfig, tracks: FeatureTracks, frame: Frame, predicted: FeatureBelief
) -> Registration:
    """Registers all features; those that fail start once more from pyramidal Lucas-Kanade."""
    uv_start, expected = _starts(tracks, frame, predicted)
    due = (tracks.age + tracks.ids) % config.registration.shape_interval == 0
    shape_sigma = np.where(due, config.registration.shape_change, 0.0)

    def register(index: Ids, start: Array) -> tuple[Array, Array, Array]:
        return patch_registration.register_patches(
            frame.image,
            tracks.templates if len(index) == len(tracks.ids) else tracks.templates.select(index),
            (expected @ tracks.shapes)[index],
            start,
            reach=config.registration.reach,
            shape_sigma=shape_sigma[index],
        )

    uv, scores, warps = register(np.arange(len(tracks.ids)), uv_start)
    known = np.isfinite(tracks.uv_image[:, 0])
    failed = np.nonzero((scores < config.registration.min_correlation) & known)[0]
    if tracks.image is not None and len(failed):
        # Features missed for the shortest time first: the others were tried at earlier ticks.
        order = np.argsort(tracks.missed[failed], kind="stable")
        most = config.flow.max_blackout_features if tracks.blackout else config.flow.max_features
        failed = failed[order][:most]
        moved, success = flow(config, tracks.image, frame.image, tracks.uv_image[failed])
        again = failed[success]
        found = register(again, moved[success])
        better = found[1] > scores[again]
        for values, new in zip((uv, scores, warps), found, strict=True):
            values[again[better]] = new[better]
    shapes: Array = np.asarray(np.linalg.solve(expected, warps))
    return Registration(uv=uv, scores=scores, warps=warps, shapes=shapes)


def follow(
    config: FeatureMotionConfig, tracks: FeatureTracks, frame: Frame, predicted: FeatureBelief
) -> FeatureTracks:
    """The tracks after one tick, without new features."""
    if len(tracks.ids) == 0:
        return replace(tracks, image=frame.image, blackout=False)
    found = search(config, tracks, frame, predicted)
    uv_covariance = patch_registration.registration_covariance(
        tracks.templates,
        found.warps,
        found.scores,
        config.registration.correlated_pixels,
        config.registration.pixel_floor,
    )
    p_WF, covariance, tangents, on_surface = locate(config, frame, found.uv, uv_covariance)
    sizes = np.linalg.svd(found.warps, compute_uv=False)
    shrunk = sizes[:, 1] < config.registration.min_shape
    contrast = patch_registration.patch_contrasts(
        frame.image, tracks.templates, found.warps, found.uv
    )
    # A smooth template correlates well with mere noise, sooner or later.
    visible = contrast > 2.0 * feature_detection.BLUR_GAIN * frame.noise
    seen = (found.scores >= config.registration.min_correlation) & visible & on_surface & ~shrunk
    before = int(np.sum(tracks.missed == 0)) if not tracks.blackout else len(tracks.ids)
    blackout = before >= 10 and np.sum(seen) < config.tracks.blackout_share * before
    waited = config.tracks.max_missed / config.tracks.max_blackout if blackout else 1.0

    fresh = replace(
        tracks,
        uv=np.where(seen[:, None], found.uv, tracks.uv),
        p_WF=np.where(seen[:, None], p_WF, tracks.p_WF),
        covariance=np.where(seen[:, None, None], covariance, tracks.covariance),
        age=tracks.age + 1,
        missed=np.where(seen, 0.0, tracks.missed + waited),
        shapes=np.where(seen[:, None, None], found.shapes, tracks.shapes),
        blackout=bool(blackout),
    )
    fresh = _coast(fresh, frame, predicted)
    if not blackout:
        fresh = replace(
            fresh, image=frame.image, uv_image=np.where(seen[:, None], fresh.uv, np.nan)
        )
        outdated = seen & (found.scores < config.registration.renewal_correlation)
        # A patch that has kept its shape but not its looks is another one: no renewal.
        outdated &= np.max(np.abs(np.log(sizes)), axis=1) > config.registration.renewal_shape
        fresh = _renew(config, fresh, frame, tangents, outdated)
        fresh, passed = _confirm(config, fresh, found.scores)
        fresh = fresh.select(passed)
    return fresh.select(_alive(config, fresh, frame))


def _confirm(
    config: FeatureMotionConfig, tracks: FeatureTracks, scores: Array
) -> tuple[FeatureTracks, Mask]:
    """Which features (N,) stay, and where tentative ones failed.

    A young patch differs from its template by noise alone; where this is large, it would wander.
    """
    passed = (tracks.age > config.tracks.tentative_ticks) | (
        scores >= config.tracks.tentative_correlation
    )
    where = tracks.uv[~passed]
    pause = np.full((len(where), 1), float(config.tracks.failure_pause))
    left = tracks.failed - [0.0, 0.0, 1.0]
    failed = np.concatenate([left[left[:, 2] > 0], np.concatenate([where, pause], axis=1)])
    return replace(tracks, failed=failed), passed


def _coast(tracks: FeatureTracks, frame: Frame, predicted: FeatureBelief) -> FeatureTracks:
    """Moves the unseen features to where the body tracker predicts them."""
    _, mine, theirs = np.intersect1d(tracks.ids, predicted.ids, return_indices=True)
    unseen = tracks.missed[mine] > 0
    mine, theirs = mine[unseen], theirs[unseen]
    if len(mine) == 0:
        return tracks
    p_WF, uv = tracks.p_WF.copy(), tracks.uv.copy()
    p_WF[mine] = predicted.p_WF[theirs]
    p_CF = camera_geometry.transform(se3.inverse(frame.X_WC), p_WF[mine])
    uv[mine] = camera_geometry.project(p_CF, frame.intrinsics)
    return replace(tracks, p_WF=p_WF, uv=uv)


def _renew(
    config: FeatureMotionConfig,
    tracks: FeatureTracks,
    frame: Frame,
    tangents: Array,
    outdated: Mask,
) -> FeatureTracks:
    """Cuts new templates for the features that no longer look like theirs."""
    index = np.nonzero(outdated)[0]
    if len(index) == 0:
        return tracks
    cut, valid = patch_registration.cut_templates(
        frame.image, tracks.uv[index], config.registration.patch_radius
    )
    index, cut = index[valid], cut.select(valid)
    templates = tracks.templates.select(np.arange(len(tracks.ids)))
    templates.values[index] = cut.values
    templates.gradients[index] = cut.gradients
    templates.overlaps[index] = cut.overlaps
    templates.hessians[index] = cut.hessians
    templates.contrast[index] = cut.contrast
    tangents_C = tracks.tangents_C.copy()
    tangents_C[index] = tangents[index]
    shapes = tracks.shapes.copy()
    shapes[index] = np.eye(2)
    return replace(tracks, templates=templates, tangents_C=tangents_C, shapes=shapes)


def _alive(config: FeatureMotionConfig, tracks: FeatureTracks, frame: Frame) -> Mask:
    height, width = frame.image.shape
    margin = config.registration.patch_radius + 2
    uv = tracks.uv
    within = (uv >= margin) & (uv < np.array([width, height]) - margin)
    inside: Mask = np.asarray(np.all(within, axis=1))  # False for NaN.
    pixel = np.where(inside[:, None], uv, 0.0).round().astype(int)
    free = frame.robot[pixel[:, 1], pixel[:, 0]] == 0
    return np.asarray(inside & free & (tracks.missed <= config.tracks.max_missed))


def give_birth(config: FeatureMotionConfig, tracks: FeatureTracks, frame: Frame) -> FeatureTracks:
    """The tracks and new features on textured, smooth, robot-free surfaces."""
    wanted = config.tracks.max_features - len(tracks.ids)
    allowed = feature_detection.flat_depth_mask(
        frame.depth, config.depth.radius, config.detection.depth_step
    )
    allowed[frame.robot > 0] = 0
    radius = config.registration.patch_radius
    margin = radius + 4
    allowed[:margin], allowed[-margin:] = 0, 0
    allowed[:, :margin], allowed[:, -margin:] = 0, 0
    uv = feature_detection.find_corners(
        frame.image,
        allowed,
        np.concatenate([tracks.uv, tracks.failed[:, :2]]),
        wanted,
        noise=frame.noise,
        min_distance=config.detection.min_distance,
        noise_factor=config.detection.corner_noise_factor,
    )
    if len(uv) == 0:
        return tracks
    templates, valid = patch_registration.cut_templates(
        frame.image, uv, config.registration.patch_radius
    )
    floor = max(config.detection.min_contrast, 3.0 * feature_detection.BLUR_GAIN * frame.noise)
    uv_covariance = np.tile(config.registration.pixel_floor**2 * np.eye(2), (len(uv), 1, 1))
    p_WF, covariance, tangents, on_surface = locate(config, frame, uv, uv_covariance)
    keep = valid & on_surface & (templates.contrast > floor)
    born = int(np.sum(keep))
    return replace(
        tracks,
        ids=np.concatenate([tracks.ids, tracks.next_id + np.arange(born)]),
        uv=np.concatenate([tracks.uv, uv[keep]]),
        p_WF=np.concatenate([tracks.p_WF, p_WF[keep]]),
        covariance=np.concatenate([tracks.covariance, covariance[keep]]),
        age=np.concatenate([tracks.age, np.zeros(born, np.int64)]),
        missed=np.concatenate([tracks.missed, np.zeros(born)]),
        templates=patch_registration.concatenate(tracks.templates, templates.select(keep)),
        tangents_C=np.concatenate([tracks.tangents_C, tangents[keep]]),
        shapes=np.concatenate([tracks.shapes, np.tile(np.eye(2), (born, 1, 1))]),
        uv_image=np.concatenate([tracks.uv_image, uv[keep]]),
        next_id=tracks.next_id + born,
    )


def track(
    config: FeatureMotionConfig, tracks: FeatureTracks, frame: Frame, predicted: FeatureBelief
) -> FeatureTracks:
    """One tick: follow what exists, then replace what was lost."""
    tracks = follow(config, tracks, frame, predicted)
    waited = tracks.since_birth + 1
    missing = config.tracks.max_features - len(tracks.ids)
    due = waited >= config.detection.interval and missing >= max(
        1, config.tracks.max_features // 20
    )
    if tracks.blackout or not due:
        return replace(tracks, since_birth=waited)
    return replace(give_birth(config, tracks, frame), since_birth=0)
