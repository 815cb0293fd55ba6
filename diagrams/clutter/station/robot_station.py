"""The station with robots: one arm looks, another one touches, as one Diagram.

Its outputs are what the robots have; the truth leaves it only through ports named `cheat_...`.
"""

from pydrake.common.value import Value
from pydrake.math import RigidTransform
from pydrake.multibody.plant import ExternallyAppliedSpatialForceMultiplexer
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import Context, DiagramBuilder
from pydrake.systems.primitives import ConstantValueSource

from crossmodal.diagrams.clutter.estimators import believed_table, load_model
from crossmodal.diagrams.clutter.own_mesh import simulated_model
from crossmodal.diagrams.clutter.robot_config import (
    CAMERA_ARM,
    CAMERA_HAND,
    GRIPPER,
    OBJECT,
    ROBOTS,
    TOUCH_ARM,
)
from crossmodal.diagrams.clutter.scenario import GOODS_DIR, Scenario, object_names, target_name
from crossmodal.diagrams.clutter.start import clutter_poses, first_guess, true_pose
from crossmodal.diagrams.clutter.station.believed_arms import believed_arms
from crossmodal.diagrams.clutter.station.declutter_control import add_declutter_control
from crossmodal.diagrams.clutter.station.robot_control import add_control
from crossmodal.diagrams.clutter.station.robot_measurements import (
    add_measurements,
    believed_camera,
    believed_taxels,
)
from crossmodal.diagrams.clutter.station.robot_sensors import add_sensors
from crossmodal.diagrams.clutter.station.wiring import StationWiring
from crossmodal.diagrams.run.application import Station
from crossmodal.diagrams.run.calibration import Calibration, draw_base
from crossmodal.diagrams.stations.connections import connect_alike
from crossmodal.diagrams.stations.drives import hold_still
from crossmodal.diagrams.stations.true_pose import add_true_pose
from crossmodal.plants.external_forces import ExternalForces
from crossmodal.plants.goods.clutter_density import measure_density
from crossmodal.plants.resting_bodies import RestingBodies
from crossmodal.plants.robots.arm_with_hand import make_arm_with_load
from crossmodal.plants.robots.panda import PANDA_AWAY
from crossmodal.plants.robots.ur5 import UR5_HOME
from crossmodal.plants.scene import ObjectPlacement, add_manipulation_scene
from crossmodal.systems.port_values import of_mesh, of_middle
from crossmodal.systems.pose.pose_measurements import Displacements

HOMES = {CAMERA_ARM: PANDA_AWAY, TOUCH_ARM: UR5_HOME}


