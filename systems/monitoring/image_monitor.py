"""Passes on the images that are new and of now, and says how the camera's streams do."""

import zlib
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context
from pydrake.systems.sensors import ImageDepth32F, ImageGrey8U, ImageRgba8U

from crossmodal.maths.immutable import Immutable
from crossmodal.maths.validation import check, number
from crossmodal.systems.monitoring.background import Background
from crossmodal.systems.monitoring.black_level import BlackLevelConfig, watch_grey
from crossmodal.systems.monitoring.depth_background import (
    DepthBackground,
    DepthBackgroundConfig,
    watch_depth,
)
from crossmodal.systems.monitoring.view import View, is_another, view_of
from crossmodal.systems.monitoring.window_monitor import (
    Monitored,
    WindowMonitorConfig,
    check_window,
)
from crossmodal.systems.port_values import IN_PLACE, SampleWindow, StampedImage, StreamHealth
from crossmodal.systems.recursive_filter import RecursiveFilter
from crossmodal.systems.ticks import Ticked

CHANGED = "the depth of what stands still has changed"
BRIGHTER = "a grey value is added to what stands still"
DARKER = "a grey value is taken from what stands still"
APART = "not of the same instant as the other image"
_EVERY = 4  # Of the rows and columns that are looked at; noise shows in all of them.


@dataclass(kw_only=True)
class ImageMonitorConfig(Ticked):
    windows = WindowMonitorConfig()  # Limits as of all streams, but for the age.
    # The last image of a camera is as old as a tick at most, if the camera has the ticks' rate.
    oldest: float = number(0.07, at_least=1e-3, at_most=3600.0, unit="s")
    # By so much the stamps of colour and depth may differ.
    apart: float = number(0.02, at_least=0.0, at_most=3600.0, unit="s")
    background: DepthBackgroundConfig = field(default_factory=DepthBackgroundConfig)
    black: BlackLevelConfig = field(default_factory=BlackLevelConfig)


@dataclass(frozen=True, kw_only=True)
class Watched(Immutable):
    """What is remembered of the images, and the depth and the grey of what stands still.

    The view is that with which depth and grey began; so is the number of the camera's jumps.
    """

    color: Monitored = field(default_factory=Monitored)
    depth: Monitored = field(default_factory=Monitored)
    background: DepthBackground | None = None
    grey: Background | None = None
    view: View | None = None
    camera_jumps: int = 0


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
    arrived: StampedImage, before: Monitored, now: float, config: ImageMonitorConfig
) -> Monitored:
    """An image as a window of one sample, or of none where none has arrived since the last tick.

    Args:
        arrived: What the camera delivered last.
        before: What was remembered.
        now: The tick, [s].
        config: Limits.
    """
    is_old = before.last_input is not None and arrived.time == before.last_input
    times = np.array([] if is_old else [arrived.time])
    values = np.array([fingerprint(arrived.image.data, time) for time in times]).reshape(-1, 1)
    limits = replace(config.windows, oldest=config.oldest)
    checked = check_window(SampleWindow(times=times, values=values), before, now, limits)
    return replace(checked, last_input=arrived.time)


def is_new(monitored: Monitored) -> bool:
    return monitored.passed is not None and len(monitored.passed.times) > 0


def kept_back(image: Monitored, before: Monitored, now: float, fault: str) -> Monitored:
    """A new image as if it had not arrived, but for what is reported."""
    health = StreamHealth(age=now - max(before.last_time, 0.0), fault=fault)
    return replace(before, last_input=image.last_input, health=health, passed=None)


def without_pairs_apart(watched: Watched, before: Watched, now: float, apart: float) -> Watched:
    """Keeps back the older of two images that are not of the same instant."""
    color, depth = watched.color, watched.depth
    if not (is_new(color) and is_new(depth)) or abs(color.last_time - depth.last_time) <= apart:
        return watched
    if color.last_time < depth.last_time:
        return replace(watched, color=kept_back(color, before.color, now, APART))
    return replace(watched, depth=kept_back(depth, before.depth, now, APART))


def _health(name: str, watched: Watched) -> StreamHealth:
    health: StreamHealth = getattr(watched, name).health
    return health


