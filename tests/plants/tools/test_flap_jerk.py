"""A hand that jerks the flap of a tool carries its edge as far as asked for, and lets go."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from crossmodal.plants.parsing import add_model, make_parser
from crossmodal.plants.scene import PlantConfig
from crossmodal.plants.tools.flap_jerk import FlapJerk, FlapJerks, share_of_displacement
from crossmodal.plants.tools.wiper import EDGE_FRAME, HINGE, WiperConfig, draw_wiper, wiper_sdf

STEP = 0.005  # [s]


def jerked(
    jerks: list[FlapJerk], start: float, times: list[float], seed: int = 0, shorter: float = 1.0
) -> list[float]:
    """How far the edge of a wiper's flap, whose handle is fixed, has gone at some times, [m]."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(
        MultibodyPlantConfig(
            time_step=STEP, discrete_contact_approximation=PlantConfig().contact_approximation
        ),
        builder,
    )
    config = WiperConfig()
    config.flap_length = config.flap_length * shorter
    wiper = draw_wiper(config, np.random.default_rng(seed))
    tool = add_model(make_parser(plant), wiper_sdf(wiper), "tool")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("body", tool))
    plant.Finalize()
    hinge, edge = plant.GetJointByName(HINGE, tool), plant.GetFrameByName(EDGE_FRAME, tool)
    hand = builder.AddSystem(FlapJerks(plant, hinge, edge, jerks))
    builder.Connect(plant.get_body_poses_output_port(), hand.GetInputPort("body_poses"))
    builder.Connect(plant.get_state_output_port(tool), hand.GetInputPort("tool_state"))
    builder.Connect(hand.get_output_port(), plant.get_applied_spatial_force_input_port())
    simulator = Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    plant.get_desired_state_input_port(tool).FixValue(context, [0.0, 0.0])
    hinge.set_angle(context, start)
    simulator.Initialize()
    lever = float(np.hypot(wiper.flap_length, wiper.hinge_offset))
    found = []
    for time in times:
        simulator.AdvanceTo(time)
        found.append(lever * hinge.get_angle(context))
    return found


def test_the_way_is_smooth_and_whole() -> None:
    jerk = FlapJerk(start=1.0, end=1.4)
    assert share_of_displacement(jerk, 0.5) == (0.0, 0.0)
    assert share_of_displacement(jerk, 1.4) == (1.0, 0.0)
    share, rate = share_of_displacement(jerk, 1.2)
    assert share == pytest.approx(0.5)
    slope = (share_of_displacement(jerk, 1.2001)[0] - share_of_displacement(jerk, 1.1999)[0]) / 2e-4
    assert rate == pytest.approx(slope, rel=1e-4)


@pytest.mark.parametrize("way", [0.03, -0.03])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_edge_goes_as_far_as_asked_for_and_stays_there(way: float, seed: int) -> None:
    jerk = FlapJerk(displacement=way, start=0.1, end=0.4)
    before, carried, later = jerked([jerk], 0.8, [0.1, 0.4, 0.8], seed)
    assert_allclose(carried - before, way, atol=0.002)
    assert_allclose(later, carried, atol=0.001)


@pytest.mark.parametrize("seed", [0, 2])
def test_a_light_flap_is_led_as_far(seed: int) -> None:
    """A hand that is too stiff for the plant's steps would fling it."""
    jerk = FlapJerk(start=0.1, end=0.4)
    before, carried, later = jerked([jerk], 0.8, [0.1, 0.4, 0.8], seed, shorter=0.7)
    assert_allclose(carried - before, jerk.displacement, atol=0.002)
    assert_allclose(later, carried, atol=0.001)


def test_one_follows_the_other() -> None:
    there = FlapJerk(displacement=0.03, start=0.1, end=0.4)
    back = FlapJerk(displacement=-0.03, start=0.5, end=0.8)
    before, _, after = jerked([there, back], 0.8, [0.1, 0.45, 0.9])
    assert_allclose(after, before, atol=0.003)


def test_an_end_before_the_start_is_refused() -> None:
    with pytest.raises(ValueError, match=r"FlapJerk: end = 0\.3 s, need > start"):
        jerked([FlapJerk(start=1.0)], 0.0, [])
