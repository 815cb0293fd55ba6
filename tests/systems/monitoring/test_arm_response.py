"""An arm that is pushed moves; one whose sensor jumps does not."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import PrismaticJoint, SpatialInertia, UnitInertia

from crossmodal.maths.arrays import Array
from crossmodal.systems.monitoring.arm_response import ArmResponse, ArmResponseConfig
from crossmodal.systems.monitoring.steps import Step
from crossmodal.systems.port_values import SampleWindow

MASS = 2.0
CONFIG = ArmResponseConfig()
STEP = Step(since=0.99, time=1.0, size=np.array([0, 0, 0, 5.0, 0, 0]), variance=np.zeros(6))


@pytest.fixture(scope="module")
def slider() -> ArmResponse:
    """A mass that slides along x and carries the sensor."""
    plant = MultibodyPlant(0.0)
    inertia = SpatialInertia(MASS, [0.0, 0.0, 0.0], UnitInertia.SolidSphere(0.1))
    body = plant.AddRigidBody("sensor", inertia)
    plant.AddJoint(PrismaticJoint("slide", plant.world_frame(), body.body_frame(), [1.0, 0.0, 0.0]))
    plant.Finalize()
    assert plant.num_positions() == 1
    return ArmResponse(CONFIG, plant)


def moved(acceleration: float, before: float = 0.0, seed: int = 0) -> SampleWindow:
    """Encoders of a mass that accelerates from 0.995 s on, and has moved already."""
    times = 0.8 + 0.005 * np.arange(60)
    rate = 0.2 + before * times + acceleration * np.maximum(times - 0.995, 0.0)
    rate = rate + 5e-3 * np.random.default_rng(seed).standard_normal(60)
    return SampleWindow(times=times, values=np.column_stack([np.zeros(60), rate]))


def test_a_force_accelerates_the_mass(slider: ArmResponse) -> None:
    F_S: Array = np.array([0.0, 0.0, 0.0, 5.0, 7.0, 0.0])
    assert_allclose(slider.acceleration(np.zeros(1), F_S), [5.0 / MASS])


def test_a_step_of_the_sensor_alone_is_not_felt(slider: ArmResponse) -> None:
    strong = Step(since=0.99, time=1.0, size=20.0 * STEP.size, variance=np.zeros(6))
    for seed in range(50):
        assert not slider.is_sensed(strong, moved(0.0, before=2.0, seed=seed))


def test_a_real_step_is_felt_even_if_motors_take_half_of_it(slider: ArmResponse) -> None:
    strong = Step(since=0.99, time=1.0, size=20.0 * STEP.size, variance=np.zeros(6))
    for share in (1.0, 0.5, -0.5):
        assert slider.is_sensed(strong, moved(share * 100.0 / MASS))


def test_a_step_that_noise_would_hide_counts_as_felt(slider: ArmResponse) -> None:
    weak = Step(since=0.99, time=1.0, size=0.1 * STEP.size, variance=np.zeros(6))
    assert slider.is_sensed(weak, moved(0.0))


def test_without_encoders_about_the_step_it_counts_as_felt(slider: ArmResponse) -> None:
    motion = moved(0.0)
    early = SampleWindow(times=motion.times - 0.5, values=motion.values)
    assert slider.is_sensed(STEP, early)
    assert slider.is_sensed(STEP, SampleWindow(times=np.zeros(0), values=np.zeros((0, 2))))


def test_the_frame_of_the_sensor_must_exist() -> None:
    plant = MultibodyPlant(0.0)
    plant.AddModelInstance("empty")
    plant.Finalize()
    with pytest.raises(RuntimeError, match="sensor"):
        ArmResponse(CONFIG, plant)
