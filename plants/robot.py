"""The robot: an arm with a soft hand, as simulated and as it knows itself."""

import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from models import SDF_DIR

Array = npt.NDArray[np.float64]

ARM_FILE = "wam_arm.sdf"
HAND_FILE = "soft_hand.sdf"
FINGER_JOINTS = [
    f"{finger}_joint_{link}"
    for finger in ("index", "middle", "ring", "little", "thumb")
    for link in (1, 2, 3)
]
# Finger angles of the open hand and of the hand closed on nothing in particular, [rad].
OPEN_POSTURE = np.zeros(15)
CLOSED_POSTURE = np.array([0.5, 0.9, 0.7] * 4 + [0.4, 0.5, 0.4])


def add_package(parser: Parser) -> None:
    """Makes `package://crossmodal/...` name the files in `models/sdf`."""
    parser.package_map().Add("crossmodal", str(SDF_DIR))


def make_arm_with_load(X_WBase: RigidTransform) -> MultibodyPlant:
    """The arm as the robot knows it: the open hand is one rigid load on its tool plate.

    Frames: `end_effector` (E), `sensor` (S).
    """
    hand = MultibodyPlant(0.0)
    Parser(hand).AddModels(str(SDF_DIR / HAND_FILE))
    wrist = hand.GetBodyByName("wrist")
    hand.WeldFrames(hand.world_frame(), wrist.body_frame())
    hand.Finalize()
    context = hand.CreateDefaultContext()
    load = hand.CalcSpatialInertia(
        context, wrist.body_frame(), hand.GetBodyIndices(wrist.model_instance())
    )

    arm = MultibodyPlant(0.0)
    parser = Parser(arm)
    add_package(parser)
    parser.AddModels(str(SDF_DIR / ARM_FILE))
    arm.WeldFrames(arm.world_frame(), arm.GetFrameByName("base"), X_WBase)
    body = arm.AddRigidBody("hand_load", ModelInstanceIndex(2), load)
    arm.WeldFrames(arm.GetFrameByName("tool_plate"), body.body_frame())
    for name in ("end_effector", "sensor"):
        X_PF = hand.GetFrameByName(name).CalcPose(context, wrist.body_frame())
        arm.AddFrame(make_frame(name, body.body_frame(), X_PF))
    arm.Finalize()
    return arm


def make_frame(name: str, parent: object, X_PF: RigidTransform) -> object:
    """A frame fixed to another."""
    from pydrake.multibody.tree import FixedOffsetFrame

    return FixedOffsetFrame(name=name, P=parent, X_PF=X_PF)
