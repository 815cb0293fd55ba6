"""The robot: an arm with a soft hand, as simulated and as it knows itself."""

from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame, ModelInstanceIndex

from maths.arrays import Array
from models import SDF_DIR

ARM_FILE = "wam_arm.sdf"
HAND_FILE = "soft_hand.sdf"
ARM_JOINTS = [f"joint_{number}" for number in range(1, 8)]
FINGER_JOINTS = [
    f"{finger}_joint_{link}"
    for finger in ("index", "middle", "ring", "little", "thumb")
    for link in (1, 2, 3)
]
# Typical finger angles of the hand around a handle, for the robot's picture of itself, [rad].
CLOSED_POSTURE = dict(zip(FINGER_JOINTS, [0.6, 1.0, 1.1] * 4 + [0.8, 0.7, 0.9], strict=True))


def add_package(parser: Parser) -> None:
    """Makes `package://crossmodal/...` name the files in `models/sdf`."""
    parser.package_map().Add("crossmodal", str(SDF_DIR))


def add_robot(plant: MultibodyPlant, X_WBase: RigidTransform) -> None:
    """Adds the arm, its base welded to the world, and the hand on its tool plate."""
    parser = Parser(plant)
    add_package(parser)
    parser.AddModels(str(SDF_DIR / ARM_FILE))
    parser.AddModels(str(SDF_DIR / HAND_FILE))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"), X_WBase)
    plant.WeldFrames(plant.GetFrameByName("tool_plate"), plant.GetFrameByName("wrist"))


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
    Parser(arm).AddModels(str(SDF_DIR / ARM_FILE))
    arm.WeldFrames(arm.world_frame(), arm.GetFrameByName("base"), X_WBase)
    body = arm.AddRigidBody("hand_load", ModelInstanceIndex(2), load)
    arm.WeldFrames(arm.GetFrameByName("tool_plate"), body.body_frame())
    for name in ("end_effector", "sensor"):
        X_BF = hand.GetFrameByName(name).CalcPose(context, wrist.body_frame())
        arm.AddFrame(FixedOffsetFrame(name=name, P=body.body_frame(), X_PF=X_BF))
    arm.Finalize()
    return arm


def hand_load(arm: MultibodyPlant) -> tuple[float, Array]:
    """Mass [kg] and centre of mass p_SScm_S (3,) [m] of the hand as the wrist sensor carries it."""
    body = arm.GetBodyByName("hand_load")
    inertia = body.default_spatial_inertia()
    X_BS = arm.GetFrameByName("sensor").CalcPose(arm.CreateDefaultContext(), body.body_frame())
    return inertia.get_mass(), X_BS.inverse() @ inertia.get_com()
