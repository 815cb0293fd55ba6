"""Scenarios of the flap application: an arm holds a tool, a fingertip turns the tool's flap."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from crossmodal.diagrams.flap.estimator_names import ESTIMATORS
from crossmodal.diagrams.flap.estimators import PerceptionConfig
from crossmodal.diagrams.flap.flip_control import FlipControlConfig
from crossmodal.diagrams.flap.robot_config import SensorsConfig
from crossmodal.diagrams.run import scenario as base
from crossmodal.diagrams.run.calibration import CalibrationConfig, realistic_errors
from crossmodal.diagrams.run.scenario import CameraConfig
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, one_line
from crossmodal.diagrams.stations import pushed
from crossmodal.diagrams.stations.scenario_checks import (
    check_estimators,
    check_one_camera,
    check_scene,
    check_textures,
    model_file,
)
from crossmodal.maths.validation import number, numbers
from crossmodal.plants.scene import PlantConfig
from crossmodal.plants.tools.flap_jerk import FlapJerk
from crossmodal.plants.tools.held_tool import check_tool
from crossmodal.plants.tools.wiper import WiperConfig
from crossmodal.systems.sensors.randomness import make_generator
from crossmodal.systems.sensors.taxels import TaxelFault
from crossmodal.systems.tactile.taxel_layout import PAD_PLACES, TaxelLayout, pad_layout

SCENARIO_FOLDER = Path(__file__).parent / "scenarios"


@dataclass(kw_only=True)
class ToolVariation:
    """What the seed draws uniformly around the nominal pose and grasp."""

    # Half ranges.
    position: np.ndarray = numbers(
        np.array([0.015, 0.015, 0.015]), at_least=0.0, at_most=1.0, unit="m"
    )
    # Half ranges of roll, pitch and yaw.
    angles: np.ndarray = numbers(np.array([3.0, 3.0, 5.0]), at_least=0.0, at_most=90.0, unit="deg")
    # Half range of how far up or down the handle is held.
    grip: float = number(0.01, at_least=0.0, at_most=0.1, unit="m")
    textures: list[str] = field(  # Names to choose from; empty: the model's.
        default_factory=lambda: ["birch", "carton", "plain_grey", "plain_white", "teal_print"]
    )


@dataclass(kw_only=True)
class ToolConfig:
    """The tool that is held, and how."""

    # An SDF or URDF beside the scenario's file, absolute or in models/sdf, with a joint `hinge` and
    # the frames `handle` and `edge`; empty: a wiper that the seed draws.
    model: str = ""
    wiper: WiperConfig = field(default_factory=WiperConfig)
    # Of the model's frame, in the world.
    position: np.ndarray = numbers(
        np.array([0.48, 0.0, 0.55]), at_least=-10.0, at_most=10.0, unit="m"
    )
    # Across the held bar, between the pads.
    thickness: float | None = number(None, above=0.0, at_most=0.04, unit="m")
    # With which the thumb presses; the two other fingers share it.
    grip_force: float = number(80.0, above=0.0, at_most=200.0, unit="N")
    variation: ToolVariation = field(default_factory=ToolVariation)


@dataclass(kw_only=True)
class CameraVariation:
    """What the seed draws uniformly around the scenario's camera; the robot knows where it is."""

    # Half ranges, of the camera.
    position: np.ndarray = numbers(np.full(3, 0.03), at_least=0.0, at_most=10.0, unit="m")
    # Half ranges, of the point that the camera looks at.
    looking_at: np.ndarray = numbers(np.full(3, 0.02), at_least=0.0, at_most=10.0, unit="m")
    # Half range of the lamp's intensity, as a share of it.
    lamp: float = number(0.2, at_least=0.0, at_most=1.0)


@dataclass(kw_only=True)
class FingerConfig:
    """The fingertip, and where a person has put it before the episode begins."""

    # x and z of each taxel, in the fingertip's frame S.
    taxels: np.ndarray = numbers(
        PAD_PLACES, at_least=-0.1, at_most=0.1, unit="m", shape=(range(0, 65), 2)
    )
    # Of the place of contact from the middle of the flap's free edge, towards the finger's arm.
    along_edge: float = number(0.055, at_least=-0.5, at_most=0.5, unit="m")
    # Between the fingertip's surface and the free edge, along the pad's normal.
    clearance: float = number(0.03, above=0.0, at_most=0.5, unit="m")
    # Half range of each coordinate, by hand.
    placement: float = number(0.002, at_least=0.0, at_most=0.1, unit="m")
    # Largest angle by which it is turned about the place of contact, by hand, about any axis.
    rotation: float = number(10.0, at_least=0.0, at_most=45.0, unit="deg")

    def layout(self) -> TaxelLayout:
        """The taxels as the robot knows them."""
        return pad_layout(np.asarray(self.taxels, dtype=float))


