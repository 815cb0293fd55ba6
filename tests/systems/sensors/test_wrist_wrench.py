import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from crossmodal.systems.sensors.wrist_wrench import (
    ReactionWrench,
    WristWrenchConfig,
    WristWrenchSensor,
    force_in_sensor,
)

MASS = 0.8
EXACT = {"noise_torque": 0.0, "noise_force": 0.0, "bias_torque": 0.0, "bias_force": 0.0}


def samples(config, F_S, count, seed=0):
    sensor = WristWrenchSensor(config, seed)
    return np.array([sensor.measure(np.asarray(F_S, dtype=float), k) for k in range(count)])


def test_a_force_moves_to_the_sensor_and_turns_into_its_axes():
    X_JcS = RigidTransform(RollPitchYaw(0.0, 0.0, np.pi / 2.0), [0.1, 0.0, 0.0])
    F_Jc = SpatialForce(tau=np.array([0.0, 0.0, 0.5]), f=np.array([0.0, 2.0, 0.0]))
    # About So the force's arm is -0.1 m along x: 0.5 - 0.2; S's x is Jc's y.
    np.testing.assert_allclose(
        force_in_sensor(F_Jc, X_JcS, 1.0), [0.0, 0.0, 0.3, 2.0, 0.0, 0.0], atol=1e-12
    )
    np.testing.assert_allclose(
        force_in_sensor(F_Jc, X_JcS, -1.0), [0.0, 0.0, -0.3, -2.0, 0.0, 0.0], atol=1e-12
    )


def test_a_resting_hand_weighs_on_the_sensor_in_the_plant():
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(MultibodyPlantConfig(time_step=0.002), builder)
    p_BoBcm = np.array([0.05, 0.0, 0.0])
    inertia = SpatialInertia.SolidSphereWithMass(MASS, 0.04).Shift(-p_BoBcm)
    hand = plant.AddRigidBody("hand", inertia)
    joint = plant.WeldFrames(plant.world_frame(), hand.body_frame())
    plant.Finalize()
    p_JcS = np.array([0.0, 0.0, -0.03])
    wrench = builder.AddSystem(ReactionWrench(plant, joint, RigidTransform(p_JcS)))
    builder.Connect(plant.get_reaction_forces_output_port(), wrench.get_input_port())
    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.AdvanceTo(0.01)
    F_S = wrench.get_output_port().Eval(wrench.GetMyContextFromRoot(simulator.get_context()))
    weight = MASS * 9.81
    np.testing.assert_allclose(F_S, [0.0, weight * 0.05, 0.0, 0.0, 0.0, -weight], atol=1e-6)


def test_noise_and_bias_have_their_deviations():
    config = WristWrenchConfig()
    spread = samples(config, np.zeros(6), 4000).std(axis=0)
    sigma = np.repeat([config.noise_torque, config.noise_force], 3)
    step = np.repeat([config.step_torque, config.step_force], 3)
    np.testing.assert_allclose(spread, np.sqrt(sigma**2 + step**2 / 12.0), rtol=0.06)

    quiet = WristWrenchConfig(noise_torque=0.0, noise_force=0.0)
    biases = np.array([samples(quiet, np.zeros(6), 1, seed)[0] for seed in range(2000)])
    expected = np.repeat([config.bias_torque, config.bias_force], 3)
    np.testing.assert_allclose(biases.std(axis=0), expected, rtol=0.06)
    np.testing.assert_allclose(biases.mean(axis=0) / expected, 0.0, atol=0.08)


def test_measurements_come_in_steps_within_half_a_step_of_the_truth():
    config = WristWrenchConfig(**EXACT)
    F_S = np.array([0.1234, -0.5678, 0.0007, 3.1415, -2.7182, 0.011])
    measured = samples(config, F_S, 1)[0]
    step = np.repeat([config.step_torque, config.step_force], 3)
    np.testing.assert_allclose(measured / step, np.round(measured / step), atol=1e-9)
    assert (np.abs(measured - F_S) <= 0.5 * step + 1e-12).all()


def test_an_overload_saturates_and_the_axial_range_is_larger():
    measured = samples(WristWrenchConfig(**EXACT), [50, -50, 0, 300, -300, 300], 1)[0]
    np.testing.assert_allclose(measured, [10, -10, 0, 130, -130, 300])


@pytest.mark.parametrize("field", ["period", "noise_force", "step_torque", "range_force_axial"])
def test_impossible_values_are_refused_by_name(field):
    with pytest.raises(ValueError, match=f"WristWrenchSensor: {field}"):
        WristWrenchSensor(WristWrenchConfig(**{field: -1.0}), 0)
