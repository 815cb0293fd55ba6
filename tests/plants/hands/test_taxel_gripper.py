"""The gripper in a plant: its taxels are where the layout says, meet things first, and feel."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    ContactResults,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from crossmodal.maths.arrays import Array
from crossmodal.models import SDF_DIR
from crossmodal.models.gripper_taxels import RADIUS, TRAVEL, gripper_taxels
from crossmodal.plants.hands.taxel_gripper import BODIES, GRIPPER_FILE, JOINTS, finger_shapes
from crossmodal.plants.parsing import add_model, make_parser


class Held:
    """The gripper, fixed in the world, its fingers down, and the can between them."""

    def __init__(self) -> None:
        builder = DiagramBuilder()
        config = MultibodyPlantConfig(
            time_step=0.005, discrete_contact_approximation="lagged", stiction_tolerance=1e-5
        )
        self.plant: MultibodyPlant
        self.scene_graph: SceneGraph
        self.plant, self.scene_graph = AddMultibodyPlant(config, builder)
        parser = make_parser(self.plant)
        self.gripper: ModelInstanceIndex = add_model(parser, GRIPPER_FILE, "gripper")
        add_model(parser, SDF_DIR / "goods" / "can" / "can.sdf", "can")
        X_WPalm = RigidTransform(RotationMatrix.MakeXRotation(np.pi), [0.0, 0.0, 0.27])
        palm = self.plant.GetFrameByName("palm", self.gripper)
        self.plant.WeldFrames(self.plant.world_frame(), palm, X_WPalm)
        self.plant.Finalize()
        self.simulator = Simulator(builder.Build())
        root = self.simulator.get_mutable_context()
        self.context = self.plant.GetMyMutableContextFromRoot(root)

    def taxel_forces(self) -> Array:
        """On each taxel (140, 3), in W, [N]."""
        shapes = finger_shapes(self.plant, self.scene_graph.model_inspector(), self.gripper).taxels
        index = {shape: k for k, shape in enumerate(shapes)}
        forces = np.zeros((140, 3))
        results: ContactResults = self.plant.get_contact_results_output_port().Eval(self.context)
        for k in range(results.num_point_pair_contacts()):
            contact = results.point_pair_contact_info(k)
            pair, force = contact.point_pair(), np.asarray(contact.contact_force())
            for shape, sign in ((pair.id_A, -1.0), (pair.id_B, 1.0)):
                if shape in index:
                    forces[index[shape]] += sign * force
        return forces


@pytest.fixture
def held() -> Held:
    return Held()


def test_the_taxels_are_where_the_layout_says(held: Held) -> None:
    plant, layout = held.plant, gripper_taxels()
    inspector = held.scene_graph.model_inspector()
    opening = np.array([0.02, 0.05])
    plant.SetPositions(held.context, held.gripper, opening)
    E = plant.GetFrameByName("end_effector", held.gripper)
    shapes = finger_shapes(plant, inspector, held.gripper).taxels
    p_ES = layout.p_ET(opening) - RADIUS * layout.n_E
    for k, shape in enumerate(shapes):
        body = plant.GetBodyFromFrameId(inspector.GetFrameId(shape))
        assert body.name() == BODIES[layout.finger[k]]
        X_EF = body.body_frame().CalcPose(held.context, E)
        found = X_EF @ inspector.GetPoseInFrame(shape).translation()
        assert_allclose(found, p_ES[k], atol=1e-6)
        assert_allclose(inspector.GetShape(shape).radius(), RADIUS)
        assert not inspector.GetProximityProperties(shape).HasGroup("hydroelastic")


def test_the_gripper_weighs_a_kilogram_and_opens_by_140_mm(held: Held) -> None:
    plant = held.plant
    bodies = map(plant.get_body, plant.GetBodyIndices(held.gripper))
    assert_allclose(sum(body.default_mass() for body in bodies), 1.0)
    joints = [plant.GetJointByName(name, held.gripper) for name in JOINTS]
    assert [joint.position_lower_limits()[0] for joint in joints] == [0.0, 0.0]
    assert_allclose([joint.position_upper_limits()[0] for joint in joints], TRAVEL)


@pytest.mark.parametrize("opening", [0.0, 0.03])
def test_a_plane_meets_a_taxel_of_the_tip_first(held: Held, opening: float) -> None:
    """From anywhere in front of the fingers: no core reaches as far as a taxel does."""
    spheres, cores = shapes_in_E(held, opening)
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(5000, 3))
    directions[:, 2] = np.abs(directions[:, 2])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    reach = (directions @ spheres.T).max(axis=1) + RADIUS
    corners = np.concatenate([corner for corner, _ in cores])
    assert (reach - (directions @ corners.T).max(axis=1)).min() > 3e-4
    within_45 = directions[:, 2] > np.cos(np.deg2rad(45.0))
    tips = spheres[spheres[:, 2] > -0.0031]
    assert len(tips) == 12
    assert_allclose(reach[within_45], (directions[within_45] @ tips.T).max(axis=1) + RADIUS)


@pytest.mark.parametrize("radius", [0.006, 0.01, 0.03])
def test_a_ball_meets_a_taxel_first(held: Held, radius: float) -> None:
    """It comes from up to 45 deg beside the approach, to any place of the closed fingers' end."""
    spheres, cores = shapes_in_E(held, 0.0)
    rng = np.random.default_rng(1)
    way = np.linspace(0.06, -0.03, 901)[:, None]
    for _ in range(100):
        tilt, turn = np.deg2rad(rng.uniform(0.0, 45.0)), rng.uniform(0.0, 2.0 * np.pi)
        along = np.array([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)])
        middle = rng.uniform([-0.014, -0.0135, 0.0], [0.014, 0.0135, 0.0]) + way * along
        to_spheres = np.linalg.norm(middle[:, None] - spheres, axis=-1).min(axis=1) - RADIUS
        to_cores = np.min(
            [
                np.linalg.norm(np.maximum(np.maximum(low - middle, middle - high), 0.0), axis=1)
                for _, (low, high) in cores
            ],
            axis=0,
        )
        assert np.argmax(to_spheres < radius) < np.argmax(to_cores < radius)