class ImageMonitor(RecursiveFilter):
    """Keeps back a camera's images that are not new, not of now or not of one instant.

    Nothing is seen then. Faults of an image are those that a `WindowMonitor` reports of a sample.
    Depth is kept back, too, while that of what stands still is not what it was
    (`depth_background`) though it is seen where it was; if the view itself is another one (`view`),
    what stands still is learnt anew. An offset of the grey values of what stands still
    (`black_level`) is reported, and the image is passed on: what is seen in it stays where it is.
    For a camera that does not move, unless somebody knocks against it.

    Input ports:
    - `color_measured`: `StampedImage` of an `ImageRgba8U`; may stay unconnected where nobody sees
      by colour.
    - `depth_measured`: `StampedImage` of an `ImageDepth32F`, [m].
    - `robot_mask`: `ImageGrey8U`, nonzero on the robot; none if not connected.
    - `camera_displacement`: `CameraDisplacement`; what stands still is learnt anew after each of
      its jumps. None if not connected.

    Output ports:
    - `color_checked`: `StampedImage` of an `ImageRgba8U`, black where the image is kept back.
    - `depth_checked`: `StampedImage` of an `ImageDepth32F`, [m], all 0 (no return) where the image
      is kept back.
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
        nothing = {
            "color": ImageRgba8U(width, height, 0),
            "depth": ImageDepth32F(width, height, 0.0),
        }
        self._ports = {
            name: self._declare_value_input(f"{name}_measured", StampedImage(time=0.0, image=image))
            for name, image in nothing.items()
        }
        self._mask = self._declare_value_input("robot_mask", ImageGrey8U(width, height))
        self._camera = self._declare_value_input("camera_displacement", IN_PLACE)
        self._declare_recursion(Watched(), self._watch, config.period)
        for name, image in nothing.items():
            self._declare_checked(name, image)
        for name in nothing:
            self._declare_latest(f"{name}_health_latest", partial(_health, name))

    def _declare_checked(self, name: str, nothing: Any) -> None:
        def write(context: Context, output: AbstractValue) -> None:
            arrived: StampedImage = self._ports[name].Eval(context)
            passes = is_new(getattr(self._posterior.Eval(context), name))
            output.set_value(arrived if passes else replace(arrived, image=nothing))

        port = self.input_port_ticket(self._ports[name].get_index())
        self.DeclareAbstractOutputPort(
            f"{name}_checked",
            lambda: AbstractValue.Make(StampedImage(time=0.0, image=nothing)),
            write,
            {self._posterior.ticket(), port},
        )

    def _watch(self, context: Context, before: Any) -> Watched:
        now = context.get_time()
        camera = self._read_optional(self._camera, context) or IN_PLACE
        if camera.jumps != before.camera_jumps:
            before = replace(
                before, background=None, grey=None, view=None, camera_jumps=camera.jumps
            )
        read = {name: self._read_optional(port, context) for name, port in self._ports.items()}
        images = {name: image for name, image in read.items() if image is not None}
        watched = replace(
            before,
            **{
                name: check_image(image, getattr(before, name), now, self._config)
                for name, image in images.items()
            },
        )
        watched = without_pairs_apart(watched, before, now, self._config.apart)
        mask = self._read_optional(self._mask, context)
        robot = None if mask is None else mask.data
        if "color" in images:
            watched = self._watch_color(watched, images["color"].image.data, robot)
        color = images["color"].image.data if "color" in images else None
        return self._watch_depth(watched, before, images["depth"].image.data, color, robot, now)

    def _watch_color(self, watched: Watched, image: Any, robot: Any) -> Watched:
        if not is_new(watched.color):
            return watched
        grey, offset = watch_grey(self._config.black, watched.grey, image, robot)
        health = watched.color.health
        if offset and not health.fault:
            health = replace(health, fault=BRIGHTER if offset > 0.0 else DARKER)
        return replace(watched, color=replace(watched.color, health=health), grey=grey)

    def _watch_depth(
        self, watched: Watched, before: Watched, image: Any, color: Any, robot: Any, now: float
    ) -> Watched:
        if not is_new(watched.depth):
            return watched
        background, has_changed = watch_depth(
            self._config.background, watched.background, image, robot
        )
        if color is not None and is_new(watched.color):
            if watched.view is None:
                watched = replace(watched, view=view_of(color, robot))
            elif has_changed and is_another(watched.view, color):
                background, has_changed = watch_depth(self._config.background, None, image, robot)
                watched = replace(watched, grey=None, view=view_of(color, robot))
        if has_changed:
            depth = kept_back(watched.depth, before.depth, now, CHANGED)
            return replace(watched, depth=depth)
        return replace(watched, background=background)
