"""A scenario: all that is chosen about an episode before it starts, read from YAML.

The parts that configure one system are that system's own config; they are checked by that system.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw

from diagrams.crossmodal.estimators import MODALITIES, PerceptionConfig, check_cut
from diagrams.crossmodal.objects.object_model import read_object_model
from diagrams.crossmodal.objects.own_object import check_pull, imported
from diagrams.crossmodal.station.station_config import ControlConfig, SensorsConfig
from diagrams.run.yaml_schema import (
    ScenarioError,
    apply_override,
    load_typed,
    read_yaml,
    suggestion,
)
from models import SDF_DIR
from plants.hands.pneumatic_hand import PneumaticHandConfig
from plants.scene import PlantConfig

SCENARIO_FOLDER = Path(__file__).parent / "scenarios"


@dataclass(kw_only=True)
class Interval:
    start: float = 0.0  # [s], since the episode began.
    end: float = float("inf")  # [s]

    def __contains__(self, time: float) -> bool:
        return self.start <= time < self.end


@dataclass(kw_only=True)
class Disturbances:
    """What goes wrong for the camera, and when."""

    lights_off: list[Interval] = field(default_factory=list)
    camera_covered: list[Interval] = field(default_factory=list)


@dataclass(kw_only=True)
class CameraView:
    """Where the camera is and what it sees; its pose is known to the robot."""

    width: int = 640  # [pixels]
    height: int = 480  # [pixels]
    horizontal_angle: float = 58.0  # Horizontal field of view, [deg].
    position: np.ndarray = field(default_factory=lambda: np.array([-0.05, 0.4, 1.42]))  # p_WC.
    looking_at: np.ndarray = field(default_factory=lambda: np.array([0.78, -0.27, 0.87]))  # [m].
    lamp: float = 0.0  # Intensity of a lamp at the camera; the ceiling light's is 0.9.


@dataclass(kw_only=True)
class ObjectVariation:
    """What the seed draws uniformly around the nominal object."""

    position: np.ndarray = field(default_factory=lambda: np.zeros(3))  # Half ranges, [m].
    yaw: float = 0.0  # Half range, [deg].
    friction: float = 0.0  # Half range of the joint's friction, as a share of it.
    textures: list[str] = field(default_factory=list)  # Names to choose from; empty: the model's.


@dataclass(kw_only=True)
class ObjectConfig:
    """The articulated object and the joint of it that the robot explores."""

    # A file of models/sdf, or any SDF or URDF beside the scenario's file, which is imported.
    model: str = "chest_drawer.sdf"
    joint: str = "slide"  # The explored one; empty: the nearest that moves the handle's frame.
    # x out of the object, y along the bar; for an import also a link, or LINK@x,y,z,roll,pitch,yaw.
    handle_frame: str = "handle"
    position: np.ndarray = field(default_factory=lambda: np.array([0.865, -0.25, 0.86]))  # [m]
    roll: float = 0.0  # [deg]
    pitch: float = 0.0  # [deg]
    yaw: float = 180.0  # [deg]
    # Whether position and yaw are the handle's, with the object upright, or the model frame's.
    place_handle: bool = False
    free: bool = False  # Whether it only rests on the table; otherwise it is fixed there.
    # Where the hand pulls to explore, in the handle's frame; out of the object is x.
    pull_direction: np.ndarray = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))
    friction: float = 6.0  # Of the joint, [N or N m].
    variation: ObjectVariation = field(default_factory=ObjectVariation)

    def pose(self) -> RigidTransform:
        """Pose of the model's frame in the world, before variation."""
        angles = np.deg2rad([self.roll, self.pitch, self.yaw])
        return RigidTransform(RollPitchYaw(angles), self.position)


@dataclass(kw_only=True)
class Task:
    opening: float = 0.2  # The joint's least travel for a success, [m or rad].
    # Exploration ends once the joint is perceived to have travelled so far, [m or rad]; without it,
    # after the hand's way of control.sequence.travel.
    goal: float | None = None
    return_to_start: bool = False  # Whether the robot then brings the joint back.
    tolerance: float = 0.05  # How near to its start is near enough for a success, [m or rad].
    modality: str = ""  # By which the robot acts; empty is the cross-modal, or the only one.


@dataclass(kw_only=True)
class Scenario:
    """One kind of episode; with a seed, one episode."""

    name: str = ""
    description: str = ""
    seed: int = 0
    duration: float = 40.0  # Simulated time after which an episode ends at the latest, [s].
    network_period: float = 1.0 / 15.0  # Tick of the filters and the sensors' windows, [s].
    modalities: list[str] = field(default_factory=lambda: list(MODALITIES))
    plant: PlantConfig = field(default_factory=PlantConfig)
    hand: PneumaticHandConfig = field(default_factory=PneumaticHandConfig)
    object: ObjectConfig = field(default_factory=ObjectConfig)
    camera: CameraView = field(default_factory=CameraView)
    sensors: SensorsConfig = field(default_factory=SensorsConfig)
    perception: PerceptionConfig = field(default_factory=PerceptionConfig)
    control: ControlConfig = field(default_factory=ControlConfig)
    task: Task = field(default_factory=Task)
    disturbances: Disturbances = field(default_factory=Disturbances)
    versions: dict[str, str] = field(default_factory=dict)  # Written into a run's folder.


