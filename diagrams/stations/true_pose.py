"""Where a frame of the simulated world truly is, for the evaluation."""

from pydrake.common.value import Value
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem


class TruePose(LeafSystem):
    """The pose of a frame F that is fixed to a body of the plant.

    Input ports:
    - `body_poses`: list of `RigidTransform` X_WB, one per body, from the plant.

    Output ports:
    - `cheat_pose`: `RigidTransform` X_WF.
    """

    def __init__(self, plant: MultibodyPlant, frame: Frame) -> None:
        super().__init__()
        self._body = int(frame.body().index())
        self._X_BF = frame.GetFixedPoseInBodyFrame()
        model = plant.get_body_poses_output_port().Allocate()
        self._poses = self.DeclareAbstractInputPort("body_poses", model)
        self.DeclareAbstractOutputPort("cheat_pose", lambda: Value(RigidTransform()), self._calc)

    def _calc(self, context: Context, output: Value) -> None:
        output.set_value(self._poses.Eval(context)[self._body] @ self._X_BF)


def add_true_pose(builder: DiagramBuilder, plant: MultibodyPlant, frame: Frame, name: str) -> None:
    """Exports `cheat_<name>_pose`, the true pose of a frame of the simulated plant."""
    truth = builder.AddNamedSystem(f"{name}_truth", TruePose(plant, frame))
    builder.Connect(plant.get_body_poses_output_port(), truth.get_input_port())
    builder.ExportOutput(truth.get_output_port(), f"cheat_{name}_pose")
