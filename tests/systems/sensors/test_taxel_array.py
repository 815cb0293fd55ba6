"""Taxels of a gripper: the forces on them in a plant, and what their sensor makes of these."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from crossmodal.maths.arrays import Array
from crossmodal.models.gripper_taxels import ARRAYS, RADIUS, gripper_taxels
from crossmodal.plants.hands.taxel_gripper import GRIPPER_FILE, finger_shapes
from crossmodal.plants.parsing import add_model, make_parser
from crossmodal.systems.sensors.taxel_array import (
    TaxelArrayConfig,
    TaxelArrayFault,
    TaxelArrayForces,
    TaxelArraySensor,
)

GRAVITY, WEIGHT = 9.81, 0.6  # [m/s^2], [N]
LAYOUT = gripper_taxels()
TIPS = [k for k, array in enumerate(LAYOUT.array) if ARRAYS[array].endswith("tip")]
EXACT = TaxelArrayConfig(noise=0.0, offset=0.0)
SAMPLES = 2000

BLOCK = f"""<?xml version="1.0"?>
<sdf version="1.9">
  <model name="block">
    <link name="rail"/>
    <link name="block">
      <inertial><mass>{WEIGHT / GRAVITY}</mass>
        <inertia><ixx>1e-5</ixx><iyy>1e-5</iyy><izz>1e-5</izz></inertia></inertial>
      <collision name="block"><geometry><box><size>0.1 0.1 0.02</size></box></geometry></collision>
    </link>
    <joint name="slide" type="prismatic"><parent>rail</parent><child>block</child>
      <axis><xyz>0 0 1</xyz><limit><effort>0</effort></limit></axis></joint>
  </model>
</sdf>
"""


# As heavy as the block, and so thin that it gets between taxels.
NEEDLE = BLOCK.replace(
    "<box><size>0.1 0.1 0.02</size></box>", "<sphere><radius>0.0005</radius></sphere>"
)


def pressed(X_WE: RigidTransform, model: str = BLOCK, lowest: float = -0.01) -> Array:
    """Forces on the taxels (140, 3) in E where a block, on a vertical slide, rests on the gripper.

    Args:
        X_WE: Of the gripper, which is closed and fixed in the world.
        model: Of the block.
        lowest: Height of its lowest points in its frame, [m].
    """
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.002)
    parser = make_parser(plant)
    gripper = add_model(parser, GRIPPER_FILE, "gripper")
    block = add_model(parser, model, "block")
    E = plant.GetFrameByName("end_effector", gripper)
    plant.WeldFrames(plant.world_frame(), E, X_WE)
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("rail", block))
    plant.Finalize()
    shapes = finger_shapes(plant, scene_graph.model_inspector(), gripper)
    forces = builder.AddSystem(TaxelArrayForces(plant, E, shapes.taxels, shapes.cores, LAYOUT))
    for port in ("contact_results", "body_poses"):
        builder.Connect(plant.GetOutputPort(port), forces.GetInputPort(port))
    simulator = Simulator(builder.Build())
    root = simulator.get_mutable_context()
    context = plant.GetMyMutableContextFromRoot(root)
    plant.get_desired_state_input_port(gripper).FixValue(context, np.zeros(4))
    top = (X_WE @ LAYOUT.p_FS.T)[2].max() + RADIUS
    plant.SetPositions(context, block, [top + 0.001 - lowest])
    simulator.AdvanceTo(1.0)
    found: Array = forces.get_output_port().Eval(forces.GetMyContextFromRoot(root))
    return np.array(found).reshape(-1, 3)


@pytest.mark.parametrize(
    "R_WE",
    [
        RotationMatrix(),
        RotationMatrix.MakeZRotation(0.7) @ RotationMatrix.MakeYRotation(0.4),
    ],
    ids=["upright", "leaning"],
)
def test_taxels_carry_what_rests_on_them(R_WE: RotationMatrix) -> None:
    """The force acts on the taxels: it points down in W, and against E's z where this is up."""
    forces = pressed(RigidTransform(R_WE, [0.0, 0.0, 0.3]))
    expected = R_WE.matrix().T @ [0.0, 0.0, -WEIGHT]
    assert_allclose(forces.sum(axis=0), expected, atol=0.01 * WEIGHT)
    others = np.delete(forces, TIPS, axis=0)
    assert not others.any()


def test_what_gets_between_taxels_presses_on_the_skin_there() -> None:
    """A needle amid four taxels of the left finger's outer face, which lies upwards."""
    outer = np.flatnonzero(LAYOUT.array == ARRAYS.index("left_outer"))
    amid = LAYOUT.p_FT[outer[[5, 6, 9, 10]]]
    R_WE = RotationMatrix.MakeYRotation(-0.5 * np.pi)
    X_WE = RigidTransform(R_WE, -(R_WE @ amid.mean(axis=0)))
    forces = pressed(X_WE, NEEDLE, -0.0005)
    assert_allclose(forces.sum(axis=0), [-WEIGHT, 0.0, 0.0], atol=0.01 * WEIGHT)
    assert set(np.flatnonzero(forces.any(axis=1))) <= set(outer[[5, 6, 9, 10]])


