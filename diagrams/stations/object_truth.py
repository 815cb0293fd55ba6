"""What is true of the explored joint, for evaluation."""

import numpy as np
from pydrake.common.value import Value
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint
from pydrake.systems.framework import BasicVector, Context, LeafSystem


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
