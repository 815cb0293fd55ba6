"""Where the taxels of the two-finger gripper lie: what makes its model and what reads it agree.

Each taxel is a small sphere on the finger's core. Frame E (end_effector): z along the
approach, x along the opening, its origin in the middle of the closed fingers' ends, as far along z
as the taxels reach. The frame of a finger is parallel to E and coincides with it when closed; the
left finger opens along +x, the right one, which is the left one turned by 180 deg about z, along
-x. On each finger are

- `phalange`, 4 x 6 on the inner face, nearer the palm;
- `outer`, 4 x 6 on the outer face, at its end;
- `tip`, 2 x 3 on the end face, 8 mm apart along x and 10.5 mm along y, from edge to edge;
- `inner`, 4 x 4 on the inner face, at its end.
"""

from dataclasses import dataclass

import numpy as np

from crossmodal.maths.arrays import Array, Ids
from crossmodal.maths.immutable import Immutable

FINGERS = ("left", "right")
PARTS = ("phalange", "outer", "tip", "inner")
# Of the arrays, in the order of the taxels.
ARRAYS = tuple(f"{finger}_{part}" for finger in FINGERS for part in PARTS)

RADIUS = 0.003  # Of a taxel's sphere, [m].
STICKS_OUT = 0.0015  # By so much it sticks out of the core on the faces and sides, [m].
TIP_STICKS_OUT = 0.0045  # Likewise at the end, where taxels are further apart, [m].
PITCH = 0.0047  # Between the middles of neighbouring taxels, except those of a tip, [m].
WIDTH = 0.027  # Of a finger along y, over its taxels, [m].
THICKNESS = 0.014  # Of a finger along x, over its taxels, [m].
TRAVEL = 0.07  # Of a finger, [m].
# Edges along x and y of a rectangle that holds palm and rail, and how far above the fingers' ends
# it is, [m].
PALM = (0.17, 0.075)
PALM_ABOVE = 0.118

_PHALANGE_END = -0.050  # z of the middle of the phalange's furthest taxels, [m].
# Cosine between a face's normal and a force that presses on it, which friction inclines; at 45 deg
# two faces are pressed alike.
_FACING = float(np.sqrt(0.5))
# How far skin reaches beside a taxel: half the diagonal between those of a tip, which are furthest
# apart (6.6 mm), so that no gap is left; it is farther than to the edges of a finger, [m].
_SKIN = 0.0067
_BESIDE = 0.5 * PITCH * np.array([-3.0, -1.0, 1.0, 3.0])  # y of four columns, [m].


@dataclass(frozen=True, kw_only=True)
class GripperTaxels(Immutable):
    """The 140 taxels, 70 on each finger, array by array in the order of `ARRAYS`.

    Attributes:
        names: Of the taxels' shapes, `taxel_<array>_<n>`.
        array: Of each, its index in `ARRAYS` (140,).
        finger: Of each, its index in `FINGERS` (140,).
        p_FS: Middles of the spheres (140, 3), each in the frame of its finger, [m].
        n_F: Outward unit normals (140, 3) of the faces that they lie on, likewise.
    """

    names: tuple[str, ...]
    array: Ids
    finger: Ids
    p_FS: Array
    n_F: Array

    @property
    def p_FT(self) -> Array:
        """Where each sticks out furthest (140, 3), in the frame of its finger, [m]."""
        return self.p_FS + RADIUS * self.n_F

    @property
    def n_E(self) -> Array:
        """Outward unit normals (140, 3) in E; fingers do not turn."""
        return self.n_F

    def under(self, finger: int, p_FC: Array, f_F: Array) -> int | None:
        """The taxel that feels what presses on the skin of a finger beside the taxels.

        Skin covers the faces with taxels, also between and beside these. The nearest one feels it.

        Args:
            finger: Its index in `FINGERS`.
            p_FC: Where it acts (3,), in the frame of the finger, [m].
            f_F: The force on the finger (3,), [N].

        Returns:
            Its index; none if no taxel of the face that is pressed is near.
        """
        pressed = (-self.n_F @ f_F > _FACING * np.linalg.norm(f_F)) & (self.finger == finger)
        beside = np.linalg.norm((p_FC - self.p_FT) * (np.abs(self.n_F) < 0.5), axis=1)
        nearest = int(np.argmin(np.where(pressed, beside, np.inf)))
        return nearest if pressed[nearest] and beside[nearest] < _SKIN else None

    def p_ET(self, opening: Array) -> Array:
        """Where each sticks out furthest (140, 3), in E, [m].

        Args:
            opening: Positions (2,) of the left and of the right finger, [m].
        """
        return self.p_FT + self.finger_places(opening)[self.finger]

    @staticmethod
    def finger_places(opening: Array) -> Array:
        """Origins p_EF (2, 3) of the fingers' frames, [m].

        Args:
            opening: Positions (2,) of the left and of the right finger, [m].
        """
        left, right = opening
        return np.array([[left, 0.0, 0.0], [-right, 0.0, 0.0]])


def gripper_taxels() -> GripperTaxels:
    """The layout of the gripper in models/sdf."""
    left = _left_finger()
    about_z = np.array([-1.0, -1.0, 1.0])
    places, normals, arrays, names = [], [], [], []
    for finger, turn in zip(FINGERS, (np.ones(3), about_z), strict=True):
        for part in PARTS:
            p, n = left[part]
            name = f"{finger}_{part}"
            places.append(turn * p)
            normals.append(np.tile(turn * n, (len(p), 1)))
            arrays.append(np.full(len(p), ARRAYS.index(name)))
            names += [f"taxel_{name}_{k}" for k in range(len(p))]
    array = np.concatenate(arrays)
    return GripperTaxels(
        names=tuple(names),
        array=array,
        finger=array // len(PARTS),
        p_FS=np.concatenate(places),
        n_F=np.concatenate(normals) + 0.0,  # There is no -0.
    )


def tip_taxels() -> Ids:
    """Indices (12,) of the taxels at the ends of both fingers."""
    tips = [array for array, name in enumerate(ARRAYS) if name.endswith("tip")]
    return np.flatnonzero(np.isin(gripper_taxels().array, tips))


def _left_finger() -> dict[str, tuple[Array, Array]]:
    """Of each part the middles of its spheres (N, 3), [m], and its normal (3,)."""
    end = -RADIUS - PITCH  # z of the first row behind the tip's.
    inside, outside = RADIUS, THICKNESS - RADIUS
    edge = 0.5 * WIDTH - RADIUS
    x, _, z = np.eye(3)
    tip = _grid(np.array([inside, outside]), np.array([-edge, 0.0, edge]), np.array([-RADIUS]))
    return {
        "phalange": (_grid(np.array([inside]), _BESIDE, _rows(_PHALANGE_END, 6)), -x),
        "outer": (_grid(np.array([outside]), _BESIDE, _rows(end, 6)), x),
        "tip": (tip, z),
        "inner": (_grid(np.array([inside]), _BESIDE, _rows(end, 4)), -x),
    }


def _rows(end: float, count: int) -> Array:
    return np.array([end - PITCH * row for row in range(count)])


def _grid(x: Array, y: Array, z: Array) -> Array:
    """Points (N, 3), y fastest and z slowest."""
    zz, xx, yy = np.meshgrid(z, x, y, indexing="ij")
    return np.column_stack([xx.ravel(), yy.ravel(), zz.ravel()])
