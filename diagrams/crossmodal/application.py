"""The cross-modal application: coupled filters over vision, proprioception and touch find the joint
of an unknown object while a compliant arm explores it.

Source: R. Martín-Martín and O. Brock, Cross-modal interpretation of multi-modal sensor streams in
interactive perception based on coupled recursion, IROS 2017.
"""

from collections.abc import Mapping

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder, System

from crossmodal.diagrams.crossmodal.calibration import make_calibration
from crossmodal.diagrams.crossmodal.estimators import (
    BODY_MOTIONS,
    BODY_STREAMS,
    SEEN_STREAMS,
    make_network,
)
from crossmodal.diagrams.crossmodal.meshcat_view import add_view
from crossmodal.diagrams.crossmodal.modalities import COLORS, FEELING, LABELS, SEEING
from crossmodal.diagrams.crossmodal.own_object import identity, keep_files, own_object_assignments
from crossmodal.diagrams.crossmodal.results.grasp_episode import GRASP_QUANTITIES
from crossmodal.diagrams.crossmodal.results.metrics import CAMPAIGN_PLOTS, METRICS, OVERVIEW
from crossmodal.diagrams.crossmodal.results.results import evaluate
from crossmodal.diagrams.crossmodal.scenario import SCENARIO_FOLDER, Scenario, resolve, units
from crossmodal.diagrams.crossmodal.station.overlaps import overlaps
from crossmodal.diagrams.crossmodal.station.settling import settling
from crossmodal.diagrams.crossmodal.station.station import (
    draw_placements,
    make_manipulation_station,
)
from crossmodal.diagrams.crossmodal.station.station_control import PERCEIVED_INPUTS
from crossmodal.diagrams.crossmodal.studies.ablations import ABLATIONS
from crossmodal.diagrams.crossmodal.studies.experiments import EXPERIMENTS
from crossmodal.diagrams.crossmodal.task import task_in_words
from crossmodal.diagrams.joints.joint_truth import MECHANICS_QUANTITY, TRUTH_QUANTITIES
from crossmodal.diagrams.run.application import Application, Station
from crossmodal.diagrams.run.calibration import Calibration
from crossmodal.diagrams.run.record import Quantity
from crossmodal.diagrams.run.sensor_streams.codecs import JOINT_STATES, WRENCHES, Topic
from crossmodal.systems.kinematics.held_joint import HeldJoint, HeldJointConfig
from crossmodal.systems.port_values import (
    UNKNOWN_END_EFFECTOR,
    BodyMotions,
    JointBeliefs,
    JointMechanicsBeliefs,
    PoseBelief,
    StreamHealth,
    no_features,
)
from crossmodal.systems.proprioception.grasp_model import initial_grasp
from crossmodal.systems.proprioception.grasp_model_config import GraspModelConfig

QUANTITIES = (
    Quantity(port="joints_latest", model=JointBeliefs()),
    Quantity(port="body_motions_latest", model=BodyMotions()),
    Quantity(port="features_latest", model=no_features(), estimators=SEEING),
    Quantity(port="grasp_latest", model=initial_grasp(GraspModelConfig()), estimators=FEELING),
    Quantity(port="joint_mechanics_latest", model=JointMechanicsBeliefs(), estimators=FEELING),
    Quantity(port="end_effector_latest", model=UNKNOWN_END_EFFECTOR, estimators=FEELING),
    Quantity(
        port="hand_bending_latest",
        model=PoseBelief(X=np.eye(4), covariance=np.eye(6)),
        estimators=FEELING,
    ),
    Quantity(port=f"{BODY_MOTIONS}_health_latest", model=StreamHealth()),
    *(
        Quantity(port=f"{stream}_health_latest", model=StreamHealth(), estimators=having)
        for having, streams in ((SEEING, SEEN_STREAMS), (FEELING, BODY_STREAMS))
        for stream in streams
    ),
)
TOPICS = {
    "joint_state_window": Topic(name="/joint_states", window=JOINT_STATES),
    "wrench_window": Topic(name="/wrist/wrench", window=WRENCHES),
    "pressure_window": Topic(name="/hand/pressures"),
    "color_measured": Topic(name="/camera/color/image_raw"),
    "depth_measured": Topic(name="/camera/depth/image_raw"),
    "robot_mask": Topic(name="/camera/robot_mask"),
    "interaction_active": Topic(name="/hand/interaction_active"),
    "cheat_configuration": Topic(name="/cheat/configuration"),
    "cheat_body_pose": Topic(name="/cheat/body_pose"),
    "cheat_joint": Topic(name="/cheat/joint"),
    "cheat_joint_mechanics": Topic(name="/cheat/joint_mechanics"),
    "cheat_hand_pose": Topic(name="/cheat/hand_pose"),
    "cheat_handle_pose": Topic(name="/cheat/handle_pose"),
}


def make_station(scenario: Scenario, calibration: Calibration) -> Station:
    """The station of a scenario with its seed."""
    station = make_manipulation_station(scenario, calibration)
    return Station(
        diagram=station.diagram,
        initialise=station.SetInitialState,
        warnings=[
            *overlaps(station),
            *settling(scenario, draw_placements(scenario), station.q_start),
        ],
    )


def make_estimators(scenario: Scenario, calibration: Calibration) -> dict[str, Diagram]:
    """One network of filters for each of the scenario's modalities."""
    return {
        modality: make_network(modality, scenario.perception, calibration, scenario.network_period)
        for modality in scenario.modalities
    }


def close_loop(
    builder: DiagramBuilder, scenario: Scenario, station: System, estimators: Mapping[str, System]
) -> None:
    """Connects what a network believes about the joint in the hand to the controllers."""
    if scenario.task.goal is None:
        return
    network = estimators[scenario.acting_modality]
    readout = builder.AddNamedSystem("held_joint", HeldJoint(HeldJointConfig()))
    for index in range(readout.num_input_ports()):
        port = readout.get_input_port(index)
        if network.HasOutputPort(port.get_name()):
            builder.Connect(network.GetOutputPort(port.get_name()), port)
    for name in PERCEIVED_INPUTS:
        builder.Connect(readout.GetOutputPort(name), station.GetInputPort(name))


APPLICATION = Application(
    name="crossmodal",
    description="an arm with a soft hand finds the joint of an unknown object while it explores it",
    scenario=Scenario,
    scenarios=SCENARIO_FOLDER,
    resolve=resolve,
    make_calibration=make_calibration,
    make_station=make_station,
    make_estimators=make_estimators,
    close_loop=close_loop,
    quantities=QUANTITIES,
    station_quantities=(*TRUTH_QUANTITIES, MECHANICS_QUANTITY, *GRASP_QUANTITIES),
    pictures=("color_measured",),
    topics=TOPICS,
    evaluate=evaluate,
    units=units,
    task_in_words=task_in_words,
    view=add_view,
    own_object=own_object_assignments,
    keep_files=keep_files,
    identity=identity,
    labels=LABELS,
    colors=COLORS,
    metrics=METRICS,
    experiments=EXPERIMENTS,
    overview=OVERVIEW,
    campaign_plots=CAMPAIGN_PLOTS,
    extras={
        "Flows of information (crossmodal ablate NAME)": {
            name: ablation.flow for name, ablation in ABLATIONS.items()
        },
        "Networks (crossmodal train NAME)": {
            "hand-bending": "the soft hand's bending from wrench and air pressure"
        },
    },
)
