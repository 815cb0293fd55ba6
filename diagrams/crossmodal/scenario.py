"""A scenario of the cross-modal application: an arm with a soft hand explores an object's joint."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw

from crossmodal.diagrams.crossmodal.estimators import PerceptionConfig, check_cut
from crossmodal.diagrams.crossmodal.modalities import MODALITIES
from crossmodal.diagrams.crossmodal.objects.object_import import check_grasp, check_pull, imported
from crossmodal.diagrams.crossmodal.objects.object_model import read_object_model
from crossmodal.diagrams.crossmodal.robot_config import HAND, ControlConfig, SensorsConfig
from crossmodal.diagrams.run import scenario as base
from crossmodal.diagrams.run.calibration import CalibrationConfig, CalibrationErrors
from crossmodal.diagrams.run.scenario import CameraConfig
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, suggestion
from crossmodal.diagrams.stations import pushed
from crossmodal.diagrams.stations.scenario_checks import (
    check_estimators,
    check_one_camera,
    check_scene,
    check_textures,
    model_file,
)
from crossmodal.maths.validation import number, numbers
from crossmodal.models import SDF_DIR
from crossmodal.plants.hands.pneumatic_hand import PneumaticHandConfig
from crossmodal.plants.scene import PlantConfig
from crossmodal.systems.port_values import JointType

SCENARIO_FOLDER = Path(__file__).parent / "scenarios"


@dataclass(kw_only=True)
class ObjectVariation:
    """What the seed draws uniformly around the nominal object."""

    # Half ranges.
    position: np.ndarray = numbers(np.zeros(3), at_least=0.0, at_most=10.0, unit="m")
    yaw: float = number(0.0, at_least=0.0, at_most=180.0, unit="deg")  # Half range.
    # Half range of the joint's friction, as a share of it.
    friction: float = number(0.0, at_least=0.0, at_most=1.0)
    textures: list[str] = field(default_factory=list)  # Names to choose from; empty: the model's.


@dataclass(kw_only=True)
class ObjectConfig:
    """An articulated object and the joint of it that the robot may explore."""

    # A file of models/sdf, or any SDF or URDF beside the scenario's file, which is imported.
    model: str = "chest_drawer.sdf"
    joint: str = "slide"  # The explored one; empty: the nearest that moves the handle's frame.
    # x out of the object, y along the bar; for an import also a link, or LINK@x,y,z,roll,pitch,yaw.
    handle_frame: str = "handle"
    # Of all lengths in an imported file: 0.001 for one in millimetres.
    scale: float = number(1.0, at_least=1e-6, at_most=1e6)
    # Of the model's frame or, with `place_handle`, of the handle's, in the world.
    position: np.ndarray = numbers(
        np.array([0.865, -0.25, 0.86]), at_least=-100.0, at_most=100.0, unit="m"
    )
    # About x of the world, first.
    roll: float = number(0.0, at_least=-720.0, at_most=720.0, unit="deg")
    # About y of the world, second.
    pitch: float = number(0.0, at_least=-720.0, at_most=720.0, unit="deg")
    # About z of the world, last.
    yaw: float = number(180.0, at_least=-720.0, at_most=720.0, unit="deg")
    # Whether position and yaw are the handle's, with the object upright, or the model frame's.
    place_handle: bool = False
    free: bool = False  # Whether it only rests on the table; otherwise it is fixed there.
    # Where the joint is at the start.
    initial_position: float = number(0.0, at_least=-100.0, at_most=100.0, unit="m or rad")
    # Where the hand pulls to explore, in the handle's frame; out of the object is x.
    pull_direction: np.ndarray = numbers(np.array([1.0, 0.0, 0.0]), at_least=-100.0, at_most=100.0)
    friction: float = number(6.0, at_least=0.0, at_most=1000.0, unit="N or N m")  # Of the joint.
    # By which a magnet or the like holds the joint where it starts, beyond friction.
    detent: float = number(0.0, at_least=0.0, at_most=1000.0, unit="N or N m")
    variation: ObjectVariation = field(default_factory=ObjectVariation)

    def pose(self) -> RigidTransform:
        """Pose of the model's frame in the world, before variation."""
        angles = np.deg2rad([self.roll, self.pitch, self.yaw])
        return RigidTransform(RollPitchYaw(angles), self.position)


