"""The shapes that grasps are learned from: the goods, the goods stretched, and random ones."""

from dataclasses import dataclass
from functools import cache
from xml.etree import ElementTree

import numpy as np
import trimesh
from scipy.spatial import ConvexHull

from crossmodal.maths.arrays import Array
from crossmodal.maths.convex import steady_directions
from crossmodal.plants.goods.goods_scene import GOODS_DIR

GOODS = tuple(sorted(folder.name for folder in GOODS_DIR.iterdir() if folder.is_dir()))

_TILT = np.deg2rad(3.0)  # By which an object that stands may be tilted and does not topple.
_SCALES = (0.75, 1.3)  # Of goods that are stretched, along each axis.
# Of random shapes: sizes of a part, density, friction, and the heaviest one.
_SIZES = (0.015, 0.16)  # [m]
_DENSITIES = (150.0, 900.0)  # [kg/m³]
_FRICTIONS = (0.3, 0.8)
_HEAVIEST = 1.0  # [kg]


@dataclass(frozen=True, kw_only=True)
class Shape:
    """A rigid body in its own frame O.

    Attributes:
        name: Of the goods, empty for others.
        corners: Of its triangles (T, 3, 3), counterclockwise from outside, [m]; parts may overlap.
        p_OCm: Centre of mass (3,), [m].
        mass: [kg]
        friction: Coulomb's coefficient.
        is_glass: Whether a depth camera looks through it.
        ups: Directions (S, 3) that point up while it stands on the table.
    """

    name: str
    corners: Array
    p_OCm: Array
    mass: float
    friction: float
    is_glass: bool
    ups: Array


@cache
def goods(name: str) -> Shape:
    """One of models/sdf/goods."""
    mesh = trimesh.load(str(GOODS_DIR / name / f"{name}.obj"), force="mesh")
    text = (GOODS_DIR / name / f"{name}.sdf").read_text(encoding="utf-8")
    link = ElementTree.fromstring(text).find("model/link")
    assert link is not None
    spaces = {"drake": "drake.mit.edu"}
    mass, pose = link.findtext("inertial/mass"), link.findtext("inertial/pose")
    friction = link.findtext(".//drake:mu_static", namespaces=spaces)
    assert mass is not None
    assert pose is not None
    assert friction is not None
    return make_shape(
        name,
        np.asarray(mesh.triangles, dtype=float),
        np.array(pose.split()[:3], dtype=float),
        float(mass),
        float(friction),
        link.find(".//drake:accepting_renderer", spaces) is not None,
    )


def stretched(shape: Shape, rng: np.random.Generator) -> Shape:
    """The same, longer or shorter along its axes, of the same density."""
    scale = rng.uniform(*_SCALES, size=3)
    return make_shape(
        "",
        shape.corners * scale,
        shape.p_OCm * scale,
        min(shape.mass * float(np.prod(scale)), _HEAVIEST),
        shape.friction,
        shape.is_glass,
    )


def random_shape(rng: np.random.Generator) -> Shape:
    """One to three boxes and bodies of revolution, each with its middle in the last one."""
    parts: list[trimesh.Trimesh] = []
    for _ in range(rng.integers(1, 4)):
        part = _random_part(rng)
        if parts:
            first, second = rng.choice(parts[-1].vertices, 2)
            part.apply_translation(0.5 * (first + second))
        parts.append(part)
    volumes = np.array([part.volume for part in parts])
    density = _between(_DENSITIES, rng, 1)[0]
    return make_shape(
        "",
        np.concatenate([np.asarray(part.triangles) for part in parts]),
        volumes @ [part.center_mass for part in parts] / volumes.sum(),
        min(density * float(volumes.sum()), _HEAVIEST),
        float(rng.uniform(*_FRICTIONS)),
        False,
    )


def _random_part(rng: np.random.Generator) -> trimesh.Trimesh:
    """A box or a body of revolution with a kink about the origin, turned to one of the axes."""
    size = _between(_SIZES, rng, 3)
    if rng.random() < 0.5:
        part = trimesh.creation.box(extents=size)
    else:
        radii = 0.5 * size[0] * np.array([rng.uniform(0.5, 1.0), 1.0, rng.uniform(0.3, 1.0)])
        z = size[2] * np.array([-0.5, rng.uniform(-0.4, 0.4), 0.5])
        angle = np.linspace(0.0, 2.0 * np.pi, 32, endpoint=False)
        circle = np.column_stack([np.cos(angle), np.sin(angle) * rng.uniform(0.6, 1.0)])
        rings = [
            np.column_stack([r * circle, np.full(32, h)]) for r, h in zip(radii, z, strict=True)
        ]
        part = trimesh.convex.convex_hull(np.concatenate(rings))
    axes = np.eye(3)[rng.permutation(3)]
    turn = np.eye(4)
    turn[:3, :3] = axes * [1.0, 1.0, np.linalg.det(axes)]
    part.apply_transform(turn)
    return part


def _between(ends: tuple[float, float], rng: np.random.Generator, count: int) -> Array:
    """Numbers (count,) whose logarithms are spread evenly."""
    low, high = ends
    return np.asarray(low * (high / low) ** rng.uniform(size=count))


def make_shape(
    name: str, corners: Array, p_OCm: Array, mass: float, friction: float, is_glass: bool
) -> Shape:
    """With the directions in which it stands."""
    hull = ConvexHull(corners.reshape(-1, 3))
    ups = steady_directions(hull, p_OCm, _TILT)
    if len(ups) == 0:  # It rolls: on what it lies longest.
        ups = steady_directions(hull, p_OCm)
    return Shape(
        name=name,
        corners=np.ascontiguousarray(corners),
        p_OCm=p_OCm,
        mass=mass,
        friction=friction,
        is_glass=is_glass,
        ups=ups,
    )


def draw_shapes(count: int, rng: np.random.Generator) -> list[Shape]:
    """Goods, each once at most, and others, about as many of each kind."""
    names = iter(rng.permutation(GOODS).tolist())
    found = []
    for kind in rng.random(size=count):
        if kind < 0.5:
            found.append(goods(next(names)))
        elif kind < 0.7:
            found.append(stretched(goods(str(rng.choice(GOODS))), rng))
        else:
            found.append(random_shape(rng))
    return found
