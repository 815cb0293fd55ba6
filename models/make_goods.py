"""Makes the twelve objects on the table: `python -m crossmodal.models.make_goods`.

Each is a union of convex parts. The union is what cameras see and what pose estimators know, the
parts are what touches it in the simulation, so that both have the same surface. A glass is hollow:
its bowl is a ring of staves. It needs `manifold3d`, which joins the parts to one watertight mesh.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import trimesh
from trimesh import Trimesh
from trimesh.creation import box, capsule, cylinder, revolve

from crossmodal.maths.arrays import Array
from crossmodal.models import SDF_DIR

GOODS_DIR = SDF_DIR / "goods"
_ROUND = 48  # Corners of a circle.
_STAVES = 24  # Of a hollow one.
# Of contact, [s/m]. In steps of 5 ms stiffer goods with Drake's 50 s/m chatter for ever where they
# stand, light ones with 100 mm/s; with more, what lies in a heap creeps faster.
_DISSIPATION = 100.0


@dataclass(kw_only=True)
class Goods:
    """One object; its frame has z upwards and its origin in the middle of what it stands on.

    Attributes:
        parts: Convex, of one density.
        mass: [kg].
        color: (R, G, B, A), 0 to 1.
        friction: Coulomb's coefficient.
        transparent: Whether a depth camera looks through it.
        modulus: Of hydroelastic contact, [Pa]; a sponge is soft.
        bodies: What the union is made of, the parts if None: staves have faces in common.
    """

    parts: Sequence[Trimesh]
    mass: float
    color: tuple[float, float, float, float]
    friction: float = 0.5
    transparent: bool = False
    modulus: float = 1e6
    bodies: Sequence[Trimesh] | None = None
    mesh: Trimesh = field(init=False)

    def __post_init__(self) -> None:
        joined = trimesh.boolean.union(self.bodies or self.parts, engine="manifold")
        joined.merge_vertices()
        if not joined.is_watertight:
            raise ValueError("the parts do not make a watertight union")
        self.mesh = joined


def lathe(profile: Sequence[tuple[float, float]], flat: float = 1.0) -> list[Trimesh]:
    """Convex parts of a body of revolution, one between every two heights.

    Args:
        profile: (radius, height) from below, [m].
        flat: Its width along y over that along x.
    """
    angle = np.linspace(0.0, 2.0 * np.pi, _ROUND, endpoint=False)
    circle = np.column_stack([np.cos(angle), flat * np.sin(angle)])

    def ring(radius: float, height: float) -> Array:
        return np.column_stack([radius * circle, np.full(_ROUND, height)])

    pairs = itertools.pairwise(profile)
    return [hull(np.concatenate([ring(*low), ring(*high)])) for low, high in pairs]


def hull(points: Array) -> Trimesh:
    """The convex hull of points (N, 3)."""
    return trimesh.convex.convex_hull(points)


def block(size: Sequence[float], centre: Sequence[float]) -> Trimesh:
    """A box of a size (3,) about a centre (3,), [m]."""
    made = box(extents=size)
    made.apply_translation(centre)
    return made


def rod(radius: float, start: Sequence[float], end: Sequence[float]) -> Trimesh:
    """A cylinder between two points (3,), [m]."""
    return cylinder(radius=radius, segment=np.array([start, end]), sections=24)


def slab(outline: Sequence[tuple[float, float]], width: float) -> Trimesh:
    """A convex outline (x, z) with a width along y, [m]."""
    points = np.array(outline)
    sides = [
        np.column_stack([points[:, 0], np.full(len(points), y), points[:, 1]])
        for y in (-0.5 * width, 0.5 * width)
    ]
    return hull(np.concatenate(sides))


def bowl(profile: Sequence[tuple[float, float, float]]) -> list[Trimesh]:
    """A hollow body of revolution: (inner radius, outer radius, height) from below, [m]."""
    step, parts = 2.0 * np.pi / _STAVES, []
    for low, high in itertools.pairwise(profile):
        for k in range(_STAVES):
            corners = [
                (radius * np.cos(a), radius * np.sin(a), height)
                for inner, outer, height in (low, high)
                for radius in (inner, outer)
                for a in (k * step, (k + 1) * step)
            ]
            parts.append(hull(np.array(corners)))
    return parts


def oil() -> Goods:
    """A bottle of olive oil: a body of revolution."""
    profile = [
        (0.034, 0.0),
        (0.037, 0.004),
        (0.037, 0.18),
        (0.030, 0.205),
        (0.017, 0.228),
        (0.014, 0.24),
        (0.014, 0.272),
        (0.016, 0.273),
        (0.016, 0.30),
    ]
    return Goods(parts=lathe(profile), mass=0.55, color=(0.35, 0.36, 0.10, 1.0))


def spray() -> Goods:
    """A spray bottle: an oval body, and a head with nozzle and trigger that points along x."""
    body = lathe([(0.043, 0.0), (0.046, 0.005), (0.046, 0.13), (0.034, 0.165), (0.016, 0.19)], 0.62)
    neck = lathe([(0.014, 0.185), (0.016, 0.192), (0.016, 0.212)])
    head = slab(
        [
            (-0.034, 0.208),
            (0.026, 0.208),
            (0.058, 0.232),
            (0.058, 0.252),
            (-0.012, 0.256),
            (-0.034, 0.244),
        ],
        0.027,
    )
    nozzle = rod(0.010, (0.055, 0.0, 0.242), (0.072, 0.0, 0.242))
    trigger = slab([(0.030, 0.222), (0.044, 0.228), (0.050, 0.185), (0.040, 0.180)], 0.016)
    parts = [*body, *neck, head, nozzle, trigger]
    return Goods(parts=parts, mass=0.45, color=(0.20, 0.45, 0.80, 1.0))


def cleaner() -> Goods:
    """A flat bottle with a handle at one side and its neck over the other."""
    body = slab([(-0.055, 0.0), (0.055, 0.0), (0.055, 0.13), (-0.055, 0.13)], 0.066)
    front = slab(
        [(0.0, 0.125), (0.055, 0.125), (0.050, 0.185), (0.022, 0.212), (0.0, 0.205)], 0.060
    )
    top = slab(
        [(-0.055, 0.185), (0.005, 0.196), (0.005, 0.212), (-0.040, 0.206), (-0.055, 0.20)], 0.032
    )
    handle = slab([(-0.055, 0.125), (-0.037, 0.125), (-0.037, 0.190), (-0.055, 0.190)], 0.032)
    neck = [
        rod(0.017, (0.028, 0.0, 0.205), (0.028, 0.0, 0.226)),
        rod(0.021, (0.028, 0.0, 0.225), (0.028, 0.0, 0.258)),
    ]
    parts = [body, front, top, handle, *neck]
    return Goods(parts=parts, mass=0.65, color=(0.90, 0.78, 0.18, 1.0))


def wineglass() -> Goods:
    """A wine glass of 2 mm, empty."""
    foot = lathe(
        [
            (0.036, 0.0),
            (0.036, 0.0025),
            (0.012, 0.009),
            (0.0045, 0.018),
            (0.0042, 0.085),
            (0.010, 0.093),
            (0.022, 0.101),
        ]
    )
    sides = [
        (0.020, 0.022, 0.101),
        (0.0335, 0.0355, 0.118),
        (0.0390, 0.0410, 0.142),
        (0.0375, 0.0395, 0.170),
        (0.0310, 0.0330, 0.210),
    ]
    section = [(r, z) for _, r, z in sides] + [(r, z) for r, _, z in sides[::-1]]
    ring = revolve(np.array([*section, section[0]]), sections=_STAVES)
    return Goods(
        parts=[*foot, *bowl(sides)],
        bodies=[*foot, ring],
        mass=0.16,
        color=(0.75, 0.82, 0.84, 0.28),
        transparent=True,
    )


def shampoo() -> Goods:
    """A flat oval bottle with a cap."""
    body = lathe([(0.033, 0.0), (0.036, 0.006), (0.036, 0.14), (0.028, 0.16)], 0.55)
    cap = lathe([(0.020, 0.158), (0.020, 0.192), (0.018, 0.195)], 0.8)
    return Goods(parts=[*body, *cap], mass=0.30, color=(0.85, 0.35, 0.55, 1.0))


def transparent_box() -> Goods:
    """An open box of 3 mm."""
    x, y, z, wall = 0.15, 0.11, 0.08, 0.003
    parts = [block((x, y, wall), (0.0, 0.0, 0.5 * wall))]
    for side in (-0.5, 0.5):
        parts.append(block((x, wall, z), (0.0, side * (y - wall), 0.5 * z)))
        parts.append(block((wall, y, z), (side * (x - wall), 0.0, 0.5 * z)))
    return Goods(parts=parts, mass=0.14, color=(0.8, 0.85, 0.88, 0.25), transparent=True)


def sponge() -> Goods:
    """A kitchen sponge."""
    part = block((0.11, 0.07, 0.035), (0.0, 0.0, 0.0175))
    return Goods(parts=[part], mass=0.03, color=(0.95, 0.85, 0.25, 1.0), friction=0.8, modulus=2e5)


def can() -> Goods:
    """A can of 0.33 l."""
    parts = lathe([(0.026, 0.0), (0.033, 0.008), (0.033, 0.106), (0.027, 0.115)])
    return Goods(parts=parts, mass=0.35, color=(0.75, 0.12, 0.12, 1.0), friction=0.4)


def black_box() -> Goods:
    """A cardboard box."""
    part = block((0.16, 0.11, 0.06), (0.0, 0.0, 0.03))
    return Goods(parts=[part], mass=0.25, color=(0.06, 0.06, 0.07, 1.0))


def screwdriver() -> Goods:
    """A screwdriver along x that lies on its handle."""
    handle = capsule(height=0.075, radius=0.0145, count=[12, 20])
    handle.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0]))
    handle.apply_translation([-0.045, 0.0, 0.0145] - handle.bounds.mean(axis=0))
    shaft = rod(0.0035, (-0.01, 0.0, 0.0145), (0.105, 0.0, 0.0145))
    return Goods(parts=[handle, shaft], mass=0.10, color=(0.90, 0.45, 0.08, 1.0))


def duster() -> Goods:
    """A hand brush along x: a handle and a head with bristles, taken for one body."""
    head = block((0.13, 0.045, 0.018), (0.065, 0.0, 0.049))
    bristles = block((0.125, 0.040, 0.042), (0.065, 0.0, 0.021))
    handle = slab([(-0.14, 0.030), (0.005, 0.040), (0.005, 0.058), (-0.14, 0.046)], 0.024)
    parts = [head, bristles, handle]
    return Goods(parts=parts, mass=0.12, color=(0.25, 0.55, 0.30, 1.0), friction=0.6)


def marker() -> Goods:
    """A marker along x."""
    barrel = rod(0.0085, (-0.065, 0.0, 0.0085), (0.035, 0.0, 0.0085))
    cap = rod(0.0095, (0.03, 0.0, 0.0085), (0.072, 0.0, 0.0085))
    return Goods(parts=[barrel, cap], mass=0.025, color=(0.10, 0.10, 0.45, 1.0))


GOODS: dict[str, Callable[[], Goods]] = {
    make.__name__: make
    for make in (
        oil,
        spray,
        cleaner,
        wineglass,
        shampoo,
        transparent_box,
        sponge,
        can,
        black_box,
        screwdriver,
        duster,
        marker,
    )
}


def sdf(name: str, goods: Goods) -> str:
    """The model file of an object whose meshes lie beside it."""
    mesh = goods.mesh.copy()
    mesh.density = goods.mass / mesh.volume
    moment, c = mesh.moment_inertia, mesh.center_mass
    inertia = "".join(
        f"<i{'xyz'[i]}{'xyz'[j]}>{moment[i, j]:.4e}</i{'xyz'[i]}{'xyz'[j]}>"
        for i in range(3)
        for j in range(i, 3)
    )
    renderer = "<drake:accepting_renderer>colour</drake:accepting_renderer>" * goods.transparent
    color = " ".join(f"{x:g}" for x in goods.color)
    properties = (
        "<drake:proximity_properties><drake:compliant_hydroelastic/>"
        f"<drake:hydroelastic_modulus>{goods.modulus:g}</drake:hydroelastic_modulus>"
        f"<drake:hunt_crossley_dissipation>{_DISSIPATION:g}</drake:hunt_crossley_dissipation>"
        f"<drake:mu_static>{goods.friction:g}</drake:mu_static>"
        f"<drake:mu_dynamic>{goods.friction:g}</drake:mu_dynamic></drake:proximity_properties>"
    )
    collisions = "\n".join(
        f'      <collision name="part_{k}"><geometry><mesh><uri>{name}_{k}.obj</uri>'
        f"<drake:declare_convex/></mesh></geometry>{properties}</collision>"
        for k in range(len(goods.parts))
    )
    return f"""<?xml version="1.0"?>
