"""What tasks of an arm have in common that plan their motions themselves."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context

from crossmodal.controllers.arm.joint_motion import JointMotion, along_line, rest_to_rest
from crossmodal.controllers.arm.kinematics import ArmModel
from crossmodal.controllers.arm.motion_planner import MotionPlanner, box_vertices
from crossmodal.controllers.arm.sequence import Sequence, read
from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import number


@dataclass(kw_only=True)
class TransitConfig:
    """How an arm moves where nothing is near."""

    # Of the end-effector.
    speed: float = number(0.1, above=0.0, at_most=5.0, unit="m/s")
    # Of each joint, as a share of its limit.
    joint_speed: float = number(0.5, above=0.0, at_most=1.0)
    # For which it waits after a motion until the arm is at rest.
    rest_time: float = number(0.3, at_least=0.0, at_most=60.0, unit="s")


def believed_obstacles(request: Any) -> list[Array]:
    """What is thought to hold all objects, as obstacles of a planner.

    Args:
        request: A view or a touch: `box_edges` (3,) [m], zero if unknown, and `X_WB` (4, 4) of the
            object's box; `obstacles`, vertices (N, 3) of what holds the others.
    """
    is_known = np.any(request.box_edges)
    own = [box_vertices(request.box_edges, RigidTransform(request.X_WB))] if is_known else []
    return [*own, *request.obstacles]


class ArmTask(Sequence):
    """A sequence that moves its arm by joint positions along planned paths.

    A subclass's state has the attribute `motion`, a `JointMotion`.

    Input ports:
    - `joint_state_measured`: (2 n,) of this arm, [rad], [rad/s].
    - `<other>_joint_state_measured`: (2 m,) of each other arm that may be in the way.
    - `pace`: (1,) share of the configured speeds at which the motions that begin now are made. May
      stay unconnected; then it is one.

    Output ports:
    - `joint_position_commanded`: (n,), [rad].
    """

    def __init__(
        self,
        arm: ArmModel,
        planner: MotionPlanner,
        transit: TransitConfig,
        others: Mapping[str, int],
    ) -> None:
        """Declares the inputs.

        Args:
            arm: The robot's own model.
            planner: Of this arm.
            transit: How it moves.
            others: Numbers of joints of other arms by the names of their models.
        """
        super().__init__(arm)
        self._planner, self._transit = planner, transit
        self._limits = transit.joint_speed * arm.plant.GetVelocityUpperLimits()
        self._pace = self.DeclareVectorInputPort("pace", 1)
        self._others = {
            name: self.DeclareVectorInputPort(f"{name}_joint_state_measured", 2 * joints)
            for name, joints in others.items()
        }

    def _declare_command(self) -> None:
        self._declare_vector(
            "joint_position_commanded",
            self._arm.num_joints,
            lambda context: self._state(context).motion.at(context.get_time()),
        )

    def _positions(self, context: Context) -> Array:
        return np.array(self._joint_state.Eval(context))[: self._arm.num_joints]

    def _others_now(self, context: Context) -> dict[str, Array]:
        """Measured positions of the other arms by the names of their models."""
        return {
            name: np.array(port.Eval(context))[: port.size() // 2]
            for name, port in self._others.items()
        }

    def _motion(self, path: Array, context: Context) -> JointMotion:
        """The motion through a path (K, n) that begins now."""
        pace = float(read(self._pace, context, 1.0)[0])
        limits, speed = pace * self._limits, pace * self._transit.speed
        return rest_to_rest(path, self._arm, context.get_time(), speed, limits)

    def _line(
        self, postures: Array, speed: float, context: Context, eased: bool = False
    ) -> JointMotion:
        """The motion through postures (K, n) close to each other, at a speed [m/s], from now on."""
        pace = float(read(self._pace, context, 1.0)[0])
        limits, now = pace * self._limits, context.get_time()
        return along_line(postures, self._arm, now, pace * speed, limits, eased)
