"""Motions of one arm that collide with nothing that is known to stand around it."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from itertools import combinations, count

import numpy as np
from pydrake.common import Parallelism
from pydrake.geometry import Convex
from pydrake.math import RigidTransform
from pydrake.planning import RobotDiagram, SceneGraphCollisionChecker

from crossmodal.controllers.arm.inverse_kinematics import all_inverse_kinematics
from crossmodal.controllers.arm.kinematics import ArmModel
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import check, number

_OBSTACLE = "obstacle"
_LINE_STEP = 0.01  # Between postures along a straight line, [m].
_LINE_ERROR = 1e-5  # Of the end-effector's pose at each of them, [rad] and [m].
_NEWTON_STEPS = 10
_LARGEST_TURN = 0.35  # Of a joint from one of these postures to the next, [rad].


@dataclass(kw_only=True)
class MotionPlannerConfig:
    """How paths are sought."""

    # Least distance from what stands around.
    clearance: float = number(0.01, at_least=0.0, at_most=0.5, unit="m")
    # Largest step of a joint between two postures that are checked.
    step: float = number(0.05, above=0.0, at_most=1.0, unit="rad")
    # Length of a branch of the search trees.
    branch: float = number(0.4, above=0.0, at_most=10.0, unit="rad")
    branches: int = number(500, at_least=1, at_most=1000000)  # After which it is given up.
    # Postures that are drawn, from which inverse kinematics starts beside those given.
    restarts: int = number(10, at_least=0, at_most=10000)
    # How far these postures are from the given ones, 1 sigma of each joint.
    spread: float = number(0.8, above=0.0, at_most=10.0, unit="rad")
    shortcuts: int = number(60, at_least=0, at_most=100000)  # That are tried on a path.


def box_vertices(edges: Array, X_WB: RigidTransform) -> Array:
    """The corners (8, 3) in W of a box, as an obstacle, [m].

    Args:
        edges: Of the box (3,), [m].
        X_WB: Of its middle.
    """
    signs = np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3), axis=-1).reshape(-1, 3)
    return np.asarray((X_WB @ (signs * edges).T).T)


class MotionPlanner:
    """Plans for one arm in what a robot knows of its surroundings.

    Args:
        arm: The robot's own model of the arm alone.
        scene: What stands around, and the robot in it; its other joints are set by `look_at`.
        robot: Names of the robot's model instances in the scene, the arm's first.
        config: Of the search.

    Raises:
        ValueError: for an impossible config value.
    """

    def __init__(
        self,
        arm: ArmModel,
        scene: RobotDiagram,
        robot: Sequence[str],
        config: MotionPlannerConfig | None = None,
    ) -> None:
        self._config = config or MotionPlannerConfig()
        check(self._config, "MotionPlanner")
        self._arm, self._plant = arm, scene.plant()
        plant = self._plant
        instances = [plant.GetModelInstanceByName(name) for name in robot]
        joints = [plant.get_joint(i) for i in plant.GetJointIndices(instances[0])]
        starts = [joint.position_start() for joint in joints if joint.num_positions() == 1]
        self._ours = np.array(sorted(starts))
        self._lower = arm.plant.GetPositionLowerLimits()
        self._upper = arm.plant.GetPositionUpperLimits()
        self._world = plant.world_body()
        self._checker = SceneGraphCollisionChecker(
            model=scene,
            robot_model_instances=instances,
            edge_step_size=self._config.step,
            env_collision_padding=self._config.clearance,
            implicit_context_parallelism=Parallelism(1),
        )
        welded = plant.GetBodiesWeldedTo(self._world)
        # The world, in which obstacles are, and what stands still in it.
        self._still = [int(b.index()) for b in welded if not self._checker.IsPartOfRobot(b)]
        self._hand = [int(b) for hand in instances[1:] for b in plant.GetBodyIndices(hand)]
        for hand in instances[1:]:  # Its parts may touch each other: the fingers of a closed hand.
            for a, b in combinations(plant.GetBodyIndices(hand), 2):
                if not self._checker.IsCollisionFilteredBetween(a, b):
                    self._checker.SetCollisionFilteredBetween(a, b, True)
        self._q = plant.GetPositions(plant.CreateDefaultContext())
        self._around, self._names = dict[bytes, str](), count()

    def look_at(
        self,
        others: Mapping[str, Array],
        obstacles: Sequence[Array] = (),
        clearance: float | None = None,
    ) -> None:
        """Takes over how other models stand, and what else is in the way.

        Shapes that were there before stay: to add one takes longer than to look for a collision.

        Args:
            others: Joint positions by the names of their models.
            obstacles: Vertices (N, 3) in W of each convex body, [m]; see `box_vertices`.
            clearance: Least distance from all that, instead of the configured one, [m].
        """
        padding = self._config.clearance if clearance is None else clearance
        self._checker.SetPaddingAllRobotEnvironmentPairs(padding)
        for name, q in others.items():
            self._plant.SetPositionsInArray(self._plant.GetModelInstanceByName(name), q, self._q)
        wanted = {vertices.tobytes(): vertices for vertices in obstacles}
        for key in [key for key in self._around if key not in wanted]:
            self._checker.RemoveAllAddedCollisionShapes(self._around.pop(key))
        for key, vertices in wanted.items():
            if key not in self._around:
                group = f"{_OBSTACLE} {next(self._names)}"
                shape = Convex(vertices.T, group)
                self._checker.AddCollisionShapeToBody(
                    group, self._world, shape, RigidTransform.Identity()
                )
                self._around[key] = group

    def is_free(self, q: Array) -> bool:
        """Whether the arm at `q` (n,) is within its limits and collides with nothing."""
        inside = bool(np.all(q >= self._lower) and np.all(q <= self._upper))
        return inside and self._checker.CheckConfigCollisionFree(self._in_scene(q))

    def posture(self, X_WE: RigidTransform, guesses: Sequence[Array]) -> Array | None:
        """A free posture (n,) that puts E there, near one of the guesses; None if there is none."""
        return next(filter(self.is_free, self.postures(X_WE, guesses)), None)

    def postures(self, X_WE: RigidTransform, guesses: Sequence[Array]) -> Iterator[Array]:
        """Postures (n,) that put E there, whether they are free or not.

        They are sought near the guesses, then in other places around the first of them.
        """
        config, arm = self._config, self._arm.plant
        return all_inverse_kinematics(arm, X_WE, guesses, config.restarts, config.spread)

    def line(
        self, q_start: Array, direction: Array, length: float, hand_is_free: bool = False
    ) -> Array:
        """Postures (K, n) along a straight line of E, which keeps its orientation.

        It ends where the arm would leave its limits or hit something.

        Args:
            q_start: Where it begins (n,), [rad].
            direction: Unit vector (3,) in W.
            length: Of the line, [m].
            hand_is_free: Whether the way of the hand was checked before, so that only the arm may
                hit something.
        """
        with self._without_hand() if hand_is_free else nullcontext():
            return self._line(q_start, direction, length)

    @contextmanager
    def _without_hand(self) -> Iterator[None]:
        """The hand hits nothing that stands still, as a table."""
        filtered = np.array(self._checker.GetFilteredCollisionMatrix())  # It is a view.
        without = filtered.copy()
        without[np.ix_(self._hand, self._still)] = without[np.ix_(self._still, self._hand)] = 1
        self._checker.SetCollisionFilterMatrix(without)
        try:
            yield
        finally:
            self._checker.SetCollisionFilterMatrix(filtered)

    def _line(self, q_start: Array, direction: Array, length: float) -> Array:
        q, still = q_start, np.zeros(len(q_start))
        X = self._arm.Evaluate(np.append(q, still)).X_WE.copy()
        postures, steps = [q], max(int(np.ceil(length / _LINE_STEP)), 1)
        for _ in range(steps):
            X[:3, 3] += length / steps * direction
            found = self._nearby(X, q)
            if found is None or np.abs(found - q).max() > _LARGEST_TURN or not self.is_free(found):
                break
            q = found
            postures.append(q)
        return np.array(postures)

    def length(self, line: Array) -> float:
        """How far E moves from the first to the last posture of a line (K, n), [m]."""
        ends = [
            self._arm.Evaluate(np.append(q, np.zeros_like(q))).X_WE[:3, 3] for q in line[[0, -1]]
        ]
        return float(np.linalg.norm(ends[1] - ends[0]))

    def _nearby(self, X_WE: Array, q: Array) -> Array | None:
        """The posture near `q` that puts E at `X_WE`, by Newton's method."""
        for _ in range(_NEWTON_STEPS):
            state = self._arm.Evaluate(np.append(q, np.zeros(len(q))))
            error = se3.log(se3.inverse(state.X_WE) @ X_WE)
            if np.abs(error).max() < _LINE_ERROR:
                return q
            q = q + np.linalg.lstsq(state.J_E, error, rcond=1e-3)[0]
        return None

    def path(self, q_start: Array, q_goal: Array, rng: np.random.Generator) -> Array | None:
        """Postures (K, n) of a free path of straight segments; None if none was found.

        Two trees grow towards each other from start and goal (RRT-Connect; Kuffner and LaValle,
        2000), then corners are cut.

        Args:
            q_start: Where it begins (n,), [rad].
            q_goal: Where it ends (n,), [rad].
            rng: Of the postures that the trees grow towards.
        """
        if not (self.is_free(q_start) and self.is_free(q_goal)):
            return None
        if self._edge(q_start, q_goal):
            return np.array([q_start, q_goal])
        config = self._config
        trees = [([q_start], [-1]), ([q_goal], [-1])]
        reach = np.minimum(self._upper, np.pi), np.maximum(self._lower, -np.pi)
        for number_of in range(config.branches):
            growing, other = trees[number_of % 2], trees[1 - number_of % 2]
            new = self._grow(growing, rng.uniform(reach[1], reach[0]))
            if new is None:
                continue
            while True:  # The other tree grows towards the new posture as far as it gets.
                met = self._grow(other, new)
                if met is None:
                    break
                if np.array_equal(met, new):
                    halves = [_branch(trees[0]), _branch(trees[1])]
                    path = [*halves[0][::-1], *halves[1][1:]]
                    return self._shortened(path, rng)
        return None

    def _grow(self, tree: tuple[list[Array], list[int]], towards: Array) -> Array | None:
        """Adds a branch from the nearest posture of a tree and returns its end."""
        postures, parents = tree
        nearest = int(np.argmin(np.linalg.norm(np.array(postures) - towards, axis=1)))
        step = towards - postures[nearest]
        length = float(np.linalg.norm(step))
        if length == 0.0:
            return None
        far = length > self._config.branch
        new = postures[nearest] + step * (self._config.branch / length) if far else towards
        if not self._edge(postures[nearest], new):
            return None
        postures.append(new)
        parents.append(nearest)
        return new

    def _shortened(self, path: list[Array], rng: np.random.Generator) -> Array:
        for _ in range(self._config.shortcuts):
            if len(path) < 3:
                break
            i, j = sorted(rng.choice(len(path), 2, replace=False))
            if j > i + 1 and self._edge(path[i], path[j]):
                path = [*path[: i + 1], *path[j:]]
        return np.array(path)

    def _edge(self, q0: Array, q1: Array) -> bool:
        return self._checker.CheckEdgeCollisionFree(self._in_scene(q0), self._in_scene(q1))

    def _in_scene(self, q: Array) -> Array:
        whole = self._q.copy()
        whole[self._ours] = q
        return whole


def _branch(tree: tuple[list[Array], list[int]]) -> list[Array]:
    """The postures from the last one that was added to the tree's root."""
    postures, parents = tree
    at, found = len(postures) - 1, []
    while at >= 0:
        found.append(postures[at])
        at = parents[at]
    return found
