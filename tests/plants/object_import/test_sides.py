"""Sheets whose two sides have triangles of their own."""

import numpy as np
import trimesh
from numpy.testing import assert_allclose

from crossmodal.plants.object_import.meshes import Surface
from crossmodal.plants.object_import.sides import with_sides_apart

CORNERS = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
FRONT = np.array([[0, 1, 2], [0, 2, 3]])


def surface(*faces: np.ndarray, offset: float = 0.0) -> Surface:
    mesh = trimesh.Trimesh(CORNERS + np.array([0, 0, offset]), np.concatenate(faces), process=False)
    return Surface(mesh=mesh, color=None, texture=None)


def heights(*surfaces: Surface) -> list[float]:
    return [float(part.mesh.vertices[:, 2].mean()) for part in with_sides_apart(list(surfaces))]


def test_each_side_of_a_sheet_is_moved_to_its_own_side() -> None:
    back = np.array([[2, 1, 0], [0, 3, 2]])
    assert_allclose(heights(surface(FRONT), surface(back)), [1e-4, -1e-4])
    assert_allclose(heights(surface(back), surface(FRONT)), [-1e-4, 1e-4])


def test_what_is_no_sheet_of_two_materials_stays() -> None:
    back = FRONT[:, ::-1]
    assert heights(surface(FRONT)) == [0.0]
    assert heights(surface(FRONT, back)) == [0.0]
    assert heights(surface(FRONT), surface(FRONT)) == [0.0, 0.0]
    assert_allclose(heights(surface(FRONT), surface(back, offset=0.01)), [0.0, 0.01])


def test_what_is_given_is_not_changed() -> None:
    front = surface(FRONT)
    with_sides_apart([front, surface(FRONT[:, ::-1])])
    assert_allclose(front.mesh.vertices, CORNERS)
