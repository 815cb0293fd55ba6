"""Scenes of goods and of unknown shapes with looks by lot, for the training of networks.

Each scene is one short drop: things start upright, on a side or in any way, just above those under
them, and fall for less than a second, so that some still roll. That takes a tenth of the time of
`dense_clutter`, whose scenes are at rest.
"""

from collections.abc import Mapping, Sequence
from colorsys import hsv_to_rgb, rgb_to_hsv

import numpy as np
from pydrake.geometry import (
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    GeometryId,
    LightParameter,
    MakeRenderEngineVtk,
    PerceptionProperties,
    QueryObject,
    RenderEngineVtkParams,
    Rgba,
    Role,
    SceneGraph,
    Shape,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    CoulombFriction,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import RigidBody, SpatialInertia, UnitInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from crossmodal.maths.arrays import Array
from crossmodal.maths.convex import steady_directions
from crossmodal.models import SDF_DIR
from crossmodal.plants.goods.dense_clutter import mesh_vertices
from crossmodal.plants.goods.goods_scene import GOODS_DIR
from crossmodal.plants.parsing import add_model, make_parser

# Renderers as in a station: what only the first one shows is transparent.
COLOUR, DEPTH = "colour", "depth"

_PLANT = MultibodyPlantConfig(
    time_step=0.005,
    contact_model="point",
    discrete_contact_approximation="lagged",
    stiction_tolerance=1e-2,
)
_FALL = 0.7  # How long things fall, [s].
_GAP = 0.005  # Above what is under them as they start, [m].
_SPREAD = 0.04, 0.14  # Standard deviation of the places where things are dropped, [m].
_SHAPE_SIZE = 0.015, 0.12  # Edges and diameters of parts of unknown shapes, [m].
_DENSITY = 400.0  # Of unknown shapes, [kg/m³].
_PLAIN = 0.7  # Share of white tables, as in the paper.
# How far the colours of goods are from those of their models: hue, saturation, value.
_COLOUR_SPREAD = 0.015, 0.10, 0.10


class VariedScene:
    """Things on a table as they are and as they look, by lot.

    Frames: W is on the table's top in its middle, z up; O is an object's.

    Attributes:
        classes: What each body's label in a rendered image stands for, by the label: the name of
            the goods, empty for an unknown shape.

    Args:
        names: Of goods, each as often as it is to be there.
        shapes: How many unknown shapes there are beside them.
        rng: By which all is drawn.
        poses: X_WO of the goods, where they are at rest; without them, all is dropped.
    """

    def __init__(
        self,
        names: Sequence[str],
        shapes: int,
        rng: np.random.Generator,
        poses: Mapping[str, RigidTransform] | None = None,
    ) -> None:
        builder = DiagramBuilder()
        plant: MultibodyPlant
        scene_graph: SceneGraph
        plant, scene_graph = AddMultibodyPlant(_PLANT, builder)
        parser = make_parser(plant)
        table = add_model(parser, SDF_DIR / "work_table.sdf", "table")
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("table", table))
        bodies, corners, self.classes = [], [], {}
        for k, name in enumerate(names):
            model = add_model(parser, GOODS_DIR / name / f"{name}.sdf", f"{name} {k}")
            bodies.append(plant.get_body(plant.GetBodyIndices(model)[0]))
            corners.append(mesh_vertices(name))
        for k in range(shapes):
            body, points = _add_shape(plant, f"shape {k}", rng)
            bodies.append(body)
            corners.append(points)
        plant.Finalize()
        for body, name in zip(bodies, [*names, *[""] * shapes], strict=True):
            self.classes[int(body.index())] = name
        self.world = scene_graph.world_frame_id()
        _paint(plant, scene_graph, bodies[: len(names)], rng)
        diagram = builder.Build()
        self._context = diagram.CreateDefaultContext()
        self._scene_graph = scene_graph
        context = scene_graph.GetMyMutableContextFromRoot(self._context)
        params = _light(rng)
        for renderer in (COLOUR, DEPTH):  # Before any pose is read.
            scene_graph.AddRenderer(context, renderer, MakeRenderEngineVtk(params))
        starts = [poses[name] for name in names] if poses else _starts(bodies, corners, rng)
        plant_context = plant.GetMyMutableContextFromRoot(self._context)
        for body, X_WO in zip(bodies, starts, strict=True):
            plant.SetFloatingBaseBodyPoseInWorldFrame(plant_context, body, X_WO)
        if poses is None:
            Simulator(diagram, self._context).AdvanceTo(_FALL)

    def query(self) -> QueryObject:
        """Renders what there is."""
        return self._scene_graph.get_query_output_port().Eval(
            self._scene_graph.GetMyContextFromRoot(self._context)
        )


