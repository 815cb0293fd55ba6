"""What can be changed of the flap application on the live page."""

from crossmodal.diagrams.flap.scenario import Scenario
from crossmodal.diagrams.flap.station.station_control import FEED_SPEED, SET_FORCE
from crossmodal.diagrams.run.live.controls import Control, silence
from crossmodal.diagrams.stations.camera_controls import camera_controls


def make_controls(scenario: Scenario) -> list[Control]:
    """Of camera, finger and holder, and which streams are silent."""
    control = scenario.control
    return [
        *camera_controls(scenario.cameras, colour_is_read=False),
        Control(
            name="finger force [N]", port=SET_FORCE, low=0.05, high=3.0, step=0.05,
            value=control.force,
        ),
        Control(
            name="flip speed [mm/s]", port=FEED_SPEED, low=0.0, high=30.0, step=0.5,
            value=1e3 * control.sequence.feed_speed, factor=1e-3,
        ),
        silence("taxels", "taxel_window"),
        silence("finger", "finger_joint_state_window"),
        silence("holder", "holder_joint_state_window"),
        silence("depth", "depth_measured"),
    ]  # fmt: skip
