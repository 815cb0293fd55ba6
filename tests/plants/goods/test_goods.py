"""The objects on the table: their meshes, and how they stand."""

import numpy as np
import pytest
import trimesh
from pydrake.math import RigidTransform, RollPitchYaw

from crossmodal.models.make_goods import GOODS, GOODS_DIR
from crossmodal.plants.goods.goods_scene import GoodsScene


@pytest.mark.parametrize("name", GOODS)
def test_an_object_is_of_one_piece(name: str) -> None:
    mesh = trimesh.load(GOODS_DIR / name / f"{name}.obj", force="mesh")
    assert mesh.is_watertight
    assert len(mesh.split(only_watertight=False)) == 1


def test_what_stands_on_a_table_does_not_chatter() -> None:
    """A light box does, for ever, with stiffer contact in the steps of the clutter's plant."""
    name = "transparent_box"
    scene = GoodsScene([name], np.zeros(3))
    scene.place({name: RigidTransform(RollPitchYaw(0.02, 0.02, 0.3), [0.0, 0.0, 0.01])})
    scene.advance(2.0)
    speeds = []
    for _ in range(100):
        scene.advance(scene.plant.time_step())
        V_WO = scene.bodies[name].EvalSpatialVelocityInWorld(scene.plant_context)
        speeds.append(np.linalg.norm(V_WO.translational()))
    assert max(speeds) < 2e-3
