"""What is believed of a pose is as wrong as it says; all evidence counts; doubts are kept."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from targets import touching

from crossmodal.systems.port_values import ObjectPose, PosePrior, of_middle
from crossmodal.systems.pose.evidence import Evidence, Table
from crossmodal.systems.pose.pose_belief import (
    SolverConfig,
    infer_pose,
    uniform_rotations,
)
from crossmodal.systems.pose.surface import cast_rays
from crossmodal.systems.pose.target_model import TargetModel, make_target

CONFIG = SolverConfig()


def wedge() -> trimesh.Trimesh:
    """A body without any symmetry."""
    mesh = trimesh.creation.box(extents=[0.08, 0.05, 0.2])
    vertices = mesh.vertices.copy()
    high = vertices[:, 2] > 0.0
    vertices[high & (vertices[:, 0] > 0.0), 0] -= 0.05
    vertices[high & (vertices[:, 1] > 0.0), 1] -= 0.02
    return trimesh.Trimesh(vertices, mesh.faces)


@pytest.fixture(scope="module")
def model() -> TargetModel:
    mesh = wedge()
    return make_target(mesh.vertices, mesh.faces)


def standing(model: TargetModel, rng: np.random.Generator) -> np.ndarray:
    """X_WO of the object on a table at height zero."""
    X = np.eye(4)
    X[:3, :3] = Rotation.from_rotvec([0.0, 0.0, rng.uniform(-3.0, 3.0)]).as_matrix()
    X[:2, 3] = [rng.uniform(0.4, 0.6), rng.uniform(-0.1, 0.1)]
    X[2, 3] = 0.1
    return X


def wrong(X: np.ndarray, sigma_R: float, sigma_t: float, rng: np.random.Generator) -> PosePrior:
    start = X.copy()
    start[:3, :3] = X[:3, :3] @ Rotation.from_rotvec(sigma_R * rng.normal(size=3)).as_matrix()
    start[:3, 3] += sigma_t * rng.normal(size=3)
    return PosePrior(X=start, rotation_sigma=sigma_R, translation_sigma=sigma_t)


def seen_from(
    model: TargetModel, X: np.ndarray, eye: np.ndarray, count: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Points that a camera sees, and the directions to it."""
    p_M = X[:3, :3] @ model.middle + X[:3, 3]
    aims = p_M + rng.uniform(-0.12, 0.12, (4 * count, 3))
    d = (aims - eye) / np.linalg.norm(aims - eye, axis=1, keepdims=True)
    start = np.tile((eye - p_M) @ X[:3, :3], (len(d), 1))
    found, _ = cast_rays(
        start, np.ascontiguousarray(d @ X[:3, :3]), np.full(len(d), 2.0), model.surface, True
    )
    met = np.nonzero(np.isfinite(found))[0][:count]
    return eye + found[met, None] * d[met], -d[met]


def test_a_view_from_a_miscalibrated_camera_is_as_wrong_as_is_said(model: TargetModel) -> None:
    """The camera is displaced by 3 mm per axis, which its calibration says."""
    distances = []
    A = np.concatenate([np.zeros((3, 3)), 3e-3 * np.eye(3)])
    for seed in range(40):
        rng = np.random.default_rng(seed)
        X = standing(model, rng)
        p, facing = seen_from(model, X, X[:3, 3] + [0.3, 0.3, 0.35], 300, rng)
        c = rng.normal(size=3)
        p = p + 1.5e-3 * rng.normal(size=p.shape) - A[3:] @ c
        evidence = Evidence().with_group(A, p, 1.5e-3, facing)
        belief = infer_pose(evidence, wrong(X, 0.2, 0.02, rng), model, CONFIG)
        distances.append(belief.distance(X))
    assert np.median(distances) < 1.5 * chi2.ppf(0.5, 6)
    assert np.mean(np.array(distances) < chi2.ppf(0.95, 6)) > 0.8


def test_few_points_of_an_object_turned_in_any_way_are_as_wrong_as_is_said(
    model: TargetModel,
) -> None:
    """The pose is known by samples, most of whose starts are far from it."""
    distances = []
    A = np.concatenate([np.zeros((3, 3)), 3e-3 * np.eye(3)])
    for seed in range(40):
        rng = np.random.default_rng(seed)
        X = standing(model, rng)
        p, facing = seen_from(model, X, X[:3, 3] + [0.3, 0.3, 0.35], 120, rng)
        p = p + 1.5e-3 * rng.normal(size=p.shape) - A[3:] @ rng.normal(size=3)
        evidence = Evidence(table=Table(height=2e-3 * rng.normal()))
        prior = replace(wrong(X, 0.2, 0.02, rng), rotation_sigma=np.inf)
        belief = infer_pose(evidence.with_group(A, p, 1.5e-3, facing), prior, model, CONFIG)
        distances.append(belief.distance(X))
    assert np.median(distances) < 1.5 * chi2.ppf(0.5, 6)
    assert np.mean(np.array(distances) < chi2.ppf(0.95, 6)) > 0.8


