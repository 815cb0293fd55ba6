"""The Gauss-Newton step against finite differences, and the walk against a Gaussian."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation
from targets import CORNERS, HALF, touching

from crossmodal.maths import se3
from crossmodal.systems.port_values import PosePrior
from crossmodal.systems.pose.evidence import Evidence, Table
from crossmodal.systems.pose.pose_belief import COARSE, problem_of
from crossmodal.systems.pose.pose_solver import Problem, _deepest, linearise, refine, walk
from crossmodal.systems.pose.target_model import TargetModel

FLOOR = 7e-4


def pose() -> np.ndarray:
    X = np.eye(4)
    X[:3, :3] = Rotation.from_rotvec([0.2, -0.1, 0.7]).as_matrix()
    X[:3, 3] = [0.5, -0.2, 0.3]
    return X


def on_faces(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Points well inside the faces (N, 3), and the faces' normals (N, 3), in O."""
    axes, signs = rng.integers(0, 3, count), rng.choice([-1.0, 1.0], count)
    p = rng.uniform(-0.6, 0.6, (count, 3)) * HALF
    normals = np.zeros((count, 3))
    normals[np.arange(count), axes] = signs
    p[np.arange(count), axes] = signs * HALF[axes]
    return p, normals


def problem(model: TargetModel, errors: int = 2, table: Table | None = None) -> Problem:
    """Points on all faces, a line that enters, planes of an outline, and errors in common."""
    rng = np.random.default_rng(0)
    X = pose()
    p, normals = on_faces(rng, 24)
    p_W = p @ X[:3, :3].T + X[:3, 3] + 5e-4 * rng.normal(size=p.shape)
    facing = normals @ X[:3, :3].T
    line = np.array([[[0.028, 0.0, 0.2], [0.028, 0.0, 0.02]]]) @ X[:3, :3].T + X[:3, 3]
    evidence = Evidence(table=table)
    for rows in (slice(0, 12), slice(12, 24)):
        A = 1e-3 * rng.normal(size=(8, errors))
        at = {"eye": rng.normal(size=3), "axis": np.array([0.6, 0.0, -0.8])}
        evidence = evidence.with_group(A, p_W[rows], 1e-3, facing[rows], line, **at)
        planes = touching(CORNERS, X, at["eye"], np.array([0.7, 2.0, 4.0]))
        group = len(evidence.displaced) - 1
        evidence = evidence.with_outline(group, planes, np.full(3, 2e-3))
    prior = PosePrior(X=X, rotation_sigma=0.2, translation_sigma=0.02)
    return problem_of(evidence, prior, model, 1000, rng)