def make_robot_station(scenario: Scenario, calibration: Calibration) -> Station:
    """Builds the station.

    Output ports of its Diagram: `pose_measurement`, `pose_guess`, `view_latest`, `grid_latest`,
    `touch_latest`, `touch_end`, `depth_measured`, `color_measured`, `robot_mask`,
    `camera_joint_state_window`, `touch_joint_state_window`, `taxel_window`, `task_status`,
    `cheat_object_pose`, `cheat_query_object`. With clutter also `cheat_clutter_density`, and
    `cheat_<name>_pose` of each object. Input ports: `object_pose`, and those of `add_control`,
    `add_sensors` and `add_cameras`, which may stay unconnected.

    Args:
        scenario: With its seed, by which the object's pose, what lies around it, the noise of all
            sensors, the true camera and where the arms truly stand are drawn.
        calibration: What the robots believe of themselves.
    """
    seed = scenario.seed
    errors = scenario.calibration.drawn_errors(seed)
    bases = {name: arm.X_WBase for name, arm in calibration.arms.items()}
    # W is where the camera's arm stands; how the two stand to each other is known up to errors.
    bases[TOUCH_ARM] = draw_base(TOUCH_ARM, bases[TOUCH_ARM], errors, seed)
    model, table = load_model(scenario), believed_table(scenario)
    clutter = clutter_poses(scenario)
    if clutter:
        X_WO = clutter[target_name(scenario)]
        X_WM = of_middle(X_WO.GetAsMatrix4(), model.middle)
    else:
        X_WM = true_pose(scenario, model)
        X_WO = RigidTransform(of_mesh(X_WM, model.middle))
    objects = {OBJECT: ObjectPlacement(model=simulated_model(scenario), X_WO=X_WO, free=True)}
    for name in object_names(scenario):
        file = GOODS_DIR / name / f"{name}.sdf"
        objects[name] = ObjectPlacement(model=file, X_WO=clutter[name], free=True)
    builder = DiagramBuilder()
    robots = [(CAMERA_ARM, CAMERA_HAND), (TOUCH_ARM, GRIPPER)]
    scene = add_manipulation_scene(
        builder,
        scenario.plant,
        objects,
        robots,
        bases,
        weightless=[name for robot in robots for name in robot],
    )
    wiring = StationWiring(builder=builder, scene=scene, scenario=scenario, calibration=calibration)
    plant = scene.plant
    arms = {name: make_arm_with_load(ROBOTS[name], X) for name, X in bases.items()}
    sensors = add_sensors(wiring, arms, HOMES)
    believed, declutter = believed_arms(wiring, sensors, HOMES), None
    if clutter:
        assert table is not None, "the scenario is refused otherwise"
        declutter = add_declutter_control(wiring, model, table.height, sensors, believed)
        guessed = declutter.sequence.GetOutputPort("pose_guess")
    else:
        guess = Value[object](first_guess(scenario, X_WM, model))
        source = builder.AddNamedSystem("pose_guess", ConstantValueSource(guess))
        guessed = source.get_output_port()
    camera, taxels = believed_camera(calibration), believed_taxels(scenario, calibration)
    # What joints' errors do differs from posture to posture by a millimetre or two.
    displaced = Displacements(camera=camera, taxels=taxels).touch(HOMES[TOUCH_ARM])
    control = add_control(wiring, model, table, sensors, believed, guessed, displaced, declutter)
    measurements = add_measurements(wiring, model, table, camera, taxels, sensors, guessed, control)
    if declutter is None:
        closed = plant.GetPositions(plant.CreateDefaultContext(), scene.model(GRIPPER))
        hold_still(wiring, GRIPPER, closed)
    else:
        for port in ("segments", "object_masks"):
            connect_alike(builder, declutter.segmenter, port, measurements)
    builder.Connect(measurements.get_output_port(), control.views.GetInputPort("pose_measurement"))
    builder.ExportOutput(measurements.get_output_port(), "pose_measurement")
    builder.ExportOutput(guessed, "pose_guess")
    _add_outside(wiring)
    if clutter:
        density = measure_density(clutter, target_name(scenario))
        source = builder.AddNamedSystem("density", ConstantValueSource(Value[object](density)))
        builder.ExportOutput(source.get_output_port(), "cheat_clutter_density")

    def initialise(root: Context) -> None:
        context = plant.GetMyMutableContextFromRoot(root)
        for name, q in HOMES.items():
            plant.SetPositions(context, scene.model(name), q)

    resting = RestingBodies(plant, scene.scene_graph, _may_rest(wiring))
    return Station(
        diagram=builder.Build(),
        initialise=initialise,
        after_step=resting.after_step if clutter else None,
    )


def _may_rest(wiring: StationWiring) -> list[RigidBody]:
    """The bodies of all objects but those that somebody pushes from outside."""
    plant, scene = wiring.plant, wiring.scene
    pushed = [force.frame.partition("::")[0] for force in wiring.scenario.disturbances.forces]
    return [
        plant.get_body(index)
        for name, model in scene.objects.items()
        if name not in pushed
        for index in plant.GetBodyIndices(model)
    ]


def _add_outside(wiring: StationWiring) -> None:
    """Adds who pushes the object, and the truth for the evaluation."""
    builder, scene = wiring.builder, wiring.scene
    plant = scene.plant
    forces = wiring.scenario.disturbances.forces
    if forces:
        pushes = builder.AddNamedSystem("external_forces", ExternalForces(plant, forces))
        total = builder.AddNamedSystem(
            "outside_forces", ExternallyAppliedSpatialForceMultiplexer(1)
        )
        builder.Connect(plant.get_body_poses_output_port(), pushes.GetInputPort("body_poses"))
        builder.Connect(pushes.get_output_port(), total.get_input_port(0))
        builder.Connect(total.get_output_port(), plant.get_applied_spatial_force_input_port())
    for name, model in scene.objects.items():
        add_true_pose(builder, plant, plant.GetFrameByName("__model__", model), name)
    builder.ExportOutput(scene.scene_graph.get_query_output_port(), "cheat_query_object")
