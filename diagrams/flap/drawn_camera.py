"""Where the seed puts the camera, and how bright its lamp is."""

from dataclasses import dataclass, replace

import numpy as np

from crossmodal.diagrams.run.scenario import CameraConfig
from crossmodal.maths.validation import number, numbers
from crossmodal.systems.sensors.randomness import make_generator


@dataclass(kw_only=True)
class CameraVariation:
    """What the seed draws uniformly around the scenario's camera; the robot knows where it is."""

    # Half ranges, of the camera and of the point that it looks at.
    position: np.ndarray = numbers(np.full(3, 0.03), at_least=0.0, at_most=10.0, unit="m")
    looking_at: np.ndarray = numbers(np.full(3, 0.02), at_least=0.0, at_most=10.0, unit="m")
    # Half range of the lamp's intensity, as a share of it.
    lamp: float = number(0.2, at_least=0.0, at_most=1.0)


def draw_camera_config(
    name: str, camera: CameraConfig, vary: CameraVariation, seed: int
) -> CameraConfig:
    """The camera of a seed.

    Args:
        name: Of the camera, so that each is drawn on its own.
        camera: Around which it is drawn.
        vary: Half ranges.
        seed: Of the scenario.
    """
    half = make_generator(seed, f"camera {name}").uniform(-1.0, 1.0, 7)
    return replace(
        camera,
        position=camera.position + vary.position * half[:3],
        looking_at=camera.looking_at + vary.looking_at * half[3:6],
        lamp=camera.lamp * (1.0 + vary.lamp * float(half[6])),
    )
