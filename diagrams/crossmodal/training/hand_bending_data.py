"""Simulates the interactions from which the hand's bending is learned."""

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.analysis import Simulator

from crossmodal.controllers.interaction.bending_excitation import BendingExcitationConfig
from crossmodal.controllers.interaction.grasp_sequence_config import GraspSequenceConfig
from crossmodal.diagrams.crossmodal.episode_parts import make_calibration
from crossmodal.diagrams.crossmodal.scenario import Scenario
from crossmodal.diagrams.crossmodal.station.station import (
    ManipulationStation,
    make_manipulation_station,
)
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.models import SDF_DIR
from crossmodal.plants.scene import ObjectPlacement
from crossmodal.systems.proprioception.hand_bending import load_reading
from crossmodal.systems.proprioception.hand_config import HandConfig
from crossmodal.systems.ticks import NETWORK_PERIOD

NOMINAL_HANDLE = np.array([0.865, -0.25, 0.86])  # Where the chest stands, p_WO, [m].


def make_training_station(seed: int) -> ManipulationStation:
    """A station whose drawer is locked, somewhere near its nominal pose."""
    rng = np.random.default_rng((seed, 2))
    yaw = np.pi + rng.uniform(-0.1, 0.1)
    X_WO = RigidTransform(RollPitchYaw(0, 0, yaw), NOMINAL_HANDLE + rng.uniform(-0.02, 0.02, 3))
    placement = ObjectPlacement(model=SDF_DIR / "chest_drawer.sdf", X_WO=X_WO)
    scenario = Scenario(name="hand-bending", seed=seed)
    scenario.cameras = {}  # Nobody looks.
    control = scenario.control
    control.excitation = BendingExcitationConfig()
    control.sequence.comply = False
    control.sequence.explore_time_limit = np.inf
    control.sequence.travel = np.inf
    return make_manipulation_station(
        scenario, make_calibration(scenario), {name: placement for name in scenario.objects}
    )


def simulate_interaction(seed: int, duration: float = 14.0) -> tuple[Array, Array]:
    """One interaction with an object that is fixed to the world.

    The object does not move, so the bent hand, which goes with it, stays where the end-effector
    was when the hand had closed: X_EH = X_WE^-1 X_WE(closed). The labels are simulated truth; the
    inputs are what the sensors give.

    Args:
        seed: Of placement, guidance, noise and path.
        duration: Of the motion after the hand has closed, [s].

    Returns:
        Inputs (T, 10), wrench without the hand's weight (6) and pressures (4), and labels
        log X_EH (T, 6).
    """
    station = make_training_station(seed)
    simulator = Simulator(station.diagram)
    root = simulator.get_mutable_context()
    station.initialise(root)
    simulator.Initialize()
    plant = station.scene.plant
    context = plant.GetMyContextFromRoot(root)
    E, S = plant.GetFrameByName("end_effector"), plant.GetFrameByName("sensor")
    sequence = GraspSequenceConfig()
    closed = sequence.approach_time + sequence.close_time
    hand = HandConfig()
    period = NETWORK_PERIOD
    X_WH: Array | None = None
    inputs: list[Array] = []
    labels: list[Array] = []
    for tick in range(1, int((closed + duration) / period)):
        time = tick * period
        simulator.AdvanceTo(time)
        if time < closed + period:
            continue
        ports = [station.diagram.GetOutputPort(n) for n in ("wrench_window", "pressure_window")]
        wrench, pressure = (port.Eval(root) for port in ports)
        R_WS = S.CalcPoseInWorld(context).rotation().matrix()
        reading = load_reading(wrench, pressure, R_WS, hand.mass, hand.p_S_com)
        X_WE = E.CalcPoseInWorld(context).GetAsMatrix4()
        X_WH = X_WE if X_WH is None else X_WH
        inputs.append(reading)
        labels.append(se3.log(se3.inverse(X_WE) @ X_WH))
    return np.array(inputs), np.array(labels)
