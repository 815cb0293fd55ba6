"""Tracking of point features through one pair of colour and depth images: pure functions."""

from dataclasses import replace

import numpy as np

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array, Mask
from crossmodal.maths.pinhole import project
from crossmodal.systems.port_values import FeatureBelief
from crossmodal.systems.ticks import whole_ticks
from crossmodal.systems.vision import camera_geometry
from crossmodal.systems.vision.features import (
    feature_detection,
    patch_registration,
    patch_templates,
)
from crossmodal.systems.vision.features.feature_motion_config import FeatureMotionConfig
from crossmodal.systems.vision.features.feature_search import search
from crossmodal.systems.vision.features.feature_tracks import Byte, FeatureTracks, Frame, locate
from crossmodal.systems.vision.features.patch_templates import Image


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
    contrast = patch_templates.patch_contrasts(frame.image, tracks.templates, found.warps, found.uv)
    # A smooth template correlates well with mere noise, sooner or later.
    visible = contrast > 2.0 * feature_detection.BLUR_GAIN * _at_pixels(frame.noise, found.uv)
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


def _at_pixels(image: Image | Byte, uv: Array) -> Array:
    """The image's values (N,) at the pixels of it that are nearest to `uv` (N, 2)."""
    last = np.array(image.shape[::-1]) - 1
    column, row = np.clip(np.nan_to_num(uv), 0, last).round().astype(int).T
    return image[row, column]


def _confirm(
    config: FeatureMotionConfig, tracks: FeatureTracks, scores: Array
) -> tuple[FeatureTracks, Mask]:
    """The tracks with the places where tentative features failed, and which (N,) stay.

    A young patch differs from its template by noise alone; where this is large, it would wander.
    """
    tentative = tracks.age <= whole_ticks(config.tracks.tentative_age, config.period)
    passed = ~tentative | (scores >= config.tracks.tentative_correlation)
    where = tracks.uv[~passed]
    pause = np.full((len(where), 1), whole_ticks(config.tracks.failure_pause, config.period))
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
    uv[mine] = project(p_CF, frame.intrinsics)
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
    cut, valid = patch_templates.cut_templates(
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
    """Which features (N,) lie in the image, off the robot, and were seen not long ago."""
    height, width = frame.image.shape
    margin = config.registration.patch_radius + 2
    uv = tracks.uv
    within = (uv >= margin) & (uv < np.array([width, height]) - margin)
    inside: Mask = np.asarray(np.all(within, axis=1))  # False for NaN.
    free = _at_pixels(frame.robot, uv) == 0
    remembered = tracks.missed <= whole_ticks(config.tracks.max_missed, config.period)
    return np.asarray(inside & free & remembered)


def initiate_tracks(
    config: FeatureMotionConfig, tracks: FeatureTracks, frame: Frame
) -> FeatureTracks:
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
    templates, valid = patch_templates.cut_templates(
        frame.image, uv, config.registration.patch_radius
    )
    noise = feature_detection.BLUR_GAIN * _at_pixels(frame.noise, uv)
    floor = np.maximum(config.detection.min_contrast, 3.0 * noise)
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
        templates=patch_templates.concatenate(tracks.templates, templates.select(keep)),
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
    waited = tracks.since_search + 1
    missing = config.tracks.max_features - len(tracks.ids)
    due = waited >= whole_ticks(config.detection.interval, config.period)
    if tracks.blackout or not due or missing < max(1, config.tracks.max_features // 20):
        return replace(tracks, since_search=waited)
    return replace(initiate_tracks(config, tracks, frame), since_search=0)
