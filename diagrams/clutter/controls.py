"""What can be changed of the clutter application on the live page."""

from crossmodal.diagrams.clutter.scenario import Scenario
from crossmodal.diagrams.clutter.station.robot_control import (
    APPROACH_SPEED,
    CAMERA_PACE,
    CONTACT_THRESHOLD,
    MOVE_PACE,
    TOUCH_PACE,
)
from crossmodal.diagrams.run.live.controls import Control
from crossmodal.diagrams.stations.camera_controls import camera_controls


def make_controls(scenario: Scenario) -> list[Control]:
    """Of the robots; a rig has nothing to be changed."""
    if scenario.station != "robots":
        return []
    touch = scenario.control.touch
    return [
        *camera_controls(scenario.cameras),
        _pace("camera arm", CAMERA_PACE),
        _pace("touch arm", TOUCH_PACE),
        *([_pace("grasp, push", MOVE_PACE)] if scenario.clutter.count else []),
        Control(
            name="approach [mm/s]",
            port=APPROACH_SPEED,
            low=1.0,
            high=100.0,
            value=1e3 * touch.speed,
            factor=1e-3,
        ),
        Control(
            name="touches at [N]",
            port=CONTACT_THRESHOLD,
            low=0.01,
            high=2.0,
            step=0.01,
            value=touch.threshold,
        ),
    ]


def _pace(name: str, port: str) -> Control:
    """The speed of motions that begin from now on, beside the scenario's."""
    return Control(
        name=f"{name} [%]", port=port, low=10.0, high=200.0, step=5.0, value=100.0,
        factor=0.01,
    )  # fmt: skip
