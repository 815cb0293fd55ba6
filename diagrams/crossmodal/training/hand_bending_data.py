"""Simulates the interactions from which the hand's bending is learned."""

from collections.abc import Callable

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.analysis import Simulator

from controllers.interaction.bending_excitation import BendingExcitationConfig
from diagrams.crossmodal.station.station import Station, make_station
from diagrams.crossmodal.station.station_config import StationConfig
from diagrams.stations.lighting import Light
from maths import se3
from maths.arrays import Array
from models import SDF_DIR
from plants.camera_view import camera_intrinsics, looking_at
from plants.scene import ObjectPlacement
from systems.proprioception.hand_bending import HandBendingConfig, load_reading

NOMINAL_HANDLE = np.array([0.865, -0.25, 0.86])  # Where the chest stands, p_WO, [m].


def make_training_station(seed: int) -> Station:
    """A station whose drawer is locked, somewhere near its nominal pose."""
    config = StationConfig()
    config.control.excitation = BendingExcitationConfig()
    config.control.sequence.comply = False
    config.control.sequence.explore_time_limit = 1e3
    config.control.sequence.travel = 1e3
    config.sensors.camera.exposure_period = 1e3  # Nobody looks.
    rng = np.random.default_rng((seed, 2))
    yaw = np.pi + rng.uniform(-0.1, 0.1)
    X_WO = RigidTransform(RollPitchYaw(0, 0, yaw), NOMINAL_HANDLE + rng.uniform(-0.02, 0.02, 3))
    return make_station(
        config,
        ObjectPlacement(model=SDF_DIR / "chest_drawer.sdf", X_WO=X_WO),
        "slide",
        "handle",
        np.array([1.0, 0.0, 0.0]),
        camera_intrinsics(64, 48, 1.0),
        looking_at(np.array([0.0, 0.4, 1.4]), NOMINAL_HANDLE),
        Light(),
        seed,
    )


def simulate_interaction(
    seed: int, duration: float = 14.0, progress: Callable[[float], None] | None = None
) -> tuple[Array, Array]:
    """One interaction with an object that is fixed to the world.

    The object does not move, so the bent hand, which goes with it, stays where the end-effector
    was when the hand had closed: X_EH = X_WE^-1 X_WE(closed). The labels are simulated truth; the
    inputs are what the sensors give.

    Args:
        seed: Of placement, guidance, noise and path.
        duration: Of the motion after the hand has closed, [s].
        progress: Called with the simulated time [s].

    Returns:
        Inputs (T, 10), wrench without the hand's weight (6) and pressures (4), and labels
        log X_EH (T, 6).
    """
    station = make_training_station(seed)
    simulator = Simulator(station.diagram)
    root = simulator.get_mutable_context()
    station.SetInitialState(root)
    simulator.Initialize()
    plant = station.scene.plant
    context = plant.GetMyContextFromRoot(root)
    E, S = plant.GetFrameByName("end_effector"), plant.GetFrameByName("sensor")
    sequence = StationConfig().control.sequence
    closed = sequence.approach_time + sequence.close_time
    config = HandBendingConfig()
    period = config.period
    X_WH: Array | None = None
    inputs: list[Array] = []
    labels: list[Array] = []
    for tick in range(1, int((closed + duration) / period)):
        time = tick * period
        simulator.AdvanceTo(time)
        if progress is not None:
            progress(time)
        if time < closed + period:
            continue
        ports = [station.diagram.GetOutputPort(n) for n in ("wrench_window", "pressure_window")]
        wrench, pressure = (port.Eval(root) for port in ports)
        R_WS = S.CalcPoseInWorld(context).rotation().matrix()
        reading = load_reading(wrench, pressure, R_WS, config.hand_mass, config.p_S_com)
        X_WE = E.CalcPoseInWorld(context).GetAsMatrix4()
        X_WH = X_WE if X_WH is None else X_WH
        inputs.append(reading)
        labels.append(se3.log(se3.inverse(X_WE) @ X_WH))
    return np.array(inputs), np.array(labels)
