"""One episode: a scenario and a seed, simulated to the end."""

import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import Meshcat, MeshcatVisualizer, MeshcatVisualizerParams
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.tree import Joint, PrismaticJoint, RevoluteJoint
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, System
from pydrake.systems.sensors import ImageDepth32F, ImageGrey8U, ImageRgba8U

from controllers.interaction.grasp_decisions import Goal
from controllers.interaction.phases import Phase as ControlPhase
from diagrams.crossmodal.estimators import RobotKnowledge, make_network
from diagrams.crossmodal.meshcat_view import MeshcatView, MeshcatViewConfig, recorded_page
from diagrams.crossmodal.objects.own_object import ObjectWarning, overlaps
from diagrams.crossmodal.scenario import Scenario, object_model_file
from diagrams.crossmodal.station.station import Station, make_station
from diagrams.crossmodal.station.station_config import StationConfig
from diagrams.crossmodal.station.station_control import PERCEIVED_INPUTS
from diagrams.crossmodal.task import event_name, task_failure, task_phases
from diagrams.run.process_memory import peak_memory
from diagrams.run.record import EpisodeResult, Event, PinholeCamera
from diagrams.run.recorder import EpisodeRecorder, RecorderConfig, TickStopwatch
from diagrams.run.sensor_log import SensorLogWriter
from diagrams.run.sensor_recorder import SensorRecorder
from diagrams.run.yaml_schema import ScenarioError, building
from diagrams.stations.lighting import Light
from maths.arrays import Array
from maths.compiled import compilation_timed
from plants.camera_view import camera_intrinsics, looking_at
from plants.scene import ObjectPlacement
from systems.kinematics.interacted_joint import InteractedJoint, InteractedJointConfig
from systems.port_values import JointType


def draw_placement(scenario: Scenario, seed: int) -> ObjectPlacement:
    """Where the object of this seed stands, how stiff it moves and how it looks."""
    thing, variation = scenario.object, scenario.object.variation
    rng = np.random.default_rng((seed, 0))
    position = thing.position + variation.position * rng.uniform(-1.0, 1.0, 3)
    turned = np.deg2rad(variation.yaw * rng.uniform(-1.0, 1.0))
    friction = thing.friction * (1.0 + variation.friction * rng.uniform(-1.0, 1.0))
    texture = str(rng.choice(variation.textures)) if variation.textures else ""
    return ObjectPlacement(
        model=object_model_file(scenario),
        X_WO=RigidTransform(
            RotationMatrix.MakeZRotation(turned) @ thing.pose().rotation(), position
        ),
        free=thing.free,
        friction=friction,
        texture=texture,
    )


def build_station(scenario: Scenario, seed: int) -> Station:
    """The plant, sensors and controllers of one episode.

    Raises:
        ScenarioError: where a value of the scenario is impossible.
    """
    view, disturbances = scenario.camera, scenario.disturbances
    light = Light(
        lights_off=[(off.start, off.end) for off in disturbances.lights_off],
        covered=[(cover.start, cover.end) for cover in disturbances.camera_covered],
        lamp=view.lamp,
    )
    with building(scenario.name):
        station = make_station(
            StationConfig(
                plant=scenario.plant,
                hand=scenario.hand,
                sensors=scenario.sensors,
                control=scenario.control,
                goal=Goal(
                    configuration=scenario.task.goal, return_to_start=scenario.task.return_to_start
                ),
            ),
            draw_placement(scenario, seed),
            scenario.object.joint,
            scenario.object.handle_frame,
            scenario.object.pull_direction,
            camera_intrinsics(view.width, view.height, np.deg2rad(view.horizontal_angle)),
            looking_at(view.position, view.looking_at),
            light,
            seed,
        )
    for line in overlaps(station):
        warnings.warn(f"{scenario.name}: {line}", ObjectWarning, stacklevel=2)
    return station


def build_networks(scenario: Scenario, station: Station) -> dict[str, Diagram]:
    """One network for each of the scenario's modalities."""
    robot = RobotKnowledge(arm=station.arm, intrinsics=station.intrinsics, X_WC=station.X_WC)
    with building(scenario.name):
        return {
            modality: make_network(modality, scenario.perception, robot)
            for modality in scenario.modalities
        }


