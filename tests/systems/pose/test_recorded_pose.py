"""A cloud and contacts of one's own against a mesh of one's own, also when both are imperfect."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from crossmodal.systems.port_values import PosePrior
from crossmodal.systems.pose.evidence import Table
from crossmodal.systems.pose.recorded_pose import estimate_pose
from crossmodal.systems.pose.surface import cast_rays
from crossmodal.systems.pose.target_model import TargetModel, make_target

EYE = np.array([0.1, -0.4, 0.6])


@pytest.fixture(scope="module")
def model() -> TargetModel:
    """A body without symmetry: a slab with a peg on one end."""
    slab = trimesh.creation.box(extents=[0.16, 0.08, 0.03])
    peg = trimesh.creation.box(extents=[0.03, 0.03, 0.09])
    peg.apply_translation([0.05, 0.02, 0.05])
    joined = trimesh.boolean.union([slab, peg], engine="manifold")
    return make_target(joined.vertices, joined.faces)


def seen(model: TargetModel, seed: int, count: int = 500) -> tuple[np.ndarray, np.ndarray]:
    """A true pose X_WM and points that a camera at EYE sees of it."""
    rng = np.random.default_rng(seed)
    X = np.eye(4)
    X[:3, :3] = Rotation.random(random_state=seed).as_matrix()
    X[:3, 3] = rng.uniform(-0.1, 0.1, 3)
    aims = X[:3, 3] + rng.uniform(-0.1, 0.1, (8 * count, 3))
    d = (aims - EYE) / np.linalg.norm(aims - EYE, axis=1, keepdims=True)
    start = np.ascontiguousarray(np.broadcast_to((EYE - X[:3, 3]) @ X[:3, :3], d.shape))
    found, _ = cast_rays(
        start, np.ascontiguousarray(d @ X[:3, :3]), np.full(len(d), 2.0), model.surface, True
    )
    met = np.nonzero(np.isfinite(found))[0][:count]
    return X, EYE + found[met, None] * d[met] + 1e-3 * rng.normal(size=(len(met), 3))


def error(X: np.ndarray, found: np.ndarray) -> tuple[float, float]:
    turned = Rotation.from_matrix(X[:3, :3].T @ found[:3, :3]).magnitude()
    return float(np.linalg.norm(X[:3, 3] - found[:3, 3])), float(turned)


@pytest.mark.parametrize("seed", range(4))
def test_an_object_is_found_anywhere(model: TargetModel, seed: int) -> None:
    X, cloud = seen(model, seed)
    moved, turned = error(X, estimate_pose(model, cloud, eye=EYE).X)
    assert moved < 2e-3
    assert turned < 0.03


def test_holes_outliers_and_a_scale_that_is_off_by_a_percent(model: TargetModel) -> None:
    X, cloud = seen(model, 5)
    rng = np.random.default_rng(5)
    cloud = cloud[np.linalg.norm(cloud - cloud[0], axis=1) > 0.03]
    cloud = X[:3, 3] + 1.01 * (cloud - X[:3, 3])
    others = X[:3, 3] + rng.uniform(-0.15, 0.15, (len(cloud) // 3, 3))
    moved, turned = error(X, estimate_pose(model, np.concatenate([cloud, others])).X)
    assert moved < 4e-3
    assert turned < 0.06


def test_missing_points_are_left_out(model: TargetModel) -> None:
    X, cloud = seen(model, 6)
    cloud[::7] = np.nan
    assert error(X, estimate_pose(model, cloud, eye=EYE).X)[0] < 2e-3


def test_a_missing_contact_takes_its_normal_along(model: TargetModel) -> None:
    touches, normals = model.surface.points[::900].copy(), model.surface.normals[::900]
    touches[2] = np.nan
    guess = PosePrior(X=np.eye(4), rotation_sigma=0.1, translation_sigma=0.01)
    both = [
        estimate_pose(model, touches=t, touch_normals=n, guess=guess).X
        for t, n in ((touches, normals), (np.delete(touches, 2, 0), np.delete(normals, 2, 0)))
    ]
    np.testing.assert_array_equal(*both)


def test_touches_and_a_table_count(model: TargetModel) -> None:
    X, cloud = seen(model, 7, 12)
    height = float(np.min(model.hull @ X[2, :3]) + X[2, 3])
    leaning = Table(height=height, tilt_sigma=np.inf)
    belief = estimate_pose(model, touches=cloud, table=leaning)
    assert np.sqrt(np.diag(belief.covariance))[3:].max() > 1e-3  # Twelve points are few.
    both = estimate_pose(model, seen(model, 7)[1], touches=cloud, table=leaning, eye=EYE)
    assert error(X, both.X)[0] < 2e-3


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({}, "neither cloud nor touches"),
        ({"cloud": np.full((3, 3), np.nan)}, "neither cloud nor touches"),
        ({"cloud": np.zeros((3, 2))}, r"cloud is \(3, 2\)"),
        ({"touches": np.zeros((2, 3)), "touch_normals": np.zeros((1, 3))}, "touch_normals"),
    ],
)
def test_what_is_no_measurement_is_refused(
    model: TargetModel, values: dict[str, np.ndarray], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        estimate_pose(model, **values)