def test_outlines_from_a_miscalibrated_camera_are_as_wrong_as_is_said(model: TargetModel) -> None:
    """Two images without depth; the camera is displaced by 3 mm per axis in both."""
    distances, angles = [], np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    for seed in range(40):
        rng = np.random.default_rng(seed)
        X = standing(model, rng)
        X_WM = of_middle(X, model.middle)
        evidence, c = Evidence(), rng.normal(size=3)
        A = np.concatenate([np.zeros((3, 3)), 3e-3 * np.eye(3), np.zeros((2, 3))])
        for view, way in enumerate(([0.3, 0.3, 0.35], [-0.3, 0.2, 0.4])):
            eye = X_WM[:3, 3] + way
            outline = touching(model.hull, X_WM, eye, angles)
            sigma = np.full(len(angles), 2e-3)
            noise = sigma * rng.normal(size=len(angles)) / np.linalg.norm(way)
            outline += noise[:, None] * (X_WM[:3, 3] - eye) / np.linalg.norm(way)
            at = {"eye": eye - A[3:6] @ c, "axis": -np.array(way) / np.linalg.norm(way)}
            evidence = evidence.with_group(A, np.zeros((0, 3)), 1.0, **at)
            evidence = evidence.with_outline(view, outline, sigma)
        belief = infer_pose(evidence, wrong(X, 0.2, 0.02, rng), model, CONFIG)
        distances.append(belief.distance(X))
    assert np.median(distances) < 1.5 * chi2.ppf(0.5, 6)
    assert np.mean(np.array(distances) < chi2.ppf(0.95, 6)) > 0.8


def test_the_joint_covariance_knows_what_pose_and_calibration_have_in_common(
    model: TargetModel,
) -> None:
    """A sharp image from a displaced camera: the object is off by what the camera is off."""
    A = np.concatenate([np.zeros((3, 3)), np.diag([3e-3, 5e-3, 4e-3])])
    rng = np.random.default_rng(3)
    X = standing(model, rng)
    p, facing = seen_from(model, X, X[:3, 3] + [0.3, 0.3, 0.35], 400, rng)
    evidence = Evidence().with_group(A, p + 5e-4 * rng.normal(size=p.shape), 5e-4, facing)
    belief = infer_pose(evidence, wrong(X, 0.1, 0.02, rng), model, CONFIG)
    joint = belief.joint
    assert joint.shape == (9, 9)
    assert_allclose(joint, joint.T, atol=1e-12)
    assert np.linalg.eigvalsh(joint).min() > 0.0
    deviations = np.sqrt(np.diag(joint))
    assert_allclose(deviations[3:6], np.diag(A[3:]), rtol=0.2)
    assert_allclose(deviations[6:], 1.0, rtol=0.1)
    assert_allclose(joint[3:6, 6:], A[3:] @ joint[6:, 6:], atol=5e-4)
    # So do the samples.
    assert_allclose(np.sqrt(np.diag(belief.covariance)), deviations[:6], rtol=0.5)
    moved = belief.samples[:, :3, 3] - belief.X[:3, 3]
    assert_allclose(moved.T @ belief.calibration / 64, joint[3:6, 6:], atol=2e-3)
    # Who knew the camera's error would know the place.
    gain = joint[:6, 6:] @ np.linalg.inv(joint[6:, 6:])
    given = joint[:6, :6] - gain @ joint[6:, :6]
    assert np.sqrt(np.diag(given))[3:].max() < 2e-3


def touched(model: TargetModel, X: np.ndarray, count: int, rng: np.random.Generator) -> Evidence:
    """Contacts with the object from all sides."""
    p_M = X[:3, :3] @ model.middle + X[:3, 3]
    evidence = Evidence().with_group(np.zeros((6, 0)), np.zeros((0, 3)), 1e-3)
    while len(evidence.points) < count:
        eye = p_M + 0.2 * np.append(rng.normal(size=2), 0.3)
        p, facing = seen_from(model, X, eye, 1, rng)
        noisy = p + 7e-4 * rng.normal(size=p.shape)
        line = np.stack([np.broadcast_to(eye, p.shape), p + 4e-3 * facing], axis=1)
        evidence = evidence.with_measured(0, noisy, 1e-3, facing, line)
    return evidence