def scenario_files() -> dict[str, Path]:
    """The scenarios that come with the program, by name."""
    found = {path.stem: path for path in SCENARIO_FOLDER.glob("*.yaml")}
    return dict(sorted(found.items()))


def find_scenario(name_or_path: str) -> Path:
    """The file of a scenario given by its name or by its path."""
    known = scenario_files()
    if name_or_path in known:
        return known[name_or_path]
    path = Path(name_or_path)
    if path.suffix in (".yaml", ".yml") or path.is_file():
        return path
    raise ScenarioError(f"unknown scenario '{name_or_path}'; {suggestion(name_or_path, known)}")


def load_scenario(name_or_path: str, overrides: Sequence[str] = ()) -> Scenario:
    """Reads and checks a scenario.

    Args:
        overrides: Assignments `key.path=value` that replace what the file says.
    """
    path = find_scenario(name_or_path)
    document = read_yaml(path)
    for assignment in overrides:
        apply_override(document, assignment)
    scenario = load_typed(Scenario, document, str(path))
    scenario.name = scenario.name or path.stem
    scenario.modalities.sort(key=lambda name: [*MODALITIES, name].index(name))
    scenario.object.model = str(_model_file(scenario.object.model, path))
    check_scenario(scenario, str(path))
    _resolve_object(scenario.object, str(path))
    _spread_network_period(scenario, str(path))
    return scenario


def _resolve_object(thing: ObjectConfig, source: str) -> None:
    """Imports a model that does not come with the program, and places it by its own frame."""
    model = Path(thing.model)
    is_own = not model.is_relative_to(SDF_DIR)
    if not is_own:
        thing.model = str(model.relative_to(SDF_DIR))
    else:
        found = imported(
            model,
            joint=thing.joint,
            frame=thing.handle_frame,
            free=thing.free,
            source=f"{source}: object.model",
        )
        thing.model, thing.joint = str(found.model), found.joint
        thing.handle_frame = found.grasp_frame
    facts = read_object_model(
        SDF_DIR / thing.model, joint=thing.joint, frame=thing.handle_frame, source=source
    )
    if is_own:
        check_pull(facts, thing.pull_direction, thing.joint, thing.handle_frame)
    if thing.place_handle:
        x_axis, p_OH = facts.X_OH.rotation().col(0), facts.X_OH.translation()
        heading = np.arctan2(x_axis[1], x_axis[0]) if np.hypot(*x_axis[:2]) > 0.1 else 0.0
        thing.yaw = float(np.rad2deg(np.deg2rad(thing.yaw) - heading))
        thing.roll = thing.pitch = 0.0
        thing.position = thing.position - thing.pose().rotation() @ p_OH
        thing.place_handle = False


def object_model_file(scenario: Scenario) -> Path:
    """The object's model; a scenario that was loaded names it from models/sdf or absolutely."""
    return SDF_DIR / scenario.object.model


def _spread_network_period(scenario: Scenario, source: str) -> None:
    """Gives every filter and sensor window the network's tick; it is chosen in one place only."""
    perception, sensors = scenario.perception, scenario.sensors
    candidates = [(f"perception.{name}", part, "period") for name, part in vars(perception).items()]
    candidates += [(f"sensors.{name}", part, "tick") for name, part in vars(sensors).items()]
    candidates.append(("sensors.camera", sensors.camera, "exposure_period"))
    places = [place for place in candidates if hasattr(place[1], place[2])]
    for path, config, key in places:
        value, usual = getattr(config, key), getattr(type(config)(), key)
        if value not in (usual, scenario.network_period):
            raise ScenarioError(
                f"{source}: {path}.{key} = {value!r} s, but the whole network ticks at"
                f" network_period = {scenario.network_period!r} s"
            )
        setattr(config, key, scenario.network_period)


def _model_file(model: str, scenario_path: Path) -> Path:
    candidates = [scenario_path.parent / model, SDF_DIR / model]
    for candidate in candidates:
        if candidate.is_file():
            return candidate.resolve()
    places = " or ".join(str(candidate.parent) for candidate in candidates)
    raise ScenarioError(
        f"{scenario_path}: object.model = '{model}': there is no such file in {places}"
    )