<!-- Made by crossmodal.models.make_goods. -->
<sdf version="1.9" xmlns:drake="drake.mit.edu">
  <model name="{name}">
    <link name="{name}">
      <inertial>
        <pose>{c[0]:.5f} {c[1]:.5f} {c[2]:.5f} 0 0 0</pose>
        <mass>{goods.mass:g}</mass>
        <inertia>{inertia}</inertia>
      </inertial>
      <visual name="{name}">
        <geometry><mesh><uri>{name}.obj</uri></mesh></geometry>
        <material><diffuse>{color}</diffuse></material>{renderer}
      </visual>
{collisions}
    </link>
  </model>
</sdf>
"""


def write(folder: Path, name: str, goods: Goods) -> None:
    """Writes the union, its parts and the model file into a folder of the object's own."""
    folder = folder / name
    folder.mkdir(parents=True, exist_ok=True)
    meshes = {name: goods.mesh} | {f"{name}_{k}": part for k, part in enumerate(goods.parts)}
    for stem, mesh in meshes.items():
        text = mesh.export(
            file_type="obj",
            include_normals=stem == name,
            include_color=False,
            digits=6,
            header=None,
        )
        (folder / f"{stem}.obj").write_text(text, encoding="utf-8")
    (folder / f"{name}.sdf").write_text(sdf(name, goods), encoding="utf-8")


if __name__ == "__main__":
    for name, make in GOODS.items():
        write(GOODS_DIR, name, make())
