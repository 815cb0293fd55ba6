"""Small systems of the station: what disturbs the camera, and what is true of the object."""

from dataclasses import dataclass, field

import numpy as np
from pydrake.common.value import Value
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint
from pydrake.systems.framework import BasicVector, Context, LeafSystem


@dataclass(kw_only=True)
class Light:
    """When the lights are off and when something covers the camera, as (start, end), [s].

    Attributes:
        lamp: Intensity of a lamp at the camera.
    """

    lights_off: list[tuple[float, float]] = field(default_factory=list)
    covered: list[tuple[float, float]] = field(default_factory=list)
    lamp: float = 0.0


class Lighting(LeafSystem):
    """Light and cover over time; the disturbances of a scenario.

    .. pydrake_system::

        name: Lighting
        output_ports:
        - illumination
        - cover

    - illumination: (1,) 1 normal, 0 lights off.
    - cover: (1,) 1 while something covers the camera.
    """

    def __init__(self, light: Light) -> None:
        super().__init__()

        def within(intervals: list[tuple[float, float]], time: float) -> float:
            return float(any(start <= time < end for start, end in intervals))

        def illumination(context: Context, output: BasicVector) -> None:
            output.SetAtIndex(0, 1.0 - within(light.lights_off, context.get_time()))

        def cover(context: Context, output: BasicVector) -> None:
            output.SetAtIndex(0, within(light.covered, context.get_time()))

        self.DeclareVectorOutputPort("illumination", 1, illumination, {self.time_ticket()})
        self.DeclareVectorOutputPort("cover", 1, cover, {self.time_ticket()})


class ObjectTruth(LeafSystem):
    """The explored joint's true position and the moved body's true pose, for evaluation.

    .. pydrake_system::

        name: ObjectTruth
        input_ports:
        - plant_state
        output_ports:
        - cheat_configuration
        - cheat_body_pose

    - plant_state: (nq + nv,).
    - cheat_configuration: (1,) [m or rad].
    - cheat_body_pose: `RigidTransform` X_WB of the joint's child.
    """

    def __init__(self, plant: MultibodyPlant, joint: Joint) -> None:
        super().__init__()
        self._plant, self._joint = plant, joint
        self._scratch = plant.CreateDefaultContext()
        self._state = self.DeclareVectorInputPort("plant_state", plant.num_multibody_states())
        self.DeclareVectorOutputPort("cheat_configuration", 1, self._calc_configuration)
        self.DeclareAbstractOutputPort(
            "cheat_body_pose", lambda: Value(RigidTransform()), self._calc_pose
        )

    def _calc_configuration(self, context: Context, output: BasicVector) -> None:
        state = np.asarray(self._state.Eval(context))
        output.SetAtIndex(0, state[self._joint.position_start()])

    def _calc_pose(self, context: Context, output: Value) -> None:
        self._plant.SetPositionsAndVelocities(self._scratch, self._state.Eval(context))
        output.set_value(self._plant.EvalBodyPoseInWorld(self._scratch, self._joint.child_body()))