@dataclass(kw_only=True)
class Task:
    """What the robot is to do with the object's joint."""

    # The joint's least travel for a success.
    opening: float = number(0.2, above=0.0, at_most=100.0, unit="m or rad")
    # Exploration ends once the joint is perceived to have travelled so far, [m or rad]; without it,
    # after the hand's way of control.sequence.travel.
    goal: float | None = number(None, above=0.0, at_most=100.0, unit="m or rad")
    return_to_start: bool = False  # Whether the robot then brings the joint back.
    # How near to its start is near enough for a success.
    tolerance: float = number(0.05, above=0.0, at_most=100.0, unit="m or rad")
    modality: str = ""  # By which the robot acts; empty is the cross-modal, or the only one.
    object: str = ""  # Which of the objects is manipulated; empty is the only one.


@dataclass(kw_only=True)
class ModelDriver:
    """What drives a model of the scene."""

    pneumatics: PneumaticHandConfig = field(default_factory=PneumaticHandConfig)  # Of a soft hand.


@dataclass(kw_only=True)
class Disturbances(pushed.Disturbances):
    """What goes wrong, and when."""

    # The hand's chambers lose their air, so that it opens.
    hand_leaks: list[base.Interval] = field(default_factory=list)

    def spans(self) -> list[tuple[str, base.Interval]]:
        """What goes wrong, in words, and when."""
        return [*super().spans(), *(("the hand leaks", span) for span in self.hand_leaks)]


def _one_camera() -> dict[str, CameraConfig]:
    position, target = np.array([-0.05, 0.4, 1.42]), np.array([0.78, -0.27, 0.87])
    return {"camera": CameraConfig(position=position, looking_at=target)}


def _trusted() -> CalibrationConfig:
    """Perfect, and the robot knows it: the joints' covariances do not grow by it."""
    return CalibrationConfig(believed=CalibrationErrors())


@dataclass(kw_only=True)
class Scenario(base.Scenario):
    """One kind of episode; with a seed, one episode."""

    modalities: list[str] = field(default_factory=lambda: list(MODALITIES))
    plant: PlantConfig = field(default_factory=PlantConfig)
    # What moves the hand and other models that are driven, by the model's name.
    model_drivers: dict[str, ModelDriver] = field(default_factory=lambda: {"hand": ModelDriver()})
    # By name; `task.object` says which one is explored.
    objects: dict[str, ObjectConfig] = field(default_factory=lambda: {"object": ObjectConfig()})
    cameras: dict[str, CameraConfig] = field(default_factory=_one_camera)
    calibration: CalibrationConfig = field(default_factory=_trusted)
    sensors: SensorsConfig = field(default_factory=SensorsConfig)
    perception: PerceptionConfig = field(default_factory=PerceptionConfig)
    control: ControlConfig = field(default_factory=ControlConfig)
    disturbances: Disturbances = field(default_factory=Disturbances)
    task: Task = field(default_factory=Task)

    @property
    def object(self) -> ObjectConfig:
        """The object that is manipulated."""
        return self.objects[self.task.object or next(iter(self.objects))]

    @property
    def acting_modality(self) -> str:
        """The estimator whose beliefs the robot acts by."""
        if self.task.modality:
            return self.task.modality
        return "crossmodal" if "crossmodal" in self.modalities else self.modalities[0]

    def units(self) -> dict[str, str]:
        """Of the values, by path, whose unit depends on whether a joint slides or turns."""
        found: dict[str, str] = {}
        for name, thing in self.objects.items():
            model, key = object_model_file(thing), f"objects.{name}"
            facts = read_object_model(
                model, joint=thing.joint, frame=thing.handle_frame, source=f"{self.name}: {key}"
            )
            force = "N" if facts.joint_type == JointType.PRISMATIC else "N m"
            found |= {
                f"{key}.initial_position": facts.unit,
                f"{key}.friction": force,
                f"{key}.detent": force,
            }
            if thing is self.object:
                found |= {f"task.{item}": facts.unit for item in ("opening", "goal", "tolerance")}
        return found


