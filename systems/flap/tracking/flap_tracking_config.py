"""How the flap is found in a depth image; the defaults suit a 640x480 structured-light camera."""

from dataclasses import dataclass, field

import numpy as np

from crossmodal.maths.validation import check, number, require
from crossmodal.systems.ticks import Ticked


@dataclass(kw_only=True)
class DepthSensorConfig:
    """What is believed of a pixel's noise, until planes have shown it: growth z^2.

    Sources: of the growth, K. Khoshelham and S. Oude Elberink, "Accuracy and resolution of Kinect
    depth data for indoor mapping applications", Sensors 2012, equation 12; of the square, K.
    Konolige and P. Mihelich, "Technical description of Kinect calibration".
    """

    # Standard deviation of the depth over its square.
    growth: float = number(1.4e-3, at_least=1e-6, at_most=1.0, unit="1/m")
    # By how much the first images' noise may exceed that.
    first_scale: float = number(2.0, at_least=0.1, at_most=100.0)
    # Images over which the residuals of planes are averaged.
    images: int = number(30, at_least=1, at_most=10**6)
    # Side of the square over which neighbours share their noise.
    correlation: int = number(9, at_least=1, at_most=99, unit="px")


@dataclass(kw_only=True)
class RegionConfig:
    """Where the tool is looked for."""

    # Of the ball about the holder's end-effector, before anything was touched.
    reach: float = number(0.35, at_least=0.05, at_most=5.0, unit="m")
    # Of the ball about the contact.
    radius: float = number(0.2, at_least=0.05, at_most=5.0, unit="m")
    # What lies so far beyond the free edge is the flap, however small the angle of the two parts.
    flap_length: float = number(0.04, at_least=0.01, at_most=1.0, unit="m")
    # Largest distance from the contact to the flap's plane: calibration and the flap's thickness.
    contact_distance: float = number(0.04, at_least=1e-3, at_most=1.0, unit="m")


@dataclass(kw_only=True)
class FlapTrackingConfig(Ticked):
    """Configuration of `FlapTracker`."""

    sensor: DepthSensorConfig = field(default_factory=DepthSensorConfig)
    region: RegionConfig = field(default_factory=RegionConfig)
    # Side of the window of a local normal.
    window: float = number(0.03, at_least=1e-3, at_most=1.0, unit="m")
    # Between the local normals, even.
    stride: int = number(4, at_least=2, at_most=32, unit="px")
    # Share of a window that must have returned.
    window_share: float = number(0.6, above=0.0, at_most=1.0)
    # Standard deviations of the noise that a window's residual may have; more is a depth edge.
    window_residual: float = number(1.8, above=0.0, at_most=100.0)
    # Of a cluster of normals.
    cluster_radius: float = number(0.2, above=0.0, at_most=np.pi / 2, unit="rad")
    # Of all local normals that a cluster needs.
    cluster_share: float = number(0.08, above=0.0, below=1.0)
    # Local normals that there must be at all.
    least_normals: int = number(12, at_least=3, at_most=10**6)
    # Between two parts that are told apart by their normals.
    least_angle: float = number(0.16, above=0.0, at_most=np.pi / 2, unit="rad")
    # Standard deviations within which a pixel belongs to a plane.
    pixel_gate: float = number(2.5, above=0.0, at_most=100.0)
    # Pixels of the flap that are needed.
    least_points: int = number(400, at_least=10, at_most=10**6)
    # The same of what lies ahead of the pad.
    least_near: int = number(200, at_least=10, at_most=10**6)
    # From the ray to the normal, beyond which a view is too grazing.
    largest_incidence: float = number(1.3, above=0.0, below=np.pi / 2, unit="rad")
    # Largest standard deviation of the normal.
    largest_error: float = number(0.1, above=0.0, at_most=1.0, unit="rad")


def check_flap_tracking(config: FlapTrackingConfig) -> None:
    """Refuses impossible values."""
    c, name = config, "FlapTracker"
    check(c, name)
    require(c.sensor.correlation % 2 == 1, name, c, "sensor.correlation", "an odd number")
    require(c.stride % 2 == 0, name, c, "stride", "an even number")
