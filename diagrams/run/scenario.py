"""What every scenario has: all that is chosen about an episode before it starts, read from YAML.

An application adds its own keys in a dataclass below `Scenario`. The parts that configure one
system are that system's own config. Each number declares its range, and all are checked here; what
is impossible only beside other values is refused by the system that it is for.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from crossmodal.diagrams.run.calibration import CalibrationConfig, Camera
from crossmodal.diagrams.run.variants import Variant
from crossmodal.diagrams.run.yaml_input.loader import apply_override, merged, read_yaml
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, load_typed, suggestion
from crossmodal.maths import se3
from crossmodal.maths.pinhole import Intrinsics
from crossmodal.maths.validation import check, number, numbers
from crossmodal.systems.sensors.stream_fault import StreamFault
from crossmodal.systems.ticks import tick_period

S = TypeVar("S", bound="Scenario")


@dataclass(kw_only=True)
class Interval:
    start: float = number(0.0, at_least=0.0, at_most=86400.0, unit="s")  # Since the episode began.
    # When it ends, since the episode began.
    end: float = number(float("inf"), above=0.0, at_most=86400.0, unit="s", infinite=True)

    def __contains__(self, time: float) -> bool:
        return self.start <= time < self.end


@dataclass(kw_only=True)
class LightsOff(Interval):
    """Lights go off, all of them or some."""

    remaining: float = number(0.0, at_least=0.0, at_most=1.0)  # What is left of the light, share.


@dataclass(kw_only=True)
class CameraBump:
    """Somebody knocks against a camera, which stands elsewhere from then on; nobody says so."""

    start: float = number(0.0, at_least=0.0, at_most=86400.0, unit="s")  # When, at once.
    camera: str = ""  # Which; empty: each.
    # How it turns, a rotation vector in the camera's frame before.
    rotation: np.ndarray = numbers(np.zeros(3), at_least=-180.0, at_most=180.0, unit="deg")
    # How it shifts, in that frame.
    translation: np.ndarray = numbers(np.zeros(3), at_least=-10.0, at_most=10.0, unit="m")

    def displacement(self) -> RigidTransform:
        """Pose of the camera after it in the camera before it."""
        turn = se3.so3_exp(np.deg2rad(np.asarray(self.rotation, dtype=float)))
        return RigidTransform(RotationMatrix(turn), self.translation)


@dataclass(kw_only=True)
class Disturbances:
    """What goes wrong, and when."""

    lights_off: list[LightsOff] = field(default_factory=list)  # When lights go off.
    camera_covered: list[Interval] = field(default_factory=list)  # When the cameras see nothing.
    camera_bumps: list[CameraBump] = field(default_factory=list)  # Knocks against a camera.
    faults: list[StreamFault] = field(default_factory=list)  # Of what the estimators read.

    def camera_displacement(self, time: float, camera: str = "") -> RigidTransform:
        """Pose of a camera, by default the only one, at a time [s], in that at the start."""
        X = RigidTransform()
        for bump in sorted(self.camera_bumps, key=lambda bump: bump.start):
            if bump.start <= time and (not bump.camera or camera in ("", bump.camera)):
                X = X @ bump.displacement()
        return X

    def dark(self) -> list[tuple[str, Interval]]:
        """Why the cameras see nothing, in words, and when."""
        return [
            *(("lights off", span) for span in self.lights_off if span.remaining == 0.0),
            *(("camera covered", span) for span in self.camera_covered),
        ]

    def spans(self) -> list[tuple[str, Interval]]:
        """What goes wrong, in words, and when."""
        faults = [
            (f"{fault.stream} {fault.kind}", Interval(start=fault.start, end=fault.end))
            for fault in self.faults
        ]
        bumps = [
            (f"{bump.camera or 'camera'} bumped", Interval(start=bump.start))
            for bump in self.camera_bumps
        ]
        dim = [
            (f"{100.0 * span.remaining:.3g} % of the light", span)
            for span in self.lights_off
            if span.remaining > 0.0
        ]
        return [*self.dark(), *dim, *faults, *bumps]


@dataclass(kw_only=True)
class CameraConfig:
    """Where a camera is and what it sees, as the robot believes; see `calibration.errors`."""

    width: int = number(640, at_least=16, at_most=4096, unit="px")  # Of its images.
    height: int = number(480, at_least=16, at_most=4096, unit="px")  # Of its images.
    # Horizontal field of view.
    horizontal_angle: float = number(58.0, at_least=0.1, at_most=179.0, unit="deg")
    base_frame: str = "world"  # The frame P that carries it; of a model as `model::frame`.
    position: np.ndarray = numbers(np.zeros(3), at_least=-100.0, at_most=100.0, unit="m")  # p_PC.
    # In P.
    looking_at: np.ndarray = numbers(
        np.array([1.0, 0.0, 0.0]), at_least=-100.0, at_most=100.0, unit="m"
    )
    up: np.ndarray = numbers(np.array([0.0, 0.0, 1.0]), at_least=-100.0, at_most=100.0)  # In P.
    # Intensity of a lamp at the camera; the ceiling light's is 0.9.
    lamp: float = number(0.0, at_least=0.0, at_most=100.0)

    def camera(self) -> Camera:
        """The camera that this describes, with square pixels.

        The principal point lies half a pixel left of and above the middle of the image.
        """
        focal = 0.5 * self.width / np.tan(0.5 * np.deg2rad(self.horizontal_angle))
        return Camera(
            intrinsics=Intrinsics(
                width=self.width,
                height=self.height,
                focal_x=focal,
                focal_y=focal,
                center_x=0.5 * self.width - 1.0,
                center_y=0.5 * self.height - 1.0,
            ),
            base_frame=self.base_frame,
            X_PC=RigidTransform(se3.looking_at(self.position, self.looking_at, self.up)),
        )


@dataclass(kw_only=True)
class Scenario:
    """One kind of episode; with a seed, one episode."""

    system: str = ""  # The application that runs it; see `crossmodal list`.
    name: str = ""  # By default the file's.
    description: str = ""  # One line, for `crossmodal list`.
    seed: int = number(0, at_least=0, at_most=2**63 - 1)  # Of all that varies by chance.
    # Simulated time after which an episode ends at the latest.
    duration: float = number(40.0, above=0.0, at_most=86400.0, unit="s")
    # How long it goes on when the robot is done.
    stop_time: float = number(1.0, at_least=0.0, at_most=3600.0, unit="s")
    network_period: float = tick_period()  # Tick of the filters and the sensors' windows.
    modalities: list[str] = field(default_factory=list)  # The estimators that run; none: all.
    # Estimators with filters of one's own, which run beside these.
    variants: dict[str, Variant] = field(default_factory=dict)
    cameras: dict[str, CameraConfig] = field(default_factory=dict)  # By name.
    calibration: CalibrationConfig = field(default_factory=CalibrationConfig)
    disturbances: Disturbances = field(default_factory=Disturbances)
    versions: dict[str, str] = field(default_factory=dict)  # Written into a run's folder.
    # What `crossmodal replay` was given for a recording of a real robot, which cannot be simulated.
    replay: str = ""

    def units(self) -> Mapping[str, str]:
        """Of values, by path, whose fields leave the unit open (`m or rad`) to the scenario."""
        return {}

    def original(self, name: str) -> str:
        """The estimator that comes with the application, of one by its name or a variant's."""
        return self.variants[name].of if name in self.variants else name

    def replacements(self, name: str) -> dict[str, Callable[..., Any]]:
        """Who makes the filters that are replaced in an estimator, by the filters' names.

        Raises:
            ScenarioError: where one cannot be imported.
        """
        key = f"{self.name}: variants.{name}"
        return self.variants[name].makers(key) if name in self.variants else {}


