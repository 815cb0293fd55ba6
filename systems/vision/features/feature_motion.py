"""The system that follows point features in RGB-D images."""

import cv2
import numpy as np
from pydrake.systems.framework import Context
from pydrake.systems.sensors import ImageDepth32F, ImageGrey8U, ImageRgba8U

from crossmodal.maths.pinhole import Intrinsics
from crossmodal.systems.port_values import IN_PLACE, StampedImage, no_features
from crossmodal.systems.recursive_filter import RecursiveFilter
from crossmodal.systems.vision import camera_geometry
from crossmodal.systems.vision.features import feature_detection
from crossmodal.systems.vision.features.feature_motion_config import (
    FeatureMotionConfig,
    check_feature_motion,
)
from crossmodal.systems.vision.features.feature_tracking import track
from crossmodal.systems.vision.features.feature_tracks import (
    FeatureTracks,
    Frame,
    belief,
    no_tracks,
)


class FeatureMotion(RecursiveFilter):
    """Follows up to N point features F through the colour and depth images of a camera.

    A feature is a patch of texture on a smooth surface. Each tick it is registered to the template
    cut when its track began (so that nothing drifts), warped by the scale and foreshortening that
    its measured surface and its position imply, starting from its last place or the one that the
    body tracker predicts, whichever looks more like it. Where that fails, pyramidal Lucas-Kanade
    with a forward-backward check from the last good image offers another start. Correlation is
    normalised, so gain and offset of the exposure do not matter. The position follows from a plane
    fitted to the depth around the pixel,

        p_WF = X_WC r(uv) / w,    r = ((u - cx)/fx, (v - cy)/fy, 1),

    with w the plane's inverse depth and X_WC as the depth image says; its covariance from the
    registration's residual and the depth's noise, along the plane. That a feature is sought first
    where it was in the last image assumes a camera that stands still, or nearly.

    Unseen features coast on predictions for a bounded time and are left out of the belief. While
    nearly all are unseen (a blackout: lights off, saturated exposure), the last good image is kept
    to start from, and no feature is born. Corners have to stand out of the image's own noise.

    Input ports:
    - `color_measured`: `StampedImage` of an `ImageRgba8U`, read at the tick.
    - `depth_measured`: `StampedImage` of an `ImageDepth32F`, registered to it, [m]; 0, NaN or inf
      is no return. It has to say where the camera is.
    - `robot_mask`: `ImageGrey8U`, nonzero on the robot; none if not connected.
    - `features_predicted`: `FeatureBelief`, where the body tracker expects features, by id; may be
      empty; none if not connected.
    - `camera_displacement`: `CameraDisplacement` X_SC of the camera in the place S that the depth
      image names; it stands there if not connected. The robot's mask is moved with it.

    Output ports:
    - `features_estimated`: `FeatureBelief` of the features seen at this tick.
    - `features_latest`: the one of the last tick, from the state.

    Frames: W world, C camera (x right, y down, z forward), S the camera as its images say, F a
    feature.

    Source: the role is that of Martín-Martín and Brock, IROS 2017, section III; the registration's
    source is in `patch_registration`.
    """

    def __init__(self, config: FeatureMotionConfig, camera: Intrinsics) -> None:
        super().__init__()
        check_feature_motion(config)
        self._config = config
        self._intrinsics = camera.vector()
        size = camera.width, camera.height
        side = 2 * config.tracks.robot_border + 1
        self._border = np.ones((side, side), np.uint8)

        self._color, self._depth = (
            self._declare_value_input(f"{name}_measured", StampedImage(time=0.0, image=image))
            for name, image in (("color", ImageRgba8U(*size)), ("depth", ImageDepth32F(*size)))
        )
        self._mask = self._declare_value_input("robot_mask", ImageGrey8U(*size))
        self._predicted = self._declare_value_input("features_predicted", no_features())
        self._displacement = self._declare_value_input("camera_displacement", IN_PLACE)
        self._declare_recursion(no_tracks(config), self._calc_tracks, config.period)
        self._declare_estimated("features_estimated", belief)
        self._declare_latest("features_latest", belief)

    def _calc_tracks(self, context: Context, tracks: FeatureTracks) -> FeatureTracks:
        predicted = self._read_optional(self._predicted, context) or no_features()
        return track(self._config, tracks, self._read_frame(context), predicted)

    def _read_frame(self, context: Context) -> Frame:
        color: StampedImage = self._read(self._color, context)
        measured: StampedImage = self._read(self._depth, context)
        if not np.all(np.isfinite(measured.X_WC)):
            raise ValueError("FeatureMotion: the depth image does not say where its camera is")
        image, noise = feature_detection.smooth_grey(color.image.data)
        depth = measured.image.data[:, :, 0]
        displacement = self._read_optional(self._displacement, context) or IN_PLACE
        mask = self._read_optional(self._mask, context)
        robot = np.zeros(image.shape, np.uint8)
        if mask is not None:
            seen = camera_geometry.displaced(
                mask.data[:, :, 0], depth, displacement.X, self._intrinsics
            )
            robot = cv2.dilate(seen, self._border)
        return Frame(
            image=image,
            noise=noise,
            depth=depth,
            robot=robot,
            intrinsics=self._intrinsics,
            X_WC=measured.X_WC @ displacement.X,
        )
