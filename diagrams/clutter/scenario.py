"""Scenarios of the clutter application: where a known object is."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from crossmodal.diagrams.clutter.robot_config import ControlConfig, PerceptionConfig, SensorsConfig
from crossmodal.diagrams.run import scenario as base
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
from crossmodal.diagrams.stations import pushed
from crossmodal.diagrams.stations.scenario_checks import check_estimators
from crossmodal.maths.validation import number, numbers
from crossmodal.models import SDF_DIR
from crossmodal.plants.goods.dense_clutter import ClutterConfig, names_in_clutter
from crossmodal.plants.scene import PlantConfig
from crossmodal.systems.active.touch_planner import TouchPlannerConfig
from crossmodal.systems.active.touch_planning import CRITERIA
from crossmodal.systems.active.view_planner import VIEW_CRITERIA, ViewPlannerConfig
from crossmodal.systems.declutter.declutter_graph import DeclutterConfig
from crossmodal.systems.declutter.declutter_sequence import DeclutterSequenceConfig
from crossmodal.systems.segmentation.network_input import TRANSPARENT
from crossmodal.systems.sensors.randomness import make_generator
from crossmodal.systems.sensors.taxel_array import TaxelArrayFault

SCENARIO_FOLDER = Path(__file__).parent / "scenarios"
GOODS_DIR = SDF_DIR / "goods"
TARGETS = ["oil", "spray", "cleaner", "wineglass"]
ESTIMATORS = ("density", "quaternion")
STATIONS = ("rig", "robots")


@dataclass(kw_only=True)
class TargetConfig:
    """The object whose pose is sought."""

    # One of models/sdf/goods; empty: one of `objects`, which the seed draws.
    object: str = ""
    # Of models/sdf/goods; the seed draws one of them.
    objects: list[str] = field(default_factory=lambda: list(TARGETS))
    # A mesh file of one's own in its place, absolute or beside the scenario's file.
    mesh: str = ""
    # Metres per unit of that file.
    scale: float = number(1.0, above=0.0, at_most=1e3, unit="m")
    # Whether a camera looks through what that file describes.
    transparent: bool = False
    # Of what that file describes.
    mass: float = number(0.3, above=0.0, at_most=100.0, unit="kg")


@dataclass(kw_only=True)
class GuessConfig:
    """By how much the pose from which it starts is wrong, between two ends."""

    # How far it is shifted, least and most.
    translation: np.ndarray = numbers(
        np.array([0.02, 0.05]), at_least=0.0, at_most=1.0, unit="m", shape=(2,)
    )
    # How far it is turned, least and most.
    rotation: np.ndarray = numbers(
        np.array([10.0, 30.0]), at_least=0.0, at_most=180.0, unit="deg", shape=(2,)
    )


@dataclass(kw_only=True)
class TableConfig:
    """What the object stands on."""

    # Whether it stands on a table whose height is known; else it is held up, turned in any way.
    known: bool = True
    # Of the height that is believed.
    height_error: float = number(2e-3, at_least=0.0, at_most=0.1, unit="m")


@dataclass(kw_only=True)
class ViewConfig:
    """Of a view."""

    # Every so many pixels along rows and columns a ray is cast.
    stride: int = number(5, at_least=1, at_most=100, unit="px")


@dataclass(kw_only=True)
class ContactConfig:
    """Of a touch."""

    # Noise of a contact's place.
    noise: float = number(7e-4, at_least=0.0, at_most=0.1, unit="m")
    # Probability that a contact is reported somewhere along the approach where there is none.
    false_contacts: float = number(0.0, at_least=0.0, at_most=1.0)


def _plant() -> PlantConfig:
    return PlantConfig(scene="pose_scene.dmd.yaml", time_step=0.0025, stiction_tolerance=1e-4)


@dataclass(kw_only=True)
class Disturbances(pushed.Disturbances):
    """What goes wrong, and when."""

    taxels: list[TaxelArrayFault] = field(default_factory=list)  # Of arrays of the gripper.

    def spans(self) -> list[tuple[str, base.Interval]]:
        """What goes wrong, in words, and when."""
        faults = [
            (
                f"array {fault.array} reads {fault.reading:g} N",
                base.Interval(start=fault.start, end=fault.end),
            )
            for fault in self.taxels
        ]
        return [*super().spans(), *faults]


@dataclass(kw_only=True)
class Scenario(base.Scenario):
    """One object, seen by a camera and touched, by robots or by a rig in their place."""

    # robots: two arms on a table. rig: a camera and a finger that go anywhere.
    station: str = "rig"
    plant: PlantConfig = field(default_factory=_plant)
    sensors: SensorsConfig = field(default_factory=SensorsConfig)
    perception: PerceptionConfig = field(default_factory=PerceptionConfig)
    control: ControlConfig = field(default_factory=ControlConfig)
    disturbances: Disturbances = field(default_factory=Disturbances)
    target: TargetConfig = field(default_factory=TargetConfig)
    # What lies around the object and on it, for robots.
    clutter: ClutterConfig = field(default_factory=lambda: ClutterConfig(count=0))
    # How it is cleared away.
    declutter: DeclutterConfig = field(default_factory=DeclutterConfig)
    sequence: DeclutterSequenceConfig = field(default_factory=DeclutterSequenceConfig)
    guess: GuessConfig = field(default_factory=GuessConfig)
    table: TableConfig = field(default_factory=TableConfig)
    views: ViewPlannerConfig = field(default_factory=ViewPlannerConfig)
    view: ViewConfig = field(default_factory=ViewConfig)
    touches: TouchPlannerConfig = field(default_factory=TouchPlannerConfig)
    contact: ContactConfig = field(default_factory=ContactConfig)


def resolve(scenario: Scenario, path: Path) -> Scenario:
    """Checks names, and says which object it is."""
    known = sorted(folder.name for folder in GOODS_DIR.iterdir() if folder.is_dir())
    for name in filter(None, [scenario.target.object, *scenario.target.objects]):
        if name not in known:
            raise ScenarioError(
                f"{path}: target.object = '{name}', but it must be one of {', '.join(known)}"
            )
    for key, criterion, allowed in (
        ("touches", scenario.touches.criterion, tuple(CRITERIA)),
        ("views", scenario.views.criterion, VIEW_CRITERIA),
    ):
        if criterion not in allowed:
            raise ScenarioError(
                f"{path}: {key}.criterion = '{criterion}', but it must be one of"
                f" {', '.join(allowed)}"
            )
    if scenario.clutter.count and (scenario.station != "robots" or scenario.target.mesh):
        raise ScenarioError(
            f"{path}: clutter.count = {scenario.clutter.count}, but only robots have clutter, and"
            " only around a target.object"
        )
    if scenario.clutter.count and not scenario.table.known:
        raise ScenarioError(
            f"{path}: clutter.count = {scenario.clutter.count}, but table.known = False: clutter"
            " lies on a table"
        )
    if scenario.station not in STATIONS:
        raise ScenarioError(
            f"{path}: station = '{scenario.station}', but it must be one of {', '.join(STATIONS)}"
        )
    if not scenario.target.object and not scenario.target.objects and not scenario.target.mesh:
        raise ScenarioError(f"{path}: target.objects is empty, and target.object, too")
    for key, ends in (
        ("translation", scenario.guess.translation),
        ("rotation", scenario.guess.rotation),
    ):
        if ends[0] > ends[1]:
            raise ScenarioError(f"{path}: guess.{key} must be least, then largest")
    chosen = scenario.modalities or ESTIMATORS
    scenario.modalities = check_estimators(scenario, chosen, ESTIMATORS, str(path))
    scenario.touches.after_views = scenario.views.count
    if scenario.target.mesh:
        mesh = Path(scenario.target.mesh)
        if not mesh.is_absolute():
            mesh = path.parent / mesh
        if not mesh.is_file():
            raise ScenarioError(f"{path}: target.mesh = '{mesh}': there is no such file")
        scenario.target.mesh = str(mesh)
    return scenario


def target_name(scenario: Scenario) -> str:
    """The object's name, by the seed where the scenario leaves it open."""
    target = scenario.target
    if target.mesh:
        return Path(target.mesh).stem
    if target.object:
        return target.object
    return target.objects[scenario.seed % len(target.objects)]