class Episode:
    """The whole diagram of an episode: station, networks, recorder and view.

    Attributes:
        diagram: All of it.
        station: Plant, sensors and controllers.
        modalities: Names of the networks, subsystems of the diagram.
        recorder: Holds what was believed and what was true.
        events: What the robot did, in order of time.
    """

    def __init__(
        self,
        scenario: Scenario,
        seed: int,
        meshcat: Meshcat | None = None,
        sensors_file: Path | None = None,
    ) -> None:
        self._scenario = scenario
        self._phase = ControlPhase.APPROACH
        self.events: list[Event] = []
        self.modalities = list(scenario.modalities)
        self._meshcat = meshcat
        self.station = build_station(scenario, seed)
        period = scenario.network_period
        builder = DiagramBuilder()
        station = builder.AddNamedSystem("station", self.station.diagram)
        self.recorder = EpisodeRecorder(RecorderConfig(period=period), scenario.modalities)
        self._stopwatches: dict[str, tuple[TickStopwatch, TickStopwatch]] = {}
        networks = build_networks(scenario, self.station)
        for modality, network in networks.items():
            self._add_network(builder, station, modality, network)
        if scenario.task.goal is not None:
            _add_readout(builder, station, networks[acting_modality(scenario)])
        builder.AddNamedSystem("recorder", self.recorder)
        for port in ("interaction_active", "cheat_configuration", "cheat_body_pose"):
            builder.Connect(station.GetOutputPort(port), self.recorder.GetInputPort(port))
        builder.Connect(
            station.GetOutputPort("color_measured"), self.recorder.GetInputPort("color_image")
        )
        self._sensor_log: SensorLogWriter | None = None
        if sensors_file is not None:
            streams = builder.AddNamedSystem("sensors", SensorRecorder(sensors_file, period))
            self._sensor_log = streams.log
            for index in range(streams.num_input_ports()):
                port = streams.get_input_port(index)
                builder.Connect(station.GetOutputPort(port.get_name()), port)
        readers: list[System] = [self.recorder]
        if meshcat is not None:
            config = MeshcatViewConfig(parent_moves=parent_moves(self.station))
            view = MeshcatView(config, meshcat, scenario.modalities)
            readers.append(builder.AddNamedSystem("meshcat_view", view))
            builder.Connect(
                station.GetOutputPort("path_planned"), view.GetInputPort("path_planned")
            )
            scene = builder.AddNamedSystem(
                "meshcat_scene",
                MeshcatVisualizer(meshcat, MeshcatVisualizerParams(publish_period=1.0 / 16.0)),
            )
            builder.Connect(
                station.GetOutputPort("cheat_query_object"), scene.query_object_input_port()
            )
        for reader in readers:
            for modality, network in networks.items():
                connect_latest(builder, network, modality, reader)
        self.diagram = builder.Build()

    def _add_network(
        self, builder: DiagramBuilder, station: Diagram, modality: str, network: Diagram
    ) -> None:
        """Adds a network between two stopwatches, for Drake updates in the order of adding."""
        period = self._scenario.network_period
        images = [Value(ImageRgba8U()), Value(ImageDepth32F()), Value(ImageGrey8U())]
        ports = ("color_measured", "depth_measured", "robot_mask")
        start, stop = TickStopwatch(period, images), TickStopwatch(period)
        builder.AddNamedSystem(f"{modality}_start", start)
        builder.AddNamedSystem(modality, network)
        builder.AddNamedSystem(f"{modality}_stop", stop)
        if network.HasInputPort("color_measured"):
            for index, port in enumerate(ports):
                builder.Connect(station.GetOutputPort(port), start.get_input_port(index))
        for index in range(network.num_input_ports()):
            port = network.get_input_port(index)
            builder.Connect(station.GetOutputPort(port.get_name()), port)
        self._stopwatches[modality] = start, stop

    def Run(self, progress: Callable[[float], None] | None = None) -> EpisodeResult:
        """Simulates until the robot has stopped or the scenario's time is over.

        A KeyboardInterrupt ends it early; what was recorded until then is returned.
        """
        scenario = self._scenario
        simulator = Simulator(self.diagram)
        root = simulator.get_mutable_context()
        self.station.SetInitialState(root)
        if self._meshcat is not None:
            self._meshcat.StartRecording(frames_per_second=16.0)
        simulator.Initialize()
        station_context = self.station.diagram.GetMyContextFromRoot(root)
        stop_time = scenario.control.sequence.stop_time
        end, stopped, interrupted = scenario.duration, False, False
        began = time.perf_counter()
        with compilation_timed() as compiling:
            try:
                while (now := root.get_time()) < end - 1e-9:
                    simulator.AdvanceTo(min(now + scenario.network_period, end))
                    phase = self._note_phase(station_context)
                    if not stopped and phase == ControlPhase.STOP:
                        stopped, end = True, min(end, root.get_time() + stop_time)
                    if progress is not None:
                        progress(root.get_time())
            except KeyboardInterrupt:
                interrupted = True
            finally:
                if self._sensor_log is not None:
                    self._sensor_log.close()
        wall_time = time.perf_counter() - began - compiling.seconds
        return self._result(root.get_time(), wall_time, interrupted)

    def _note_phase(self, station_context: Context) -> ControlPhase:
        """The phase now; remembered as an event where it is a new one."""
        ports = self.station.diagram
        phase = ControlPhase(int(ports.GetOutputPort("phase").Eval(station_context)[0]))
        if phase != self._phase:
            lost = ports.GetOutputPort("grasp_lost").Eval(station_context)[0] > 0.5
            name = event_name(phase, lost)
            if name is not None:
                self.events.append(Event(time=station_context.get_time(), name=name))
            self._phase = phase
        return phase

    def _result(self, duration: float, wall_time: float, interrupted: bool) -> EpisodeResult:
        scenario, station = self._scenario, self.station
        for modality, (start, stop) in self._stopwatches.items():
            pairs = zip(start.marks, stop.marks, strict=False)
            self.recorder.modalities[modality].tick_times = [b - a for a, b in pairs]
        truth = self.recorder.truth(station.joint.name(), *joint_truth(station))
        failure = task_failure(scenario.task, truth, self.events)
        intrinsics = station.intrinsics
        return EpisodeResult(
            scenario=scenario,
            truth=truth,
            modalities=self.recorder.modalities,
            camera=PinholeCamera(K=intrinsics.intrinsic_matrix(), X_WC=station.X_WC.GetAsMatrix4()),
            duration=duration,
            wall_time=wall_time,
            frames=self.recorder.frames,
            failure="interrupted" if interrupted else failure,
            phases=task_phases(scenario.task, truth, self.events),
            events=self.events,
            peak_memory=peak_memory(),
            interrupted=interrupted,
            sensors_file=None if self._sensor_log is None else self._sensor_log.path,
            meshcat_html=None if self._meshcat is None else recorded_page(self._meshcat),
        )