def _add_shape(
    plant: MultibodyPlant, name: str, rng: np.random.Generator
) -> tuple[RigidBody, Array]:
    """Adds a body of one or two primitives; returns it and corners (K, 3) around it, [m]."""
    size = rng.uniform(*_SHAPE_SIZE, size=3)
    mass = _DENSITY * float(size.prod())
    inertia = SpatialInertia(mass, np.zeros(3), UnitInertia.SolidBox(*size))
    body = plant.AddRigidBody(name, plant.AddModelInstance(name), inertia)
    colour = [*hsv_to_rgb(*rng.uniform([0.0, 0.0, 0.05], 1.0)), 1.0]
    corners = []
    for k in range(rng.integers(1, 3)):
        centre = 0.5 * k * size * rng.choice([-1.0, 1.0], 3)
        a, b, c = size if k == 0 else rng.uniform(0.4, 1.0, 3) * size
        shapes: list[Shape] = [
            Box(a, b, c),
            Cylinder(0.5 * a, c),
            Ellipsoid(0.5 * a, 0.5 * b, 0.5 * c),
            Capsule(0.5 * a, c),
        ]
        shape = shapes[rng.integers(len(shapes))]
        X_BG = RigidTransform(centre)
        plant.RegisterVisualGeometry(body, X_BG, shape, f"{name} {k}", colour)
        plant.RegisterCollisionGeometry(
            body, X_BG, shape, f"{name} {k} touched", CoulombFriction(0.5, 0.5)
        )
        half = 0.5 * np.array([a, max(a, b), c + a * isinstance(shape, Capsule)])
        signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
        corners.append(centre + half * signs)
    return body, np.concatenate(corners)


def _paint(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    goods: Sequence[RigidBody],
    rng: np.random.Generator,
) -> None:
    """Gives goods and table colours by lot; how each of them is rendered stays."""
    inspector = scene_graph.model_inspector()

    def visuals(body: RigidBody) -> list[GeometryId]:
        frame = plant.GetBodyFrameIdOrThrow(body.index())
        return inspector.GetGeometries(frame, Role.kPerception)

    def paint(geometry: GeometryId, rgb: Array) -> None:
        properties = PerceptionProperties(inspector.GetPerceptionProperties(geometry))
        alpha = properties.GetProperty("phong", "diffuse").a()
        properties.UpdateProperty("phong", "diffuse", Rgba(*np.clip(rgb, 0.0, 1.0), alpha))
        # Drake replaces no perception properties.
        scene_graph.RemoveRole(plant.get_source_id(), geometry, Role.kPerception)
        scene_graph.AssignRole(plant.get_source_id(), geometry, properties)

    for body in goods:
        for geometry in visuals(body):
            rgba = inspector.GetPerceptionProperties(geometry).GetProperty("phong", "diffuse")
            hsv = rgb_to_hsv(rgba.r(), rgba.g(), rgba.b()) + rng.normal(0.0, _COLOUR_SPREAD)
            paint(geometry, np.array(hsv_to_rgb(hsv[0] % 1.0, *np.clip(hsv[1:], 0.0, 1.0))))
    white = rng.uniform(0.7, 1.0) + rng.uniform(-0.04, 0.04, 3)
    top = (
        white
        if rng.random() < _PLAIN
        else np.array(hsv_to_rgb(*rng.uniform([0.0, 0.0, 0.1], [1.0, 0.7, 1.0])))
    )
    for geometry in visuals(plant.GetBodyByName("table")):
        paint(geometry, top)


def _light(rng: np.random.Generator) -> RenderEngineVtkParams:
    """A ceiling light, a window and a lamp at the camera, from anywhere and as strong as may be."""
    lights = [
        LightParameter(
            type="directional",
            direction=[*rng.uniform(-spread, spread, 2), -1.0],
            intensity=rng.uniform(least, most),
            frame="world",
        )
        for spread, least, most in ((0.8, 0.4, 1.2), (4.0, 0.0, 0.7))
    ]
    lamp = LightParameter(
        type="directional",
        direction=[0.0, 0.0, 1.0],
        intensity=rng.uniform(0.0, 1.1),
        frame="camera",
    )
    return RenderEngineVtkParams(
        default_clear_color=rng.uniform(0.2, 1.0, 3), lights=[*lights, lamp]
    )


def _starts(
    bodies: Sequence[RigidBody], corners: Sequence[Array], rng: np.random.Generator
) -> list[RigidTransform]:
    """X_WO at which things start to fall, in an order by lot, each above those under it."""
    spread = rng.uniform(*_SPREAD)
    starts = {}
    below: list[tuple[Array, float, float]] = []  # Middle, radius and top of what is there.
    for k in rng.permutation(len(bodies)):
        R_WO = _turned(bodies[k], corners[k], rng)
        turned = corners[k] @ R_WO.matrix().T
        lowest, highest = turned.min(axis=0), turned.max(axis=0)
        middle, radius = rng.normal(scale=spread, size=2), 0.35 * np.ptp(turned[:, :2])
        under = [top for p, r, top in below if np.linalg.norm(p - middle) < r + radius]
        z = max(under, default=0.0) + _GAP
        shift = [*(middle - 0.5 * (lowest + highest)[:2]), z - lowest[2]]
        starts[int(k)] = RigidTransform(R_WO, shift)
        below.append((middle, radius, z + highest[2] - lowest[2]))
    return [starts[k] for k in range(len(bodies))]


def _turned(body: RigidBody, corners: Array, rng: np.random.Generator) -> RotationMatrix:
    """Upright, on a side on which it stays, or in any way, each as often."""
    ups = [[0.0, 0.0, 1.0]], steady_directions(ConvexHull(corners), body.default_com())
    ways = rng.integers(3)
    if ways == 2 or len(ups[ways]) == 0:
        return RotationMatrix(Rotation.from_quat(rng.normal(size=4)).as_matrix())
    up = ups[ways][rng.integers(len(ups[ways]))]
    R_up = Rotation.align_vectors([[0.0, 0.0, 1.0]], [up])[0]
    turn = Rotation.from_rotvec([0.0, 0.0, rng.uniform(-np.pi, np.pi)])
    return RotationMatrix((turn * R_up).as_matrix())
