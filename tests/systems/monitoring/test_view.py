"""When a camera's view is another one, whatever the light, and what that says of its depth."""

from dataclasses import replace

import cv2
import numpy as np
import numpy.typing as npt
import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.sensors import ImageDepth32F, ImageRgba8U

from crossmodal.systems.monitoring.image_monitor import CHANGED, ImageMonitor, ImageMonitorConfig
from crossmodal.systems.monitoring.view import is_another, view_of
from crossmodal.systems.port_values import IN_PLACE, StampedImage
from crossmodal.systems.shared_settings import with_shared

HEIGHT, WIDTH = 240, 320
TICK = 0.1
Byte = npt.NDArray[np.uint8]


def seen(shift: float = 0.0, gain: float = 1.0, noise: int = 0) -> Byte:
    """Colours (H, W, 4) of a textured wall, shifted to the right by so many pixels."""
    rng = np.random.default_rng(0)
    wall = cv2.resize(rng.uniform(40.0, 160.0, (40, 60)), (400, 280), interpolation=cv2.INTER_CUBIC)
    M = np.array([[1.0, 0.0, shift - 40.0], [0.0, 1.0, -20.0]])
    grey = cv2.warpAffine(wall, M, (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC)
    grey = gain * grey + 2.0 * np.random.default_rng([1, noise]).standard_normal(grey.shape)
    image = np.repeat(np.clip(grey, 1, 254)[:, :, None], 4, axis=2)
    return image.astype(np.uint8)


@pytest.mark.parametrize("gain", [0.5, 1.0, 1.5])
def test_noise_and_another_exposure_are_no_other_view(gain: float) -> None:
    before = view_of(seen(), None)
    assert not any(is_another(before, seen(gain=gain, noise=k)) for k in range(1, 20))


@pytest.mark.parametrize("shift", [0.9, -2.6, 9.0])
def test_a_shifted_view_is_another_one(shift: float) -> None:
    assert is_another(view_of(seen(), None), seen(shift, gain=1.2, noise=1))


def test_a_robot_that_fills_the_image_says_nothing() -> None:
    robot = np.full((HEIGHT, WIDTH, 1), 255, np.uint8)
    assert not is_another(view_of(seen(), robot), seen(5.0))


def test_an_image_without_texture_says_nothing() -> None:
    blank = np.full((HEIGHT, WIDTH, 4), 120, np.uint8)
    assert not is_another(view_of(blank, None), blank)


@pytest.mark.parametrize(("shift", "fault"), [(0.0, CHANGED), (4.0, "")])
def test_depth_that_changes_with_the_view_is_no_fault(shift: float, fault: str) -> None:
    system = ImageMonitor(with_shared(ImageMonitorConfig(), period=TICK), WIDTH, HEIGHT)
    context = system.CreateDefaultContext()
    for k in range(6):
        knocked = k >= 3
        color, depth = ImageRgba8U(WIDTH, HEIGHT), ImageDepth32F(WIDTH, HEIGHT)
        color.mutable_data[:] = seen(shift if knocked else 0.0, noise=k)
        far = 1.0 + 1e-3 * np.random.default_rng(k).standard_normal((HEIGHT, WIDTH, 1))
        depth.mutable_data[:] = far + (0.02 if knocked else 0.0)
        context.SetTime(k * TICK)
        for name, image in (("color", color), ("depth", depth)):
            value = StampedImage(time=k * TICK, image=image)
            system.GetInputPort(f"{name}_measured").FixValue(context, AbstractValue.Make(value))
        passed = system.GetOutputPort("depth_checked").Eval(context).image.data
        assert bool(passed.any()) == (not (knocked and fault))
        system.ExecuteForcedEvents(context)
    assert system.GetOutputPort("depth_health_latest").Eval(context).fault == fault


def test_a_depth_sensor_that_fails_after_a_knock_is_noticed() -> None:
    """The knock leaves the depth of the wall as it is, so that only the features tell of it."""
    system = ImageMonitor(with_shared(ImageMonitorConfig(), period=TICK), WIDTH, HEIGHT)
    context = system.CreateDefaultContext()
    jumped = replace(IN_PLACE, jumps=1)
    told = []
    for k in range(12):
        color, depth = ImageRgba8U(WIDTH, HEIGHT), ImageDepth32F(WIDTH, HEIGHT)
        color.mutable_data[:] = seen(4.0 if k >= 3 else 0.0, noise=k)
        noise = 1e-3 * np.random.default_rng(k).standard_normal((HEIGHT, WIDTH, 1))
        depth.mutable_data[:] = 1.0 + noise + (0.02 if k >= 8 else 0.0)
        context.SetTime(k * TICK)
        for name, image in (("color", color), ("depth", depth)):
            value = StampedImage(time=k * TICK, image=image)
            system.GetInputPort(f"{name}_measured").FixValue(context, AbstractValue.Make(value))
        camera = jumped if k >= 4 else IN_PLACE
        system.GetInputPort("camera_displacement").FixValue(context, AbstractValue.Make(camera))
        system.ExecuteForcedEvents(context)
        told.append(system.GetOutputPort("depth_health_latest").Eval(context).fault)
    assert told == [""] * 8 + [CHANGED] * 4
