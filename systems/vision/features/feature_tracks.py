"""The tracks of point features and where they lie on the surfaces of a depth image."""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from crossmodal.maths.arrays import Array, Ids, Mask
from crossmodal.maths.immutable import Immutable
from crossmodal.systems.port_values import FeatureBelief
from crossmodal.systems.ticks import whole_ticks
from crossmodal.systems.vision import camera_geometry
from crossmodal.systems.vision.features.feature_motion_config import FeatureMotionConfig
from crossmodal.systems.vision.features.patch_templates import Image, Templates

Byte = npt.NDArray[np.uint8]


@dataclass(kw_only=True)
class FeatureTracks(Immutable):
    """What the tracker remembers; never written after it is made, so a deep copy is the object.

    Attributes:
        ids: Numbers of the features (N,).
        uv: Pixels (N, 2), seen or, since the feature was last seen, predicted.
        p_WF: Positions (N, 3), seen or predicted likewise, [m].
        covariance: Covariance of the positions when last seen (N, 3, 3), [m^2].
        age: Ticks since its initiation (N,).
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
        since_search: Ticks since the last search for new features.
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
    since_search: int

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
        since_search=whole_ticks(config.detection.interval, config.period),
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
        noise: Standard deviation of the raw image's noise (H, W), [grey levels].
        depth: (H, W), [m].
        robot: Nonzero on the robot and its border (H, W).
        intrinsics: (fx, fy, cx, cy), [px].
        X_WC: Camera pose (4, 4).
    """

    image: Image
    noise: Image
    depth: Image
    robot: Byte
    intrinsics: Array
    X_WC: Array


def locate(
    config: FeatureMotionConfig, frame: Frame, uv: Array, uv_covariance: Array
) -> tuple[Array, Array, Array, Mask]:
    """Positions p_WF (N, 3), covariances (N, 3, 3), tangents in C (N, 3, 2), validity (N,)."""
    pixel = config.noise
    noise = np.array([pixel.depth, pixel.depth_growth, pixel.depth_range, config.depth.floor])
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
