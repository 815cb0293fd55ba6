"""A camera that is knocked out of its place, through the ports, on synthetic features."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.framework import Diagram, DiagramBuilder
from scipy.stats import chi2

from crossmodal.maths import se3
from crossmodal.maths.pinhole import Intrinsics
from crossmodal.systems.port_values import FeatureBelief, PoseBelief
from crossmodal.systems.vision.bodies.rigid_body_motion import RigidBodyMotion
from crossmodal.systems.vision.bodies.rigid_body_motion_config import (
    BodyDynamicsConfig,
    RigidBodyMotionConfig,
)
from crossmodal.systems.vision.camera.camera_jump import fit_displacement
from crossmodal.systems.vision.camera.camera_motion import CameraMotion, CameraMotionConfig

X_WS = se3.looking_at(np.array([-0.2, 0.1, 1.0]), np.array([1.0, 0.0, 0.5]))
PERIOD, ONSET = 1.0 / 15.0, 30  # Of the ticks, [s]; tick at which the body starts to move.


def knock(seed: int, degrees: float) -> np.ndarray:
    """A turn by so much about a random axis, and some millimetres; X_SC."""
    rng = np.random.default_rng([seed, 3])
    axis = rng.standard_normal(3)
    turn = np.deg2rad(degrees) * axis / np.linalg.norm(axis)
    return se3.exp(np.concatenate([turn, 2e-3 * rng.standard_normal(3)]))


class Scene:
    """Features of a room and of a drawer's front, seen with noise by a camera that may be knocked.

    Args:
        room: Count.
        front: Count; it slides from `ONSET` on.
        jumps: X_SC from a tick on.
    """

    def __init__(
        self, seed: int, *, room: int = 80, front: int = 40, jumps: dict[int, np.ndarray]
    ) -> None:
        self.rng = np.random.default_rng([seed, 5])
        self.jumps = jumps
        self.front = np.arange(room + front) >= room
        far = self.rng.uniform([0.9, -0.6, 0.0], [1.8, 0.6, 1.2], (room + front, 3))
        near = self.rng.uniform([0.95, -0.2, 0.4], [1.0, 0.2, 0.7], (room + front, 3))
        self.p_0 = np.where(self.front[:, None], near, far)

    def opening(self, k: int) -> float:
        """Of the drawer, [m]: it starts as a hand pulls, within half a second at 2 cm/s."""
        seconds = max(k - ONSET, 0) * PERIOD
        return 0.02 * (seconds**2 if seconds < 0.5 else seconds - 0.25)

    def displacement(self, k: int) -> np.ndarray:
        """X_SC at a tick."""
        begun = [tick for tick in self.jumps if tick <= k]
        return self.jumps[max(begun)] if begun else np.eye(4)

    def seen(self, k: int, believed: np.ndarray) -> FeatureBelief:
        """Features at a tick as a camera that is taken to stand at X_SC sees them."""
        shift = np.array([-self.opening(k), 0.0, 0.0])
        p_W = np.where(self.front[:, None], self.p_0 + shift, self.p_0)
        X_WC = X_WS @ self.displacement(k)
        p_C = (p_W - X_WC[:3, 3]) @ X_WC[:3, :3]
        sigma = 0.5 * (1.2e-3 + 1.9e-3 * (p_C[:, 2] - 0.4) ** 2)
        along = p_C / np.linalg.norm(p_C, axis=1)[:, None]
        C = sigma[:, None, None] ** 2 * along[:, :, None] * along[:, None, :]
        C = C + 1e-8 * np.eye(3)
        p_C = p_C + np.einsum("nij,nj->ni", np.linalg.cholesky(C), self.rng.normal(size=p_C.shape))
        X = X_WS @ believed
        rows = np.nonzero(self.rng.random(len(p_C)) > 0.03)[0]
        return FeatureBelief(
            ids=rows,
            uv=np.zeros((len(rows), 2)),
            p_WF=p_C[rows] @ X[:3, :3].T + X[:3, 3],
            covariance=(X[:3, :3] @ C @ X[:3, :3].T)[rows],
            age=np.full(len(rows), k),
        )


@pytest.fixture
def watch(camera: Intrinsics, tick: Callable) -> Callable[..., Iterator]:
    """Plays a scene; yields the tick, the diagram and its context."""

    def run(scene: Scene, count: int, config: CameraMotionConfig | None = None) -> Iterator:
        network = _network(camera, config or CameraMotionConfig())
        believed = [np.eye(4)]

        def inputs(k: int) -> dict[str, FeatureBelief]:
            return {"features_estimated": scene.seen(k, believed[0])}

        for k, context in tick(network, inputs, count):
            belief = network.GetOutputPort("camera_displacement_latest").Eval(context)
            believed[0] = belief.X
            yield k, network, context

    return run


def _network(camera: Intrinsics, config: CameraMotionConfig) -> Diagram:
    builder = DiagramBuilder()
    place = builder.AddSystem(CameraMotion(config, BodyDynamicsConfig(), X_WS))
    bodies = builder.AddSystem(RigidBodyMotion(RigidBodyMotionConfig(), camera, X_WS))
    builder.Connect(
        place.GetOutputPort("camera_displacement_estimated"),
        bodies.GetInputPort("camera_displacement"),
    )
    builder.ExportInput(place.GetInputPort("features_estimated"), "features_estimated")
    for source, target in ((place, bodies), (bodies, place)):
        name = "features_estimated" if source is place else "features_predicted"
        builder.Connect(source.GetOutputPort(name), target.GetInputPort(name))
    for name in ("camera_displacement_latest", "health_latest"):
        builder.ExportOutput(place.GetOutputPort(name), name)
    builder.ExportOutput(bodies.GetOutputPort("body_motions_latest"), "bodies")
    return builder.Build()


def fault(network: Diagram, context: object) -> str:
    return network.GetOutputPort("health_latest").Eval(context).fault


def deviation(belief: PoseBelief, true: np.ndarray) -> tuple[float, np.ndarray]:
    """NEES of a pose and its error (6,)."""
    error = se3.log(se3.inverse(belief.X) @ true)
    return float(error @ np.linalg.solve(belief.covariance, error)), error


def test_a_motion_is_fitted_as_exactly_as_it_says_beside_a_third_of_outliers() -> None:
    values = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        q = rng.uniform([0.8, -0.5, 0.2], [1.6, 0.5, 1.0], (90, 3))
        C = np.tile(np.diag([4e-6, 1e-7, 1e-7]), (90, 1, 1))
        Y = se3.exp(rng.normal(size=6) * np.repeat([0.02, 0.005], 3))
        p = q @ Y[:3, :3].T + Y[:3, 3] + rng.normal(size=(90, 3)) * np.sqrt(np.diag(C[0]))
        p[:30] = q[:30] + rng.normal(size=(30, 3)) * 0.02
        found = fit_displacement(p, q, C)
        about = np.eye(4)
        about[:3, 3] = found.centre
        left = se3.log(se3.inverse(about) @ Y @ se3.inverse(found.Y) @ about)
        values.append(left @ np.linalg.solve(found.covariance, left))
        assert np.mean(found.follows[30:]) > 0.98
        assert np.mean(found.follows[:30]) < 0.3
    low, high = chi2.ppf([1e-3, 0.999], 6 * len(values))
    assert low < np.sum(values) < 1.3 * high  # Of weights that are not one, a little more.


@pytest.mark.parametrize(  # Before the drawer moves, and while it does.
    ("when", "degrees"), [(20, 0.3), (20, 1.0), (60, 0.3), (60, 2.0)]
)
def test_a_knock_is_told_at_once_and_measured_as_well_as_is_said(
    watch: Callable, when: int, degrees: float
) -> None:
    told, inside = [], []
    for seed in range(6):
        scene = Scene(seed, jumps={when: knock(seed, degrees)})
        first, belief = None, None
        for k, network, context in watch(scene, when + 40):
            if fault(network, context) and first is None:
                first = k
            belief = network.GetOutputPort("camera_displacement_latest").Eval(context)
        told.append(first is not None and first - when <= 3)
        nees, _ = deviation(belief, scene.displacement(when))
        inside.append(nees < chi2.ppf(0.999, 6))
    assert all(told)
    assert all(inside)


@pytest.mark.parametrize("when", [20, 60])
def test_what_moves_is_followed_across_a_knock(watch: Callable, when: int) -> None:
    scene = Scene(1, jumps={when: knock(1, 1.0)})
    bodies = []
    for _, network, context in watch(scene, 110):
        bodies = network.GetOutputPort("bodies").Eval(context).bodies
        assert len(bodies) <= 1
    (body,) = bodies
    moved = body.motion.X[:3, 3] - body.X_WB_reference[:3, 3]
    np.testing.assert_allclose(moved, [-scene.opening(109), 0.0, 0.0], atol=1e-3)


@pytest.mark.parametrize(("room", "front"), [(80, 40), (20, 100), (0, 120)])
def test_what_moves_is_no_knock_even_where_it_fills_the_view(
    watch: Callable, room: int, front: int
) -> None:
    for seed in range(4):
        scene = Scene(seed, room=room, front=front, jumps={})
        for _, network, context in watch(scene, 80):
            assert not fault(network, context)


@pytest.mark.parametrize(("room", "front"), [(40, 80), (2, 118)])
@pytest.mark.parametrize("jerk", [0.008, -0.004])
def test_what_moves_and_is_jerked_is_no_knock_either(
    watch: Callable, room: int, front: int, jerk: float
) -> None:
    """A hand that slips off lets a door go that fills the view: it jumps, and stops at once."""

    class Jerked(Scene):
        def opening(self, k: int) -> float:
            return super().opening(min(k, 60)) + jerk * (k > 60)

    for seed in range(4):
        scene = Jerked(seed, room=room, front=front, jumps={})
        for _, network, context in watch(scene, 80):
            assert not fault(network, context)


def test_a_second_knock_adds_to_the_first(watch: Callable) -> None:
    first, second = knock(3, 1.0), knock(3, 1.0) @ knock(4, 0.6)
    scene = Scene(3, jumps={20: first, 50: second})
    belief = None
    for _, network, context in watch(scene, 90):
        belief = network.GetOutputPort("camera_displacement_latest").Eval(context)
    nees, error = deviation(belief, second)
    assert nees < chi2.ppf(0.999, 6)
    assert np.linalg.norm(error[:3]) < np.deg2rad(0.05)


def test_few_features_are_no_proof(watch: Callable) -> None:
    scene = Scene(0, room=8, front=0, jumps={20: knock(0, 1.0)})
    for _, network, context in watch(scene, 30):
        assert not fault(network, context)


def test_impossible_values_are_refused() -> None:
    with pytest.raises(ValueError, match="settling"):
        CameraMotion(replace(CameraMotionConfig(), settling=-1.0), BodyDynamicsConfig(), np.eye(4))
