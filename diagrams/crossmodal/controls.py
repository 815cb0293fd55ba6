"""What can be changed of the cross-modal application on the live page."""

from crossmodal.diagrams.crossmodal.modalities import sees
from crossmodal.diagrams.crossmodal.scenario import Scenario
from crossmodal.diagrams.crossmodal.station.station_control import PULL_SPEED
from crossmodal.diagrams.run.live.controls import Control, ControlKind, silence
from crossmodal.diagrams.stations.add_soft_hand import LEAK
from crossmodal.diagrams.stations.camera_controls import camera_controls


def make_controls(scenario: Scenario) -> list[Control]:
    """Of camera, arm and hand, and which streams are silent."""
    speed = scenario.control.exploration.speed
    pulling = Control(
        name="pull speed [cm/s]", port=PULL_SPEED, low=0.0, high=6.0, step=0.1, value=100.0 * speed,
        factor=0.01,
    )  # fmt: skip
    pulls = scenario.control.excitation is None
    return [
        *(camera_controls(scenario.cameras, colour_is_read=True) if sees(scenario) else []),
        *([pulling] if pulls else []),
        Control(name="hand leaks", port=LEAK, kind=ControlKind.SWITCH),
        silence("depth", "depth_measured"),
        silence("wrist", "wrench_window"),
        silence("encoders", "joint_state_window"),
        silence("pressures", "pressure_window"),
    ]