def resolve(scenario: Scenario, path: Path) -> Scenario:
    """A scenario that was read from a file, checked, its object imported and placed.

    Raises:
        ScenarioError: for values that no episode can have.
    """
    source = str(path)
    chosen = sorted(scenario.modalities, key=lambda name: [*MODALITIES, name].index(name))
    modalities = check_estimators(scenario, chosen, MODALITIES, source)
    scenario = replace(scenario, modalities=modalities)
    _check(scenario, source)
    return replace(
        scenario,
        objects={
            name: _resolve_object(thing, f"objects.{name}", path)
            for name, thing in scenario.objects.items()
        },
    )


def object_model_file(thing: ObjectConfig) -> Path:
    """The object's model; a scenario that was loaded names it from models/sdf or absolutely."""
    return SDF_DIR / thing.model


def _resolve_object(thing: ObjectConfig, key: str, path: Path) -> ObjectConfig:
    """Imports a model that does not come with the program, and places it by its own frame."""
    source = str(path)
    model = model_file(thing.model, f"{key}.model", path)
    is_own = not model.is_relative_to(SDF_DIR)
    if not is_own:
        if thing.scale != 1.0:
            raise ScenarioError(
                f"{source}: {key}.scale = {thing.scale!r}, but it is for imported models only"
            )
        thing = replace(thing, model=str(model.relative_to(SDF_DIR)))
    else:
        found = imported(
            model,
            joint=thing.joint,
            frame=thing.handle_frame,
            free=thing.free,
            scale=thing.scale,
            source=f"{source}: {key}.model",
        )
        thing = replace(
            thing,
            model=str(found.model),
            joint=found.joint,
            handle_frame=found.grasp_frame,
            scale=1.0,  # The copy has it.
        )
    facts = read_object_model(
        SDF_DIR / thing.model,
        joint=thing.joint,
        frame=thing.handle_frame,
        source=f"{source}: {key}",
    )
    if not facts.lower <= thing.initial_position <= facts.upper:
        raise ScenarioError(
            f"{source}: {key}.initial_position = {thing.initial_position!r}, but the joint's"
            f" limits are {facts.lower:g} to {facts.upper:g}"
        )
    if is_own:
        check_pull(facts, thing.pull_direction, thing.joint, thing.handle_frame)
        check_grasp(SDF_DIR / thing.model, thing.handle_frame, f"{source}: {key}")
    if not thing.place_handle:
        return thing
    x_axis, p_OH = facts.X_OH.rotation().col(0), facts.X_OH.translation()
    heading = np.arctan2(x_axis[1], x_axis[0]) if np.hypot(*x_axis[:2]) > 0.1 else 0.0
    yaw = float(np.rad2deg(np.deg2rad(thing.yaw) - heading))
    upright = replace(thing, yaw=yaw, roll=0.0, pitch=0.0, place_handle=False)
    return replace(upright, position=thing.position - upright.pose().rotation() @ p_OH)


def _check(scenario: Scenario, source: str) -> None:
    task = scenario.task
    if task.return_to_start and task.goal is None:
        raise ScenarioError(f"{source}: task.return_to_start needs task.goal, [m or rad]")
    if not scenario.objects or (task.object and task.object not in scenario.objects):
        raise ScenarioError(
            f"{source}: task.object = '{task.object}': {suggestion(task.object, scenario.objects)}"
        )
    if len(scenario.objects) > 1 and not task.object:
        raise ScenarioError(
            f"{source}: task.object must say which of the objects is manipulated:"
            f" {', '.join(scenario.objects)}"
        )
    for name, thing in scenario.objects.items():
        key = f"{source}: objects.{name}"
        if not np.linalg.norm(thing.pull_direction) > 1e-6:
            raise ScenarioError(f"{key}.pull_direction must not be all zero")
        check_textures(thing.variation.textures, f"{key}.variation.textures")
    if task.modality and task.modality not in scenario.modalities:
        raise ScenarioError(
            f"{source}: task.modality = '{task.modality}' is not among the modalities"
            f" {', '.join(scenario.modalities)}"
        )
    try:
        check_cut(scenario.perception.cut)
    except ValueError as error:
        raise ScenarioError(f"{source}: {error}") from None
    check_one_camera(scenario, source, "the estimators see")
    if HAND not in scenario.model_drivers:
        raise ScenarioError(f"{source}: model_drivers: need one of the model '{HAND}'")
    check_scene(scenario.plant.scene, source)
