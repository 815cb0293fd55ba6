"""Friction takes the same of a joint at any mass and speed; a detent lets go beyond its force."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from crossmodal.models import SDF_DIR
from crossmodal.plants.joint_friction import Detents
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
    detent = Detents(plant, [(slide, 12.0)])
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


@pytest.mark.parametrize("friction", [0.5, 6.0, 60.0])
@pytest.mark.parametrize("beyond", [-0.3, 0.0, 4.0])
def test_a_drawer_feels_all_of_its_friction_however_large_it_is(
    friction: float, beyond: float
) -> None:
    """A force of F + x [N] accelerates m v' = x - b v; one that F can hold moves nothing.

    A friction of 60 N that is applied after the velocity before each step of 6 ms would be felt by
    a third, since the drawer weighs 2.5 kg.
    """
    builder = DiagramBuilder()
    placed = ObjectPlacement(
        model=SDF_DIR / "chest_drawer.sdf", X_WO=RigidTransform([0.9, 0.0, 0.86]), friction=friction
    )
    scene = add_manipulation_scene(builder, PlantConfig(), {"object": placed}, [("arm", "hand")])
    plant, slide = scene.plant, scene.plant.GetJointByName("slide")
    simulator = Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    for robot in map(scene.model, ("arm", "hand")):
        none = np.zeros(plant.num_actuated_dofs(robot))
        plant.get_actuation_input_port(robot).FixValue(context, none)
    pull = np.zeros(plant.num_velocities())
    pull[slide.velocity_start()] = friction + beyond
    plant.get_applied_generalized_force_input_port().FixValue(context, pull)
    simulator.AdvanceTo(0.12)
    mass = plant.GetBodyByName("drawer").default_spatial_inertia().get_mass()
    damping = slide.default_damping()
    expected = max(beyond, 0.0) / damping * (1.0 - np.exp(-damping / mass * 0.12))
    assert_allclose(slide.get_translation_rate(context), expected, rtol=0.02, atol=1.1e-4)


def test_a_strong_detent_keeps_a_nudged_drawer_where_it_is() -> None:
    """It would rattle its way out if it were as short as that of a heavy one."""
    builder = DiagramBuilder()
    placed = ObjectPlacement(
        model=SDF_DIR / "chest_drawer.sdf", X_WO=RigidTransform([0.9, 0.0, 0.86]), friction=1.0
    )
    scene = add_manipulation_scene(builder, PlantConfig(), {"object": placed}, [("arm", "hand")])
    plant, slide = scene.plant, scene.plant.GetJointByName("slide")
    detents = builder.AddSystem(Detents(plant, [(slide, 100.0)]))
    builder.Connect(plant.get_state_output_port(), detents.get_input_port())
    builder.Connect(detents.get_output_port(), plant.get_applied_generalized_force_input_port())
    simulator = Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    for robot in map(scene.model, ("arm", "hand")):
        none = np.zeros(plant.num_actuated_dofs(robot))
        plant.get_actuation_input_port(robot).FixValue(context, none)
    slide.set_translation_rate(context, 0.1)
    simulator.AdvanceTo(1.0)
    assert abs(slide.get_translation(context)) < 1e-3
    assert abs(slide.get_translation_rate(context)) < 1e-3
