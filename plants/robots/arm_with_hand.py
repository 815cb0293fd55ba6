"""An arm that carries a hand: as it is simulated, and as the robot knows it."""

from dataclasses import dataclass
from pathlib import Path

from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame, ModelInstanceIndex

from crossmodal.maths.arrays import Array
from crossmodal.plants.parsing import add_model, make_parser


@dataclass(kw_only=True, frozen=True)
class ArmWithHand:
    """The files of an arm and of its hand, and where the two are joined.

    Attributes:
        arm: SDF or URDF file.
        hand: Likewise.
        base: Frame of the arm that is fixed in the world.
        flange: Frame of the arm that carries the hand.
        mount: Frame of the hand that is fixed to the flange.
        hand_frames: Frames of the hand that the robot's model of its arm has too.
    """

    arm: Path
    hand: Path
    base: str = "base"
    flange: str = "tool_plate"
    mount: str = "wrist"
    hand_frames: tuple[str, ...] = ("end_effector", "sensor")


def add_robot(
    plant: MultibodyPlant,
    robot: ArmWithHand,
    X_WBase: RigidTransform,
    arm: str = "arm",
    hand: str = "hand",
) -> tuple[ModelInstanceIndex, ModelInstanceIndex]:
    """Adds the arm, its base welded to the world, and the hand on its flange.

    Args:
        plant: Not finalized yet.
        robot: What is added.
        X_WBase: Pose of the arm's base.
        arm: Name of the arm's model instance.
        hand: Name of the hand's model instance.
    """
    parser = make_parser(plant)
    arm_index = add_model(parser, robot.arm, arm)
    hand_index = add_model(parser, robot.hand, hand)
    base = plant.GetFrameByName(robot.base, arm_index)
    plant.WeldFrames(plant.world_frame(), base, X_WBase)
    flange = plant.GetFrameByName(robot.flange, arm_index)
    plant.WeldFrames(flange, plant.GetFrameByName(robot.mount, hand_index))
    return arm_index, hand_index


def make_arm_with_load(robot: ArmWithHand, X_WBase: RigidTransform) -> MultibodyPlant:
    """The arm alone, as the robot knows it: the open hand is one rigid load on its flange.

    Frames: those of the arm and `robot.hand_frames`.
    """
    hand = MultibodyPlant(0.0)
    hand_index = add_model(make_parser(hand), robot.hand, "hand")
    mount = hand.GetFrameByName(robot.mount, hand_index)
    hand.WeldFrames(hand.world_frame(), mount)
    hand.Finalize()
    context = hand.CreateDefaultContext()
    load = hand.CalcSpatialInertia(context, mount, hand.GetBodyIndices(hand_index))
    arm = MultibodyPlant(0.0)
    arm_index = add_model(make_parser(arm), robot.arm, "arm")
    base = arm.GetFrameByName(robot.base, arm_index)
    arm.WeldFrames(arm.world_frame(), base, X_WBase)
    body = arm.AddRigidBody("hand_load", arm_index, load)
    arm.WeldFrames(arm.GetFrameByName(robot.flange, arm_index), body.body_frame())
    for name in robot.hand_frames:
        X_BF = hand.GetFrameByName(name, hand_index).CalcPose(context, mount)
        arm.AddFrame(FixedOffsetFrame(name=name, P=body.body_frame(), X_PF=X_BF))
    arm.Finalize()
    return arm


def hand_load(arm: MultibodyPlant) -> tuple[float, Array]:
    """Mass [kg] and centre of mass p_SScm_S (3,) [m] of the hand as the wrist sensor carries it.

    Args:
        arm: Of `make_arm_with_load`.
    """
    body = arm.GetBodyByName("hand_load")
    inertia = body.default_spatial_inertia()
    X_BS = arm.GetFrameByName("sensor").CalcPose(arm.CreateDefaultContext(), body.body_frame())
    return inertia.get_mass(), X_BS.inverse() @ inertia.get_com()