def stepped(X: np.ndarray, c: np.ndarray, dx: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    Y = X.copy()
    Y[:3, :3] = X[:3, :3] @ se3.so3_exp(dx[:3])
    Y[:3, 3] += dx[3:6]
    return Y, c + dx[6:]


def test_how_deep_a_line_goes_into_a_box(box: TargetModel) -> None:
    m = np.empty(3)

    def deepest(start: list[float], stop: list[float]) -> tuple[float, float]:
        return _deepest(np.array(start), np.array(stop), box.radius, box.surface, m)

    # Through an edge's neighbourhood, 4 mm below a face.
    depth, share = deepest([HALF[0] - 4e-3, -0.5, 0.0], [HALF[0] - 4e-3, 0.5, 0.0])
    assert_allclose(depth, -4e-3, atol=1e-6)
    assert_allclose(m, [1.0, 0.0, 0.0], atol=1e-6)
    assert abs(share - 0.5) < HALF[1]
    # It ends before it gets in, or passes by.
    depth, _ = deepest([0.5, 0.0, 0.0], [HALF[0] + 5e-3, 0.0, 0.0])
    assert 5e-3 - 1e-6 < depth < 1.5e-2
    assert deepest([HALF[0] + 0.02, -0.5, 0.0], [HALF[0] + 0.02, 0.5, 0.0])[0] > 0.019
    assert deepest([0.5, -0.5, 0.0], [0.5, 0.5, 0.0])[0] == np.inf
    assert deepest([0.0, 0.0, 0.0], [0.0, 0.0, 0.0])[0] == np.inf


def test_the_step_is_along_the_gradient_of_the_cost(box: TargetModel) -> None:
    terms = problem(box, table=Table(height=0.24, height_sigma=4e-3, tilt_sigma=0.05))
    X, c = stepped(pose(), np.zeros(2), np.array([2e-3, -1e-3, 3e-3, 1e-4, 2e-4, -1e-4, 0.3, -0.2]))
    N, v, none = np.empty((8, 8)), np.empty(8), np.empty(8)
    linearise(X, c, FLOOR, terms, N, v)
    step, numeric = 1e-6, np.empty(8)
    for i in range(8):
        costs = [
            linearise(*stepped(X, c, sign * step * np.eye(8)[i]), FLOOR, terms, N.copy(), none)
            for sign in (1.0, -1.0)
        ]
        numeric[i] = (costs[0] - costs[1]) / (2.0 * step)
    assert_allclose(-2.0 * v, numeric, rtol=2e-3, atol=2e-3 * np.abs(numeric).max())


def test_refining_finds_the_pose_and_the_displacement_of_a_group(box: TargetModel) -> None:
    """One of two groups is displaced by 4 mm, which its calibration allows."""
    rng = np.random.default_rng(1)
    X = pose()
    evidence = Evidence()
    for displaced in (0.0, 2.0):
        p, normals = on_faces(rng, 60)
        A = np.zeros((6, 1))
        A[3] = -2e-3 * (displaced > 0.0)  # The points have to move back along x.
        p_W = p @ X[:3, :3].T + X[:3, 3] + 1e-4 * rng.normal(size=p.shape)
        p_W[:, 0] += displaced * 2e-3
        evidence = evidence.with_group(A, p_W, 5e-4, normals @ X[:3, :3].T)
    prior = PosePrior(X=X, rotation_sigma=0.2, translation_sigma=0.02)
    terms = problem_of(evidence, prior, box, 1000, rng)
    start, c = X[None].copy(), np.zeros((1, 1))
    start[0] = start[0] @ se3.exp(np.array([0.03, -0.05, 0.04, 3e-3, 2e-3, -4e-3]))
    floors = np.array([5.0, 3.0, 1.5, 0.7, 0.7, 0.7]) * 1e-3
    _, P = refine(start, c, floors, terms)
    assert_allclose(start[0, :3, 3], X[:3, 3], atol=3e-4)
    assert_allclose(c, 2.0, atol=0.2)
    assert np.sqrt(P[0, 6, 6]) < 0.3


def test_outlines_of_two_views_place_a_box(box: TargetModel) -> None:
    """Far from where it is, too: a plane pulls however far it passes."""
    X, angles = pose(), np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    evidence = Evidence()
    for view, eye in enumerate(([0.9, -0.2, 0.6], [0.4, 0.3, 0.5])):
        evidence = evidence.with_group(np.zeros((6, 0)), np.zeros((0, 3)), 1.0, eye=np.array(eye))
        evidence = evidence.with_outline(
            view, touching(CORNERS, X, np.array(eye), angles), np.full(12, 2e-3)
        )
    prior = PosePrior(X=X, rotation_sigma=np.inf, translation_sigma=np.inf)
    terms = problem_of(evidence, prior, box, 1000, np.random.default_rng(0))
    start = X[None].copy() @ se3.exp(np.array([0.15, -0.1, 0.2, 0.0, 0.0, 0.0]))
    start[:, :3, 3] += [0.03, -0.04, 0.05]
    costs, _ = refine(start, np.zeros((1, 0)), np.geomspace(2e-2, 7e-4, 20), terms)
    assert_allclose(start[0, :3, 3], X[:3, 3], atol=3e-4)
    assert_allclose(start[0, :3, :3], X[:3, :3], atol=5e-3)
    assert costs[0] < 0.1


def test_a_displacement_that_all_share_makes_the_pose_as_uncertain(box: TargetModel) -> None:
    rng = np.random.default_rng(2)
    X = pose()
    p, normals = on_faces(rng, 400)
    A = np.concatenate([np.zeros((3, 3)), 3e-3 * np.eye(3)])
    evidence = Evidence().with_group(A, p @ X[:3, :3].T + X[:3, 3], 1e-3, normals @ X[:3, :3].T)
    prior = PosePrior(X=X, rotation_sigma=1.0, translation_sigma=1.0)
    terms = problem_of(evidence, prior, box, 1000, rng)
    _, P = refine(X[None].copy(), np.zeros((1, 3)), np.full(4, FLOOR), terms)
    assert_allclose(np.sqrt(np.diag(P[0])[3:6]), 3e-3, rtol=0.02)
    assert np.sqrt(np.diag(P[0])[:3].max()) < 6e-3


def test_a_walk_draws_from_the_prior_where_nothing_was_measured(box: TargetModel) -> None:
    rng = np.random.default_rng(3)
    X = pose()
    prior = PosePrior(X=X, rotation_sigma=0.1, translation_sigma=0.02)
    terms = problem_of(
        Evidence().with_group(np.ones((6, 1)), np.zeros((0, 3)), 1e-3), prior, box, 10, rng
    )
    count, length = 400, 120
    poses, c = np.tile(X, (count, 1, 1)), np.zeros((count, 1))
    sigma = np.array([0.1] * 3 + [0.02] * 3 + [1.0])
    walk(
        poses,
        c,
        0.6,
        rng.normal(size=(count, length, 7)),
        rng.uniform(size=(count, length)),
        FLOOR,
        terms,
    )
    found = np.concatenate(
        [
            Rotation.from_matrix(X[:3, :3].T @ poses[:, :3, :3]).as_rotvec(),
            poses[:, :3, 3] - X[:3, 3],
            c,
        ],
        axis=1,
    )
    assert_allclose(found.std(axis=0) / sigma, 1.0, atol=0.15)
    assert_allclose(found.mean(axis=0) / sigma, 0.0, atol=0.2)


@pytest.mark.parametrize("lean", [0.0, 0.3])
def test_what_stands_on_a_table_is_upright_and_at_its_height(box: TargetModel, lean: float) -> None:
    X = np.eye(4)
    X[:3, :3] = Rotation.from_rotvec([lean, 0.0, 0.5]).as_matrix()
    X[:3, 3] = [0.5, 0.0, 0.103]
    rng = np.random.default_rng(4)
    free_to_lean = Table(height=0.0, height_sigma=1e-3, tilt_sigma=np.inf)
    for table in (Table(height=0.0, height_sigma=1e-3, tilt_sigma=1e-2), free_to_lean):
        prior = PosePrior(X=X, rotation_sigma=0.3, translation_sigma=0.05)
        terms = problem_of(Evidence(table=table), prior, box, 10, rng)
        Y = X[None].copy()
        refine(Y, np.zeros((1, 0)), np.append(COARSE, np.full(30, FLOOR)), terms)
        lowest = float(np.min(box.hull @ Y[0, 2, :3]) + Y[0, 2, 3])
        assert_allclose(lowest, 0.0, atol=5e-4)
        if table is free_to_lean:
            assert_allclose(Y[0, :3, :3], X[:3, :3], atol=0.1)
        elif lean == 0.0:
            assert_allclose(Y[0, 2, 2], 1.0, atol=1e-4)


def test_nothing_is_below_the_table_and_what_leans_may_be_above(box: TargetModel) -> None:
    prior = PosePrior(X=np.eye(4), rotation_sigma=np.inf, translation_sigma=np.inf)
    table = Table(height=0.0, height_sigma=2e-3, tilt_sigma=1e-2)
    terms = problem_of(Evidence(table=table), prior, box, 10, np.random.default_rng(0))
    X, N, v = np.eye(4), np.empty((6, 6)), np.empty(6)
    costs = []
    for height in (0.0, 0.05, -0.05):
        X[2, 3] = HALF[2] + height
        costs.append(linearise(X, np.zeros(0), FLOOR, terms, N, v))
    assert costs[0] < 0.1 < costs[1] < 40.0
    assert_allclose(costs[2], 25.0**2, atol=1.0)