def other_goods(scenario: Scenario) -> list[str]:
    """Names of the goods that may lie around the object."""
    goods = sorted(folder.name for folder in GOODS_DIR.iterdir() if folder.is_dir())
    return [name for name in goods if name != target_name(scenario)]


def object_names(scenario: Scenario) -> list[str]:
    """Names of the goods that lie around the object, by the seed."""
    config, others = scenario.clutter, other_goods(scenario)
    return names_in_clutter(config, target_name(scenario), others, scenario.seed)[1:]


def wanted_touches(scenario: Scenario) -> int:
    """How many touches there are to be, those by lot and those that are chosen."""
    return scenario.touches.random_touches + scenario.touches.chosen_touches


def is_transparent(scenario: Scenario) -> bool:
    """Whether a camera looks through the object, so that what it sees behind says nothing."""
    if scenario.target.mesh:
        return scenario.target.transparent
    return target_name(scenario) in TRANSPARENT


def target_mesh(scenario: Scenario) -> Path:
    """The file of the object's mesh."""
    if scenario.target.mesh:
        return Path(scenario.target.mesh)
    name = target_name(scenario)
    return GOODS_DIR / name / f"{name}.obj"


def generator(scenario: Scenario, purpose: str) -> np.random.Generator:
    """Random numbers of a scenario's seed for one purpose."""
    return make_generator(scenario.seed, purpose)
