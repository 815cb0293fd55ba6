"""Passes on the images that are new and of now, and says how the camera's streams do."""

import zlib
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context
from pydrake.systems.sensors import ImageDepth32F, ImageRgba8U

from maths.validation import check, number
from systems.monitoring.window_monitor import Monitored, WindowMonitorConfig, check_window
from systems.port_values import SampleWindow, StampedImage, StreamHealth
from systems.recursive_filter import RecursiveFilter

APART = "not of the same instant as the other image"
_EVERY = 4  # Of the rows and columns that are looked at; noise shows in all of them.


@dataclass(kw_only=True)
class ImageMonitorConfig(WindowMonitorConfig):
    # The last image of a camera is as old as a tick at most, if the camera has the ticks' rate.
    oldest: float = number(0.07, at_least=1e-3, at_most=3600.0, unit="s")
    # By so much the stamps of colour and depth may differ.
    apart: float = number(0.02, at_least=0.0, at_most=3600.0, unit="s")


def fingerprint(image: Any, stamp: float) -> float:
    """A number that repeats only where an image (H, W, C) is the old one; NaN without numbers.

    A camera's noise never repeats. An image that shows nothing at all, black or without a return,
    is always another one.
    """
    some = image[::_EVERY, ::_EVERY, :3]
    if np.issubdtype(image.dtype, np.floating) and np.isnan(some).all():
        return np.nan
    if not some.any():
        return -1.0 - stamp
    return float(zlib.adler32(np.ascontiguousarray(image[::_EVERY]).tobytes()))


def check_image(
    arrived: StampedImage, before: Monitored, now: float, config: WindowMonitorConfig
) -> Monitored:
    """An image as a window of one sample, or of none where none has arrived since the last tick.

    Args:
        arrived: What the camera delivered last.
        before: What was remembered.
        now: The tick, [s].
        config: Limits.
    """
    is_old = before.last_heard is not None and arrived.time == before.last_heard
    times = np.array([] if is_old else [arrived.time])
    values = np.array([fingerprint(arrived.image.data, time) for time in times]).reshape(-1, 1)
    checked = check_window(SampleWindow(times=times, values=values), before, now, config)
    return replace(checked, last_heard=arrived.time)


def is_new(monitored: Monitored) -> bool:
    return monitored.passed is not None and len(monitored.passed.times) > 0


def without_pairs_apart(
    pair: tuple[Monitored, Monitored], before: tuple[Monitored, Monitored], apart: float
) -> tuple[Monitored, Monitored]:
    """Keeps back the older of two images that are not of the same instant."""
    stamps = [monitored.last_time for monitored in pair]
    if not all(map(is_new, pair)) or abs(stamps[0] - stamps[1]) <= apart:
        return pair
    older = int(np.argmin(stamps))
    kept_back = replace(
        before[older],
        last_heard=pair[older].last_heard,
        health=StreamHealth(age=max(stamps) - before[older].last_time, fault=APART),
        passed=None,
    )
    return (kept_back, pair[1]) if older == 0 else (pair[0], kept_back)


def _health(index: int, watched: tuple[Monitored, Monitored]) -> StreamHealth:
    return watched[index].health


class ImageMonitor(RecursiveFilter):
    """Keeps back a camera's images that are not new, not of now or not of one instant.

    Nothing is seen then. What is told of an image is what a `WindowMonitor` tells of a sample.

    .. pydrake_system::

        name: ImageMonitor
        input_ports:
        - color_measured
        - depth_measured
        output_ports:
        - color_checked
        - depth_checked
        - color_health_latest
        - depth_health_latest

    - `color_measured`: `StampedImage` of an `ImageRgba8U`.
    - `depth_measured`: `StampedImage` of an `ImageDepth32F`, [m].
    - `color_checked`: `ImageRgba8U`, black where the image is kept back.
    - `depth_checked`: `ImageDepth32F`, [m], all 0 (no return) where the image is kept back.
    - `color_health_latest`, `depth_health_latest`: `StreamHealth` as of the last tick.

    Args:
        config: Limits.
        width: Of the images, [px].
        height: Of the images, [px].

    Raises:
        ValueError: for an impossible config value.
    """

    def __init__(self, config: ImageMonitorConfig, width: int, height: int) -> None:
        super().__init__()
        check(config, "ImageMonitor")
        self._config = config
        nothing = [ImageRgba8U(width, height, 0), ImageDepth32F(width, height, 0.0)]
        self._ports = [
            self._declare_value_input(f"{name}_measured", StampedImage(time=0.0, image=image))
            for name, image in zip(("color", "depth"), nothing, strict=True)
        ]
        self._declare_recursion((Monitored(), Monitored()), self._watch, config.period)
        for index, name in enumerate(("color", "depth")):
            self._declare_checked(index, f"{name}_checked", nothing[index])
        for index, name in enumerate(("color", "depth")):
            self._declare_latest(f"{name}_health_latest", partial(_health, index))

    def _declare_checked(self, index: int, name: str, nothing: Any) -> None:
        def write(context: Context, output: AbstractValue) -> None:
            passes = is_new(self._posterior.Eval(context)[index])
            output.set_value(self._ports[index].Eval(context).image if passes else nothing)

        port = self.input_port_ticket(self._ports[index].get_index())
        self.DeclareAbstractOutputPort(
            name, lambda: AbstractValue.Make(nothing), write, {self._posterior.ticket(), port}
        )

    def _watch(self, context: Context, before: Any) -> tuple[Monitored, Monitored]:
        now = context.get_time()
        color, depth = (
            check_image(self._read(port, context), last, now, self._config)
            for port, last in zip(self._ports, before, strict=True)
        )
        return without_pairs_apart((color, depth), before, self._config.apart)
