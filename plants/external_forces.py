"""Forces from outside, such as a person's hand that pulls a drawer shut."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce, MultibodyPlant
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import Context, LeafSystem

from crossmodal.maths.validation import check, number, numbers
from crossmodal.plants.parsing import find_model


@dataclass(kw_only=True)
class ExternalForce:
    """A force on one frame of a model, for a time."""

    frame: str = ""  # Where it acts, as `model::frame`.
    # In the frame's axes.
    force: np.ndarray = numbers(np.zeros(3), at_least=-1e4, at_most=1e4, unit="N")
    start: float = number(0.0, at_least=0.0, at_most=86400.0, unit="s")  # Since the episode began.
    # When it ends, since the episode began.
    end: float = number(float("inf"), above=0.0, at_most=86400.0, unit="s", infinite=True)


class ExternalForces(LeafSystem):
    """Applies forces while their time is.

    Input ports:
    - `body_poses`: of the plant (true).

    Output ports:
    - `spatial_forces`: list of `ExternallyAppliedSpatialForce`.

    Args:
        plant: The finalized plant.
        forces: Any number of them.

    Raises:
        ValueError: for impossible values and unknown frames.
    """

    def __init__(self, plant: MultibodyPlant, forces: Sequence[ExternalForce]) -> None:
        super().__init__()
        self._forces = [(force, _find_frame(plant, force)) for force in forces]
        poses = plant.get_body_poses_output_port()
        self._poses = self.DeclareAbstractInputPort("body_poses", poses.Allocate())
        self.DeclareAbstractOutputPort(
            "spatial_forces",
            lambda: Value[list[ExternallyAppliedSpatialForce]](),
            self._calc_forces,
        )

    def _calc_forces(self, context: Context, output: AbstractValue) -> None:
        X_WBs, now = self._poses.Eval(context), context.get_time()
        acting = []
        for force, frame in self._forces:
            if not force.start <= now < force.end:
                continue
            index, X_BF = frame.body().index(), frame.GetFixedPoseInBodyFrame()
            applied = ExternallyAppliedSpatialForce()
            applied.body_index = index
            applied.p_BoBq_B = X_BF.translation()
            R_WF = X_WBs[int(index)].rotation() @ X_BF.rotation()
            applied.F_Bq_W = SpatialForce(np.zeros(3), R_WF @ force.force)
            acting.append(applied)
        output.set_value(acting)


def _find_frame(plant: MultibodyPlant, force: ExternalForce) -> Frame:
    check(force, "ExternalForce")
    model, _, name = force.frame.partition("::")
    instance = find_model(plant, model)
    if not plant.HasFrameNamed(name, instance):
        raise ValueError(f"ExternalForce on '{force.frame}': '{model}' has no frame '{name}'")
    return plant.GetFrameByName(name, instance)
