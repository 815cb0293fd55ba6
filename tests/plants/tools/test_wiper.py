import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from crossmodal.plants.parsing import add_model, make_parser
from crossmodal.plants.scene import PlantConfig
from crossmodal.plants.tools.wiper import Wiper, WiperConfig, draw_wiper, wiper_sdf


def wiper(seed: int = 0) -> Wiper:
    return draw_wiper(WiperConfig(), np.random.default_rng(seed))


def fixed(model: Wiper, time_step: float = 0.0) -> MultibodyPlant:
    """A wiper whose handle is fixed in the world."""
    plant = MultibodyPlant(time_step)
    tool = add_model(make_parser(plant), wiper_sdf(model), "tool")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("body", tool))
    plant.Finalize()
    return plant


def test_every_number_is_drawn_between_its_ends() -> None:
    config = WiperConfig()
    drawn = [vars(wiper(seed)) for seed in range(200)]
    for name, (low, high) in vars(config).items():
        values = np.array([numbers[name] for numbers in drawn])
        assert np.all((values >= low) & (values <= high))
        assert_allclose([values.min(), values.max()], [low, high], atol=0.05 * (high - low))


def test_a_range_that_is_upside_down_is_refused() -> None:
    config = WiperConfig(flap_length=np.array([0.1, 0.07]))
    with pytest.raises(ValueError, match=r"flap_length = \[0.1, 0.07\] m, need two numbers"):
        draw_wiper(config, np.random.default_rng(0))


def test_the_edge_is_the_flap_s_length_below_the_hinge_and_turns_forwards_and_up() -> None:
    numbers = wiper()
    plant = fixed(numbers)
    context = plant.CreateDefaultContext()
    edge = plant.GetFrameByName("edge")
    assert_allclose(
        edge.CalcPoseInWorld(context).translation(),
        [numbers.hinge_offset, 0.0, -numbers.flap_length],
        atol=1e-6,
    )
    plant.GetJointByName("hinge").set_angle(context, np.pi / 2)
    assert_allclose(
        edge.CalcPoseInWorld(context).translation(),
        [numbers.flap_length, 0.0, numbers.hinge_offset],
        atol=1e-6,
    )


@pytest.mark.parametrize("seed", range(5))
def test_the_level_flap_s_weight_turns_it_by_its_imbalance(seed: int) -> None:
    plant = fixed(wiper(seed))
    context = plant.CreateDefaultContext()
    plant.GetJointByName("hinge").set_angle(context, np.pi / 2)
    torque = plant.CalcGravityGeneralizedForces(context)
    assert_allclose(torque, [-wiper(seed).imbalance], atol=1e-5)


def test_the_flap_stays_level_by_its_friction_alone() -> None:
    plant, simulator = _braked(wiper(1))
    simulator.AdvanceTo(2.0)
    context = plant.GetMyContextFromRoot(simulator.get_context())
    assert_allclose(plant.GetPositions(context), [np.pi / 2], atol=np.deg2rad(0.05))


def test_more_than_friction_and_weight_turns_the_flap() -> None:
    """It gives way to a torque above its friction, and holds against one below."""
    numbers = wiper(1)
    for share, turns in ((0.9, False), (1.3, True)):
        plant, simulator = _braked(numbers)
        torque = numbers.imbalance + share * numbers.friction
        context = plant.GetMyContextFromRoot(simulator.get_mutable_context())
        plant.get_applied_generalized_force_input_port().FixValue(context, [torque])
        simulator.AdvanceTo(0.5)
        turned = plant.GetPositions(context)[0] - np.pi / 2
        assert (turned > np.deg2rad(5.0)) == turns


def _braked(numbers: Wiper) -> tuple[MultibodyPlant, Simulator]:
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(
        MultibodyPlantConfig(
            time_step=0.005, discrete_contact_approximation=PlantConfig().contact_approximation
        ),
        builder,
    )
    tool = add_model(make_parser(plant), wiper_sdf(numbers), "tool")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("body", tool))
    plant.Finalize()
    simulator = Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    plant.GetJointByName("hinge").set_angle(context, np.pi / 2)
    plant.get_desired_state_input_port(tool).FixValue(context, [0.0, 0.0])
    return plant, simulator