@dataclass(kw_only=True)
class Task:
    """What the robot is to do with the flap, as the truth is asked.

    By how much it turns the flap as it believes is `control.sequence.angle`.
    """

    # By so much the flap has to be turned, at least.
    least_angle: float = number(float(np.deg2rad(90.0)), above=0.0, at_most=3.0, unit="rad")
    # Longest time without contact on the way.
    longest_loss: float = number(0.5, at_least=0.0, at_most=3600.0, unit="s")


@dataclass(kw_only=True)
class Disturbances(pushed.Disturbances):
    """What goes wrong, and when."""

    jerks: list[FlapJerk] = field(default_factory=list)  # Of the flap, by its free edge.
    taxels: list[TaxelFault] = field(default_factory=list)  # Of single taxels.

    def spans(self) -> list[tuple[str, base.Interval]]:
        """What goes wrong, in words, and when."""
        reported: list[tuple[str, FlapJerk | TaxelFault]] = [
            *((f"flap jerked by {1e3 * jerk.displacement:.3g} mm", jerk) for jerk in self.jerks),
            *((f"taxel {one.taxel} reads {one.reading:g} N", one) for one in self.taxels),
        ]
        spans = [(what, base.Interval(start=it.start, end=it.end)) for what, it in reported]
        return [*super().spans(), *spans]


def _plant() -> PlantConfig:
    return PlantConfig(scene="flap_scene.dmd.yaml", time_step=0.005, stiction_tolerance=1e-4)


def _camera() -> dict[str, CameraConfig]:
    position, target = np.array([1.3, 0.0, 0.12]), np.array([0.5, 0.0, 0.55])
    return {"camera": CameraConfig(position=position, looking_at=target, lamp=1.0)}


@dataclass(kw_only=True)
class Scenario(base.Scenario):
    """One kind of episode; with a seed, one episode."""

    calibration: CalibrationConfig = field(
        default_factory=lambda: CalibrationConfig(errors=realistic_errors(), spread=0.5)
    )
    plant: PlantConfig = field(default_factory=_plant)
    tool: ToolConfig = field(default_factory=ToolConfig)
    finger: FingerConfig = field(default_factory=FingerConfig)
    cameras: dict[str, CameraConfig] = field(default_factory=_camera)
    camera_variation: CameraVariation = field(default_factory=CameraVariation)
    sensors: SensorsConfig = field(default_factory=SensorsConfig)
    disturbances: Disturbances = field(default_factory=Disturbances)
    perception: PerceptionConfig = field(default_factory=PerceptionConfig)
    control: FlipControlConfig = field(default_factory=FlipControlConfig)
    task: Task = field(default_factory=Task)

    def drawn_cameras(self) -> dict[str, CameraConfig]:
        """The cameras of the seed, each drawn on its own."""
        drawn, vary = {}, self.camera_variation
        for name, camera in self.cameras.items():
            half = make_generator(self.seed, f"camera {name}").uniform(-1.0, 1.0, 7)
            drawn[name] = replace(
                camera,
                position=camera.position + vary.position * half[:3],
                looking_at=camera.looking_at + vary.looking_at * half[3:6],
                lamp=camera.lamp * (1.0 + vary.lamp * float(half[6])),
            )
        return drawn

    @property
    def acting_estimator(self) -> str:
        """By which estimator both arms act; the first of `modalities`."""
        return self.modalities[0]


def resolve(scenario: Scenario, path: Path) -> Scenario:
    """A scenario that was read from a file, checked, its tool's file found.

    Raises:
        ScenarioError: for values that no episode can have.
    """
    check_one_camera(scenario, str(path), "the flap is tracked")
    check_scene(scenario.plant.scene, str(path))
    check_textures(scenario.tool.variation.textures, f"{path}: tool.variation.textures")
    modalities = check_estimators(
        scenario, scenario.modalities or ESTIMATORS, ESTIMATORS, str(path)
    )
    try:
        scenario.finger.layout()
    except ValueError as error:
        raise ScenarioError(f"{path}: finger.taxels: {error}") from None
    tool = scenario.tool.model
    model = str(model_file(tool, "tool.model", path)) if tool else ""
    if model:
        try:
            check_tool(Path(model))
        except (ValueError, RuntimeError) as error:
            raise ScenarioError(f"{path}: tool.model: {one_line(error)}") from None
        if scenario.tool.thickness is None:
            raise ScenarioError(
                f"{path}: tool.thickness: a tool of one's own needs it, [m]; of the bar at its"
                " frame 'handle', between the pads"
            )
    return replace(
        scenario,
        modalities=modalities,
        tool=replace(scenario.tool, model=model),
    )