def read_document(
    path: Path, overrides: Sequence[str] = (), known: Mapping[str, Path] = MappingProxyType({})
) -> dict[str, Any]:
    """A scenario's file as a mapping; assignments `key.path=value` replace what it says.

    Where it says `base: NAME`, it only has what differs from another scenario.

    Args:
        path: Of the file.
        overrides: Those assignments.
        known: Files of the scenarios that have names. A base may also be a file, beside the one
            that says so or by its path from there.
    """
    document = _read_with_base(path, known, ())
    for assignment in overrides:
        apply_override(document, assignment)
    return document


def _read_with_base(path: Path, known: Mapping[str, Path], above: Sequence[Path]) -> dict[str, Any]:
    """What a file says, and what it leaves to its base, whose name is not its own."""
    document = read_yaml(path)
    base = document.pop("base", None)
    if base is None:
        return document
    if not isinstance(base, str):
        raise ScenarioError(f"{path}: base must be text, a scenario's name or file")
    beside = [path.parent / base, path.parent / f"{base}.yaml"]
    file = next((file for file in beside if file.is_file()), known.get(base))
    if file is None:
        names = {*known, *(each.stem for each in path.parent.glob("*.yaml"))} - {path.stem}
        guess = suggestion(base, sorted(names))
        raise ScenarioError(f"{path}: base = '{base}' is no file; {guess}")
    if file.resolve() in [each.resolve() for each in (path, *above)]:
        raise ScenarioError(f"{path}: base = '{base}' is based on this scenario itself")
    inherited = _read_with_base(file, known, (path, *above))
    inherited.pop("name", None)
    return merged(inherited, document)