def connect_latest(
    builder: DiagramBuilder, network: Diagram, modality: str, reader: System
) -> None:
    quantities = ("joints", "body_motions", "features", "grasp", "end_effector", "hand_bending")
    for quantity in quantities:
        output, port = f"{quantity}_latest", f"{modality}_{quantity}_latest"
        if network.HasOutputPort(output) and reader.HasInputPort(port):
            builder.Connect(network.GetOutputPort(output), reader.GetInputPort(port))


def acting_modality(scenario: Scenario) -> str:
    """The modality whose beliefs the robot acts by."""
    if scenario.task.modality:
        return scenario.task.modality
    return "crossmodal" if "crossmodal" in scenario.modalities else scenario.modalities[0]


def _add_readout(builder: DiagramBuilder, station: System, network: Diagram) -> None:
    """Tells the station's controllers what a network believes about the joint in the hand."""
    readout = builder.AddNamedSystem("interacted_joint", InteractedJoint(InteractedJointConfig()))
    for index in range(readout.num_input_ports()):
        port = readout.get_input_port(index)
        if network.HasOutputPort(port.get_name()):
            builder.Connect(network.GetOutputPort(port.get_name()), port)
    for name in PERCEIVED_INPUTS:
        builder.Connect(readout.GetOutputPort(name), station.GetInputPort(name))


def joint_truth(station: Station) -> tuple[JointType, Array, Array, bool]:
    """The explored joint: type, axis (3,) and a point (3,) on it in W, whether its parent moves."""
    plant, joint = station.scene.plant, station.joint
    X_WJ = joint.frame_on_parent().CalcPoseInWorld(plant.CreateDefaultContext())
    joint_type, axis_J = _type_and_axis(joint)
    return (
        joint_type,
        X_WJ.rotation() @ axis_J,
        X_WJ.translation(),
        parent_moves(station),
    )


def parent_moves(station: Station) -> bool:
    """Whether the explored joint hangs on a body that can move, as the lid of a free box does."""
    return not station.scene.plant.IsAnchored(station.joint.parent_body())


def _type_and_axis(joint: Joint) -> tuple[JointType, Array]:
    if isinstance(joint, PrismaticJoint):
        return JointType.PRISMATIC, joint.translation_axis()
    if isinstance(joint, RevoluteJoint):
        return JointType.REVOLUTE, joint.revolute_axis()
    raise ScenarioError(f"joint '{joint.name()}' is neither prismatic nor revolute")


def run_episode(
    scenario: Scenario,
    seed: int,
    *,
    meshcat: Meshcat | None = None,
    progress: Callable[[float], None] | None = None,
    sensors_file: Path | None = None,
) -> EpisodeResult:
    """Builds and simulates one episode.

    Args:
        scenario: What is simulated.
        seed: Of all that varies and of all noise.
        meshcat: Where to draw; the recording becomes part of the result.
        progress: Called with the simulated time [s], about once per tick.
        sensors_file: Where to keep the sensor streams, so that they can be replayed.
    """
    scenario.seed = seed
    return Episode(scenario, seed, meshcat, sensors_file).Run(progress)
