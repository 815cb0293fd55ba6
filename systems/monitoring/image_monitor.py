"""Passes on the images that are new, and says how the camera's streams do."""

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context
from pydrake.systems.sensors import ImageDepth32F, ImageRgba8U

from maths.immutable import Immutable
from maths.validation import check, number
from systems.port_values import HEALTHY, StreamHealth
from systems.recursive_filter import RecursiveFilter
from systems.ticks import tick_period

SAME_IMAGE = "the same image again"
NOT_FINITE = "depths that are no numbers"


@dataclass(kw_only=True)
class ImageMonitorConfig:
    period: float = tick_period()
    # Age of the last new image that is a fault.
    stale_after: float = number(0.15, at_least=1e-3, at_most=3600.0, unit="s")


@dataclass(frozen=True, kw_only=True)
class Watched(Immutable):
    """The last image, when it was new, and whether it is new at this tick."""

    image: Any = None
    new_at: float = 0.0
    is_new: bool = False
    health: StreamHealth = HEALTHY


def watch_image(image: Any, before: Watched, now: float, config: ImageMonitorConfig) -> Watched:
    """Whether an image (H, W, C) says anything new.

    A camera's noise never repeats, so equal pixels are the old image, unless it shows nothing at
    all: black, or without a return.
    """
    if np.issubdtype(image.dtype, np.floating) and np.isnan(image).all():
        age = now - before.new_at
        return Watched(
            image=before.image,
            new_at=before.new_at,
            health=StreamHealth(age=age, fault=NOT_FINITE),
        )
    same = before.image is not None and np.array_equal(image, before.image)
    if same and image[:, :, :3].any():
        age = now - before.new_at
        fault = SAME_IMAGE if age > config.stale_after else ""
        return Watched(
            image=before.image, new_at=before.new_at, health=StreamHealth(age=age, fault=fault)
        )
    return Watched(image=image.copy(), new_at=now, is_new=True)


def _health(index: int, watched: tuple[Watched, Watched]) -> StreamHealth:
    return watched[index].health


class ImageMonitor(RecursiveFilter):
    """Keeps back a camera's images that are not new: nothing is seen then.

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

    - `color_measured`: `ImageRgba8U`.
    - `depth_measured`: `ImageDepth32F`, [m].
    - `color_checked`: `ImageRgba8U`, black where the image is not new.
    - `depth_checked`: `ImageDepth32F`, [m], all 0 (no return) where the image is not new.
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
        self._ports = [
            self._declare_value_input("color_measured", ImageRgba8U(width, height)),
            self._declare_value_input("depth_measured", ImageDepth32F(width, height)),
        ]
        nothing = [ImageRgba8U(width, height, 0), ImageDepth32F(width, height, 0.0)]
        self._declare_recursion((Watched(), Watched()), self._watch, config.period)
        for index, name in enumerate(("color", "depth")):
            self._declare_checked(index, f"{name}_checked", nothing[index])
        for index, name in enumerate(("color", "depth")):
            self._declare_latest(f"{name}_health_latest", partial(_health, index))

    def _declare_checked(self, index: int, name: str, nothing: Any) -> None:
        def write(context: Context, output: AbstractValue) -> None:
            watched = self._posterior.Eval(context)[index]
            output.set_value(self._ports[index].Eval(context) if watched.is_new else nothing)

        port = self.input_port_ticket(self._ports[index].get_index())
        self.DeclareAbstractOutputPort(
            name, lambda: AbstractValue.Make(nothing), write, {self._posterior.ticket(), port}
        )

    def _watch(self, context: Context, before: Any) -> tuple[Watched, Watched]:
        now = context.get_time()
        color, depth = (
            watch_image(self._read(port, context).data, last, now, self._config)
            for port, last in zip(self._ports, before, strict=True)
        )
        return color, depth