def shapes_in_E(
    held: Held, opening: float
) -> tuple[Array, list[tuple[Array, tuple[Array, Array]]]]:
    """Middles of the taxels (140, 3); of each core the corners (8, 3), and its extremes (3,)."""
    plant, inspector = held.plant, held.scene_graph.model_inspector()
    plant.SetPositions(held.context, held.gripper, [opening, opening])
    E = plant.GetFrameByName("end_effector", held.gripper)
    signs = np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3), axis=-1).reshape(-1, 3)
    spheres, cores = [], []
    for name in BODIES:
        body = plant.GetBodyByName(name, held.gripper)
        X_EF = body.body_frame().CalcPose(held.context, E)
        for shape in plant.GetCollisionGeometriesForBody(body):
            X_ES = X_EF @ inspector.GetPoseInFrame(shape)
            if inspector.GetName(shape).endswith("core"):
                size = inspector.GetShape(shape).size()
                corners = (X_ES @ (signs * size).T).T
                cores.append((corners, (corners.min(axis=0), corners.max(axis=0))))
            else:
                spheres.append(X_ES.translation())
    return np.array(spheres), cores


def test_it_holds_the_can_with_10_newtons(held: Held) -> None:
    plant = held.plant
    can = plant.GetBodyByName("can")
    start = np.array([0.0, 0.0, -0.02])
    plant.SetFreeBodyPose(held.context, can, RigidTransform(start))
    plant.SetPositions(held.context, held.gripper, [0.034, 0.034])
    plant.get_desired_state_input_port(held.gripper).FixValue(held.context, np.zeros(4))
    held.simulator.AdvanceTo(0.5)
    place = plant.GetFreeBodyPose(held.context, can).translation()
    assert_allclose(place, start, atol=5e-4)
    forces, finger = held.taxel_forces(), gripper_taxels().finger
    sums = np.array([forces[finger == k].sum(axis=0) for k in (0, 1)])
    assert_allclose(sums[:, 0], [10.0, -10.0], atol=0.1)
    weight = can.default_mass() * 9.81
    assert_allclose(sums[:, 2].sum(), -weight, atol=0.05)
    assert np.count_nonzero(np.linalg.norm(forces, axis=1) > 0.01) > 10
