"""A detent holds its joint up to a force, and lets it go beyond."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder

from crossmodal.models import SDF_DIR
from crossmodal.plants.joint_friction import JointFriction
from crossmodal.plants.scene import (
    ManipulationScene,
    ObjectPlacement,
    PlantConfig,
    add_manipulation_scene,
)


@pytest.fixture(scope="module")
def scene() -> ManipulationScene:
    drawer = SDF_DIR / "chest_drawer.sdf"
    placed = ObjectPlacement(model=drawer, X_WO=RigidTransform([0.9, 0.0, 0.86]))
    return add_manipulation_scene(
        DiagramBuilder(), PlantConfig(), {"object": placed}, [("arm", "hand")]
    )


def _forces(scene: ManipulationScene, positions: np.ndarray) -> np.ndarray:
    """Of a detent of 12 N on the drawer, at each of its positions [m]."""
    plant = scene.plant
    slide = plant.GetJointByName("slide")
    detent = JointFriction(plant, np.zeros(plant.num_velocities()), [(slide, 12.0)])
    context, state = detent.CreateDefaultContext(), np.zeros(plant.num_multibody_states())
    found = []
    for x in positions:
        state[slide.position_start()] = x
        detent.get_input_port().FixValue(context, state)
        force = np.asarray(detent.get_output_port().Eval(context))
        found.append(force[slide.velocity_start()])
        assert np.count_nonzero(force) <= 1
    return np.array(found)


def test_it_holds_most_by_its_force_and_pulls_back_to_where_the_joint_was(
    scene: ManipulationScene,
) -> None:
    x = np.linspace(-0.02, 0.02, 4001)
    force = _forces(scene, x)
    assert_allclose(np.abs(force).max(), 12.0, rtol=1e-6)
    assert (force * x <= 0.0).all()
    assert_allclose(force, -force[::-1])


def test_it_lets_go_a_centimetre_away(scene: ManipulationScene) -> None:
    assert abs(_forces(scene, np.array([0.01]))[0]) < 0.02
