"""The network of filters and the station: wires, loops, truth, and what one tick does."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from truth_paths import truth_paths

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.crossmodal.application import APPLICATION
from crossmodal.diagrams.crossmodal.episode_parts import QUANTITIES
from crossmodal.diagrams.crossmodal.estimators import CROSSMODAL_CONNECTIONS
from crossmodal.diagrams.crossmodal.modalities import MODALITIES
from crossmodal.diagrams.crossmodal.scenario import Scenario
from crossmodal.diagrams.drawing.diagram_drawing import leaf_systems, wires
from crossmodal.diagrams.run.application import Station
from crossmodal.diagrams.run.build import build_estimators, build_station
from crossmodal.diagrams.run.calibration import Calibration
from crossmodal.diagrams.run.episode import Episode
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
from crossmodal.systems.port_values import HELD_BODY, SampleWindow
from crossmodal.systems.proprioception.grasp_model import initial_grasp
from crossmodal.systems.proprioception.grasp_model_config import GraspModelConfig
from crossmodal.systems.recursive_filter import RecursiveFilter

Q = np.array([-0.6, 0.9, 0.45, 1.5, -3.65, 0.7, 0.0])


def drawer(*overrides: str) -> Scenario:
    return load_scenario("drawer", overrides)[1]


@cache
def scenario() -> Scenario:
    return drawer()


@cache
def calibration() -> Calibration:
    return APPLICATION.make_calibration(scenario())


@cache
def station() -> Station:
    return build_station(APPLICATION, scenario(), calibration())


def built(*overrides: str) -> dict[str, Diagram]:
    return dict(build_estimators(APPLICATION, drawer(*overrides), calibration()))


@cache
def networks() -> dict[str, Diagram]:
    return built()


@cache
def episode() -> Episode:
    return Episode(APPLICATION, scenario())


@pytest.mark.parametrize("modality", MODALITIES)
def test_a_network_builds_without_algebraic_loop(modality: str) -> None:
    assert networks()[modality].num_output_ports() >= 2


def test_every_modality_reads_only_its_own_senses() -> None:
    inputs = {
        name: {network.get_input_port(i).get_name() for i in range(network.num_input_ports())}
        for name, network in networks().items()
    }
    assert inputs["vision"] == {"color_measured", "depth_measured", "robot_mask"}
    assert inputs["proprioception"].isdisjoint(inputs["vision"])
    assert inputs["crossmodal"] == inputs["vision"] | inputs["proprioception"]


def test_every_filter_updates_at_the_networks_period(monkeypatch: pytest.MonkeyPatch) -> None:
    declare, periods = RecursiveFilter._declare_recursion, []

    def remembering(system: RecursiveFilter, initial: object, calc: Any, period: float) -> None:
        periods.append(period)
        declare(system, initial, calc, period)

    monkeypatch.setattr(RecursiveFilter, "_declare_recursion", remembering)
    built("network_period=0.05", "modalities=[crossmodal]")
    assert len(periods) > 10
    assert set(periods) == {0.05}


def connections(network: Diagram) -> set[tuple[str, str, str, str]]:
    return {
        (wire.source.get_name(), wire.source_port, wire.target.get_name(), wire.target_port)
        for wire in wires(network)
        if wire.source is not None
    }


@pytest.mark.parametrize("name", CROSSMODAL_CONNECTIONS)
def test_cutting_a_wire_removes_its_connections_and_no_other(name: str) -> None:
    cut = built(f"perception.cut=[{name}]", "modalities=[crossmodal]")["crossmodal"]
    missing = connections(networks()["crossmodal"]) - connections(cut)
    assert missing == set(CROSSMODAL_CONNECTIONS[name].connections)


def test_every_network_knows_how_well_its_sensors_are_calibrated() -> None:
    known = "calibration.believed.camera_rotation=0.02", "calibration.believed.arm_rotation=0.03"
    believed = APPLICATION.make_calibration(drawer(*known))
    for modality, network in build_estimators(APPLICATION, drawer(*known), believed).items():
        model = network.GetSubsystemByName("kinematic_model")
        deviations = [np.sqrt(sensor.covariance[0, 0]) for sensor in (model._camera, model._arm)]
        sees, feels = modality != "proprioception", modality != "vision"
        assert deviations == pytest.approx([0.02 * sees, 0.03 * feels])


def test_with_every_wire_cut_the_network_still_ticks() -> None:
    names = ", ".join(CROSSMODAL_CONNECTIONS)
    network = built(f"perception.cut=[{names}]", "modalities=[crossmodal]")["crossmodal"]
    context = network.CreateDefaultContext()
    fix_inputs(network, context, Q, 0.0)
    body = network.GetSubsystemByName("held_body_motion")
    grasp = network.GetSubsystemByName("grasp_model")
    motions = body.GetOutputPort("body_motions_estimated").Eval(body.GetMyContextFromRoot(context))
    belief = grasp.GetOutputPort("grasp_estimated").Eval(grasp.GetMyContextFromRoot(context))
    assert len(motions.bodies) == 1
    prior = initial_grasp(GraspModelConfig()).probabilities
    assert belief.probabilities == pytest.approx(prior)


def test_a_cut_touches_no_other_modality() -> None:
    names = ", ".join(CROSSMODAL_CONNECTIONS)
    cut = built(f"perception.cut=[{names}]")
    for modality in ("vision", "proprioception"):
        assert connections(cut[modality]) == connections(networks()[modality])


def test_an_unknown_wire_lists_the_known_ones() -> None:
    with pytest.raises(ScenarioError, match=r"cut: unknown connection 'thumb'.*joints_to_vision"):
        drawer("perception.cut=[thumb]")


def test_no_path_leads_from_the_truth_to_what_the_robot_runs() -> None:
    assert truth_paths(episode().diagram) == []


@pytest.mark.parametrize("modality", MODALITIES)
def test_control_acts_by_what_one_network_perceives_and_by_nothing_true(modality: str) -> None:
    diagram = Episode(*load_scenario("drawer-return", [f"modalities=[{modality}]"])).diagram
    assert truth_paths(diagram) == []
    wired = connections(diagram)
    assert ("kinematic_model", "joints_latest", "held_joint", "joints_latest") in wired
    assert ("held_joint", "joint_latest", "joint_memory", "joint_latest") in wired


def test_a_wire_from_the_truth_into_a_filter_is_found() -> None:
    plant = build_station(APPLICATION, scenario()).diagram
    network = built("modalities=[proprioception]")["proprioception"]
    builder = DiagramBuilder()
    builder.AddSystem(plant)
    builder.AddSystem(network)
    builder.Connect(
        plant.GetOutputPort("cheat_configuration"),
        network.GetInputPort("interaction_active"),
    )
    paths = truth_paths(builder.Build())
    assert any("object_truth.cheat_configuration -> hand_bending" in path for path in paths)


def test_the_truth_leaves_the_station_only_through_cheat_ports_to_recorder_and_view() -> None:
    diagram = episode().diagram
    robot = {id(s) for name in MODALITIES for s in leaf_systems(diagram.GetSubsystemByName(name))}
    cheats = [wire for wire in wires(diagram) if wire.source_port.startswith("cheat_")]
    assert cheats
    assert not [wire for wire in cheats if id(wire.target) in robot]


def test_predictions_close_the_loop_from_joints_to_features() -> None:
    found = {
        (wire.source.get_name(), wire.target.get_name())
        for wire in wires(networks()["crossmodal"])
        if wire.source is not None and wire.is_prediction
    }
    assert ("kinematic_model", "rigid_body_motion") in found
    assert ("rigid_body_motion", "feature_motion") in found
    assert ("held_body_motion", "rigid_body_motion") in found
    assert ("grasp_model", "held_body_motion") in found


def fix_inputs(network: Diagram, context: Context, q: np.ndarray, time: float) -> None:
    """The senses of a robot that stands still at `q` with its hand closed."""

    def window(values: np.ndarray) -> AbstractValue:
        return AbstractValue.Make(SampleWindow(times=np.array([time]), values=values[None]))

    values = {
        "joint_state_window": window(np.concatenate([q, np.zeros(7)])),
        "wrench_window": window(np.zeros(6)),
        "pressure_window": window(np.full(4, 6e4)),
    }
    for port, value in values.items():
        network.GetInputPort(port).FixValue(context, value)
    network.GetInputPort("interaction_active").FixValue(context, [1.0])


def test_an_estimate_reacts_to_a_measurement_in_the_same_tick() -> None:
    network = networks()["proprioception"]
    body = network.GetSubsystemByName("held_body_motion")
    context = network.CreateDefaultContext()

    def position(q: np.ndarray) -> np.ndarray:
        fix_inputs(network, context, q, 0.0)
        motions = body.GetOutputPort("body_motions_estimated").Eval(
            body.GetMyContextFromRoot(context)
        )
        (motion,) = motions.bodies
        assert motion.body_id == HELD_BODY
        return np.array(motion.motion.X[:3, 3])

    first = position(Q)
    moved = position(Q + np.array([0.1, 0, 0, 0, 0, 0, 0]))
    assert np.linalg.norm(moved - first) > 0.02
    latest = body.GetOutputPort("body_motions_latest").Eval(body.GetMyContextFromRoot(context))
    assert latest.bodies == []


def test_what_is_recorded_of_a_network_is_what_it_has() -> None:
    known = {quantity.port: quantity.model for quantity in QUANTITIES}
    for network in networks().values():
        for index in range(network.num_output_ports()):
            port = network.get_output_port(index)
            assert type(port.Allocate().get_value()) is type(known[port.get_name()])


def test_a_station_has_what_is_recorded_of_it_and_what_every_network_hears() -> None:
    diagram = station().diagram
    for quantity in APPLICATION.station_quantities(scenario()):
        assert diagram.HasOutputPort(quantity.port)
    for port in (*APPLICATION.pictures(scenario()), "task_status", "cheat_query_object"):
        assert diagram.HasOutputPort(port)
    for network in networks().values():
        for index in range(network.num_input_ports()):
            assert diagram.HasOutputPort(network.get_input_port(index).get_name())
