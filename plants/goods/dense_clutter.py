"""Dense clutter around a target, by a seed: objects dropped on a table and left to come to rest."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import trimesh
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.tree import RigidBody
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from crossmodal.maths.arrays import Array
from crossmodal.maths.convex import steady_directions
from crossmodal.maths.validation import check, number
from crossmodal.plants.goods.goods_scene import GOODS_DIR, GoodsScene

# Of the target as it is put down.
_STEADY = np.deg2rad(3.0)  # By which it may be tilted and does not topple.
_LYING = 0.5  # Largest cosine between its z and the vertical while it lies.
# Of the others as they fall.
_GAP = 0.01  # Between one object and the next above it as they start, [m].
# How far from what lies, and from what stands, they are dropped, as shares of `spread`: what is
# dropped on a standing target becomes a tower.
_ON, _BESIDE = (0.0, 0.4), (0.6, 1.0)
_PULL = 10.0  # Inwards, acceleration, [m/s²].
_NEAR = 0.02  # From which on the pull grows weaker, [m].
# Slow enough that nothing passes through a thin wall between two steps, [1/s].
_DRAG_FALLING, _DRAG_SETTLING = 15.0, 5.0
# Of what rests.
_CHECK = 0.25  # Between two looks, [s].
_ARM = 0.05  # From an object's origin to the points whose motion is judged, [m].
_NEAR_REST, _REST = 2e-2, 5e-4  # Largest mean speeds between two looks, in haste and not, [m/s].
_LAST = 0.5  # How long not in haste, [s].
# Of a scene that is accepted.
_TARGET_MOVED = 0.05  # Largest motion of the target after it is let go, [m].
_TARGET_TILTED = 0.2  # Largest change of the cosine between its z and the vertical.
_BELOW = 0.01  # So far below the table's top an object fell off, [m].
# Largest depths by which objects may be in each other, before they rest and when they do, [m].
_IMPALED, _DEEP = 1e-2, 4e-3


class ClutterError(RuntimeError):
    """No scene came to rest as it should."""


@dataclass(kw_only=True)
class ClutterConfig:
    """How dense clutter comes about."""

    # Objects beside the target.
    count: int = number(8, at_least=0, at_most=11)
    # Probability that the target is laid down; else it stands upright.
    laid_down: float = number(0.5, at_least=0.0, at_most=1.0)
    # From points of the target the others are dropped at most this far away.
    spread: float = number(0.06, at_least=0.0, at_most=0.3, unit="m")
    # How long they are pulled towards the target, which is held meanwhile.
    pulled: float = number(2.5, at_least=0.0, at_most=10.0, unit="s")
    # How long they may take to come to rest when all is free.
    settling: float = number(6.0, above=0.0, at_most=60.0, unit="s")
    # Farthest from the scene's middle that an object's origin may come to rest.
    reach: float = number(0.35, above=0.0, at_most=0.6, unit="m")
    # Scenes that are tried. Where much rolls, most scatter.
    tries: int = number(8, at_least=1, at_most=1000)


def names_in_clutter(
    config: ClutterConfig, target: str, others: Sequence[str], seed: int
) -> list[str]:
    """Names of the objects in the clutter of a seed, the target first; see `make_dense_clutter`."""
    return _drawn_names(config, target, others, np.random.default_rng(seed))


def make_dense_clutter(
    config: ClutterConfig, target: str, others: Sequence[str], p_WMiddle: Array, seed: int
) -> dict[str, RigidTransform]:
    """Poses X_WO at which a target and what lies around and on it are at rest on a table.

    Args:
        config: Of the clutter.
        target: One of models/sdf/goods.
        others: Such names; the seed draws `config.count` of them.
        p_WMiddle: Middle of the scene on the table's top (3,), [m].
        seed: The same seed gives the same poses, on one machine.

    Returns:
        By name, the target first.

    Raises:
        ValueError: for an impossible configuration, too few others, a name that is not known or is
            there twice, and a target that is to be laid down and has no side to lie on.
        ClutterError: if each of a bounded number of scenes moved too long or too far.
    """
    check(config, "ClutterConfig")
    if len(others) < config.count:
        raise ValueError(
            f"ClutterConfig: count = {config.count}, but there are {len(others)} others"
        )
    rng = np.random.default_rng(seed)
    names = _drawn_names(config, target, others, rng)
    X_WT = _target_pose(GoodsScene([target], p_WMiddle), target, config, rng)
    fault = ""
    for _ in range(config.tries):
        scene = GoodsScene(names, p_WMiddle, hasty=True)
        fault, poses = _drop(scene, target, X_WT, config, rng)
        if not fault:
            return poses
    raise ClutterError(
        f"clutter around '{target}' with seed {seed}: in {config.tries} tries no scene came to rest"
        f" as it should; the last one {fault}"
    )


def _drawn_names(
    config: ClutterConfig, target: str, others: Sequence[str], rng: np.random.Generator
) -> list[str]:
    return [target, *(str(name) for name in rng.permutation(others)[: config.count])]


def _target_pose(
    scene: GoodsScene, target: str, config: ClutterConfig, rng: np.random.Generator
) -> RigidTransform:
    """X_WO of the target on the table, upright or on a side that is drawn."""
    vertices = mesh_vertices(target)
    up, lies = np.array([0.0, 0.0, 1.0]), rng.random() < config.laid_down
    turn, roll = rng.uniform(-np.pi, np.pi, size=2)
    if lies:
        steady = steady_directions(
            ConvexHull(vertices), scene.bodies[target].default_com(), _STEADY
        )
        sides = steady[np.abs(steady[:, 2]) < _LYING]
        if len(sides) == 0:
            raise ValueError(f"'{target}' does not lie on any side")
        up = sides[np.argmax(sides @ [np.cos(roll), np.sin(roll), 0.0])]
    R_up = Rotation.align_vectors([[0.0, 0.0, 1.0]], [up])[0]
    R_WO = RotationMatrix((Rotation.from_rotvec([0.0, 0.0, turn]) * R_up).as_matrix())
    corners = vertices @ R_WO.matrix().T
    lowest, highest = corners.min(axis=0), corners.max(axis=0)
    shift = [*(-0.5 * (lowest + highest)[:2]), -lowest[2]]
    return RigidTransform(R_WO, scene.p_WTable + shift)


@cache
def mesh_vertices(name: str) -> Array:
    """Of the mesh of one of models/sdf/goods (V, 3), in O, [m]."""
    mesh = trimesh.load(str(GOODS_DIR / name / f"{name}.obj"), force="mesh")
    return np.asarray(mesh.vertices, dtype=float)


def _drop(
    scene: GoodsScene,
    target: str,
    X_WT: RigidTransform,
    config: ClutterConfig,
    rng: np.random.Generator,
) -> tuple[str, dict[str, RigidTransform]]:
    """Drops all but the target and waits until all rest: what is wrong, if anything, and X_WO."""
    names = [name for name in scene.bodies if name != target]
    above = X_WT.multiply(mesh_vertices(target).T).T
    count = len(names)
    inside = [rng.dirichlet(np.ones(3)) @ rng.choice(above, 3) for _ in names]
    # Their directions are spread evenly, or they would pile up to a tower.
    angles = 2.0 * np.pi * (np.arange(count) + rng.uniform(size=count)) / max(count, 1)
    beside = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(count)])
    lies = abs(X_WT.rotation().matrix()[2, 2]) < _LYING
    away = config.spread * rng.uniform(*(_ON if lies else _BESIDE), size=(count, 1))
    aims = np.reshape(inside, (count, 3)) + away * beside
    starts, top = {target: X_WT}, above[:, 2].max()
    for index in rng.permutation(count):
        R_WO = RotationMatrix(Rotation.from_quat(rng.normal(size=4)).as_matrix())
        heights = mesh_vertices(names[index]) @ R_WO.matrix()[2]
        z = top + _GAP - heights.min()
        starts[names[index]] = RigidTransform(R_WO, [*aims[index, :2], z])
        top = z + heights.max()
    scene.place(starts)
    _fall(scene, target, aims, config.pulled)
    at_work, speed = GoodsScene(list(scene.bodies), scene.p_WTable), np.inf
    end = config.pulled + config.settling
    while (
        speed > _REST
        and scene.context.get_time() < end
        and not _fault(scene, target, X_WT, config.reach, _IMPALED)
    ):
        speed = _settle(scene, end - scene.context.get_time(), _NEAR_REST)
        if speed <= _NEAR_REST:
            at_work.place(scene.poses())
            speed = _settle(at_work, _LAST, _REST)
            scene.place(at_work.poses())
    fault = _fault(scene, target, X_WT, config.reach, _DEEP)
    if not fault and speed > _REST:
        fault = f"still moved at {1e3 * speed:.2g} mm/s"
    return fault, scene.poses()


def _fall(scene: GoodsScene, target: str, aims: Array, seconds: float) -> None:
    """Lets all but the target fall and pulls it inwards; then lets go of the target, too."""
    pulled = [body for name, body in scene.bodies.items() if name != target]
    force = scene.plant.get_applied_generalized_force_input_port()
    scene.bodies[target].Lock(scene.plant_context)
    scene.damp(_DRAG_FALLING)
    while scene.context.get_time() < seconds:
        force.FixValue(scene.plant_context, _pull(scene, pulled, aims))
        scene.advance(scene.plant.time_step())
    force.FixValue(scene.plant_context, np.zeros(scene.plant.num_velocities()))
    scene.bodies[target].Unlock(scene.plant_context)
    scene.damp(_DRAG_SETTLING)


def _settle(scene: GoodsScene, seconds: float, rest: float) -> float:
    """Simulates until all are as slow as that, at most so long; the fastest's mean speed, [m/s]."""
    before, speed, end = scene.poses(), np.inf, scene.context.get_time() + seconds
    while speed > rest and scene.context.get_time() < end:
        scene.advance(_CHECK)
        speed, before = _moved(before, scene.poses()) / _CHECK, scene.poses()
    return speed