def mean_error(belief: ObjectPose, X: np.ndarray, model: TargetModel) -> float:
    p_M = X[:3, :3] @ model.middle + X[:3, 3]
    return float(np.linalg.norm(belief.X[:3, 3] - p_M))


def test_a_table_makes_a_few_touches_worth_more(model: TargetModel) -> None:
    errors: dict[str, list[float]] = {"alone": [], "table": []}
    inside = []
    for seed in range(16):
        rng = np.random.default_rng(seed)
        X = standing(model, rng)
        prior = wrong(X, 0.2, 0.02, rng)
        evidence = touched(model, X, 6, rng)
        table = replace(evidence, table=Table(height=0.0))
        for name, known in (("alone", evidence), ("table", table)):
            belief = infer_pose(known, prior, model, CONFIG)
            errors[name].append(mean_error(belief, X, model))
            inside.append(belief.distance(X) < chi2.ppf(0.95, 6))
    assert np.mean(errors["table"]) < 0.6 * np.mean(errors["alone"])
    assert np.mean(errors["table"]) < 6e-3
    assert np.mean(inside) > 0.7


def test_where_a_finger_swept_the_object_is_not(model: TargetModel) -> None:
    """A finger that meets nothing on its way past one side leaves the other side."""
    X = standing(model, np.random.default_rng(0))
    prior = PosePrior(X=X, rotation_sigma=1e-3, translation_sigma=0.05)
    none = Evidence().with_group(np.zeros((6, 0)), np.zeros((0, 3)), 1e-3)
    across = X[:3, 3] + np.array([[[0.02, -0.3, 0.0], [0.02, 0.3, 0.0]]])
    swept = none.with_measured(0, np.zeros((0, 3)), 1e-3, None, across)
    right = [
        np.mean(infer_pose(known, prior, model, CONFIG).samples[:, 0, 3] > X[0, 3] + 0.02)
        for known in (none, swept)
    ]
    assert right[0] == pytest.approx(0.35, abs=0.2)
    near = np.abs(infer_pose(swept, prior, model, CONFIG).samples[:, 0, 3] - X[0, 3] - 0.02)
    assert np.mean(near < 0.015) < 0.1


def test_without_evidence_the_prior_is_believed(model: TargetModel) -> None:
    rng = np.random.default_rng(0)
    prior = wrong(standing(model, rng), 0.2, 0.02, rng)
    evidence = Evidence().with_group(np.zeros((6, 0)), np.zeros((0, 3)), 1e-3)
    belief = infer_pose(evidence, prior, model, CONFIG)
    assert_allclose(np.sqrt(np.diag(belief.covariance)), [0.2] * 3 + [0.02] * 3, rtol=0.5)


def test_the_height_of_the_prior_tells_how_the_object_stands() -> None:
    """A box whose middle is as high as when it stands upright does not lie on a side."""
    mesh = trimesh.creation.box(extents=[0.08, 0.05, 0.2])
    model = make_target(mesh.vertices, mesh.faces)
    X = standing(model, np.random.default_rng(0))
    X[2, 3] = 0.1
    prior = PosePrior(X=X, rotation_sigma=np.inf, translation_sigma=0.01)
    evidence = Evidence(table=Table(height=0.0, height_sigma=1e-3))
    belief = infer_pose(
        evidence.with_group(np.zeros((6, 0)), np.zeros((0, 3)), 1e-3), prior, model, CONFIG
    )
    assert np.mean(np.abs(belief.samples[:, 2, 2]) > 0.95) > 0.95
    assert_allclose(belief.samples[:, 2, 3], 0.1, atol=0.01)


def test_any_rotation_is_found_in_one_view(model: TargetModel) -> None:
    found = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        X = standing(model, rng)
        p, facing = seen_from(model, X, X[:3, 3] + [0.3, 0.3, 0.35], 400, rng)
        evidence = Evidence().with_group(
            np.zeros((6, 0)), p + 1e-3 * rng.normal(size=p.shape), 1e-3, facing
        )
        start = wrong(X, 3.0, 0.02, rng)
        prior = PosePrior(X=start.X, rotation_sigma=np.inf, translation_sigma=0.03)
        belief = infer_pose(evidence, prior, model, CONFIG)
        turned = Rotation.from_matrix(X[:3, :3].T @ belief.X[:3, :3]).magnitude()
        found.append(mean_error(belief, X, model) < 3e-3 and turned < 0.05)
    assert np.mean(found) > 0.9


