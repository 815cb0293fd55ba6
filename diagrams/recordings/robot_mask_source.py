"""Where the robot itself is in a recording's images, by its model at the measured joints."""

from typing import Any

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.sensors import ImageGrey8U

from crossmodal.diagrams.crossmodal.robot_config import ARM, HAND
from crossmodal.diagrams.recordings.port_sources import Source
from crossmodal.diagrams.recordings.sample_rows import JointRows
from crossmodal.diagrams.run.calibration import Calibration
from crossmodal.maths.arrays import Array
from crossmodal.plants.camera_view import renderer_intrinsics
from crossmodal.plants.hands.soft_hand import CLOSED_POSTURE
from crossmodal.plants.robots.arm_with_hand import add_robot
from crossmodal.plants.robots.wam import ARM_JOINTS, WAM_WITH_SOFT_HAND
from crossmodal.systems.sensors.robot_mask import MaskedRobot, RobotMask, RobotMaskConfig

_REDUCTIONS = (4, 2, 1)  # Of the rendered image; one that divides its size.


class RenderedMaskSource(Source):
    """The mask of an arm with a soft hand, rendered at the last joint state before a tick.

    Args:
        rows: Of the arm's joints.
        topic: Of the joint states.
        calibration: Of its only camera and its arm.
        held: Says whether the hand is closed.
    """

    def __init__(
        self, rows: JointRows, topic: str, calibration: Calibration, held: Source | None
    ) -> None:
        super().__init__([topic])
        self._rows, self._held = rows, held
        camera, arm = calibration.camera, calibration.arm
        size = camera.intrinsics.width, camera.intrinsics.height
        reduction = next(r for r in _REDUCTIONS if not any(length % r for length in size))
        posture = {joint: (0.0, closed) for joint, closed in CLOSED_POSTURE.items()}
        robot = MaskedRobot(arm=ARM, arm_joints=ARM_JOINTS, hand=HAND, hand_posture=posture)

        def build(plant: MultibodyPlant) -> Any:
            return add_robot(plant, WAM_WITH_SOFT_HAND, arm.X_WBase, ARM, HAND)

        self._mask = RobotMask(
            RobotMaskConfig(reduction=reduction),
            build,
            renderer_intrinsics(camera.intrinsics),
            camera.X_PC,
            {"robot": robot},
        )
        self._context = self._mask.CreateDefaultContext()
        self._image = ImageGrey8U(*size)
        self._state: Array | None = None

    def value(self, now: int) -> ImageGrey8U:
        """The mask; empty before the first joint state."""
        rows = (self._rows(self.topics[0], time, message) for time, message in self.take(now))
        states = [row for row in rows if row is not None]
        if not states:
            return self._image
        self._state = np.asarray(states[-1])
        closure = [0.0] if self._held is None else self._held.value(now)
        for port, value in (("joint_state_measured", self._state), ("closure_commanded", closure)):
            self._mask.GetInputPort(port).FixValue(self._context, value)
        image = self._mask.GetOutputPort("robot_mask").Eval(self._context)
        self._image = ImageGrey8U(image.width(), image.height())
        self._image.mutable_data[:] = image.data
        return self._image
