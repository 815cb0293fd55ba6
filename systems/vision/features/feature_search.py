"""Where tracked features are in a new image: registration from several starts."""

from dataclasses import dataclass

import numpy as np

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array, Ids
from crossmodal.maths.optical_flow import flow
from crossmodal.maths.pinhole import project
from crossmodal.systems.port_values import FeatureBelief
from crossmodal.systems.ticks import whole_ticks
from crossmodal.systems.vision import camera_geometry
from crossmodal.systems.vision.features import patch_registration, patch_templates
from crossmodal.systems.vision.features.feature_motion_config import FeatureMotionConfig
from crossmodal.systems.vision.features.feature_tracks import FeatureTracks, Frame


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
    uv_predicted = project(p_CF, frame.intrinsics)
    # Where both starts agree, one of them is enough.
    apart = np.max(np.abs(uv_predicted - uv[mine]), axis=1) > 0.5
    mine, p_CF, uv_predicted = mine[apart], p_CF[apart], uv_predicted[apart]
    warps_predicted = camera_geometry.patch_warps(p_CF, tracks.tangents_C[mine], frame.intrinsics)
    templates, shapes = tracks.templates.select(mine), tracks.shapes[mine]
    better = patch_templates.score_patches(
        frame.image, templates, warps_predicted @ shapes, uv_predicted
    ) > patch_templates.score_patches(frame.image, templates, warps[mine] @ shapes, uv[mine])
    # An unseen feature starts from where the body tracker predicts it.
    better |= tracks.missed[mine] > 0
    uv[mine[better]] = uv_predicted[better]
    warps[mine[better]] = warps_predicted[better]
    return uv, warps


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
    interval = whole_ticks(config.registration.shape_interval, config.period)
    due = (tracks.age + tracks.ids) % interval == 0
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
        moved, success = flow(
            tracks.image, frame.image, tracks.uv_image[failed], config.flow.max_error
        )
        again = failed[success]
        found = register(again, moved[success])
        better = found[1] > scores[again]
        for values, new in zip((uv, scores, warps), found, strict=True):
            values[again[better]] = new[better]
    shapes: Array = np.asarray(np.linalg.solve(expected, warps))
    return Registration(uv=uv, scores=scores, warps=warps, shapes=shapes)
