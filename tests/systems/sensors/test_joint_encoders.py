import numpy as np
import pytest
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable

from crossmodal.models import SDF_DIR
from crossmodal.systems.sensors.joint_encoders import (
    JointEncoders,
    JointEncodersConfig,
    draw_joint_offset,
)


@pytest.fixture(scope="module")
def jacobian():
    """Of the arm's last link, (6, 7), with bent elbow and wrist."""
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModels(str(SDF_DIR / "wam_arm.sdf"))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.Finalize()
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, [0.3, 0.8, -0.4, 1.6, 0.5, -0.8, 0.2])
    world, link = plant.world_frame(), plant.GetFrameByName("link_7")
    return plant.CalcJacobianSpatialVelocity(
        context, JacobianWrtVariable.kV, link, np.array([0.0, 0.0, 0.15]), world, world
    )


def sample(encoders, q, index=0):
    return encoders.measure(np.concatenate([q, np.zeros(7)]), index)


def test_offsets_put_the_end_effector_off_by_one_centimetre_and_three_degrees(jacobian):
    config = JointEncodersConfig()
    rng = np.random.default_rng(0)
    offsets = np.array([draw_joint_offset(config, jacobian, rng) for _ in range(3000)])
    errors = offsets @ jacobian.T
    scale = np.repeat([np.deg2rad(3.0), 0.01], 3)
    covariance = np.cov((errors / scale).T)
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), 1.0, atol=0.15)
    assert np.abs(covariance - np.diag(np.diag(covariance))).max() < 0.2
    np.testing.assert_allclose(errors.mean(axis=0) / scale, 0.0, atol=0.06)


def test_no_joint_exceeds_its_limit_and_typical_ones_stay_small(jacobian):
    config = JointEncodersConfig()
    rng = np.random.default_rng(1)
    offsets = np.array([draw_joint_offset(config, jacobian, rng) for _ in range(2000)])
    assert np.abs(offsets).max() <= config.offset_limit
    assert np.rad2deg(offsets.std(axis=0)).max() < 5.5


def test_a_limit_that_no_draw_keeps_is_reached_by_scaling(jacobian):
    config = JointEncodersConfig(offset_limit=1e-3)
    offset = draw_joint_offset(config, jacobian, np.random.default_rng(2))
    np.testing.assert_allclose(np.abs(offset).max(), 1e-3)


def test_the_offset_is_constant_within_an_episode_and_differs_between_them(jacobian):
    config = JointEncodersConfig(stretch=0.0, noise_position=0.0)
    encoders, other = (JointEncoders(config, jacobian, seed) for seed in (0, 1))
    q = np.linspace(-1.0, 1.0, 7)
    offset = sample(encoders, q)[:7] - q
    np.testing.assert_allclose(sample(encoders, -q, 500)[:7] + q, offset, atol=1e-12)
    assert np.abs(sample(other, q)[:7] - q - offset).max() > 1e-3


def test_noise_is_white_about_the_offset_and_velocities_carry_no_offset(jacobian):
    config = JointEncodersConfig()
    encoders = JointEncoders(config, jacobian, 4)
    state = np.arange(14.0)
    samples = np.array([encoders.measure(state, index) for index in range(5000)])
    np.testing.assert_allclose(samples[:, :7].std(axis=0), config.noise_position, rtol=0.05)
    np.testing.assert_allclose(samples[:, 7:].std(axis=0), config.noise_velocity, rtol=0.05)
    np.testing.assert_allclose(samples[:, 7:].mean(axis=0), state[7:], atol=3e-4)


def test_the_stretch_varies_with_the_posture_by_no_more_than_its_amplitude(jacobian):
    config = JointEncodersConfig(stretch=0.002, noise_position=0.0)
    encoders = JointEncoders(config, jacobian, 0)
    postures = np.linspace(-3.0, 3.0, 200)[:, None] * np.ones(7)
    errors = np.array([sample(encoders, q)[:7] - q for q in postures])
    spread = errors.max(axis=0) - errors.min(axis=0)
    assert (spread <= 0.004 + 1e-12).all()
    assert (spread > 0.003).all()


def test_measuring_leaves_the_true_state_alone(jacobian):
    state = np.arange(14.0)
    JointEncoders(JointEncodersConfig(), jacobian, 0).measure(state, 0)
    np.testing.assert_array_equal(state, np.arange(14.0))


def test_the_same_seed_measures_the_same(jacobian):
    first, again = (JointEncoders(JointEncodersConfig(), jacobian, 9) for _ in range(2))
    np.testing.assert_array_equal(sample(first, np.zeros(7), 77), sample(again, np.zeros(7), 77))


@pytest.mark.parametrize(
    ("field", "value"),
    [("period", 0.0), ("noise_position", -1.0), ("offset_limit", float("nan"))],
)
def test_impossible_values_are_refused_by_name(jacobian, field, value):
    with pytest.raises(ValueError, match=f"JointEncoders: {field}"):
        JointEncoders(JointEncodersConfig(**{field: value}), jacobian, 0)


def test_where_it_is_read_is_what_reading_inverts(jacobian):
    """What is left is the noise; with a degree of stretch less than a hundredth of it."""
    config = JointEncodersConfig(stretch=0.02, noise_position=0.0)
    encoders = JointEncoders(config, jacobian, 3)
    for q in np.linspace(-2.0, 2.0, 9)[:, None] * np.ones(7):
        read = sample(encoders, q)[:7]
        assert np.abs(read - q).max() > 1e-3
        np.testing.assert_allclose(encoders.where_read(read), q, atol=1e-4)