def parse_scenario(
    schema: type[S],
    document: Mapping[str, Any],
    path: Path,
    units: Callable[[], Mapping[str, str]] = dict,
) -> S:
    """The scenario that a mapping describes, checked as far as every scenario is the same.

    Args:
        path: Of its file, which names it where it has no name.
        units: Gives the units, by path, of values whose fields leave them open.
    """
    scenario = load_typed(schema, document, str(path), units)
    scenario = replace(scenario, name=scenario.name or path.stem)
    if scenario.name in ("..", ".") or "/" in scenario.name or not scenario.name.isprintable():
        raise ScenarioError(
            f"{path}: name = {scenario.name!r}, but it must be a file's name, without folders"
        )
    check_scenario(scenario, str(path))
    return scenario


def check_scenario(scenario: Scenario, source: str) -> None:
    """Refuses values that no episode can have.

    Raises:
        ScenarioError: for the first number, anywhere in the scenario, that is outside the range
            that its field declares, and for what is impossible only beside other values.
    """
    try:
        check(scenario, source)
    except ValueError as error:
        raise ScenarioError(str(error)) from None
    for name, camera in scenario.cameras.items():
        _check_camera(f"cameras.{name}", camera, source)
    for index, bump in enumerate(scenario.disturbances.camera_bumps):
        if bump.camera and bump.camera not in scenario.cameras:
            raise ScenarioError(
                f"{source}: disturbances.camera_bumps.{index}.camera = '{bump.camera}':"
                f" {suggestion(bump.camera, scenario.cameras)}"
            )
    for key, spans in vars(scenario.disturbances).items():
        for index, span in enumerate(spans):
            if not span.start < getattr(span, "end", np.inf):
                raise ScenarioError(
                    f"{source}: disturbances.{key}.{index} = {span.start:g} to {span.end:g} s, but"
                    " it must be start < end"
                )


def _check_camera(key: str, camera: CameraConfig, source: str) -> None:
    ray = camera.looking_at - camera.position
    if np.allclose(ray, 0.0):
        raise ScenarioError(f"{source}: {key}.looking_at must differ from {key}.position")
    if np.linalg.norm(np.cross(ray, camera.up)) < 1e-6 * np.linalg.norm(ray):
        raise ScenarioError(f"{source}: {key}.up must not be zero or point where the camera looks")
