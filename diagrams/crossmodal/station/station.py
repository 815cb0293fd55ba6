"""The station: plant, sensors and controllers of one episode, as one Diagram.

Its outputs are what a robot has (measured and commanded quantities); the truth leaves it only
through ports named `cheat_...`, for evaluation.
"""

from dataclasses import dataclass

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from pydrake.systems.sensors import CameraInfo

from diagrams.crossmodal.station.station_config import (
    ARM,
    HAND,
    OBJECT,
    StationConfig,
    StationWiring,
)
from diagrams.crossmodal.station.station_control import add_control, taught_postures
from diagrams.crossmodal.station.station_sensors import add_proprioception, add_vision
from diagrams.stations.lighting import Light
from diagrams.stations.object_truth import ObjectTruth
from maths.arrays import Array
from plants.camera_view import MountedCamera
from plants.joint_friction import JointFriction
from plants.robots.arm_with_hand import make_arm_with_load
from plants.robots.wam import WAM_WITH_SOFT_HAND
from plants.scene import (
    ManipulationScene,
    ObjectPlacement,
    add_manipulation_scene,
    facing,
)


@dataclass(kw_only=True)
class Station:
    """The station's Diagram and what the wiring around it needs to know.

    Attributes:
        diagram: See `make_station` for its ports.
        scene: The plant and its names.
        arm: The robot's knowledge of its arm, the hand a rigid load.
        intrinsics: Of the camera.
        X_WC: The camera's calibrated pose.
        joint: The explored joint.
        q_start: Posture (n,) at the start of the approach, true, [rad].
        locked: Whether the object is fixed to the world.
    """

    diagram: Diagram
    scene: ManipulationScene
    arm: MultibodyPlant
    intrinsics: CameraInfo
    X_WC: RigidTransform
    joint: Joint
    q_start: Array
    locked: bool

    def SetInitialState(self, root_context: Context) -> None:
        """Puts the arm where the approach begins; locks the object if it is to stay."""
        context = self.scene.plant.GetMyMutableContextFromRoot(root_context)
        self.scene.plant.SetPositions(context, self.scene.model(ARM), self.q_start)
        if self.locked:
            self.joint.Lock(context)


def make_station(
    config: StationConfig,
    placement: ObjectPlacement,
    joint_name: str,
    handle_frame: str,
    pull_direction: Array,
    intrinsics: CameraInfo,
    X_WC: RigidTransform,
    light: Light,
    seed: int,
) -> Station:
    """Builds the station.

    Output ports of its Diagram: `color_measured`, `depth_measured`, `robot_mask`,
    `joint_state_window`, `wrench_window`, `pressure_window`, `interaction_active`, `phase`,
    `grasp_lost`, `path_planned`, `cheat_configuration`, `cheat_body_pose`, `cheat_plant_state`,
    `cheat_query_object`. Input ports, which may stay unconnected: `PERCEIVED_INPUTS`.

    Args:
        config: Of plant, sensors and controllers.
        placement: The object.
        joint_name: The joint to explore.
        handle_frame: The object's frame to grasp, x out of the object, y along the bar.
        pull_direction: Where the hand pulls to explore (3,), in the handle's frame.
        intrinsics: Of the camera.
        X_WC: Its pose.
        light: Disturbances.
        seed: Of the noise of all sensors and of how the hand is guided to the handle.

    Raises:
        ValueError: for impossible values, unknown names, a handle out of reach.
    """
    builder = DiagramBuilder()
    scene = add_manipulation_scene(builder, config.plant, {OBJECT: placement}, [(ARM, HAND)])
    plant, explored = scene.plant, scene.objects[OBJECT]
    for kind, name, known in (
        (
            "joint",
            joint_name,
            [j.name() for j in map(plant.get_joint, plant.GetJointIndices(explored))],
        ),
        (
            "frame",
            handle_frame,
            [plant.get_frame(i).name() for i in plant.GetFrameIndices(explored)],
        ),
    ):
        if name not in known:
            raise ValueError(
                f"{placement.model}: no {kind} named '{name}'; there are {', '.join(known)}"
            )
    joint = plant.GetJointByName(joint_name, explored)
    X_WBase = scene.pose("base", ARM)
    wiring = StationWiring(
        builder=builder,
        scene=scene,
        true_arm=make_arm_with_load(WAM_WITH_SOFT_HAND, X_WBase),
        X_WBase=X_WBase,
        arm=make_arm_with_load(WAM_WITH_SOFT_HAND, X_WBase),
        config=config,
        seed=seed,
    )
    _add_object_mechanics(wiring, joint)
    X_WHandle = plant.GetFrameByName(handle_frame, explored).CalcPoseInWorld(
        plant.CreateDefaultContext()
    )
    q_grasp, q_start = taught_postures(wiring, X_WHandle)
    encoders = add_proprioception(wiring, q_grasp)
    # A person guided the hand along the approach, so the arm knows it as its encoders read it.
    taught = [
        encoders.measure(np.append(q, np.zeros_like(q)), 0)[: q.size] for q in (q_grasp, q_start)
    ]
    direction_E = facing(RigidTransform()).rotation().inverse() @ pull_direction
    sequence = add_control(wiring, encoders, taught[0], taught[1], direction_E)
    camera = MountedCamera(intrinsics=intrinsics, X_PC=X_WC)
    add_vision(wiring, encoders, sequence, camera, camera, light)
    return Station(
        diagram=builder.Build(),
        scene=scene,
        arm=wiring.arm,
        intrinsics=intrinsics,
        X_WC=X_WC,
        joint=joint,
        q_start=q_start,
        locked=config.control.excitation is not None,
    )


def _add_object_mechanics(wiring: StationWiring, joint: Joint) -> None:
    builder, scene = wiring.builder, wiring.scene
    plant = scene.plant
    friction = builder.AddNamedSystem("joint_friction", JointFriction(plant, scene.friction))
    truth = builder.AddNamedSystem("object_truth", ObjectTruth(plant, joint))
    builder.Connect(plant.get_state_output_port(), friction.get_input_port())
    builder.Connect(friction.get_output_port(), plant.get_applied_generalized_force_input_port())
    builder.Connect(plant.get_state_output_port(), truth.get_input_port())
    for name in ("cheat_configuration", "cheat_body_pose"):
        builder.ExportOutput(truth.GetOutputPort(name), name)
    builder.ExportOutput(plant.get_state_output_port(), "cheat_plant_state")
    builder.ExportOutput(scene.scene_graph.get_query_output_port(), "cheat_query_object")
