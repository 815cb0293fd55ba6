import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.geometry import Role
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from crossmodal.models import SDF_DIR
from crossmodal.plants.parsing import add_model, make_parser
from crossmodal.systems.sensors.taxels import (
    TaxelFault,
    TaxelForces,
    TaxelsConfig,
    TaxelSensor,
    calibration_factor,
    draw_places,
    felt_shares,
    pressure_on,
)
from crossmodal.systems.tactile.taxel_layout import fingertip_layout

LAYOUT = fingertip_layout()
SPREAD = 0.0025
GRAVITY = 9.81
WEIGHT = 0.5  # [N]

BLOCK = """<?xml version="1.0"?>
<sdf version="1.9" xmlns:drake="drake.mit.edu">
  <model name="block">
    <link name="rail"/>
    <link name="block">
      <inertial><mass>{mass}</mass>
        <inertia><ixx>1e-5</ixx><iyy>1e-5</iyy><izz>1e-5</izz></inertia></inertial>
      <collision name="block"><geometry><box><size>0.05 0.05 0.02</size></box></geometry>
        <drake:proximity_properties><drake:rigid_hydroelastic/>
          <drake:mesh_resolution_hint>1</drake:mesh_resolution_hint>
        </drake:proximity_properties></collision>
    </link>
    <joint name="slide" type="prismatic"><parent>rail</parent><child>block</child>
      <axis><xyz>0 0 1</xyz><limit><effort>0</effort></limit></axis></joint>
  </model>
</sdf>
"""


class Pressed:
    """A block of known weight, on a vertical slide, rests on the pad, which looks up."""

    def __init__(self, p_WS: np.ndarray) -> None:
        builder = DiagramBuilder()
        plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.002)
        parser = make_parser(plant)
        finger = add_model(parser, SDF_DIR / "tactile_fingertip.sdf", "fingertip")
        block = add_model(parser, BLOCK.format(mass=WEIGHT / GRAVITY), "block")
        frame = plant.GetFrameByName("end_effector", finger)
        y_up = RotationMatrix(np.column_stack([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]))
        self.X_WS = RigidTransform(y_up, p_WS)
        plant.WeldFrames(plant.world_frame(), frame, self.X_WS)
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("rail", block))
        plant.Finalize()
        body = plant.GetBodyFrameIdOrThrow(frame.body().index())
        skin = scene_graph.model_inspector().GetGeometryIdByName(
            body, Role.kProximity, "fingertip::tip"
        )
        taxels = builder.AddSystem(TaxelForces(plant, frame, skin, LAYOUT.p_ST, LAYOUT.n_S, SPREAD))
        for port in ("contact_results", "body_poses"):
            source = plant.GetOutputPort(port)
            builder.Connect(source, taxels.GetInputPort(port))
        simulator = Simulator(builder.Build())
        context = simulator.get_mutable_context()
        start = p_WS[2] + 0.010 + 0.010  # The pad's height, and half of the block's.
        plant.SetPositions(plant.GetMyMutableContextFromRoot(context), [start])
        simulator.AdvanceTo(1.0)
        self.forces = np.array(taxels.get_output_port().Eval(taxels.GetMyContextFromRoot(context)))
        contacts = plant.get_contact_results_output_port().Eval(plant.GetMyContextFromRoot(context))
        self.pressure = pressure_on(contacts, skin, self.X_WS)


@pytest.fixture(scope="module")
def pressed() -> Pressed:
    return Pressed(np.array([0.001, 0.002, 0.3]))


def test_the_pressure_carries_the_weight(pressed: Pressed) -> None:
    assert_allclose(pressed.pressure.f_S, [0.0, WEIGHT, 0.0], atol=0.01 * WEIGHT)
    normal = pressed.pressure.force @ pressed.pressure.n_S
    assert_allclose(normal, [0.0, WEIGHT, 0.0], atol=0.01 * WEIGHT)


def test_the_pressure_is_on_the_fingertip_s_surface(pressed: Pressed) -> None:
    level = np.sum((pressed.pressure.p_SQ / LAYOUT.semi_axes) ** 2, axis=1)
    assert np.all((level > 0.75) & (level <= 1.01))
    centre = pressed.pressure.force @ pressed.pressure.p_SQ / np.sum(pressed.pressure.force)
    assert_allclose(centre[[0, 2]], [0.0, 0.0], atol=2e-4)


