"""What of a scene is shown, and from where."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from crossmodal.maths.arrays import Array


@dataclass(frozen=True, kw_only=True)
class Layers:
    """What can be shown and hidden of what a view draws.

    Attributes:
        estimators: Paths of which one is shown at a time, by the name of each.
        truth: Path of what is true; empty where that is not drawn.
    """

    estimators: Mapping[str, str] = field(default_factory=dict)
    truth: str = ""


@dataclass(frozen=True, kw_only=True)
class Viewpoint:
    """From where a scene is seen: p_WV of the viewer, p_WT of the middle, (3,) [m]."""

    p_WV: Array
    p_WT: Array
