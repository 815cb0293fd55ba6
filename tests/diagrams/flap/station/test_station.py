"""The station of the flap application: what is true in it, and what leaves it."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context
from truth_paths import truth_paths, truth_references

from crossmodal.diagrams.flap.episode_parts import make_calibration
from crossmodal.diagrams.flap.scenario import Scenario
from crossmodal.diagrams.flap.station.station import FlapStation, make_flap_station
from crossmodal.diagrams.flap.station.tool_placement import draw_tool

Load = Callable[..., Scenario]
REACH = 0.010  # Of the pad from the fingertip's centre, [m].


def make(scenario: Scenario) -> FlapStation:
    return make_flap_station(scenario, make_calibration(scenario))


@pytest.fixture(scope="module")
def station(load: Load) -> FlapStation:
    return make(load("flap"))


@pytest.fixture(scope="module")
def held(station: FlapStation) -> tuple[Context, Context]:
    """The root context at first, and after 2 s in which the finger approaches the flap."""
    simulator = Simulator(station.diagram)
    root = simulator.get_mutable_context()
    station.initialise(root)
    simulator.Initialize()
    first = root.Clone()
    simulator.AdvanceTo(2.0)
    return first, root


def output(station: FlapStation, root: Context, port: str) -> object:
    return station.diagram.GetOutputPort(port).Eval(root)


def test_the_grasp_holds_the_tool(station: FlapStation, held: tuple[Context, Context]) -> None:
    plant = station.scene.plant
    hand = plant.GetFrameByName("end_effector", station.scene.model("holder_hand"))
    handle = plant.GetFrameByName("handle", station.scene.model("tool"))
    first, last = (handle.CalcPose(plant.GetMyContextFromRoot(root), hand) for root in held)
    moved = first.inverse() @ last
    assert np.linalg.norm(moved.translation()) < 1e-4
    assert moved.rotation().ToAngleAxis().angle() < np.deg2rad(0.05)


def test_the_flap_stays_and_nothing_touches_it(
    station: FlapStation, held: tuple[Context, Context]
) -> None:
    for root in held:
        truth = output(station, root, "cheat_flap")
        assert abs(truth.theta) < np.deg2rad(0.3)
        assert not truth.touching
    assert_allclose(output(station, held[1], "taxel_window").values, 0.0, atol=0.06)


def test_the_fingertip_waits_below_the_edge_and_looks_up_to_it(
    station: FlapStation, held: tuple[Context, Context]
) -> None:
    plant = station.scene.plant
    X_WS = output(station, held[0], "cheat_fingertip_pose")
    edge = plant.GetFrameByName("edge", station.scene.model("tool"))
    X_EdgeS = edge.CalcPoseInWorld(plant.GetMyContextFromRoot(held[0])).inverse() @ X_WS
    assert_allclose(X_EdgeS @ [0.0, REACH + 0.03, 0.0], [0.0, 0.055, 0.0], atol=0.003)
    k_W = output(station, held[0], "cheat_flap").k_W
    limit = np.cos(np.deg2rad(10.2))
    assert X_EdgeS.rotation().matrix()[2, 1] > limit
    assert limit < X_WS.rotation().matrix()[:, 2] @ k_W < np.cos(np.deg2rad(0.5))


def test_the_truth_about_the_hinge_is_the_tool_s(
    station: FlapStation, held: tuple[Context, Context]
) -> None:
    truth = output(station, held[0], "cheat_flap")
    plant = station.scene.plant
    edge = plant.GetFrameByName("edge", station.scene.model("tool"))
    X_WEdge = edge.CalcPoseInWorld(plant.GetMyContextFromRoot(held[0]))
    assert_allclose(truth.n_W, X_WEdge.rotation().matrix()[:, 0], atol=1e-9)
    assert_allclose(truth.k_W, -X_WEdge.rotation().matrix()[:, 1], atol=1e-9)
    assert truth.n_W[0] > 0.9
    p_WS = output(station, held[0], "cheat_fingertip_pose").translation()
    assert abs((p_WS - truth.p_WK) @ truth.k_W) < 1e-9


def test_each_arm_reads_its_own_joints_to_a_tenth_of_a_degree(
    station: FlapStation, held: tuple[Context, Context]
) -> None:
    for owner, q in (("holder", station.start.holder), ("finger", station.start.finger)):
        window = output(station, held[0], f"{owner}_joint_state_window")
        assert_allclose(window.values[:, :7], np.tile(q, (len(window.times), 1)), atol=0.004)


def test_the_images_show_the_robots_where_the_mask_says(
    station: FlapStation, held: tuple[Context, Context]
) -> None:
    mask = np.array(output(station, held[1], "robot_mask").data[:, :, 0]) > 0
    depth = np.array(output(station, held[1], "depth_measured").image.data[:, :, 0])
    seen = np.isfinite(depth) & (depth > 0.0)
    assert 0.05 < mask.mean() < 0.5
    assert (seen & ~mask).sum() > 3000  # The tool.
    assert seen[mask].mean() > 0.5


def test_the_truth_leaves_the_station_through_cheat_ports_only(station: FlapStation) -> None:
    assert truth_paths(station.diagram) == []
    assert truth_references(station.diagram) == []
    ports = {
        station.diagram.get_output_port(index).get_name()
        for index in range(station.diagram.num_output_ports())
    }
    measured = {
        "color_measured",
        "depth_measured",
        "robot_mask",
        "holder_joint_state_window",
        "finger_joint_state_window",
        "taxel_window",
        "taxel_measured",
        "tip_estimated",
        "task_status",
    }
    assert measured <= ports
    assert all(name.startswith("cheat_") for name in ports - measured)


def test_a_tool_out_of_reach_is_refused_by_the_arm_s_name(load: Load) -> None:
    for x, arm in ((0.9, "holder_arm"), (0.48, "finger_arm")):
        y = 0.0 if arm == "holder_arm" else -0.4
        with pytest.raises(ValueError, match=f"^{arm}: the arm does not reach") as error:
            make(load("flap", f"tool.position=[{x}, {y}, 0.55]"))
        assert "\n" not in str(error.value)


def test_a_camera_that_does_not_see_the_flap_is_refused(load: Load) -> None:
    for target in ("[0.5, 0.0, 3.0]", "[3.0, 0.0, 0.12]"):
        with pytest.raises(ValueError, match=r"^cameras.camera: the flap at .* is not in its"):
            make(load("flap", f"cameras.camera.looking_at={target}"))
    beside = "cameras.camera.position=[0.48, 2.5, 0.55]"
    with pytest.raises(ValueError, match=r"^cameras.camera: it sees the flap edge-on only"):
        make(load("flap", beside))


def test_a_fault_of_the_taxels_cable_is_heard_by_control_too(load: Load) -> None:
    faults = "disturbances.faults=[{stream: taxel_window, kind: nan, start: 0.05}]"
    station = make(load("flap", faults))
    simulator = Simulator(station.diagram)
    station.initialise(simulator.get_mutable_context())
    simulator.Initialize()
    assert np.isfinite(output(station, simulator.get_context(), "taxel_measured")).all()
    simulator.AdvanceTo(0.1)
    assert np.isnan(output(station, simulator.get_context(), "taxel_measured")).all()
    assert np.isfinite(output(station, simulator.get_context(), "taxel_window").values).all()


def test_the_seed_draws_the_tool_and_how_it_is_held(load: Load) -> None:
    first, again, other = (draw_tool(load("flap", f"seed={s}"), REACH) for s in (1, 1, 2))
    assert first.model == again.model
    assert first.X_WM.IsExactlyEqualTo(again.X_WM)
    assert first.model != other.model
    scenario = load("flap")
    off = first.X_WM.translation() - scenario.tool.position
    assert np.all(np.abs(off) <= scenario.tool.variation.position)
