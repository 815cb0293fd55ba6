"""Symmetries, stable poses and samples of targets; meshes that are no targets."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation
from targets import HALF, target

from crossmodal.systems.pose.surface import nearest_distances, surface_distance
from crossmodal.systems.pose.target_model import (
    TargetModel,
    TargetModelError,
    load_target,
    make_target,
)

NOWHERE = np.zeros(3)


@pytest.mark.parametrize(
    ("mesh", "axes"),
    [
        (trimesh.creation.cylinder(radius=0.03, height=0.2, sections=64), [0, 0, 1]),
        (trimesh.creation.icosphere(subdivisions=4, radius=0.05), [1, 1, 1]),
        (trimesh.creation.box(extents=[0.05, 0.05, 0.2]), [0, 0, 0]),
    ],
)
def test_what_looks_the_same_when_turned_is_found(mesh: trimesh.Trimesh, axes: list[int]) -> None:
    assert_allclose(target(mesh).spins, np.diag(axes), atol=1e-3)


def test_a_symmetry_is_found_in_any_frame() -> None:
    mesh = trimesh.creation.cylinder(radius=0.03, height=0.2, sections=64)
    R = Rotation.from_rotvec([0.3, -0.5, 0.9]).as_matrix()
    model = make_target(mesh.vertices @ R.T + [0.1, 0.0, -0.2], mesh.faces)
    assert_allclose(model.spins, np.outer(R[:, 2], R[:, 2]), atol=1e-3)
    assert_allclose(model.middle, [0.1, 0.0, -0.2], atol=1e-6)


def test_a_box_stands_on_six_sides_and_a_leaning_tower_not_on_its_foot(box: TargetModel) -> None:
    assert len(box.stable) == 6
    assert_allclose(np.sort(np.abs(box.stable).max(axis=1)), 1.0, atol=1e-9)
    tower = trimesh.creation.box(extents=[0.04, 0.04, 0.2])
    vertices = tower.vertices.copy()
    vertices[vertices[:, 2] > 0.0, 0] += 0.15
    model = make_target(vertices, tower.faces)
    assert not np.any(model.stable @ [0.0, 0.0, 1.0] > 0.999)


def test_samples_are_spread_evenly(ball: TargetModel) -> None:
    rng = np.random.default_rng(3)
    p = rng.normal(size=(2000, 3))
    p *= 0.05 / np.linalg.norm(p, axis=1, keepdims=True)
    apart = KDTree(ball.surface.points).query(p)[0]
    assert apart.max() < 1.2 * ball.surface.spacing
    assert_allclose(nearest_distances(p, ball.surface), 0.0, atol=2e-4)


def test_a_surface_that_is_inside_out_is_turned(box: TargetModel) -> None:
    mesh = trimesh.creation.box(extents=2.0 * HALF)
    model = make_target(mesh.vertices, mesh.faces[:, ::-1])
    m = np.empty(3)
    p = np.array([0.04, 0.0, 0.0])
    assert_allclose(surface_distance(p, NOWHERE, model.surface, m), 0.01, atol=1e-9)


def test_a_small_hole_is_closed() -> None:
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    assert len(make_target(mesh.vertices, mesh.faces[1:]).stable) > 0


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (np.zeros((0, 3)), np.zeros((0, 3), int), "holds no triangle"),
        (np.full((3, 3), np.nan), np.array([[0, 1, 2]]), "not finite"),
        (
            200.0 * trimesh.creation.box().vertices,
            trimesh.creation.box().faces,
            "346 m large.*give its scale",
        ),
        (
            0.05 * trimesh.creation.icosphere(subdivisions=2).vertices,
            trimesh.creation.icosphere(subdivisions=2).faces[::2],
            "open edges.*close it first",
        ),
    ],
)
def test_what_is_no_target_is_refused(
    vertices: np.ndarray, faces: np.ndarray, message: str
) -> None:
    with pytest.raises(TargetModelError, match=message):
        make_target(vertices, faces)


def test_a_file_that_is_no_mesh_is_refused_by_its_name(tmp_path: Path) -> None:
    with pytest.raises(TargetModelError, match=r"none\.obj"):
        load_target(tmp_path / "none.obj")
    (tmp_path / "text.obj").write_text("what is this")
    with pytest.raises(TargetModelError, match=r"text\.obj"):
        load_target(tmp_path / "text.obj")


def test_a_scale_brings_a_file_to_metres(tmp_path: Path) -> None:
    trimesh.creation.box(extents=2000.0 * HALF).export(tmp_path / "box.stl")
    with pytest.raises(TargetModelError, match="scale"):
        load_target(tmp_path / "box.stl")
    model = load_target(tmp_path / "box.stl", scale=1e-3)
    assert_allclose(np.abs(model.hull), np.tile(HALF, (8, 1)), atol=1e-9)
