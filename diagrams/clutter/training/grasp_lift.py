"""Simulated lifts: whether the gripper that robots have holds a good as geometry says."""

from dataclasses import dataclass

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import FixedOffsetFrame, PdControllerGains, PrismaticJoint
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from crossmodal.controllers.primitives.move_object_config import GripConfig
from crossmodal.diagrams.clutter.training.grasp_labels import grip_force
from crossmodal.diagrams.clutter.training.shapes import goods
from crossmodal.maths.arrays import Array
from crossmodal.models import SDF_DIR
from crossmodal.plants.goods.goods_scene import GOODS_DIR
from crossmodal.plants.hands.taxel_gripper import GRIPPER_FILE
from crossmodal.plants.parsing import add_model, make_parser
from crossmodal.systems.grasping.grasp_planner import grasp_pose

_PLANT = MultibodyPlantConfig(
    time_step=0.002, discrete_contact_approximation="lagged", stiction_tolerance=1e-4
)
_STIFFNESS, _DAMPING = 2e4, 1e3  # Of what carries the gripper, [N/m] and [N s/m].
_STEP = 0.01  # Between commands, [s].
# Mean speeds of heights above the grasp and of commanded positions of the fingers, [m/s].
_DOWN, _CLOSING, _UP = 0.25, 0.1, 0.12
_ABOVE, _LIFT = 0.08, 0.12  # From where it comes and how far it goes, [m].
_CLOSED = -0.01  # Commanded positions of fingers that close on something, [m].
_HOLD = 0.4  # After closing, and at the top, [s].
_HELD, _TURNED = 0.1, np.deg2rad(30.0)  # Least rise and largest rotation of what is held.


@dataclass(frozen=True, kw_only=True)
class Lift:
    """What became of an object.

    Attributes:
        rise: Of its centre of mass, [m].
        turned: By how much it is rotated, [rad].
    """

    rise: float
    turned: float

    @property
    def held(self) -> bool:
        """Whether it was lifted without turning much."""
        return self.rise > _HELD and self.turned < _TURNED


def simulate_lift(name: str, X_WO: Array, grasp: Array) -> Lift:
    """Lifts a good that stands on a table by a gripper that moves up and down alone.

    Args:
        name: Of models/sdf/goods.
        X_WO: Its pose (4, 4); the origin of W is on the table.
        grasp: (5,), see `grasp_geometry`.
    """
    builder = DiagramBuilder()
    plant: MultibodyPlant
    plant, _ = AddMultibodyPlant(_PLANT, builder)
    parser = make_parser(plant)
    table = add_model(parser, SDF_DIR / "work_table.sdf", "table")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("table", table))
    object_model = add_model(parser, GOODS_DIR / name / f"{name}.sdf", name)
    gripper = add_model(parser, GRIPPER_FILE, "gripper")
    X_WE = RigidTransform(grasp_pose(grasp, 0.0))
    place = plant.AddFrame(FixedOffsetFrame("grasp", plant.world_frame(), X_WE))
    carriage = plant.AddJoint(
        PrismaticJoint(
            "carriage", place, plant.GetFrameByName("end_effector", gripper), [0.0, 0.0, -1.0]
        )
    )
    drive = plant.AddJointActuator("carriage", carriage)
    drive.set_controller_gains(PdControllerGains(p=_STIFFNESS, d=_DAMPING))
    plant.Finalize()
    body = plant.get_body(plant.GetBodyIndices(object_model)[0])
    simulator = Simulator(builder.Build())
    root = simulator.get_mutable_context()
    context = plant.GetMyMutableContextFromRoot(root)
    plant.SetFreeBodyPose(context, body, RigidTransform(X_WO))
    half = 0.5 * float(grasp[3])
    carriage.set_translation(context, _ABOVE)
    for finger in ("left_joint", "right_joint"):
        plant.GetJointByName(finger, gripper).set_translation(context, half)
    desired = plant.get_desired_state_input_port(gripper)

    def go(start: Array, end: Array, speed: float, hold: float = 0.0) -> Array:
        """Moves the commands (both fingers, height) there, without a jerk."""
        seconds = float(np.abs(end - start).max()) / speed
        steps = int(np.ceil((seconds + hold) / _STEP))
        for k in range(1, steps + 1):
            phase = np.pi * min(k * _STEP / seconds, 1.0)
            commands = start + 0.5 * (1.0 - np.cos(phase)) * (end - start)
            rates = 0.5 * np.pi * np.sin(phase) / seconds * (end - start)
            desired.FixValue(context, [*commands, *rates])
            simulator.AdvanceTo(root.get_time() + _STEP)
        return end

    at = go(np.array([half, half, _ABOVE]), np.array([half, half, 0.0]), _DOWN)
    before = body.EvalPoseInWorld(context)
    at = go(at, np.array([_CLOSED, _CLOSED, 0.0]), _CLOSING, _HOLD)
    # The drives are springs, commanded into the object.
    into = grip_force(goods(name).mass) / GripConfig().stiffness
    fingers = plant.GetPositions(context, gripper)[:2] - into
    at = go(at, np.array([*fingers, 0.0]), _CLOSING, _HOLD)
    go(at, np.array([*fingers, _LIFT]), _UP, _HOLD)
    after = body.EvalPoseInWorld(context)
    p_OCm = body.default_com()
    return Lift(
        rise=float((after @ p_OCm - before @ p_OCm)[2]),
        turned=abs((before.inverse() @ after).rotation().ToAngleAxis().angle()),
    )
