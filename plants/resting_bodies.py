"""Free bodies that rest cost nothing: they are locked, and freed again before anything meets them.

Contact between bodies that rest takes most of the time of a scene with many of them. A locked body
has no degrees of freedom, and no contact with what is locked or fixed. One always stays free.
Whatever a robot or a moving body may soon meet is free, and so is all that touches it, directly or
through others: what lies on it, leans against it or bears it moves as if nothing had been locked.

This is a matter of the simulation alone: who measures and who controls knows nothing of it.
"""

from collections.abc import Sequence

import numpy as np
from pydrake.geometry import (
    CollisionFilterDeclaration,
    FilterId,
    FrameId,
    GeometrySet,
    Role,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, RigidBody
from pydrake.systems.framework import Context
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from crossmodal.maths.arrays import Array, Mask

_PERIOD = 0.02  # Between two looks, [s].
_ACCELERATION = 20.0  # Of a robot that starts, and of what falls, at most, [m/s²].
# What moves by less in this time rests. A fall begins as exp(t sqrt(g / h)), so that of a body of
# 10 cm grows 150-fold in it. Friction that is simulated creeps by up to a fifth of this in a heap.
_TIME, _MOTION = 0.5, 1e-3  # [s], [m]
_CREEP = 1e-4  # By which one that alone is free may creep before another one is, [m].
_TOUCHING = 1e-3  # Largest distance of bodies that may press on each other, [m].


class RestingBodies:
    """Locks free bodies while they rest, and frees them before they are met.

    It looks at them at the first step and every 20 ms. Until the next look a point with the speed v
    goes no farther than v T + a T² / 2; bodies that are nearer to each other may meet.

    What it knows is kept outside the Context, so one serves one simulation.

    Args:
        plant: The simulated one, finalized.
        scene_graph: Its geometry.
        bodies: Free ones, which are at rest at first.

    Attributes:
        locked: Which of the bodies (N,) are locked now.
    """

    def __init__(
        self, plant: MultibodyPlant, scene_graph: SceneGraph, bodies: Sequence[RigidBody]
    ) -> None:
        count = len(bodies)
        self.locked: Mask = np.zeros(count, bool)
        self._plant, self._scene_graph, self._bodies = plant, scene_graph, tuple(bodies)
        fixed = {body.index() for body in plant.GetBodiesWeldedTo(plant.world_body())}
        self._fixed = [plant.GetBodyFrameIdOrThrow(index) for index in fixed]
        # Ours first, then what moves by itself.
        ours = [body.index() for body in bodies]
        everything = map(BodyIndex, range(plant.num_bodies()))
        others = [index for index in everything if index not in {*ours, *fixed}]
        self._moving = [plant.get_body(index) for index in [*ours, *others]]
        frames = [plant.GetBodyFrameIdOrThrow(body.index()) for body in self._moving]
        self._frames, self._index = frames[:count], {frame: k for k, frame in enumerate(frames)}
        inspector = scene_graph.model_inspector()
        self._shapes = [
            inspector.NumGeometriesForFrameWithRole(frame, Role.kProximity)
            for frame in self._frames
        ]
        self._radii = np.array([_radius(scene_graph, frame) for frame in frames])
        self._touching = np.zeros((count, count), bool)
        self._filter: FilterId | None = None
        # Since when, and where, each has not moved.
        self._since, self._at = np.full(count, -np.inf), list[RigidTransform]()
        self._next = -np.inf
        # Which one alone was free last, from where, and which have crept then.
        self._alone, self._from = -1, RigidTransform()
        self._creeps = np.zeros(count, bool)

    def after_step(self, root: Context) -> None:
        """Locks what rests and frees what may be met. A monitor of the simulation.

        Args:
            root: Context of the whole Diagram, as it is between two steps.
        """
        time, count = root.get_time(), len(self._bodies)
        if time < self._next or count == 0:
            return
        self._next = time + _PERIOD
        context = self._plant.GetMyContextFromRoot(root)
        poses = [body.EvalPoseInWorld(context) for body in self._bodies]
        speeds = self._speeds(context)
        self._at = self._at or poses
        for k, X_WB in enumerate(poses):
            if self._moved(k, self._at[k], X_WB) > _MOTION:
                self._at[k], self._since[k] = X_WB, time
        # Contact makes speeds flicker: what counts is how far that leads.
        moves = (self._since > time - _TIME) | (speeds[:count] > _MOTION / _PERIOD)
        disturbed = self._met(root, speeds, moves) | moves
        _, group = connected_components(csr_array(self._touching), directed=False)
        awake = np.isin(group, group[disturbed])
        # The solver's tolerance is relative to the momenta. With arms at rest that bear no weight
        # there would be none at all, and it would not converge. The cheapest one is free, then.
        if not awake.any():
            awake[self._cheapest(poses)] = True
        self._lock(root, ~awake)

    def _moved(self, k: int, X: RigidTransform, Y: RigidTransform) -> float:
        """How far no point of a body has gone from one pose to another, [m]."""
        change = X.inverse() @ Y
        turn = abs(change.rotation().ToAngleAxis().angle())
        return float(np.linalg.norm(change.translation()) + turn * self._radii[k])

    def _cheapest(self, poses: Sequence[RigidTransform]) -> int:
        """The body that costs least while it is free: fewest touch it, it has fewest shapes.

        One that has crept so comes last, until all have.
        """
        k = self._alone
        if k >= 0 and self._moved(k, self._from, poses[k]) > _CREEP:
            self._creeps[k] = True
        if self._creeps.all():
            self._creeps[:] = False
        last, touching = -np.arange(len(self._bodies)), self._touching.sum(axis=0)
        chosen = int(np.lexsort([last, self._shapes, touching, self._creeps])[0])
        if chosen != k:
            self._alone, self._from = chosen, poses[chosen]
        return chosen

    def _speeds(self, context: Context) -> Array:
        """Largest speeds of the points of each moving body, ours first, [m/s]."""
        V = [body.EvalSpatialVelocityInWorld(context) for body in self._moving]
        translational = np.array([np.linalg.norm(v.translational()) for v in V])
        return translational + self._radii * [np.linalg.norm(v.rotational()) for v in V]

    def _met(self, root: Context, speeds: Array, moves: Mask) -> Mask:
        """Which of ours what moves may meet until the next look; updates what touches what."""
        count = len(self._bodies)
        moves = np.append(moves, np.ones(len(speeds) - count, bool))
        ways, least = _PERIOD * speeds, 0.5 * _ACCELERATION * _PERIOD**2
        query = self._scene_graph.get_query_output_port().Eval(
            self._scene_graph.GetMyContextFromRoot(root)
        )
        inspector = query.inspector()
        self._touching &= np.outer(self.locked, self.locked)  # These do not see each other.
        met = np.zeros(len(speeds), bool)
        farthest = np.partition(ways, -2)[-2:].sum() + least
        for pair in query.ComputeSignedDistancePairwiseClosestPoints(farthest):
            i, j = (self._index.get(inspector.GetFrameId(id), -1) for id in (pair.id_A, pair.id_B))
            if min(i, j) < 0:
                continue
            if pair.distance < ways[i] + ways[j] + least:
                met[i] |= moves[j]
                met[j] |= moves[i]
            if max(i, j) < count and pair.distance < _TOUCHING:
                self._touching[i, j] = self._touching[j, i] = True
        return met[:count]

    def _lock(self, root: Context, locked: Mask) -> None:
        """Locks these, and no others."""
        if np.array_equal(locked, self.locked):
            return
        context = self._plant.GetMyMutableContextFromRoot(root)
        for k in np.flatnonzero(locked != self.locked):
            body = self._bodies[k]
            body.Lock(context) if locked[k] else body.Unlock(context)
        self.locked = locked
        filters = self._scene_graph.collision_filter_manager(
            self._scene_graph.GetMyMutableContextFromRoot(root)
        )
        if self._filter is not None:
            filters.RemoveDeclaration(self._filter)
        alike = GeometrySet([*self._fixed, *(self._frames[k] for k in np.flatnonzero(locked))])
        self._filter = filters.ApplyTransient(CollisionFilterDeclaration().ExcludeWithin(alike))


def _radius(scene_graph: SceneGraph, frame: FrameId) -> float:
    """Of the ball around a body's origin that holds its shapes, [m]."""
    inspector = scene_graph.model_inspector()
    farthest = 0.0
    for geometry in inspector.GetGeometries(frame, Role.kProximity):
        box, X_BG = inspector.GetObbInGeometryFrame(geometry), inspector.GetPoseInFrame(geometry)
        middle = (X_BG @ box.pose()).translation()
        farthest = max(farthest, float(np.linalg.norm(middle) + np.linalg.norm(box.half_width())))
    return farthest
