"""A soft hand of a station: its pneumatics and the sensors in its chambers."""

from collections.abc import Sequence

from pydrake.systems.primitives import MatrixGain

from crossmodal.diagrams.run.scenario import Interval
from crossmodal.diagrams.stations.naming import own_seed, prefixed
from crossmodal.diagrams.stations.occurrence import Occurrence
from crossmodal.diagrams.stations.wiring import StationWiring
from crossmodal.plants.hands.pneumatic_hand import PneumaticHand, PneumaticHandConfig
from crossmodal.plants.hands.soft_hand import finger_selection
from crossmodal.systems.sensors.air_pressure import PressureSensor, PressureSensorConfig

LEAK = "leak_by_hand"


def add_soft_hand(
    wiring: StationWiring,
    hand: str,
    config: PneumaticHandConfig,
    sensor: PressureSensorConfig,
    owner: str = "",
    leaks: Sequence[Interval] = (),
) -> tuple[PneumaticHand, PressureSensor]:
    """Adds pneumatics and pressure sensors; exports `pressure_window`.

    The input `leak_by_hand`, above 0.5 while somebody lets air escape, may stay unconnected.

    What the pneumatics are commanded is left to be connected.

    Args:
        hand: Name of the hand's model in the scene.
        sensor: Of the pressure sensors.
        owner: Name of the hand where there are several; it then begins the names.
        leaks: When air escapes from all chambers.
    """
    builder, plant, scenario = wiring.builder, wiring.plant, wiring.scenario
    model = wiring.scene.model(hand)
    pneumatics = builder.AddNamedSystem(prefixed(owner, "pneumatics"), PneumaticHand(config))
    fingers = builder.AddNamedSystem(
        prefixed(owner, "finger_state"), MatrixGain(finger_selection(plant, model))
    )
    seed, tick = own_seed(scenario.seed, owner), scenario.network_period
    pressure = builder.AddNamedSystem(
        prefixed(owner, "pressure"), PressureSensor(sensor, seed, tick)
    )
    builder.Connect(plant.get_state_output_port(model), fingers.get_input_port())
    builder.Connect(fingers.get_output_port(), pneumatics.GetInputPort("hand_state"))
    builder.Connect(
        pneumatics.GetOutputPort("joint_torques"), plant.get_actuation_input_port(model)
    )
    builder.Connect(pneumatics.GetOutputPort("cheat_pressure"), pressure.get_input_port())
    leaking = pneumatics.GetInputPort("leaking")
    if leaks:
        leak = builder.AddNamedSystem(prefixed(owner, "leak"), Occurrence(leaks))
        builder.Connect(leak.get_output_port(), leaking)
        leaking = leak.get_input_port()
    builder.ExportInput(leaking, prefixed(owner, LEAK))
    window = pressure.GetOutputPort("pressure_window")
    builder.ExportOutput(window, prefixed(owner, "pressure_window"))
    return pneumatics, pressure
