"""The station of the flap application: plant, sensors and what moves the arms, as one Diagram.

Its outputs are what the robots have (measured and commanded quantities); the truth leaves it only
through ports named `cheat_...`, for evaluation.
"""

from dataclasses import dataclass

from pydrake.systems.framework import Context, Diagram, DiagramBuilder

from diagrams.flap.calibration import ROBOTS
from diagrams.flap.robot_config import FINGER, HOLDER_HAND, TOOL
from diagrams.flap.scenario import Scenario
from diagrams.flap.station.flap_truth import add_flap_truth
from diagrams.flap.station.settling import Start, add_scene, settled_start
from diagrams.flap.station.station_control import add_drives, add_flip_control, hold_still
from diagrams.flap.station.station_sensors import add_joint_sensors, add_taxels, add_vision
from diagrams.flap.station.tool_placement import draw_tool
from diagrams.flap.station.wiring import StationWiring
from diagrams.run.calibration import Calibration, draw_base
from diagrams.stations.true_pose import add_true_pose
from plants.external_forces import ExternalForces
from plants.robots.arm_with_hand import make_arm_with_load
from plants.scene import ManipulationScene
from plants.tools.wiper import EDGE_FRAME
from systems.tactile.taxel_layout import SEMI_AXES


@dataclass(kw_only=True)
class FlapStation:
    """The station's Diagram and what of it others than the estimators may know.

    Attributes:
        diagram: See `make_flap_station` for its ports.
        scene: The simulated plant and its names.
        start: The true state at first.
    """

    diagram: Diagram
    scene: ManipulationScene
    start: Start

    def SetInitialState(self, root_context: Context) -> None:
        """The hand holds the tool, the finger waits at the flap."""
        context = self.scene.plant.GetMyMutableContextFromRoot(root_context)
        self.scene.plant.SetPositions(context, self.start.positions)


def make_flap_station(scenario: Scenario, calibration: Calibration) -> FlapStation:
    """Builds the station.

    Output ports of its Diagram: `color_measured`, `depth_measured`, `robot_mask`,
    `holder_joint_state_window`, `finger_joint_state_window`, `taxel_window`, `taxel_measured`,
    `task_status`, `cheat_flap`, `cheat_end_effector_pose` (of the holder),
    `cheat_fingertip_pose`, `cheat_query_object`.
    Input ports, which may stay unconnected: `flap_angle_latest`, `hinge_latest`.

    Args:
        scenario: With its seed, by which the tool and how it is held, the noise of all sensors,
            the true camera and where the arms truly stand are drawn.
        calibration: What the robots believe of themselves.

    Raises:
        ValueError: for impossible values, for a tool without hinge, handle or edge, and for one
            out of reach or out of a camera's sight.
    """
    errors, seed = scenario.calibration.errors, scenario.seed
    bases = {
        name: draw_base(name, arm.X_WBase, errors, seed) for name, arm in calibration.arms.items()
    }
    arms = {name: make_arm_with_load(ROBOTS[name], X) for name, X in bases.items()}
    tool = draw_tool(scenario, reach=float(SEMI_AXES[1]))
    builder = DiagramBuilder()
    wiring = StationWiring(
        builder=builder,
        scene=add_scene(builder, scenario, tool, bases),
        scenario=scenario,
        calibration=calibration,
        start=settled_start(scenario, tool, bases, arms),
    )
    _check_sight(wiring)
    drives = add_drives(wiring)
    hold_still(wiring, drives)
    encoders = add_joint_sensors(wiring, arms)
    taxels = add_taxels(wiring, scenario.finger.layout())
    add_flip_control(wiring, drives[FINGER], encoders[FINGER], taxels)
    add_vision(wiring, encoders)
    _add_outside(wiring)
    return FlapStation(diagram=builder.Build(), scene=wiring.scene, start=wiring.start)


def _check_sight(wiring: StationWiring) -> None:
    """Refuses a camera in whose image the flap is not."""
    p_WEdge = wiring.scene.pose(EDGE_FRAME, TOOL).translation()
    for name, camera in wiring.calibration.cameras.items():
        ((u, v),) = camera.project(p_WEdge)
        seen = 0.0 <= u < camera.intrinsics.width and 0.0 <= v < camera.intrinsics.height
        if not seen:  # Behind the camera, u and v are NaN.
            raise ValueError(
                f"cameras.{name}: the flap at {p_WEdge.round(2).tolist()} m is not in its image"
            )


def _add_outside(wiring: StationWiring) -> None:
    """Adds what disturbs the tool, and the truth for the evaluation."""
    builder, scene = wiring.builder, wiring.scene
    plant = scene.plant
    if wiring.scenario.disturbances.forces:
        forces = ExternalForces(plant, wiring.scenario.disturbances.forces)
        builder.AddNamedSystem("external_forces", forces)
        builder.Connect(plant.get_body_poses_output_port(), forces.get_input_port())
        builder.Connect(forces.get_output_port(), plant.get_applied_spatial_force_input_port())
    add_flap_truth(wiring)
    end_effector = plant.GetFrameByName("end_effector", scene.model(HOLDER_HAND))
    add_true_pose(builder, plant, end_effector, "end_effector")
    add_true_pose(builder, plant, wiring.fingertip, "fingertip")
    builder.ExportOutput(scene.scene_graph.get_query_output_port(), "cheat_query_object")
