"""The objects that come along: sane models, and mechanics that follow from their numbers."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ScrewJoint
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from crossmodal.models import SDF_DIR
from crossmodal.plants.scene import (
    ManipulationScene,
    ObjectPlacement,
    PlantConfig,
    add_manipulation_scene,
    object_joints,
)

OBJECTS = {
    "chest_drawer.sdf": "slide",
    "cupboard_door.sdf": "hinge",
    "glass_door.sdf": "hinge",
    "sliding_door.sdf": "slide",
    "tripod.sdf": "pan",
    "cardboard_box.sdf": "hinge",
    "fly_press.sdf": "spindle",
}


def alone(model: str) -> MultibodyPlant:
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModels(str(SDF_DIR / model))
    plant.Finalize()
    return plant


@pytest.mark.parametrize("model", OBJECTS)
def test_bodies_weigh_what_such_things_weigh(model: str) -> None:
    plant = alone(model)
    for index in plant.GetBodyIndices(plant.GetFrameByName("handle").model_instance()):
        inertia = plant.get_body(index).default_spatial_inertia()
        assert inertia.IsPhysicallyValid()
        assert 0.05 < inertia.get_mass() < 20.0
        radius = np.sqrt(inertia.get_unit_inertia().get_moments().max())
        assert 0.02 < radius < 0.5


@pytest.mark.parametrize(("model", "joint"), OBJECTS.items())
def test_the_closed_joint_is_at_a_limit_or_between_and_the_handle_moves_with_it(
    model: str, joint: str
) -> None:
    plant = alone(model)
    context = plant.CreateDefaultContext()
    moved = plant.GetJointByName(joint)
    handle = plant.GetFrameByName("handle")
    assert handle.body().index() == moved.child_body().index()
    lower, upper = moved.position_lower_limits()[0], moved.position_upper_limits()[0]
    assert lower <= 0.0 < upper
    assert upper < np.inf or isinstance(moved, ScrewJoint)  # To which Drake gives no limits.
    start = handle.CalcPoseInWorld(context).translation()
    moved_by = 0.05
    q = plant.GetPositions(context)
    q[moved.position_start()] = moved_by
    plant.SetPositions(context, q)
    way = np.linalg.norm(handle.CalcPoseInWorld(context).translation() - start)
    assert 0.1 * moved_by < way <= 1.01 * moved_by


class Released:
    """An object in the scene, the robot far off, its joints free to move."""

    def __init__(self, model: str, X_WO: RigidTransform, friction: float, **placement: bool):
        builder = DiagramBuilder()
        placed = ObjectPlacement(
            model=Path(SDF_DIR / model), X_WO=X_WO, friction=friction, **placement
        )
        self.scene: ManipulationScene = add_manipulation_scene(
            builder, PlantConfig(), {"object": placed}, [("arm", "hand")]
        )
        plant = self.scene.plant
        self.simulator = Simulator(builder.Build())
        self.context = plant.GetMyMutableContextFromRoot(self.simulator.get_mutable_context())
        for robot in map(self.scene.model, ("arm", "hand")):
            plant.get_actuation_input_port(robot).FixValue(
                self.context, np.zeros(plant.num_actuated_dofs(robot))
            )


def test_the_sliding_panel_slows_down_by_friction_and_damping() -> None:
    """m v' = -F - b v."""
    released = Released("sliding_door.sdf", RigidTransform([0.9, 0, 1.5]), friction=4.0)
    plant = released.scene.plant
    slide = plant.GetJointByName("slide")
    mass = plant.GetBodyByName("panel").default_spatial_inertia().get_mass()
    slide.set_translation(released.context, 0.05)
    slide.set_translation_rate(released.context, 0.5)
    released.simulator.AdvanceTo(0.15)
    damping = slide.default_damping()
    expected = (0.5 + 4.0 / damping) * np.exp(-damping / mass * 0.15) - 4.0 / damping
    assert 0.05 < expected < 0.45
    assert_allclose(slide.get_translation_rate(released.context), expected, rtol=0.03)


