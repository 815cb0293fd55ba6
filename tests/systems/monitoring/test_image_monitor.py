"""A camera that says the same again has seen nothing."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from pydrake.common.value import AbstractValue
from pydrake.systems.sensors import ImageDepth32F, ImageRgba8U

from crossmodal.maths.arrays import Array
from crossmodal.systems.monitoring.image_monitor import (
    APART,
    BRIGHTER,
    DARKER,
    ImageMonitor,
    ImageMonitorConfig,
)
from crossmodal.systems.monitoring.window_monitor import NO_SAMPLES, NOT_FINITE, OUT_OF_TIME, STUCK
from crossmodal.systems.port_values import StampedImage
from crossmodal.systems.shared_settings import with_shared

TICK = 0.1
CONFIG = with_shared(ImageMonitorConfig(), period=TICK)
SIZE = 4, 3


def color(number: int) -> ImageRgba8U:
    image = ImageRgba8U(*SIZE)
    image.mutable_data[:, :, :3] = np.random.default_rng(number).integers(0, 255, (3, 4, 3))
    image.mutable_data[:, :, 3] = 255
    return image


def depth(number: int) -> ImageDepth32F:
    image = ImageDepth32F(*SIZE)
    image.mutable_data[:] = np.random.default_rng(number).uniform(0.5, 1.0, (3, 4, 1))
    return image


def scene(number: int, added: int) -> ImageRgba8U:
    """Stripes of many greys, with noise."""
    image = ImageRgba8U(320, 240)
    noise = np.random.default_rng(number).integers(-3, 4, (240, 320, 3))
    stripes = np.repeat(np.linspace(60.0, 180.0, 8), 40)[None, :, None]
    image.mutable_data[:, :, :3] = stripes + noise + added
    return image


def watched(
    colors: list[ImageRgba8U],
    depths: list[ImageDepth32F],
    stamps: tuple[list[float], list[float]] | None = None,
) -> list[tuple[Array, Array, str, str]]:
    """Per tick: checked colour and depth, and what is said to be wrong with them.

    Args:
        stamps: Of colours and depths, in ticks; by default each is of its tick.
    """
    system = ImageMonitor(CONFIG, colors[0].width(), colors[0].height())
    context = system.CreateDefaultContext()
    found = []
    of_now = [float(tick) for tick in range(len(colors))]
    for tick, images in enumerate(zip(colors, depths, strict=True)):
        context.SetTime(tick * TICK)
        for k, (name, image) in enumerate(zip(("color", "depth"), images, strict=True)):
            taken = TICK * (stamps or (of_now, of_now))[k][tick]
            value = AbstractValue.Make(StampedImage(time=taken, image=image))
            system.GetInputPort(f"{name}_measured").FixValue(context, value)
        checked = [
            np.array(system.GetOutputPort(f"{name}_checked").Eval(context).image.data)
            for name in ("color", "depth")
        ]
        system.ExecuteForcedEvents(context)
        faults = [
            system.GetOutputPort(f"{name}_health_latest").Eval(context).fault
            for name in ("color", "depth")
        ]
        found.append((checked[0], checked[1], faults[0], faults[1]))
    return found


def test_new_images_pass_as_they_are() -> None:
    colors, depths = [color(k) for k in range(3)], [depth(k) for k in range(3)]
    for tick, (seen, measured, *faults) in enumerate(watched(colors, depths)):
        assert_array_equal(seen, colors[tick].data)
        assert_array_equal(measured, depths[tick].data)
        assert faults == ["", ""]


def test_an_image_says_where_its_camera_was_also_when_it_is_kept_back() -> None:
    system = ImageMonitor(CONFIG, *SIZE)
    context = system.CreateDefaultContext()
    for tick in (0, 1):
        context.SetTime(tick * TICK)
        X_WC, covariance = np.full((4, 4), tick), np.full((6, 6), tick)
        image = StampedImage(time=0.0, image=depth(0), X_WC=X_WC, covariance=covariance)
        system.GetInputPort("depth_measured").FixValue(context, AbstractValue.Make(image))
        checked = system.GetOutputPort("depth_checked").Eval(context)
        assert checked.image.data.any() == (tick == 0)
        assert_array_equal(checked.X_WC, X_WC)
        assert_array_equal(checked.covariance, covariance)
        system.ExecuteForcedEvents(context)


def test_depth_passes_where_nobody_sees_by_colour() -> None:
    system = ImageMonitor(CONFIG, *SIZE)
    context = system.CreateDefaultContext()
    faults = []
    for tick in (0, 1, 2):
        context.SetTime(tick * TICK)
        image = StampedImage(time=tick * TICK, image=depth(min(tick, 1)))
        system.GetInputPort("depth_measured").FixValue(context, AbstractValue.Make(image))
        passed = bool(system.GetOutputPort("depth_checked").Eval(context).image.data.any())
        system.ExecuteForcedEvents(context)
        health = system.GetOutputPort("depth_health_latest").Eval(context)
        faults.append((passed, health.fault))
    assert faults == [(True, ""), (True, ""), (False, STUCK)]


def test_depth_that_stopped_while_colour_lives_is_no_depth() -> None:
    stamps = [0.0, 1.0, 2.0, 3.0, 4.0], [0.0, 1.0, 1.0, 1.0, 4.0]
    found = watched([color(k) for k in range(5)], [depth(0), *[depth(1)] * 3, depth(4)], stamps)
    assert [fault for *_, fault in found] == ["", "", "", NO_SAMPLES, ""]
    assert [bool(measured.any()) for _, measured, *_ in found] == [True, True, False, False, True]
    assert all(fault == "" for _, _, fault, _ in found)
    assert all(seen.any() for seen, *_ in found)


def test_a_camera_that_repeats_its_image_with_new_stamps_sees_nothing() -> None:
    found = watched([color(0)] * 4, [depth(0)] * 4)
    assert [tick[2:] for tick in found] == [("", "")] + [(STUCK, STUCK)] * 3
    assert not found[1][0].any()
    assert not found[1][1].any()


def test_images_of_earlier_and_of_later_are_kept_back_and_told() -> None:
    for late in ([0.0, -2.0, -1.0, 3.0], [0.0, 31.0, 32.0, 3.0]):
        found = watched([color(k) for k in range(4)], [depth(k) for k in range(4)], (late, late))
        assert [tick[2] for tick in found] == ["", OUT_OF_TIME, OUT_OF_TIME, ""]
        assert [tick[3] for tick in found] == ["", OUT_OF_TIME, OUT_OF_TIME, ""]
        assert [bool(seen.any()) for seen, *_ in found] == [True, False, False, True]


def test_an_image_of_another_instant_than_its_partner_is_kept_back() -> None:
    stamps = [0.0, 1.0, 2.0, 3.0], [0.0, 0.5, 1.5, 3.0]
    found = watched([color(k) for k in range(4)], [depth(k) for k in range(4)], stamps)
    assert [tick[2:] for tick in found] == [("", ""), *[("", APART)] * 2, ("", "")]
    assert [bool(measured.any()) for _, measured, *_ in found] == [True, False, False, True]
    assert all(seen.any() for seen, *_ in found)


def test_grey_that_is_added_is_told_and_the_image_passes() -> None:
    colors = [scene(number, added) for number, added in enumerate((0, 40, -20, 0))]
    found = watched(colors, [ImageDepth32F(320, 240, 0.0)] * 4)
    assert [fault for _, _, fault, _ in found] == ["", BRIGHTER, DARKER, ""]
    for (seen, *_), measured in zip(found, colors, strict=True):
        assert_array_equal(seen, measured.data)


def test_a_covered_camera_is_no_fault() -> None:
    black, nothing = ImageRgba8U(*SIZE), ImageDepth32F(*SIZE)
    black.mutable_data[:] = [0, 0, 0, 255]
    nothing.mutable_data[:] = 0.0
    assert [found[2:] for found in watched([black] * 4, [nothing] * 4)] == [("", "")] * 4


def test_depths_that_are_no_numbers_are_told() -> None:
    broken = ImageDepth32F(*SIZE)
    broken.mutable_data[:] = np.nan
    found = watched([color(k) for k in range(3)], [depth(0), broken, depth(2)])
    assert [fault for *_, fault in found] == ["", NOT_FINITE, ""]
    assert not found[1][1].any()


@pytest.mark.parametrize("value", [np.nan, 0.0, -1.0])
def test_impossible_limits_are_refused(value: float) -> None:
    with pytest.raises(ValueError, match="oldest"):
        ImageMonitor(ImageMonitorConfig(oldest=value), *SIZE)
