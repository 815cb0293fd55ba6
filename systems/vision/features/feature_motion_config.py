"""How features are found, followed and located; the defaults suit a 640x480 RGB-D camera."""

from dataclasses import dataclass, field

import numpy as np

from crossmodal.maths.validation import check, number
from crossmodal.systems.shared_settings import SensorNoise
from crossmodal.systems.ticks import Ticked, require_ticks


@dataclass(kw_only=True)
class DetectionConfig:
    """Where new features are found."""

    # Time from one search for new features to the next.
    interval: float = number(2.0 / 15.0, at_least=1e-3, at_most=3600.0, unit="s")
    # Least distance between two features.
    min_distance: int = number(10, at_least=1, at_most=4096, unit="px")
    # Least corner strength over that of the image's noise.
    corner_noise_factor: float = number(15.0, above=0.0, at_most=1e6)
    # Least standard deviation of a patch.
    min_contrast: float = number(2.5, above=0.0, at_most=255.0, unit="grey levels")
    # Jump between neighbours that makes a depth edge.
    depth_step: float = number(0.02, above=0.0, at_most=10.0, unit="m")


@dataclass(kw_only=True)
class RegistrationConfig:
    """How a feature's template is found again in the image."""

    # Templates are 2 radius + 1 wide.
    patch_radius: int = number(7, at_least=1, at_most=100, unit="px")
    # Farthest a registration moves from its start.
    reach: float = number(6.0, above=0.0, at_most=1000.0, unit="px")
    # ZNCC below which a feature is not seen.
    min_correlation: float = number(0.8, above=0.0, below=1.0)
    # Least relative size of a seen patch in any direction.
    min_shape: float = number(0.4, above=0.0, below=1.0)
    # Relative change of a patch's shape per update, 1 sigma.
    shape_change: float = number(0.04, at_least=0.0, at_most=10.0)
    # Time from one update of a patch's shape to the next.
    shape_interval: float = number(0.2, at_least=1e-3, at_most=3600.0, unit="s")
    # ZNCC below which a reshaped patch's template is cut anew.
    renewal_correlation: float = number(0.88, above=0.0, below=1.0)
    # Least logarithm of the change of size of a reshaped patch.
    renewal_shape: float = number(0.3, at_least=0.0, at_most=100.0)
    # Registration error that does not show in the residual.
    pixel_floor: float = number(0.05, at_least=0.0, at_most=100.0, unit="px")
    # Number of blurred pixels whose noise is one and the same.
    correlated_pixels: float = number(4.0, above=0.0, at_most=1e4)


@dataclass(kw_only=True)
class FlowConfig:
    """The pyramidal Lucas-Kanade tracker, which offers failed features another start."""

    # Largest forward-backward error.
    max_error: float = number(1.5, above=0.0, at_most=1000.0, unit="px")
    # Most features that are tried per tick.
    max_features: int = number(200, at_least=0, at_most=10000)
    # Most features that are tried per tick of a blackout.
    max_blackout_features: int = number(40, at_least=0, at_most=10000)


@dataclass(kw_only=True)
class DepthConfig:
    """The surface around a feature."""

    # Error that averaging over a patch leaves.
    floor: float = number(2e-4, at_least=0.0, at_most=1.0, unit="m")
    # Number of neighbours whose noise is one and the same.
    correlated_pixels: float = number(50.0, above=0.0, at_most=1e4)
    # A surface is fitted to a window 2 radius + 1 wide.
    radius: int = number(7, at_least=1, at_most=100, unit="px")
    # Least share of the window that lies on the surface.
    min_share: float = number(0.85, above=0.0, below=1.0)
    # Largest angle between a ray and a surface's normal.
    max_incidence: float = number(1.15, above=0.0, below=np.pi / 2, unit="rad")


@dataclass(kw_only=True)
class TrackManagementConfig:
    """How many features there are and when one is given up."""

    # Most features that exist at a time.
    max_features: int = number(200, at_least=1, at_most=10000)
    # Age up to which a feature is tentative.
    tentative_age: float = number(0.2, at_least=0.0, at_most=3600.0, unit="s")
    # ZNCC below which a tentative feature is given up.
    tentative_correlation: float = number(0.92, above=0.0, below=1.0)
    # Time without new features where a tentative one failed.
    failure_pause: float = number(4.0, at_least=0.0, at_most=3600.0, unit="s")
    # Distance to the robot's mask at which a feature is given up.
    robot_border: int = number(8, at_least=0, at_most=1000, unit="px")
    # Longest time for which a feature stays unseen.
    max_missed: float = number(1.0, above=0.0, at_most=3600.0, unit="s")
    # The same in a blackout.
    max_blackout: float = number(3.0, above=0.0, at_most=3600.0, unit="s")
    # Share of features seen below which there is a blackout.
    blackout_share: float = number(0.2, above=0.0, below=1.0)


@dataclass(kw_only=True)
class FeatureMotionConfig(Ticked):
    noise = SensorNoise()
    detection: DetectionConfig = field(default_factory=DetectionConfig)
    registration: RegistrationConfig = field(default_factory=RegistrationConfig)
    flow: FlowConfig = field(default_factory=FlowConfig)
    depth: DepthConfig = field(default_factory=DepthConfig)
    tracks: TrackManagementConfig = field(default_factory=TrackManagementConfig)


def check_feature_motion(config: FeatureMotionConfig) -> None:
    """Raises ValueError, naming the first impossible value."""
    name, durations = "FeatureMotion", "detection.interval registration.shape_interval"
    check(config, name)
    require_ticks(name, config, config.period, lasting=durations)
