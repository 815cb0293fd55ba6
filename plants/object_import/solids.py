"""The shapes of bodies as triangles, in a frame of one's own."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import trimesh
from pydrake.geometry import (
    Box,
    Capsule,
    Convex,
    Cylinder,
    Ellipsoid,
    GeometryId,
    HalfSpace,
    Mesh,
    SceneGraphInspector,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, RigidBody
from pydrake.systems.framework import Context

_SECTIONS = 24  # Of what is round.


def solid_of(
    plant: MultibodyPlant,
    inspector: SceneGraphInspector,
    context: Context,
    bodies: Iterable[RigidBody],
    frame: Frame,
    *,
    visual: bool = False,
) -> trimesh.Trimesh:
    """What can be touched of bodies, or seen of them, in `frame`, [m]; empty for none."""
    parts = []
    for body in bodies:
        X_FB = plant.CalcRelativeTransform(context, frame, body.body_frame())
        for geometry in shapes_of(plant, body, visual=visual):
            parts.append(shape_solid(inspector.GetShape(geometry)))
            X_FG = X_FB @ inspector.GetPoseInFrame(geometry)
            parts[-1].apply_transform(X_FG.GetAsMatrix4())
    return trimesh.util.concatenate(parts) if parts else trimesh.Trimesh()


def shapes_of(plant: MultibodyPlant, body: RigidBody, *, visual: bool) -> list[GeometryId]:
    """The visual or the collision geometries of a body."""
    if visual:
        return list(plant.GetVisualGeometriesForBody(body))
    return list(plant.GetCollisionGeometriesForBody(body))


def shape_solid(shape: Shape) -> trimesh.Trimesh:
    """A shape in its own frame, without looks; a half space is none."""
    if isinstance(shape, Mesh | Convex):
        mesh = trimesh.load_mesh(Path(shape.source().path()), process=False)
        made = trimesh.Trimesh(mesh.vertices, mesh.faces)
        made.apply_transform(np.diag([*np.asarray(shape.scale3()), 1.0]))
        return made.convex_hull if isinstance(shape, Convex) else made
    if isinstance(shape, Box):
        return trimesh.creation.box(shape.size())
    if isinstance(shape, Cylinder):
        return trimesh.creation.cylinder(shape.radius(), shape.length(), sections=_SECTIONS)
    if isinstance(shape, Capsule):
        count = [_SECTIONS, _SECTIONS]
        return trimesh.creation.capsule(shape.length(), shape.radius(), count=count)
    if isinstance(shape, Sphere | Ellipsoid):
        made = trimesh.creation.uv_sphere(1.0, count=[_SECTIONS, _SECTIONS])
        radii = (
            [shape.radius()] * 3 if isinstance(shape, Sphere) else [shape.a(), shape.b(), shape.c()]
        )
        made.apply_transform(np.diag([*radii, 1.0]))
        return made
    assert isinstance(shape, HalfSpace)
    return trimesh.Trimesh()


def bounds_overlap(first: np.ndarray, second: np.ndarray) -> float:
    """Intersection over union of two boxes (2, 3), least and largest corner."""
    shared = np.minimum(first[1], second[1]) - np.maximum(first[0], second[0])
    intersection = float(np.prod(np.maximum(shared, 0.0)))
    union = sum(float(np.prod(box[1] - box[0])) for box in (first, second)) - intersection
    return intersection / union if union > 0 else 0.0


def turned(
    inspector: SceneGraphInspector, geometry: GeometryId, X_GG: RigidTransform
) -> np.ndarray:
    """Vertices (n, 3) of a shape in its body's frame, turned about its own frame by `X_GG`."""
    solid = shape_solid(inspector.GetShape(geometry))
    solid.apply_transform((inspector.GetPoseInFrame(geometry) @ X_GG).GetAsMatrix4())
    return np.asarray(solid.vertices)