def _pull(scene: GoodsScene, bodies: Sequence[RigidBody], aims: Array) -> Array:
    """Generalized forces (nv,) that pull bodies towards the verticals through their aims (N, 3)."""
    context, forces = scene.plant_context, np.zeros(scene.plant.num_velocities())
    for body, p_WAim in zip(bodies, aims, strict=True):
        X_WB = body.EvalPoseInWorld(context)
        to_aim = (p_WAim - X_WB.translation()) * [1.0, 1.0, 0.0]
        pull = _PULL * to_aim / max(float(np.linalg.norm(to_aim)), _NEAR)
        f_W = body.default_mass() * pull
        start = body.floating_velocities_start_in_v()
        forces[start : start + 3] = np.cross(X_WB.rotation() @ body.default_com(), f_W)
        forces[start + 3 : start + 6] = f_W
    return forces


def _fault(
    scene: GoodsScene, target: str, X_WT: RigidTransform, reach: float, deepest: float
) -> str:
    """What is wrong with a scene in which the target was put at X_WT; empty if nothing is."""
    poses = scene.poses()
    away = [X_WO.translation() - scene.p_WTable for X_WO in poses.values()]
    far = max(float(np.linalg.norm(p[:2])) for p in away)
    if far > reach or min(p[2] for p in away) < -_BELOW:
        return f"had an object {far:.2g} m from its middle"
    shifted = float(np.linalg.norm(poses[target].translation() - X_WT.translation()))
    cosine, at_first = (X.rotation().matrix()[2, 2] for X in (poses[target], X_WT))
    if shifted > _TARGET_MOVED or abs(cosine - at_first) > _TARGET_TILTED:
        return f"moved the target by {1e3 * shifted:.2g} mm"
    deep = -min(scene.distances(0.0).values(), default=0.0)
    return f"had objects {1e3 * deep:.2g} mm in each other" if deep > deepest else ""


def _moved(before: Mapping[str, RigidTransform], after: Mapping[str, RigidTransform]) -> float:
    """The largest motion between two times of a point 5 cm from an object's origin, [m]."""
    motions = [before[name].inverse() @ X_WO for name, X_WO in after.items()]
    return max(
        float(np.linalg.norm(X.translation())) + _ARM * abs(X.rotation().ToAngleAxis().angle())
        for X in motions
    )
