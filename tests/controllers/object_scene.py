"""Goods on the table of two arms, one of which moves them; simulated, without cameras."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from known_scene import CAMERA_AWAY, SCENE, touch_arm, touch_planner
from pydrake.common.value import Value
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantValueSource, ConstantVectorSource, MatrixGain

from crossmodal.controllers.primitives.move_object import MoveObject
from crossmodal.controllers.primitives.move_object_config import (
    ActionEnd,
    MoveObjectConfig,
)
from crossmodal.models import SDF_DIR
from crossmodal.models.gripper_taxels import ARRAYS, gripper_taxels
from crossmodal.plants.hands.taxel_gripper import finger_shapes
from crossmodal.plants.robots.panda import PANDA_AWAY
from crossmodal.plants.robots.ur5 import UR5_HOME
from crossmodal.plants.scene import ObjectPlacement, PlantConfig, add_manipulation_scene
from crossmodal.systems.port_values import ActionRequest
from crossmodal.systems.sensors.finger_encoders import FingerEncoders, FingerEncodersConfig
from crossmodal.systems.sensors.taxel_array import (
    TaxelArrayConfig,
    TaxelArrayForces,
    TaxelArraySensor,
)

_ARM, _GRIPPER = "touch_arm", "gripper"
_ROBOTS = [("camera_arm", "camera_hand"), (_ARM, _GRIPPER)]


class ObjectScene:
    """The station's plant with goods, and `MoveObject`, which gets one request.

    Args:
        poses: X_WO of goods by their names.
        request: What is to be done.
        config: Of the action.
        seed: Of the taxels' noise.
        friction: Of all goods where it is not their own, e.g. to let them slip.
    """

    def __init__(
        self,
        poses: Mapping[str, RigidTransform],
        request: ActionRequest,
        config: MoveObjectConfig | None = None,
        seed: int = 0,
    ) -> None:
        builder = DiagramBuilder()
        goods = SDF_DIR / "goods"
        scene = add_manipulation_scene(
            builder,
            PlantConfig(scene=SCENE, time_step=0.0025, stiction_tolerance=1e-4),
            {
                name: ObjectPlacement(model=goods / name / f"{name}.sdf", X_WO=X_WO, free=True)
                for name, X_WO in poses.items()
            },
            _ROBOTS,
            weightless=[name for robot in _ROBOTS for name in robot],
        )
        self.plant, self.scene_graph = scene.plant, scene.scene_graph
        plant = self.plant
        self.models = {name: scene.model(name) for name in (*poses, _ARM, _GRIPPER, "camera_arm")}
        self.move = builder.AddNamedSystem(
            "move",
            MoveObject(
                config or MoveObjectConfig(),
                touch_arm(),
                touch_planner(),
                _GRIPPER,
                UR5_HOME,
                {"camera_arm": PANDA_AWAY},
            ),
        )
        layout = gripper_taxels()
        gripper = self.models[_GRIPPER]
        shapes = finger_shapes(plant, self.scene_graph.model_inspector(), gripper)
        forces = builder.AddSystem(
            TaxelArrayForces(
                plant,
                plant.GetFrameByName("end_effector", gripper),
                shapes.taxels,
                shapes.cores,
                layout,
            )
        )
        taxels = builder.AddSystem(TaxelArraySensor(TaxelArrayConfig(), ARRAYS, layout.array, seed))
        fingers = builder.AddSystem(FingerEncoders(FingerEncodersConfig(), 2))
        wanted = builder.AddSystem(ConstantValueSource(Value[object](request)))
        clear = builder.AddSystem(ConstantVectorSource([1.0]))
        positions = builder.AddSystem(MatrixGain(np.eye(2, 4)))
        states = {name: plant.get_state_output_port(self.models[name]) for name in self.models}
        for source, system, port in (
            (plant.get_contact_results_output_port(), forces, "contact_results"),
            (plant.get_body_poses_output_port(), forces, "body_poses"),
            (forces.get_output_port(), taxels, "taxel_forces"),
            (states[_GRIPPER], positions, "u0"),
            (positions.get_output_port(), fingers, "finger_positions"),
            (taxels.GetOutputPort("taxel_measured"), self.move, "taxel_measured"),
            (
                fingers.GetOutputPort("hand_positions_measured"),
                self.move,
                "finger_position_measured",
            ),
            (states[_ARM], self.move, "joint_state_measured"),
            (states["camera_arm"], self.move, "camera_arm_joint_state_measured"),
            (wanted.get_output_port(), self.move, "action_request"),
            (clear.get_output_port(), self.move, "is_clear"),
        ):
            builder.Connect(source, system.GetInputPort(port))
        for name, size, command in (
            (_ARM, 6, "joint_position_commanded"),
            (_GRIPPER, 2, "finger_position_commanded"),
        ):
            still = builder.AddSystem(MatrixGain(np.eye(2 * size, size)))
            builder.Connect(self.move.GetOutputPort(command), still.get_input_port())
            builder.Connect(
                still.get_output_port(), plant.get_desired_state_input_port(self.models[name])
            )
        for name, q in CAMERA_AWAY.items():
            held = builder.AddSystem(ConstantVectorSource(np.append(q, np.zeros(len(q)))))
            builder.Connect(
                held.get_output_port(), plant.get_desired_state_input_port(self.models[name])
            )
        self.diagram = builder.Build()
        self.simulator = Simulator(self.diagram)
        self.context = self.simulator.get_mutable_context()
        context = plant.GetMyMutableContextFromRoot(self.context)
        for name, q in {**CAMERA_AWAY, _ARM: UR5_HOME}.items():
            plant.SetPositions(context, self.models[name], q)

    def read(self, port: str) -> Any:
        """An output of `MoveObject`."""
        system = self.move
        return system.GetOutputPort(port).Eval(system.GetMyContextFromRoot(self.context))

    def pose(self, name: str) -> RigidTransform:
        """X_WO of an object, as it truly is."""
        (body,) = self.plant.GetBodyIndices(self.models[name])
        return self.plant.EvalBodyPoseInWorld(
            self.plant.GetMyContextFromRoot(self.context), self.plant.get_body(body)
        )

    def run(self, longest: float = 90.0, step: float = 0.1) -> ActionEnd:
        """Simulates until the action has ended; raises if it does not within so long, [s]."""
        while self.context.get_time() < longest:
            self.simulator.AdvanceTo(self.context.get_time() + step)
            end: ActionEnd = self.read("action_end")
            if end.number > 0:
                return end
        raise AssertionError(f"it still {self.read('phase')}")
