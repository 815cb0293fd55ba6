"""The meshes of the objects on the table."""

import pytest
import trimesh

from crossmodal.models.make_goods import GOODS, GOODS_DIR


@pytest.mark.parametrize("name", GOODS)
def test_an_object_is_of_one_piece(name: str) -> None:
    mesh = trimesh.load(GOODS_DIR / name / f"{name}.obj", force="mesh")
    assert mesh.is_watertight
    assert len(mesh.split(only_watertight=False)) == 1
