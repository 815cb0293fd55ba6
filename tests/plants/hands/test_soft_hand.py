"""What the soft hand holds: closed around a bar that is then drawn out of it."""

import numpy as np
import pytest
from pydrake.geometry import (
    AddRigidHydroelasticProperties,
    Box,
    CollisionFilterDeclaration,
    Cylinder,
    GeometrySet,
    ProximityProperties,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    CoulombFriction,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import ModelInstanceIndex, PrismaticJoint, RigidBody, SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, MatrixGain

from crossmodal.plants.hands.pneumatic_hand import PneumaticHand, PneumaticHandConfig
from crossmodal.plants.hands.soft_hand import HAND_FILE, SOFT_HAND_RANGE, finger_selection
from crossmodal.plants.parsing import add_model, make_parser
from crossmodal.plants.scene import PlantConfig

CAN = SOFT_HAND_RANGE
# A bar that has come out so far is between the tips of the fingers, no longer within them, [m].
OUT = 0.035


def add_bar(
    plant: MultibodyPlant,
    shape: Shape,
    X_EShape: RigidTransform,
    panel: float,
    axis: list[float],
    stem: float,
) -> RigidBody:
    """A shape in front of a panel at z of E = `panel`, that slides along an axis of E (3,).

    Args:
        stem: Radius of what is between both, [m]; zero for nothing.
    """
    instance = plant.AddModelInstance("bar")
    inertia = SpatialInertia.SolidCylinderWithMass(2.0, 0.05, 0.2, [0, 1, 0])
    body = plant.AddRigidBody("bar", instance, inertia)
    slide = PrismaticJoint("slide", plant.world_frame(), body.body_frame(), axis, -1, 1, 8.0)
    plant.AddJointActuator("puller", plant.AddJoint(slide))
    properties = ProximityProperties()
    AddRigidHydroelasticProperties(0.012, properties)
    properties.AddProperty("material", "coulomb_friction", CoulombFriction(1.0, 1.0))
    plant.RegisterCollisionGeometry(body, X_EShape, shape, "bar", properties)
    if stem:
        X_EStem = RigidTransform([0, 0, 0.5 * panel])
        plant.RegisterCollisionGeometry(body, X_EStem, Cylinder(stem, panel), "stem", properties)
    if np.isfinite(panel):
        behind, friction = RigidTransform([0, 0, panel + 0.01]), CoulombFriction(0.5, 0.5)
        plant.RegisterCollisionGeometry(body, behind, Box(0.4, 0.4, 0.02), "panel", friction)
    return body


def ignore_self_collision(plant: MultibodyPlant, scene_graph, hand: ModelInstanceIndex) -> None:  # type: ignore[no-untyped-def]
    shapes = [
        shape
        for index in plant.GetBodyIndices(hand)
        for shape in plant.GetCollisionGeometriesForBody(plant.get_body(index))
    ]
    declaration = CollisionFilterDeclaration().ExcludeWithin(GeometrySet(shapes))
    scene_graph.collision_filter_manager().Apply(declaration)


def slip(
    force: float, thickness: float = 0.018, clearance: float = 0.06, off: float = 0.0
) -> float:
    """How far a bar along y of E comes out of the hand, drawn by a force along z of E, [m]."""
    X_EBar = RigidTransform(RotationMatrix.MakeXRotation(np.pi / 2), [0, 0, off])
    panel = off + thickness / 2 + clearance
    return slip_of(force, Cylinder(thickness / 2, 0.17), X_EBar, panel, [0, 0, 1])


def slip_of(
    force: float,
    shape: Shape,
    X_EShape: RigidTransform,
    panel: float,
    axis: list[float],
    stem: float = 0.0,
) -> float:
    """How far a shape comes out of the hand, drawn by a force along an axis of E, [m]."""
    builder = DiagramBuilder()
    config = MultibodyPlantConfig(
        time_step=0.006, discrete_contact_approximation=PlantConfig().contact_approximation
    )
    plant, scene_graph = AddMultibodyPlant(config, builder)
    plant.mutable_gravity_field().set_gravity_vector([0, 0, 0])
    hand = add_model(make_parser(plant), HAND_FILE, "hand")
    end_effector = plant.GetFrameByName("end_effector", hand)
    plant.WeldFrames(plant.world_frame(), end_effector)
    bar = add_bar(plant, shape, X_EShape, panel, axis, stem)
    plant.Finalize()
    ignore_self_collision(plant, scene_graph, hand)
    air = builder.AddSystem(PneumaticHand(PneumaticHandConfig()))
    fingers = builder.AddSystem(MatrixGain(finger_selection(plant, hand)))
    builder.Connect(plant.get_state_output_port(hand), fingers.get_input_port())
    builder.Connect(fingers.get_output_port(), air.GetInputPort("hand_state"))
    builder.Connect(air.GetOutputPort("joint_torques"), plant.get_actuation_input_port(hand))
    sealed = builder.AddSystem(ConstantVectorSource([0.0]))
    for source, port in (
        (builder.AddSystem(ConstantVectorSource([6e4, 6e4, 6e4, 8e4])), "pressure_commanded"),
        (sealed, "sealed"),
    ):
        builder.Connect(source.get_output_port(), air.GetInputPort(port))
    pull = builder.AddSystem(ConstantVectorSource([0.0]))
    pulled = plant.get_actuation_input_port(bar.model_instance())
    builder.Connect(pull.get_output_port(), pulled)
    simulator = Simulator(builder.Build())
    root = simulator.get_mutable_context()
    context = plant.GetMyMutableContextFromRoot(root)
    plant.GetJointByName("slide").Lock(context)
    simulator.AdvanceTo(1.5)
    plant.GetJointByName("slide").Unlock(context)
    for source, value in ((sealed, 1.0), (pull, force)):
        source.get_mutable_source_value(source.GetMyMutableContextFromRoot(root)).set_value([value])
    simulator.AdvanceTo(2.5)
    return float(plant.GetPositions(context, bar.model_instance())[0])


@pytest.mark.parametrize(
    "case",
    [
        {"thickness": CAN.least_thickness, "force": 15.0},
        {"thickness": CAN.most_thickness, "force": 25.0},
        {"clearance": CAN.behind - 0.009, "force": 15.0},
        {"clearance": CAN.clearance, "off": CAN.tips - 0.009 - CAN.clearance, "force": 25.0},
        {"off": CAN.reach, "force": 25.0},
    ],
)
def test_the_hand_holds_what_is_in_its_range(case: dict[str, float]) -> None:
    assert slip(**case) < OUT


@pytest.mark.parametrize(
    ("radius", "stem"),
    [(0.5 * CAN.least_knob, 0.003), (0.5 * CAN.least_knob, 0.006), (0.02, 0.008)],
)
def test_the_hand_holds_knobs_also_on_a_stem(radius: float, stem: float) -> None:
    panel = max(CAN.behind, radius + CAN.clearance)
    assert slip_of(15.0, Sphere(radius), RigidTransform(), panel, [0, 0, 1], stem) < OUT


@pytest.mark.parametrize("thickness", [CAN.least_thickness, CAN.most_thickness])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_hand_holds_the_edge_of_a_board_that_moves_across_it(
    thickness: float, sign: float
) -> None:
    inside = RigidTransform([0, 0, 0.15 - 0.02])  # Its edge is 2 cm before the frame.
    assert slip_of(8.0, Box(thickness, 0.4, 0.3), inside, np.inf, [sign, 0, 0]) < OUT


@pytest.mark.parametrize("case", [{"off": 2 * CAN.reach}, {"thickness": 0.5 * CAN.least_thickness},
                                  {"clearance": 0.4 * CAN.behind}])  # fmt: skip
def test_the_hand_loses_what_is_out_of_its_range(case: dict[str, float]) -> None:
    assert slip(25.0, **case) > OUT