def check_scenario(scenario: Scenario, source: str) -> None:
    """Refuses values that no episode can have."""

    def positive(key: str, value: float, unit: str) -> None:
        if not 0 < value < float("inf"):
            raise ScenarioError(f"{source}: {key} = {value!r} {unit}, but it must be > 0 {unit}")

    positive("duration", scenario.duration, "s")
    positive("plant.time_step", scenario.plant.time_step, "s")
    positive("network_period", scenario.network_period, "s")
    positive("task.opening", scenario.task.opening, "m or rad")
    positive("task.tolerance", scenario.task.tolerance, "m or rad")
    if scenario.task.goal is not None:
        positive("task.goal", scenario.task.goal, "m or rad")
    elif scenario.task.return_to_start:
        raise ScenarioError(f"{source}: task.return_to_start needs task.goal, [m or rad]")
    if not 0 <= scenario.object.friction < float("inf"):
        raise ScenarioError(
            f"{source}: object.friction = {scenario.object.friction!r}, but it must be >= 0 N"
        )
    if scenario.seed < 0:
        raise ScenarioError(f"{source}: seed = {scenario.seed}, but it must be >= 0")
    _check_modalities(scenario.modalities, source)
    if scenario.task.modality and scenario.task.modality not in scenario.modalities:
        raise ScenarioError(
            f"{source}: task.modality = '{scenario.task.modality}' is not among the modalities"
            f" {', '.join(scenario.modalities)}"
        )
    try:
        check_cut(scenario.perception.cut)
    except ValueError as error:
        raise ScenarioError(f"{source}: {error}") from None
    _check_vector("object.position", scenario.object.position, source)
    _check_vector("object.pull_direction", scenario.object.pull_direction, source, unit="")
    if not np.any(scenario.object.pull_direction):
        raise ScenarioError(f"{source}: object.pull_direction must not be all zero")
    if scenario.control.posture.shape != (7,) or not np.all(np.isfinite(scenario.control.posture)):
        raise ScenarioError(
            f"{source}: control.posture = {scenario.control.posture.tolist()},"
            " but it must be 7 numbers, [rad]"
        )
    _check_camera(scenario.camera, source)
    _check_variation(scenario.object.variation, source)
    if not (SDF_DIR / scenario.plant.scene).is_file():
        raise ScenarioError(
            f"{source}: plant.scene = '{scenario.plant.scene}': there is no such file in {SDF_DIR}"
        )
    for key in ("lights_off", "camera_covered"):
        for index, interval in enumerate(getattr(scenario.disturbances, key)):
            if not 0 <= interval.start < interval.end:
                raise ScenarioError(
                    f"{source}: disturbances.{key}.{index} = {interval.start:g} to"
                    f" {interval.end:g} s, but it must be 0 <= start < end"
                )


def _check_modalities(modalities: Iterable[str], source: str) -> None:
    names = list(modalities)
    for name in names:
        if name not in MODALITIES:
            raise ScenarioError(
                f"{source}: modalities: unknown modality '{name}'; {suggestion(name, MODALITIES)}"
            )
    if not names or len(set(names)) < len(names):
        raise ScenarioError(
            f"{source}: modalities = {names}, but it must name each once, at least one"
        )


def _check_camera(camera: CameraView, source: str) -> None:
    for key in ("width", "height"):
        if not 16 <= getattr(camera, key) <= 4096:
            raise ScenarioError(
                f"{source}: camera.{key} = {getattr(camera, key)} pixels,"
                " but it must be from 16 to 4096 pixels"
            )
    if not 0 < camera.horizontal_angle < 180:
        raise ScenarioError(
            f"{source}: camera.horizontal_angle = {camera.horizontal_angle!r} deg,"
            " but it must be between 0 and 180 deg"
        )
    for key in ("position", "looking_at"):
        _check_vector(f"camera.{key}", getattr(camera, key), source)
    if not 0 <= camera.lamp < np.inf:
        raise ScenarioError(f"{source}: camera.lamp = {camera.lamp!r}, must be from 0 on")
    if np.allclose(camera.position, camera.looking_at):
        raise ScenarioError(f"{source}: camera.looking_at must differ from camera.position")


def _check_variation(variation: ObjectVariation, source: str) -> None:
    _check_vector("object.variation.position", variation.position, source)
    known = [path.stem for path in (SDF_DIR / "textures").glob("*.png")]
    for name in variation.textures:
        if name not in known:
            raise ScenarioError(
                f"{source}: object.variation.textures: unknown texture '{name}';"
                f" {suggestion(name, known)}"
            )
    ranges = {"yaw": variation.yaw, "friction": variation.friction}
    ranges["position"] = float(np.min(variation.position))
    for key, value in ranges.items():
        if not 0 <= value < float("inf"):
            raise ScenarioError(
                f"{source}: object.variation.{key} = {value!r}, but a half range must be >= 0"
            )


def _check_vector(key: str, value: np.ndarray, source: str, unit: str = ", [m]") -> None:
    if value.shape != (3,) or not np.all(np.isfinite(value)):
        raise ScenarioError(f"{source}: {key} = {value.tolist()}, but it must be 3 numbers{unit}")
