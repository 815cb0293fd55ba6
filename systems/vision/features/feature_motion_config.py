"""How features are found, followed and located; the defaults suit a 640x480 RGB-D camera."""

from dataclasses import dataclass, field

import numpy as np

from maths.validation import require_fields, require_ranges
from systems.ticks import require_ticks


@dataclass(kw_only=True)
class DetectionConfig:
    """Where new features are found."""

    interval: float = 2.0 / 15.0  # Time from one search for new features to the next, [s].
    min_distance: int = 10  # Least distance between two features, [px].
    corner_noise_factor: float = 15.0  # Least corner strength over that of the image's noise, [-].
    min_contrast: float = 2.5  # Least standard deviation of a patch, [grey levels].
    depth_step: float = 0.02  # Jump between neighbours that makes a depth edge, [m].


@dataclass(kw_only=True)
class RegistrationConfig:
    """How a feature's template is found again in the image."""

    patch_radius: int = 7  # Templates are 2 radius + 1 wide, [px].
    reach: float = 6.0  # Farthest a registration moves from its start, [px].
    min_correlation: float = 0.8  # ZNCC below which a feature is not seen, [-].
    min_shape: float = 0.4  # Least relative size of a seen patch in any direction, [-].
    shape_change: float = 0.04  # Relative change of a patch's shape per update, 1 sigma, [-].
    shape_interval: float = 0.2  # Time from one update of a patch's shape to the next, [s].
    renewal_correlation: float = 0.88  # ZNCC below which a reshaped patch's template is cut anew.
    renewal_shape: float = 0.3  # Least logarithm of the change of size of a reshaped patch, [-].
    pixel_floor: float = 0.05  # Registration error that does not show in the residual, [px].
    correlated_pixels: float = 4.0  # Number of blurred pixels whose noise is one and the same.


@dataclass(kw_only=True)
class FlowConfig:
    """The pyramidal Lucas-Kanade tracker, which offers failed features another start."""

    window: int = 21  # Width of the window, [px].
    levels: int = 3  # Number of pyramid levels above the image.
    max_error: float = 1.5  # Largest forward-backward error, [px].
    max_features: int = 200  # Most features that are tried per tick.
    max_blackout_features: int = 40  # Most features that are tried per tick of a blackout.


@dataclass(kw_only=True)
class DepthConfig:
    """The surface around a feature; a pixel's noise is noise + noise_growth (z - noise_range)^2."""

    noise: float = 1.2e-3  # Standard deviation at `noise_range`, [m].
    noise_growth: float = 1.9e-3  # Growth with the square of the distance from there, [1/m].
    noise_range: float = 0.4  # Distance of the least noise, [m].
    floor: float = 2e-4  # Error that averaging over a patch leaves, [m].
    correlated_pixels: float = 50.0  # Number of neighbours whose noise is one and the same.
    radius: int = 7  # A surface is fitted to a window 2 radius + 1 wide, [px].
    min_share: float = 0.85  # Least share of the window that lies on the surface, [-].
    max_incidence: float = 1.15  # Largest angle between a ray and a surface's normal, [rad].


@dataclass(kw_only=True)
class TrackManagementConfig:
    """How many features there are and when one is given up."""

    max_features: int = 200  # Most features that exist at a time.
    tentative_age: float = 0.2  # Age up to which a feature is tentative, [s].
    tentative_correlation: float = 0.92  # ZNCC below which a tentative feature is given up, [-].
    failure_pause: float = 4.0  # Time without new features where a tentative one failed, [s].
    robot_border: int = 8  # Distance to the robot's mask at which a feature is given up, [px].
    max_missed: float = 1.0  # Longest time for which a feature stays unseen, [s].
    max_blackout: float = 3.0  # The same in a blackout, [s].
    blackout_share: float = 0.2  # Share of features seen below which there is a blackout, [-].


@dataclass(kw_only=True)
class FeatureMotionConfig:
    period: float = 1.0 / 15.0  # Update period, [s].
    detection: DetectionConfig = field(default_factory=DetectionConfig)
    registration: RegistrationConfig = field(default_factory=RegistrationConfig)
    flow: FlowConfig = field(default_factory=FlowConfig)
    depth: DepthConfig = field(default_factory=DepthConfig)
    tracks: TrackManagementConfig = field(default_factory=TrackManagementConfig)


def check_feature_motion(config: FeatureMotionConfig) -> None:
    """Raises ValueError, naming the first impossible value."""
    name = "FeatureMotion"
    require_ranges(name, config, positive="period")
    require_ranges(
        f"{name}.detection",
        config.detection,
        positive="min_distance corner_noise_factor min_contrast depth_step",
    )
    require_ticks(f"{name}.detection", config.detection, config.period, lasting="interval")
    require_ranges(
        f"{name}.registration",
        config.registration,
        positive="patch_radius reach correlated_pixels",
        not_negative="shape_change renewal_shape pixel_floor",
    )
    require_ticks(
        f"{name}.registration", config.registration, config.period, lasting="shape_interval"
    )
    _shares(f"{name}.registration", config.registration, "min_correlation renewal_correlation")
    _shares(f"{name}.registration", config.registration, "min_shape")
    require_ranges(
        f"{name}.flow",
        config.flow,
        positive="max_error",
        not_negative="levels max_features max_blackout_features",
    )
    require_fields(f"{name}.flow", config.flow, ["window"], ">= 3 px", lambda x: x >= 3)
    require_ranges(
        f"{name}.depth",
        config.depth,
        positive="correlated_pixels radius",
        not_negative="noise noise_growth noise_range floor",
    )
    _shares(f"{name}.depth", config.depth, "min_share")
    acute = "in (0, pi/2) rad"
    require_fields(f"{name}.depth", config.depth, ["max_incidence"], acute, _is_acute)
    require_ranges(
        f"{name}.tracks",
        config.tracks,
        positive="max_missed max_blackout",
        not_negative="tentative_age failure_pause robot_border",
        counts="max_features",
    )
    _shares(f"{name}.tracks", config.tracks, "tentative_correlation blackout_share")


def _shares(name: str, config: object, fields: str) -> None:
    require_fields(name, config, fields.split(), "in (0, 1)", lambda x: 0 < x < 1)


def _is_acute(angle: float) -> bool:
    return 0.0 < angle < np.pi / 2
