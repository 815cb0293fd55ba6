"""What was seen and touched of the flap while it was turned, averaged into keyframes."""

from dataclasses import dataclass, replace

import numpy as np

from crossmodal.maths.arrays import Array, Mask
from crossmodal.maths.immutable import Immutable
from crossmodal.systems.port_values import FingertipContact, FlapPlane


@dataclass(frozen=True, kw_only=True)
class Keyframe(Immutable):
    """Ticks between which the flap has hardly turned.

    Attributes:
        p_WC0: Contact at the first of them (3,), [m].
        ticks: How many there are.
        p_WC: Mean contact (3,), [m].
        p_WC_covariance: (3, 3), white part of one tick's.
        face: 1 the front is seen, -1 the back, 0 neither.
        n_W: Mean normal (3,) of the face that is seen, towards the camera.
        d: Mean distance, [m].
        plane_covariance: (4, 4) of one tick.
    """

    p_WC0: Array
    ticks: int
    p_WC: Array
    p_WC_covariance: Array
    face: int
    n_W: Array
    d: float
    plane_covariance: Array


@dataclass(frozen=True, kw_only=True)
class StackedKeyframes:
    """Keyframes as arrays with K rows; a plane that is not seen is a zero.

    Attributes:
        face: (K,), see `Keyframe`.
        n_W: (K, 3).
        d: (K,), [m].
        p_WC: (K, 3), [m].
        covariance: (K, 7, 7) of (n_W, d, p_WC).
    """

    face: Array
    n_W: Array
    d: Array
    p_WC: Array
    covariance: Array

    @property
    def seen(self) -> Mask:
        """Which of them (K,) have a plane."""
        return np.asarray(self.face != 0.0)


def begin(contact: FingertipContact, plane: FlapPlane, face: int) -> Keyframe:
    """A keyframe of one tick."""
    seen = plane.seen and face != 0
    return Keyframe(
        p_WC0=contact.p_WC,
        ticks=1,
        p_WC=contact.p_WC,
        p_WC_covariance=contact.p_WC_white_covariance,
        face=face if seen else 0,
        n_W=plane.n_W if seen else np.zeros(3),
        d=plane.d if seen else 0.0,
        plane_covariance=plane.covariance if seen else np.zeros((4, 4)),
    )


def merge(a: Keyframe, b: Keyframe) -> Keyframe:
    """The average of two, which show the same face."""
    ticks = a.ticks + b.ticks
    x, y = a.ticks / ticks, b.ticks / ticks
    n_W = x * a.n_W + y * b.n_W
    return replace(
        a,
        ticks=ticks,
        p_WC=x * a.p_WC + y * b.p_WC,
        p_WC_covariance=x * a.p_WC_covariance + y * b.p_WC_covariance,
        n_W=n_W / max(float(np.linalg.norm(n_W)), 1e-9) if a.face else n_W,
        d=x * a.d + y * b.d,
        plane_covariance=x * a.plane_covariance + y * b.plane_covariance,
    )


def append(
    keyframes: tuple[Keyframe, ...], tick: Keyframe, spacing: float, memory: int
) -> tuple[Keyframe, ...]:
    """The keyframes with one more tick.

    It goes into the last keyframe, if that shows the same face and its contact began within
    `spacing` [m]; of more than `memory` keyframes the oldest but one is left out, for the first
    says where the turning began.
    """
    if keyframes:
        last = keyframes[-1]
        near = float(np.linalg.norm(tick.p_WC - last.p_WC0)) < spacing
        if near and last.face == tick.face:
            return (*keyframes[:-1], merge(last, tick))
    longer = (*keyframes, tick)
    return longer if len(longer) <= memory else (longer[0], *longer[2:])


def stack(keyframes: tuple[Keyframe, ...], plane_floor: tuple[float, float]) -> StackedKeyframes:
    """As arrays.

    Args:
        keyframes: At least one.
        plane_floor: Standard deviations of a plane's direction [rad] and distance [m] that
            averaging does not lessen.
    """
    covariance = np.zeros((len(keyframes), 7, 7))
    ticks = np.array([frame.ticks for frame in keyframes], dtype=float)[:, None, None]
    covariance[:, :4, :4] = np.array([frame.plane_covariance for frame in keyframes]) / ticks
    covariance[:, :4, :4] += np.diag(np.array([plane_floor[0]] * 3 + [plane_floor[1]]) ** 2)
    covariance[:, 4:, 4:] = np.array([frame.p_WC_covariance for frame in keyframes]) / ticks
    return StackedKeyframes(
        face=np.array([frame.face for frame in keyframes], dtype=float),
        n_W=np.array([frame.n_W for frame in keyframes]),
        d=np.array([frame.d for frame in keyframes]),
        p_WC=np.array([frame.p_WC for frame in keyframes]),
        covariance=covariance,
    )