def test_the_weight_of_the_press_hardly_turns_its_screw() -> None:
    """The torque of the weight, m g h / (2 pi), is held at a creep of F w / w_s."""
    released = Released("fly_press.sdf", RigidTransform([0.9, 0, 0.7]), friction=1.5)
    plant = released.scene.plant
    spindle, head = plant.GetJointByName("spindle"), plant.GetBodyByName("head")
    pitch = spindle.screw_pitch() / (2.0 * np.pi)
    assert_allclose(pitch, 0.08 / (2.0 * np.pi))
    released.simulator.AdvanceTo(1.0)
    creep = spindle.get_angular_velocity(released.context)
    weight = head.default_mass() * 9.81
    expected = weight * pitch / (1.5 / 1e-4 + spindle.default_damping())
    assert_allclose(creep, expected, atol=2e-5)  # The solver stops where so little is left.


def test_the_turning_press_goes_down_by_its_pitch_and_slows_down_by_friction_and_damping() -> None:
    """I (w' - w) / dt = m g h - F - b w', h the pitch per radian, m h^2 in the inertia I."""
    released = Released("fly_press.sdf", RigidTransform([0.9, 0, 0.7]), friction=1.5)
    plant = released.scene.plant
    spindle, head = plant.GetJointByName("spindle"), plant.GetBodyByName("head")
    start = head.EvalPoseInWorld(released.context).translation()
    pitch, damping = spindle.screw_pitch() / (2.0 * np.pi), spindle.default_damping()
    spindle.set_angular_velocity(released.context, 20.0)
    steps, step = 5, PlantConfig().time_step
    released.simulator.AdvanceTo(steps * step)
    mass = head.default_mass()
    inertia = head.default_rotational_inertia().CopyToFullMatrix3()[2, 2] + mass * pitch**2
    expected, held = 20.0, 1.5 - mass * 9.81 * pitch
    for _ in range(steps):
        expected = (expected - held * step / inertia) / (1.0 + damping * step / inertia)
    assert 1.0 < expected < 10.0
    assert_allclose(spindle.get_angular_velocity(released.context), expected, rtol=1e-3)
    way = head.EvalPoseInWorld(released.context).translation() - start
    assert_allclose(way[2], -pitch * spindle.get_rotation(released.context), atol=1e-9)


def test_the_free_carton_slides_on_the_table_as_far_as_its_feet_let_it() -> None:
    """s = v^2 / (2 mu g)."""
    X_WO = RigidTransform([1.0, -0.25, 0.70])
    released = Released("cardboard_box.sdf", X_WO, friction=5.0, free=True)
    plant = released.scene.plant
    box = plant.GetBodyByName("box")
    released.simulator.AdvanceTo(0.5)
    before = box.EvalPoseInWorld(released.context).translation()
    assert_allclose(before, X_WO.translation(), atol=2e-3)
    velocity = SpatialVelocity(np.zeros(3), np.array([0.0, 0.5, 0.0]))
    plant.SetFreeBodySpatialVelocity(context=released.context, body=box, V_JpJc=velocity)
    released.simulator.AdvanceTo(1.2)
    way = box.EvalPoseInWorld(released.context).translation() - before
    assert_allclose(way[1], 0.5**2 / (2 * 0.15 * 9.81), rtol=0.1)
    assert_allclose(way[[0, 2]], 0.0, atol=5e-3)


def test_the_table_bears_the_carton_at_every_step_of_its_slide() -> None:
    """A solver that lets it hover or rattle takes the table's friction away, or adds to it."""
    released = Released("cardboard_box.sdf", RigidTransform([1.0, -0.25, 0.70]), 5.0, free=True)
    plant = released.scene.plant
    released.simulator.AdvanceTo(0.3)
    velocity = SpatialVelocity(np.zeros(3), np.array([0.0, 0.3, 0.0]))
    box = plant.GetBodyByName("box")
    plant.SetFreeBodySpatialVelocity(context=released.context, body=box, V_JpJc=velocity)
    carried = []
    for step in range(1, 16):
        released.simulator.AdvanceTo(0.3 + step * PlantConfig().time_step)
        results = plant.get_contact_results_output_port().Eval(released.context)
        feet = map(results.point_pair_contact_info, range(results.num_point_pair_contacts()))
        carried.append(sum(abs(foot.contact_force()[2]) for foot in feet))
    mass = plant.CalcTotalMass(released.context, [released.scene.objects["object"]])
    assert_allclose(carried, mass * 9.81, rtol=0.01)


def test_the_lid_is_a_joint_of_the_free_carton() -> None:
    released = Released("cardboard_box.sdf", RigidTransform([1, 0, 0.7]), 5.0, free=True)
    scene = released.scene
    assert [j.name() for j in object_joints(scene.plant, scene.objects["object"])] == ["hinge"]
