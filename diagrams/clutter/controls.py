"""What can be changed of the clutter application on the live page."""

from crossmodal.controllers.primitives.guarded_touch import GuardedTouchConfig
from crossmodal.diagrams.clutter.scenario import Scenario, wanted_touches
from crossmodal.diagrams.clutter.station.robot_control import (
    APPROACH_SPEED,
    CAMERA_PACE,
    CONTACT_THRESHOLD,
    MOVE_PACE,
    TOUCH_PACE,
)
from crossmodal.diagrams.clutter.station.robot_sensors import NUMB
from crossmodal.diagrams.run.live.controls import Control, ControlKind
from crossmodal.diagrams.stations.camera_controls import camera_controls


def make_controls(scenario: Scenario) -> list[Control]:
    """Of the robots; a rig is at once where it measures, so that nothing of it can be changed."""
    if scenario.station != "robots":
        return []
    clears = scenario.clutter.count > 0
    return [
        *camera_controls(scenario.cameras, colour_is_read=clears),
        _pace("camera arm", CAMERA_PACE),
        *([_pace("grasp, push", MOVE_PACE)] if clears else []),
        *(_of_touches(scenario.control.touch) if wanted_touches(scenario) else []),
        Control(name="silent: taxels", port=NUMB, kind=ControlKind.SWITCH),
    ]


def _of_touches(touch: GuardedTouchConfig) -> list[Control]:
    return [
        _pace("touch arm", TOUCH_PACE),
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
