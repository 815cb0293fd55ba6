"""A body made from a mesh: its mass, and that its convex parts have the mesh's shape."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose
from pydrake.multibody.plant import MultibodyPlant

from crossmodal.plants.goods.mesh_model import write_mesh_model
from crossmodal.plants.parsing import add_model, make_parser


@pytest.fixture(scope="module")
def angle() -> trimesh.Trimesh:
    """An L of two bars, 20 mm thick."""
    outline = 1e-3 * np.array([[0, 0], [80, 0], [80, 20], [20, 20], [20, 60], [0, 60]])
    triangles = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]])
    return trimesh.creation.extrude_triangulation(outline, triangles, height=0.02)


def test_the_body_has_the_mesh_s_shape_and_the_given_mass(
    angle: trimesh.Trimesh, tmp_path: Path
) -> None:
    file = write_mesh_model(angle.vertices, angle.faces, "angle", 0.4, tmp_path)
    plant = MultibodyPlant(0.0)
    instance = add_model(make_parser(plant), file, "angle")
    plant.Finalize()
    (body,) = (plant.get_body(index) for index in plant.GetBodyIndices(instance))
    inertia = body.default_spatial_inertia()
    assert inertia.get_mass() == pytest.approx(0.4)
    assert_allclose(inertia.get_com(), angle.center_mass, atol=1e-5)
    angle.density = 0.4 / angle.volume
    assert_allclose(
        inertia.Shift(inertia.get_com()).CopyToFullMatrix6()[:3, :3],
        angle.moment_inertia,
        rtol=1e-3,
        atol=1e-8,
    )
    parts = [trimesh.load(path) for path in sorted(tmp_path.glob("part_*.obj"))]
    assert len(parts) > 1  # One hull would fill the corner.
    assert all(part.is_convex for part in parts)
    assert sum(part.volume for part in parts) == pytest.approx(angle.volume, rel=0.05)
    corner = np.array([[0.05, 0.04, 0.01]])
    assert not any(part.contains(corner)[0] for part in parts)


def test_the_visual_can_be_rendered(angle: trimesh.Trimesh, tmp_path: Path) -> None:
    """Drake's renderer needs normals."""
    write_mesh_model(angle.vertices, angle.faces, "angle", 0.4, tmp_path)
    assert "\nvn " in (tmp_path / "body.obj").read_text()