@pytest.mark.parametrize(
    ("place", "force", "taxel"),
    [
        ([0.0125, 0.001, -0.0075], [-1.0, 0.0, 0.5], "left_outer_2"),
        ([0.005, -0.011, -0.0045], [0.2, 0.0, -1.0], "left_tip_0"),
        ([0.0125, -0.012, -0.022], [-4.0, 0.6, -1.8], "left_outer_12"),
        ([0.0125, 0.001, -0.045], [-1.0, 0.0, 0.0], None),
        ([0.010, 0.012, -0.0075], [0.0, -1.0, 0.0], None),
    ],
    ids=["outer face", "end", "edge of the outer face", "bare part of the outer face", "bare side"],
)
def test_skin_reaches_a_little_beyond_its_taxels(
    place: list[float], force: list[float], taxel: str | None
) -> None:
    found = LAYOUT.under(0, np.array(place), np.array(force))
    assert (None if found is None else LAYOUT.names[found]) == (taxel and f"taxel_{taxel}")


def samples(sensor: TaxelArraySensor, forces: Array, count: int = SAMPLES) -> Array:
    return np.array([sensor.measure(forces, k) for k in range(count)])


def sensor_of(
    config: TaxelArrayConfig, seed: int = 0, faults: tuple[TaxelArrayFault, ...] = ()
) -> TaxelArraySensor:
    return TaxelArraySensor(config, ARRAYS, LAYOUT.array, seed, faults)


def test_noise_is_white_about_a_constant_offset() -> None:
    true = np.linspace(-0.5, 0.5, 420)
    read = samples(sensor_of(TaxelArrayConfig(noise=0.01, offset=0.05)), true)
    offsets = read.mean(axis=0) - true
    assert_allclose(np.std(offsets), 0.05, rtol=0.12)
    assert_allclose(np.mean(offsets), 0.0, atol=0.01)
    noise = read - read.mean(axis=0)
    assert_allclose(noise.std(axis=0), 0.01, rtol=0.1)
    assert abs(np.mean(noise[1:] * noise[:-1])) < 0.02 * 0.01**2
    assert abs(np.mean(noise[:, 1:] * noise[:, :-1])) < 0.02 * 0.01**2


def test_a_seed_decides_offsets_and_noise() -> None:
    config = TaxelArrayConfig()
    first, again, other = (samples(sensor_of(config, s), np.zeros(420), 3) for s in (1, 1, 2))
    assert_array_equal(first, again)
    assert np.abs(first - other).max() > 0.05


def test_it_saturates() -> None:
    true = np.array([5.0, -4.0, 2.9] + 417 * [0.0])
    assert_allclose(sensor_of(EXACT).measure(true, 0)[:4], [3.0, -3.0, 2.9, 0.0])
    wide = sensor_of(replace(EXACT, largest=4.5)).measure(true, 0)
    assert_allclose(wide[:3], [4.5, -4.0, 2.9])


def test_a_silent_and_a_stuck_array_read_one_value_for_a_time() -> None:
    faults = (
        TaxelArrayFault(array="left_tip", start=1.0, end=2.0),
        TaxelArrayFault(array="right_outer", reading=0.4, start=1.5),
    )
    sensor = sensor_of(EXACT, faults=faults)
    silent = np.repeat(LAYOUT.array == ARRAYS.index("left_tip"), 3)
    stuck = np.repeat(LAYOUT.array == ARRAYS.index("right_outer"), 3)
    assert (silent.sum(), stuck.sum()) == (18, 72)
    for time, of_silent, of_stuck in ((0.995, 1.0, 1.0), (1.0, 0.0, 1.0), (2.0, 1.0, 0.4)):
        read = sensor.measure(np.ones(420), round(time / EXACT.period))
        assert_array_equal(read[silent], np.full(18, of_silent))
        assert_array_equal(read[stuck], np.full(72, of_stuck))
        assert_array_equal(read[~(silent | stuck)], np.ones(330))


def test_a_fault_of_an_array_that_is_not_there_is_refused() -> None:
    message = r"array = 'left_thumb', but it must be one of left_phalange, .*right_inner$"
    with pytest.raises(ValueError, match=message):
        sensor_of(EXACT, faults=(TaxelArrayFault(array="left_thumb"),))


def test_false_contacts_come_as_often_as_is_said_one_taxel_at_a_time() -> None:
    config = replace(EXACT, false_contacts=2.0, false_force=0.3, false_time=0.05)
    sensor, per_slot = sensor_of(config), round(0.05 / EXACT.period)
    slots = 4000
    first = np.array([sensor.measure(np.zeros(420), k * per_slot + 1) for k in range(slots)])
    sizes = np.linalg.norm(first.reshape(slots, -1, 3), axis=2)
    touched = sizes.any(axis=1)
    expected = 2.0 * 0.05 * slots
    assert touched.sum() == pytest.approx(expected, abs=4.0 * np.sqrt(expected))
    assert np.all((sizes > 0.0).sum(axis=1) <= 1)
    assert_allclose(sizes[touched].max(axis=1), 0.3)
    assert len(set(sizes[touched].argmax(axis=1))) > 80
    # A slot is all of it or none of it.
    for slot in (int(np.argmax(touched)), int(np.argmin(touched))):
        within = [sensor.measure(np.zeros(420), slot * per_slot + k) for k in range(1, per_slot)]
        assert_array_equal(within, np.tile(first[slot], (per_slot - 1, 1)))


def test_there_are_no_false_contacts_unless_they_are_wanted() -> None:
    assert not samples(sensor_of(EXACT), np.zeros(420), 200).any()
