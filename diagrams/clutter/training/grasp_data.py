"""Scenes of objects on a table, what a depth camera sees of them, and how they can be grasped.

Objects are put down one by one: each is lowered onto the table and what lies there already, until
it touches. What would rest in another way in the end looks much the same, and a thousand scenes
take minutes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from crossmodal.diagrams.clutter.training.grasp_labels import find_grasps
from crossmodal.diagrams.clutter.training.rasterise import rasterise
from crossmodal.diagrams.clutter.training.shapes import Shape, draw_shapes
from crossmodal.maths.arrays import Array, Ids
from crossmodal.maths.pinhole import Intrinsics
from crossmodal.systems.grasping.height_map import (
    CELL,
    CELLS,
    HeightMap,
    height_map,
    seen_points,
)
from crossmodal.systems.sensors.depth_noise import (
    DepthNoiseConfig,
    correlated_noise,
    measure_depth,
    returns,
)
from crossmodal.systems.sensors.randomness import make_generator

_CANDIDATES = 400  # Places and angles of grasps that are tried on an object.
_UPRIGHT = 0.4  # Share of objects that stand as they are modelled, if they can.
_MOST = 7  # Objects in a scene.
_ALONE = 0.3  # Share of scenes with one object.
_SPREAD = 0.1  # Standard deviation of the objects' places, [m].
_TRIES = 4  # Places for an object: where it comes to lie lowest, it stays.
_LEANING = np.deg2rad(40.0)  # Largest tilt of what lies on others.
_GROUND = 256  # Cells along each edge on which objects are lowered.
_VISIBLE = 0.3  # Share of an object that is seen, for a view of it.
_FEWEST = 150  # Pixels that show it, likewise.
# Of the camera: distance from the middle of the scene, tilt from above, focal length.
_DISTANCES, _TILTS, _FOCAL_LENGTHS = (0.6, 0.95), (0.0, np.deg2rad(25.0)), (540.0, 620.0)
_THROUGH_GLASS = (0.0, 0.3, 1.0)
_TABLE_ERROR = 0.0015  # Standard deviation of the table's believed height, [m].


@dataclass(frozen=True, kw_only=True)
class Body:
    """A shape where it lies.

    Attributes:
        shape: What it is.
        corners: Of its triangles (T, 3, 3), in W, whose origin is on the table, [m].
        p_WCm: Its centre of mass (3,), [m].
        X_WO: Its pose (4, 4).
    """

    shape: Shape
    corners: Array
    p_WCm: Array
    X_WO: Array


@dataclass(frozen=True, kw_only=True)
class Sample:
    """A view of an object, and how it can be grasped.

    Attributes:
        name: Of the goods, empty for others.
        alone: Whether it is the only object.
        view: What is seen.
        grasps: That hold, whatever lies around it (N, 5), see `grasp_geometry`.
        liking: How well each is liked (N,).
        body: The object.
        heights: Its true heights on the cells of the view, [m].
        others: Those of the others, [m].
    """

    name: str
    alone: bool
    view: HeightMap
    grasps: Array
    liking: Array
    body: Body
    heights: Array
    others: Array


def body_at(shape: Shape, X_WO: Array) -> Body:
    """A shape at a pose (4, 4)."""
    R, p = X_WO[:3, :3], X_WO[:3, 3]
    return Body(shape=shape, corners=shape.corners @ R.T + p, p_WCm=R @ shape.p_OCm + p, X_WO=X_WO)


def true_heights(bodies: Sequence[Body], corner: Array, cells: int = CELLS) -> Array:
    """Heights (cells, cells) of bodies seen straight from above, zero where none is, [m]."""
    if not bodies:
        return np.zeros((cells, cells))
    corners = np.concatenate([body.corners for body in bodies])
    corners[..., :2] = (corners[..., :2] - corner) / CELL
    heights, _ = rasterise(corners, np.zeros(len(corners), int), cells, cells)
    return np.maximum(heights, 0.0)


def standing(shape: Shape, rng: np.random.Generator) -> Rotation:
    """A rotation of a shape with which it stands or lies on the table."""
    upright = int(np.argmax(shape.ups[:, 2]))
    up = shape.ups[upright if rng.random() < _UPRIGHT else rng.integers(len(shape.ups))]
    steady, _ = Rotation.align_vectors([[0.0, 0.0, 1.0]], [up])
    return Rotation.from_rotvec([0.0, 0.0, rng.uniform(-np.pi, np.pi)]) * steady


def draw_scene(rng: np.random.Generator) -> list[Body]:
    """Objects on a table about the origin of W."""
    count = 1 if rng.random() < _ALONE else int(rng.integers(2, _MOST + 1))
    bodies: list[Body] = []
    for shape in draw_shapes(count, rng):
        turned = standing(shape, rng)
        spread = _SPREAD if count > 1 else 0.0
        tries = [lowered(shape, turned, spread * rng.normal(size=2), bodies) for _ in range(_TRIES)]
        body = min(tries, key=_top)
        if body.corners[..., 2].min() > 1e-3:  # On others it may lie as it likes.
            azimuth = rng.uniform(-np.pi, np.pi)
            lean = rng.uniform(0.0, _LEANING) * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
            tilted = Rotation.from_rotvec(lean) * turned
            body = lowered(shape, tilted, body.p_WCm[:2], bodies)
        bodies.append(body)
    return bodies


def _top(body: Body) -> float:
    """Height of its highest corner, [m]."""
    return float(body.corners[..., 2].max())


def lowered(shape: Shape, turned: Rotation, xy: Array, bodies: Sequence[Body]) -> Body:
    """A shape with its centre of mass over a place, lowered until it touches."""
    X_WO = np.eye(4)
    X_WO[:3, :3] = turned.as_matrix()
    X_WO[:2, 3] = xy - X_WO[:2, :3] @ shape.p_OCm
    body = body_at(shape, X_WO)
    corner = xy - 0.5 * (_GROUND - 1) * CELL
    below = body.corners * [1.0, 1.0, -1.0]
    below[..., :2] = (below[..., :2] - corner) / CELL
    underside, _ = rasterise(below, np.zeros(len(below), int), _GROUND, _GROUND)
    lift = (true_heights(bodies, corner, _GROUND) + underside).max()
    X_WO[2, 3] = max(lift, -body.corners[..., 2].min())
    return body_at(shape, X_WO)


def draw_camera(rng: np.random.Generator) -> tuple[Intrinsics, Array]:
    """A camera that looks about at the origin from above: intrinsics and X_WC (4, 4)."""
    tilt, azimuth = rng.uniform(*_TILTS), rng.uniform(-np.pi, np.pi)
    turn = Rotation.from_euler("ZYZ", [azimuth, tilt, rng.uniform(-np.pi, np.pi)]).as_matrix()
    X_WC = np.eye(4)
    X_WC[:3, :3] = turn * [1.0, -1.0, -1.0]
    middle = [*rng.normal(size=2) * 0.02, 0.0]
    X_WC[:3, 3] = middle - rng.uniform(*_DISTANCES) * X_WC[:3, 2]
    focal = float(rng.uniform(*_FOCAL_LENGTHS))
    return Intrinsics(
        width=640, height=480, focal_x=focal, focal_y=focal, center_x=319.5, center_y=239.5
    ), X_WC


def ideal_depth(bodies: Sequence[Body], intrinsics: Intrinsics, X_WC: Array) -> tuple[Array, Ids]:
    """Depth (H, W) of bodies on an endless table, [m], and whose pixel it is, -1 for the table."""
    R, p = X_WC[:3, :3], X_WC[:3, 3]
    u, v = np.meshgrid(np.arange(intrinsics.width), np.arange(intrinsics.height))
    focal_x, focal_y, center_x, center_y = intrinsics.vector()
    down = (u - center_x) / focal_x * R[2, 0] + (v - center_y) / focal_y * R[2, 1] + R[2, 2]
    table = np.where(down < -1e-3, p[2] / np.maximum(-down, 1e-3), np.inf)
    if not bodies:
        return table, np.full(table.shape, -1)
    seen = np.concatenate([(body.corners - p) @ R for body in bodies])
    owners = np.repeat(np.arange(len(bodies)), [len(body.corners) for body in bodies])
    pixels = intrinsics.project(seen.reshape(-1, 3)).reshape(-1, 3, 2)
    inverse, owner = rasterise(
        np.concatenate([pixels, 1.0 / seen[..., 2:]], axis=-1),
        owners,
        intrinsics.height,
        intrinsics.width,
    )
    depth = np.where(owner >= 0, 1.0 / np.where(owner >= 0, inverse, 1.0), table)
    return depth, owner


def measured_depth(
    bodies: Sequence[Body], intrinsics: Intrinsics, X_WC: Array, rng: np.random.Generator
) -> tuple[Array, Ids]:
    """Depth (H, W) as a camera with faults measures it, zero where it does not, and the masks.

    What lies behind glass returns in patches, if at all; masks are off by a pixel or two.
    """
    config = DepthNoiseConfig(
        sigma_base=float(rng.uniform(0.5e-3, 2e-3)),
        grazing_angle=float(rng.uniform(1.2, 1.5)),
        baseline=float(rng.uniform(0.03, 0.09)),
    )
    surface, labels = ideal_depth(bodies, intrinsics, X_WC)
    is_glass = np.array([body.shape.is_glass for body in bodies])
    ideal = surface
    if is_glass.any():
        solid = [body for body in bodies if not body.shape.is_glass]
        ideal, _ = ideal_depth(solid, intrinsics, X_WC)
    k = intrinsics.vector()
    valid = returns(
        ideal.astype(np.float32),
        (float(k[0]), float(k[1]), float(k[2]), float(k[3])),
        (config.range_min, config.range_max),
        config.baseline,
        float(np.cos(config.grazing_angle)),
    )
    behind = surface < ideal - 1e-3
    if behind.any():
        patches = correlated_noise(rng, ideal.shape, config.correlation_window)
        share = rng.choice(_THROUGH_GLASS)
        valid &= ~behind | (patches < np.quantile(patches, share))
        ideal = np.where(behind, ideal + config.glass_delay, ideal)
    noise = correlated_noise(rng, ideal.shape, config.correlation_window)
    depth = measure_depth(
        ideal.astype(np.float32),
        valid,
        noise,
        config.depth_step,
        config.sigma_base,
        config.sigma_square,
    )
    return depth.astype(float), _spoilt(labels, rng)


def _spoilt(labels: Ids, rng: np.random.Generator) -> Ids:
    """Labels (H, W) whose borders are shifted, and moved in- or outwards."""
    shift = np.roll(labels, rng.integers(-1, 2, size=2), axis=(0, 1))
    size = int(rng.integers(0, 3))
    change = cv2.erode if rng.random() < 0.5 else cv2.dilate
    return np.asarray(change(shift.astype(np.int16), np.ones((2 * size + 1,) * 2)).astype(np.int64))


def observe(bodies: Sequence[Body], rng: np.random.Generator) -> list[Sample]:
    """The views of all objects of a scene that are seen well enough."""
    intrinsics, X_WC = draw_camera(rng)
    depth, labels = measured_depth(bodies, intrinsics, X_WC, rng)
    table = float(_TABLE_ERROR * rng.normal())
    points = seen_points(depth, labels, intrinsics, X_WC, table)
    found = []
    for label, body in enumerate(bodies):
        seen = int((labels == label).sum())
        alone = (ideal_depth([body], intrinsics, X_WC)[1] == 0).sum()
        if seen < max(_FEWEST, _VISIBLE * alone):
            continue
        view = height_map(points, label)
        true = true_heights([body], view.corner)
        grasps, liking = find_grasps(
            body.shape, body.corners, body.p_WCm, view, true, _CANDIDATES, rng
        )
        others = [other for other in bodies if other is not body]
        found.append(
            Sample(
                name=body.shape.name,
                alone=len(bodies) == 1,
                view=view,
                grasps=grasps,
                liking=liking,
                body=body,
                heights=true,
                others=true_heights(others, view.corner),
            )
        )
    return found


def draw_samples(seed: int, scene: int) -> list[Sample]:
    """What is seen of a scene."""
    rng = make_generator(seed, "grasp scene", scene)
    return observe(draw_scene(rng), rng)
