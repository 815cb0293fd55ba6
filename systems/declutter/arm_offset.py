"""By how much an arm meets objects beside the place where a camera sees them.

Camera and arm are each mounted some millimetres and tenths of a degree from where they are believed
to be. Over a table both errors together hardly differ from place to place: they are one
displacement in the table's plane. A look at the arm tells most of it, what it meets while it works
the rest.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
from pydrake.systems.framework import Context
from scipy.special import ndtr
from shapely.affinity import translate

from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.validation import check, number
from crossmodal.systems.port_values import (
    NO_OFFSET,
    NO_SEGMENTS,
    ActionRequest,
    ArmOffset,
    Segments,
)
from crossmodal.systems.recursive_filter import RecursiveFilter

_CELLS = 51  # Of the grid along each axis.
_REACH = 4.0  # Of the grid to each side, in standard deviations before anything was met.
_SURE = 3.0  # Standard deviations of the table's height within which it is met.
_LEAST_DEPTH = 1e-3  # What is met at an outline is met within so much of it, [m].


@dataclass(kw_only=True)
class ArmOffsetConfig:
    """How well an outline tells where an object begins."""

    # Of an outline, also because a finger meets an object below its widest place; the standard
    # deviation.
    outline: float = number(0.006, above=0.0, at_most=0.1, unit="m")
    # Share of contacts that say nothing: what was met had moved, or was something unseen.
    wrong: float = number(0.2, above=0.0, below=1.0)


def beyond_outlines(points: Array, scene: Segments) -> Array:
    """Distances (N,) of places (N, 2) to the nearest outline, negative within one, [m].

    Infinite, where there is no object.
    """
    at, nearest = shapely.points(points), np.full(len(points), np.inf)
    for segment in scene.segments:
        shapely.prepare(segment.contour)
        apart = shapely.distance(at, segment.contour.boundary)
        nearest = np.minimum(
            nearest, np.where(shapely.contains(segment.contour, at), -apart, apart)
        )
    return nearest


def likelihood(contact: Array, offsets: Array, scene: Segments, config: ArmOffsetConfig) -> Array:
    """Of one contact, for offsets (N, 2) [m], up to a factor (N,).

    A contact is anywhere between the outline and so far within it: where a finger came down on
    something, it may be anywhere on it. With the outline's error that is a difference of two normal
    distributions.

    Args:
        contact: x and y of its place and how far within the outline it may be (3,), [m].
        offsets: Of the arm.
        scene: What was seen afterwards, when what was met had come to rest.
        config: Of the outlines.
    """
    beyond = beyond_outlines(contact[:2] - offsets, scene) / config.outline
    depth = max(contact[2], _LEAST_DEPTH) / config.outline
    found = ndtr(-beyond) - ndtr(-beyond - depth)
    best = 2.0 * ndtr(0.5 * depth) - 1.0
    return np.asarray((1.0 - config.wrong) * found / best + config.wrong)


def as_met(request: ActionRequest, arm: ArmOffset, table: float = 0.0) -> ActionRequest:
    """A request for places that a camera has seen, at those where the arm meets them.

    Args:
        request: What is to be done; its heights are above the table.
        arm: By how much it meets things beside where they are seen.
        table: z at which the camera sees the table, [m].
    """
    offset = arm.mean
    X = np.eye(4)
    X[:3, 3] = offset
    raised = table + offset[2]
    return replace(
        request,
        grasps=tuple(replace(grasp, X_WE=X @ grasp.X_WE) for grasp in request.grasps),
        landing=max(request.landing, _SURE * float(np.sqrt(arm.covariance[2, 2]))),
        pushes=tuple(
            replace(
                push,
                point=push.point + offset[:2],
                place=push.place + offset[:2],
                height=push.height + raised,
                finger=translate(push.finger, *offset[:2]),
            )
            for push in request.pushes
        ),
        places=request.places + offset[:2],
        top=request.top + raised,
        obstacles=tuple(vertices + offset for vertices in request.obstacles),
    )


@dataclass(frozen=True, kw_only=True)
class OffsetBelief(Immutable):
    """A density over a grid, and of which action and image the contacts were counted last.

    Attributes:
        offsets: Of the grid in x and y (N, 2), [m].
        density: (N,).
        view: Number of the view of the arm with which it has begun; -1 before.
        action: Number of the action.
        image: Number of the image.
        offset: What is reported of it.
    """

    offsets: Array
    density: Array
    view: int = -1
    action: int = 0
    image: int = 0
    offset: ArmOffset = NO_OFFSET


class ArmOffsetFilter(RecursiveFilter):
    """Learns the offset from what the arm meets: a Bayes filter on a grid of offsets.

    Contacts are compared with the image after them, in which what was put down or pushed stands
    there, and often by itself.

    Input ports:
    - `arm_offset_seen`: `ArmOffset` by a look at the arm, with which it begins anew when the number
      of its view rises.
    - `segments`: `Segments` of the last image, whose number tells that it is new; places in W as
      the camera has them, [m].
    - `action_end`: how the last action ended, with `number` and `contacts` (K, 3): x and y of the
      place in W as the arm has it, and how far within an outline it may be, [m].

    Output ports:
    - `arm_offset`: `ArmOffset` of the last tick, from the state alone.

    State: `OffsetBelief`.

    Args:
        config: Of the outlines.
        period: Of the ticks, [s].

    Raises:
        ValueError: for an impossible configuration.
    """

    def __init__(self, config: ArmOffsetConfig, period: float) -> None:
        super().__init__()
        check(config, "ArmOffsetFilter")
        self._config = config
        self._seen = self._declare_value_input("arm_offset_seen", NO_OFFSET)
        self._segments = self._declare_value_input("segments", NO_SEGMENTS)
        self._end = self._declare_value_input("action_end", object())
        nothing = OffsetBelief(offsets=np.zeros((1, 2)), density=np.ones(1))
        self._declare_recursion(nothing, self._calc, period)
        self._declare_latest("arm_offset", lambda belief: belief.offset)

    def _calc(self, context: Context, belief: Any) -> OffsetBelief:
        before: OffsetBelief = belief
        seen: ArmOffset = self._read(self._seen, context)
        if seen.view > before.view:
            before = _as_seen(before, seen)
        end, scene = self._read(self._end, context), self._read(self._segments, context)
        if scene.number == before.image:
            return before
        if end.number == before.action:
            return replace(before, image=scene.number)
        density = before.density
        for contact in end.contacts:
            density = density * likelihood(contact, before.offsets, scene, self._config)
        density = density / density.sum()
        mean, covariance = before.offset.mean.copy(), before.offset.covariance.copy()
        mean[:2] = density @ before.offsets
        away = before.offsets - mean[:2]
        covariance[:2, :2] = (density[:, None] * away).T @ away
        return replace(
            before,
            density=density,
            action=end.number,
            image=scene.number,
            offset=replace(before.offset, mean=mean, covariance=covariance),
        )


def _as_seen(belief: OffsetBelief, seen: ArmOffset) -> OffsetBelief:
    """A grid over what was seen, with its normal distribution."""
    axis = np.linspace(-_REACH, _REACH, _CELLS)
    deviations = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    density = np.exp(-0.5 * np.square(deviations).sum(axis=1))
    return replace(
        belief,
        offsets=seen.mean[:2] + deviations @ np.linalg.cholesky(seen.covariance[:2, :2]).T,
        density=density / density.sum(),
        view=seen.view,
        offset=seen,
    )
