"""The form in which an estimated joint is drawn, in pictures and in Meshcat alike.

A prismatic joint is a green bar along its axis above the body, where no hand hides it (its axis has
no place), with a cone on either side whose half angle is two standard deviations of the axis. A
revolute one is a red bar on its axis, with a tube of two standard deviations of its position, which
opens by those of its direction. A screw is a purple bar likewise, with a helix about it.
"""

from dataclasses import dataclass

import matplotlib.patheffects as path_effects
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from scipy.spatial import ConvexHull, QhullError

from crossmodal.diagrams.joints.joint_palette import JOINT
from crossmodal.diagrams.run.calibration import Camera
from crossmodal.maths.arrays import Array
from crossmodal.maths.vectors import normal_basis
from crossmodal.systems.port_values import MOVING_TYPES, BodyMotion, JointBelief, JointType

BAR_LENGTH = 0.3  # [m]
HELIX_RADIUS = 0.025  # [m]
BAR_HEIGHT = 0.2  # Of a prismatic joint's bar above the body, [m].
_LARGEST_ANGLE = np.deg2rad(60.0)  # Cones are drawn no wider than this.
_LARGEST_RADIUS = 0.15  # [m]


@dataclass(kw_only=True)
class JointSketch:
    """A joint as a bar with its uncertainty.

    Attributes:
        type: Prismatic, revolute or screw.
        center_W: Middle (3,) of the bar, [m].
        direction_W: Unit vector (3,) along it, to growing configuration.
        length: Of the bar, [m].
        angle: Two standard deviations of its direction, [rad].
        radius: Two standard deviations of its position, [m]; 0 for prismatic joints.
    """

    type: JointType
    center_W: Array
    direction_W: Array
    length: float
    angle: float
    radius: float


def sketch_joint(joint: JointBelief, body: BodyMotion | None) -> JointSketch | None:
    """The drawing of a joint to the environment; None for a rigid or disconnected body."""
    if joint.type not in MOVING_TYPES:
        return None
    model = joint.model
    sign = -1.0 if model.configuration[0] < 0.0 else 1.0
    deviation = 2.0 * np.sqrt(max(float(np.linalg.eigvalsh(model.axis_covariance)[-1]), 0.0))
    radius = 0.0
    if joint.type != JointType.PRISMATIC:
        center = np.asarray(model.p_PA, dtype=float)
        variance = float(np.linalg.eigvalsh(model.p_PA_covariance)[-1])
        radius = min(2.0 * float(np.sqrt(max(variance, 0.0))), _LARGEST_RADIUS)
    elif body is not None:
        center = body.motion.X[:3, 3] + np.array([0.0, 0.0, BAR_HEIGHT])
    else:
        return None
    return JointSketch(
        type=joint.type,
        center_W=center,
        direction_W=sign * np.asarray(model.axis_P, dtype=float),
        length=BAR_LENGTH,
        angle=min(float(deviation), _LARGEST_ANGLE),
        radius=radius,
    )


def uncertainty_outline(sketch: JointSketch, side: float, points: int = 32) -> Array:
    """Points (points + points, 3) of one cone or half tube: its ring at the middle and at the end.

    Args:
        side: 1 for the end in the joint's direction, -1 for the other.
    """
    u, v = normal_basis(sketch.direction_W)
    turn = np.linspace(0.0, 2.0 * np.pi, points, endpoint=False)
    ring = np.cos(turn)[:, None] * u + np.sin(turn)[:, None] * v
    half = 0.5 * sketch.length
    end = sketch.center_W + side * half * sketch.direction_W
    near = sketch.center_W + sketch.radius * ring
    far = end + (sketch.radius + half * np.tan(sketch.angle)) * ring
    return np.vstack([near, far])


def helix_along(bar: Array, turns: int = 3, points: int = 73) -> Array:
    """Points (points, 3) of a thread about a bar (3,) centred at zero; its pitch says nothing."""
    u, v = normal_basis(bar / np.linalg.norm(bar))
    along = np.linspace(-0.5, 0.5, points)
    turn = 2.0 * np.pi * turns * along
    ring = np.cos(turn)[:, None] * u + np.sin(turn)[:, None] * v
    return np.asarray(along[:, None] * bar + HELIX_RADIUS * ring)


def draw_joint(axes: Axes, joint: JointBelief, body: BodyMotion | None, camera: Camera) -> bool:
    """Draws a joint into a camera image; says whether its middle is in there."""
    sketch = sketch_joint(joint, body)
    if sketch is None:
        return False
    color = JOINT[sketch.type]
    for side in (1.0, -1.0):
        outline = _hull(camera.project(uncertainty_outline(sketch, side)))
        if outline is not None:
            axes.add_patch(Polygon(outline, facecolor=color, alpha=0.33, lw=0))
    half = 0.5 * sketch.length * sketch.direction_W
    ends = camera.project(np.array([sketch.center_W - half, sketch.center_W + half]))
    if not np.all(np.isfinite(ends)):
        return False
    outline_effect = [path_effects.withStroke(linewidth=6.5, foreground="white")]
    axes.plot(*ends.T, color=color, lw=4.5, solid_capstyle="butt", path_effects=outline_effect)
    if sketch.type == JointType.SCREW:
        thread = sketch.center_W + helix_along(sketch.length * sketch.direction_W)
        axes.plot(*camera.project(thread).T, color=color, lw=2.0)
    if sketch.type == JointType.PRISMATIC:
        axes.annotate(
            "",
            xy=tuple(ends[1] + 0.12 * (ends[1] - ends[0])),
            xytext=tuple(ends[1]),
            arrowprops={
                "arrowstyle": "-|>,head_width=0.45,head_length=0.6",
                "color": color,
                "lw": 3,
            },
        )
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    u, v = ends.mean(axis=0)
    return bool(left <= u <= right and min(top, bottom) <= v <= max(top, bottom))


def _hull(points: Array) -> Array | None:
    finite = points[np.all(np.isfinite(points), axis=1)]
    try:
        return finite[ConvexHull(finite).vertices]
    except (QhullError, ValueError):
        return None
