"""The truth about hinge and contact, from the simulated plant."""

import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import GeometryId
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, RevoluteJoint
from pydrake.systems.framework import Context, LeafSystem

from crossmodal.diagrams.flap.robot_config import TOOL
from crossmodal.diagrams.flap.station.wiring import StationWiring
from crossmodal.diagrams.flap.truth import UNKNOWN_FLAP, FlapTruth
from crossmodal.plants.scene import position_index
from crossmodal.plants.tools.wiper import EDGE_FRAME
from crossmodal.systems.sensors.taxels import pressure_on


class FlapTruthSource(LeafSystem):
    """Hinge, flap and contact as they are.

    Input ports:
    - `contact_results`: `ContactResults` of the plant.
    - `body_poses`: list of `RigidTransform` X_WB, one per body, from the plant.
    - `tool_state`: positions and velocities of the tool.

    Output ports:
    - `cheat_flap`: `FlapTruth`.

    Frames: S fingertip, F the tool's frame `edge`, J the hinge on the body that is held.
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        hinge: RevoluteJoint,
        edge: Frame,
        fingertip: Frame,
        skin: GeometryId,
    ) -> None:
        """Keeps the frames.

        Args:
            plant: The simulated one, finalized.
            hinge: Of the flap.
            edge: Of the flap, its x out of the face that is turned to the camera at first.
            fingertip: S.
            skin: The fingertip's shape.
        """
        super().__init__()
        instance = hinge.model_instance()
        self._frames = {
            name: (int(frame.body().index()), frame.GetFixedPoseInBodyFrame())
            for name, frame in (("J", hinge.frame_on_parent()), ("F", edge), ("S", fingertip))
        }
        self._axis = hinge.revolute_axis()
        self._theta = position_index(plant, hinge)
        self._skin = skin
        self._contacts = self.DeclareAbstractInputPort(
            "contact_results", plant.get_contact_results_output_port().Allocate()
        )
        self._poses = self.DeclareAbstractInputPort(
            "body_poses", plant.get_body_poses_output_port().Allocate()
        )
        self._state = self.DeclareVectorInputPort(
            "tool_state", plant.num_multibody_states(instance)
        )
        self.DeclareAbstractOutputPort(
            "cheat_flap",
            lambda: Value[object](UNKNOWN_FLAP),
            lambda context, output: output.set_value(self._truth(context)),
        )

    def _pose(self, context: Context, frame: str) -> RigidTransform:
        body, X_BF = self._frames[frame]
        return self._poses.Eval(context)[body] @ X_BF

    def _truth(self, context: Context) -> FlapTruth:
        X_WS, X_WJ = self._pose(context, "S"), self._pose(context, "J")
        pressure = pressure_on(self._contacts.Eval(context), self._skin, X_WS)
        force = float(np.sum(pressure.force))
        p_SC = pressure.force @ pressure.p_SQ / force if force > 0.0 else np.full(3, np.nan)
        p_WC = X_WS @ p_SC
        k_W, p_WJ = X_WJ.rotation() @ self._axis, X_WJ.translation()
        near = p_WC if force > 0.0 else X_WS.translation()
        return FlapTruth(
            theta=float(self._state.Eval(context)[self._theta]),
            k_W=k_W,
            p_WK=p_WJ + k_W * float(k_W @ (near - p_WJ)),
            n_W=self._pose(context, "F").rotation().matrix()[:, 0].copy(),
            touching=force > 0.0,
            p_WC=p_WC,
            p_SC=p_SC,
            Sy_W=X_WS.rotation().matrix()[:, 1].copy(),
            force=force,
            edge_force=float(k_W @ (X_WS.rotation() @ pressure.f_S)),
        )


def add_flap_truth(wiring: StationWiring) -> None:
    """Adds the truth and exports its ports."""
    builder, plant, tool = wiring.builder, wiring.scene.plant, wiring.scene.model(TOOL)
    edge = plant.GetFrameByName(EDGE_FRAME, tool)
    truth = builder.AddNamedSystem(
        "flap_truth",
        FlapTruthSource(plant, wiring.hinge, edge, wiring.fingertip, wiring.skin),
    )
    for source, port in (
        (plant.get_contact_results_output_port(), "contact_results"),
        (plant.get_body_poses_output_port(), "body_poses"),
        (plant.get_state_output_port(tool), "tool_state"),
    ):
        builder.Connect(source, truth.GetInputPort(port))
    builder.ExportOutput(truth.get_output_port(), "cheat_flap")