def test_the_taxels_vector_sum_is_the_force_that_presses(pressed: Pressed) -> None:
    assert_allclose(pressed.forces @ LAYOUT.n_S, [0.0, WEIGHT, 0.0], atol=0.03 * WEIGHT)


def test_the_four_taxels_in_the_middle_feel_alike_and_most(pressed: Pressed) -> None:
    middle = pressed.forces[[0, 3, 8, 11]]
    assert_allclose(middle, np.mean(middle), rtol=0.05)
    assert np.sum(middle) > 0.9 * np.sum(pressed.forces)


def test_a_force_is_shared_and_none_is_made() -> None:
    rng = np.random.default_rng(0)
    shares = felt_shares(rng.uniform(-0.02, 0.02, (200, 3)), LAYOUT.p_ST, SPREAD)
    assert np.all(shares >= 0.0)
    assert np.all(shares.sum(axis=1) < 1.0)


def test_a_force_beside_the_pad_is_not_felt() -> None:
    shares = felt_shares(np.array([[0.0, -0.010, 0.0], [0.0, 0.0, -0.015]]), LAYOUT.p_ST, SPREAD)
    assert np.all(shares < 0.1)


def test_a_force_on_a_taxel_is_mostly_its_own() -> None:
    shares = felt_shares(LAYOUT.p_ST, LAYOUT.p_ST, SPREAD)
    assert_allclose(np.argmax(shares, axis=1), np.arange(12))
    assert np.all(np.diag(shares) > 0.75)


def test_the_calibration_makes_up_for_normals_that_spread() -> None:
    normals = LAYOUT.n_S[[0, 3, 8, 11]]
    factor = calibration_factor(LAYOUT.p_ST[[0, 3, 8, 11]], normals, 0.02)
    assert_allclose(factor, 1.0 / np.linalg.norm(normals.mean(axis=0)), rtol=0.02)


def test_noise_is_white_and_weak_readings_are_nothing() -> None:
    sensor = TaxelSensor(TaxelsConfig(noise=0.01, threshold=0.03), 12, seed=0)
    samples = np.array([sensor.measure(np.full(12, 0.5), index) for index in range(2000)])
    assert_allclose(samples.mean(), 0.5, atol=3e-4)
    assert_allclose(samples.std(axis=0), 0.01, rtol=0.08)
    quiet = np.array([sensor.measure(np.zeros(12), index) for index in range(2000)])
    assert np.mean(quiet > 0.0) < 0.003
    assert np.all((quiet == 0.0) | (quiet >= 0.03))


def test_a_dead_and_a_stuck_taxel_read_one_value_from_their_start_on() -> None:
    faults = [TaxelFault(taxel=3, start=1.0, end=2.0), TaxelFault(taxel=8, reading=0.2)]
    sensor = TaxelSensor(TaxelsConfig(noise=0.0), 12, seed=0, faults=faults)
    before, during, after = (sensor.measure(np.ones(12), k) for k in (99, 100, 200))
    assert_allclose(before[[3, 8, 0]], [1.0, 0.2, 1.0])
    assert_allclose(during[[3, 8, 0]], [0.0, 0.2, 1.0])
    assert_allclose(after[[3, 8, 0]], [1.0, 0.2, 1.0])


def test_a_fault_of_a_taxel_that_is_not_there_is_refused() -> None:
    with pytest.raises(ValueError, match=r"taxel = 12, need < 12"):
        TaxelSensor(TaxelsConfig(), 12, seed=0, faults=[TaxelFault(taxel=12)])


def test_all_taxels_are_off_their_places_by_the_same() -> None:
    off = [draw_places(LAYOUT.p_ST, TaxelsConfig(), seed) - LAYOUT.p_ST for seed in range(300)]
    assert_allclose(np.ptp(off, axis=1), 0.0, atol=1e-12)
    assert_allclose(np.std([shift[0] for shift in off], axis=0), 0.0005, rtol=0.15)