def test_the_spin_of_a_round_body_stays_unknown() -> None:
    mesh = trimesh.creation.cylinder(radius=0.035, height=0.2, sections=48)
    model = make_target(mesh.vertices, mesh.faces)
    rng = np.random.default_rng(0)
    X = standing(model, rng)
    p, facing = seen_from(model, X, X[:3, 3] + [0.3, 0.3, 0.35], 300, rng)
    evidence = Evidence().with_group(np.zeros((6, 0)), p, 1e-3, facing)
    belief = infer_pose(evidence, wrong(X, 0.2, 0.02, rng), model, CONFIG)
    deviation = np.sqrt(np.diag(belief.covariance))
    assert deviation[2] > 1.0
    assert deviation[:2].max() < 0.02
    assert mean_error(belief, X, model) < 1e-3


def test_a_half_turn_that_looks_the_same_is_a_mode_of_its_own() -> None:
    mesh = trimesh.creation.box(extents=[0.08, 0.05, 0.2])
    model = make_target(mesh.vertices, mesh.faces)
    rng = np.random.default_rng(1)
    X = standing(model, rng)
    p, facing = seen_from(model, X, X[:3, 3] + [0.3, 0.3, 0.35], 300, rng)
    evidence = Evidence().with_group(np.zeros((6, 0)), p, 1e-3, facing)
    prior = PosePrior(X=X, rotation_sigma=np.inf, translation_sigma=0.03)
    belief = infer_pose(evidence, prior, model, CONFIG)
    assert len(belief.modes) >= 2
    assert belief.probabilities[0] < 0.9
    # Of the half turn about the vertical, which is in the joint covariance, too.
    assert np.sqrt(belief.joint[2, 2]) > 0.8
    assert belief.distance(X) < chi2.ppf(0.95, 6)


def test_samples_of_a_bent_density_are_as_wide_as_it_is() -> None:
    """A finger has met a post from the side, and has passed it elsewhere.

    So the post's middle is on half a circle about the contact, but where the finger passed. Its
    density there is drawn from the prior by weights.
    """
    radius, sigma, rng = 0.03, 0.02, np.random.default_rng(0)
    mesh = trimesh.creation.cylinder(radius=radius, height=0.12, sections=64)
    post = make_target(mesh.vertices, mesh.faces)
    X = np.eye(4)
    X[:3, 3] = [0.5, 0.0, 0.06]
    prior = PosePrior(X=X, rotation_sigma=0.1, translation_sigma=sigma)
    contact, facing = np.array([[0.53, 0.0, 0.06]]), np.array([[1.0, 0.0, 0.0]])
    swept = np.array([[[0.4, 0.025, 0.06], [0.6, 0.025, 0.06]]])
    evidence = Evidence(table=Table(height=0.0, height_sigma=1e-3))
    evidence = evidence.with_group(np.zeros((6, 0)), contact, 1e-3, facing, swept)
    belief = infer_pose(evidence, prior, post, replace(CONFIG, samples=256))
    middle = X[:2, 3] + sigma * rng.normal(size=(400_000, 2))
    away = np.linalg.norm(middle - contact[0, :2], axis=1) - radius
    faces = middle[:, 0] < contact[0, 0]
    passed = np.abs(middle[:, 1] - swept[0, 0, 1]) > radius
    weights = np.exp(-0.5 * (away / 1e-3) ** 2) * faces * passed
    weights /= weights.sum()
    mean = weights @ middle
    deviation = np.sqrt(weights @ (middle - mean) ** 2)
    found = belief.samples[:, :2, 3]
    assert_allclose(found.mean(axis=0), mean, atol=0.6 * deviation.max())
    assert_allclose(found.std(axis=0), deviation, rtol=0.3)


def test_the_same_evidence_gives_the_same_belief(model: TargetModel) -> None:
    rng = np.random.default_rng(2)
    X = standing(model, rng)
    evidence, prior = touched(model, X, 4, rng), wrong(X, 0.2, 0.02, rng)
    first, second = (infer_pose(evidence, prior, model, CONFIG) for _ in range(2))
    np.testing.assert_array_equal(first.samples, second.samples)


def test_rotations_are_spread_evenly() -> None:
    R = uniform_rotations(500)
    angles = [
        Rotation.from_matrix(np.einsum("nij,ik->njk", R, Q)).magnitude().min()
        for Q in Rotation.random(50, random_state=0).as_matrix()
    ]
    assert np.max(angles) < np.deg2rad(40.0)


@pytest.mark.parametrize("name", ["points", "sigma", "facing"])
def test_evidence_that_is_not_finite_is_refused(name: str) -> None:
    values = {"points": np.zeros((1, 3)), "sigma": np.ones(1), "facing": np.zeros((1, 3))}
    values[name] = values[name] * np.nan
    with pytest.raises(ValueError, match=name):
        Evidence().with_group(np.zeros((6, 0)), values["points"], values["sigma"], values["facing"])
