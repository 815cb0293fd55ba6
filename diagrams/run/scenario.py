"""What every scenario has: all that is chosen about an episode before it starts, read from YAML.

An application adds its own keys in a dataclass below `Scenario`. The parts that configure one
system are that system's own config; they are checked by that system.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from diagrams.run.calibration import CalibrationConfig, Camera, check_errors
from diagrams.run.yaml_schema import ScenarioError, apply_override, load_typed, read_yaml
from maths.pinhole import Intrinsics

S = TypeVar("S", bound="Scenario")


@dataclass(kw_only=True)
class Interval:
    start: float = 0.0  # [s], since the episode began.
    end: float = float("inf")  # [s]

    def __contains__(self, time: float) -> bool:
        return self.start <= time < self.end


@dataclass(kw_only=True)
class Disturbances:
    """What goes wrong for the cameras, and when."""

    lights_off: list[Interval] = field(default_factory=list)
    camera_covered: list[Interval] = field(default_factory=list)

    def spans(self) -> list[tuple[str, Interval]]:
        """What goes wrong, in words, and when."""
        return [
            *(("lights off", span) for span in self.lights_off),
            *(("camera covered", span) for span in self.camera_covered),
        ]


@dataclass(kw_only=True)
class CameraConfig:
    """Where a camera is and what it sees, as the robot believes; see `calibration.errors`."""

    width: int = 640  # [px]
    height: int = 480  # [px]
    horizontal_angle: float = 58.0  # Horizontal field of view, [deg].
    base_frame: str = "world"  # The frame P that carries it; of a model as `model::frame`.
    position: np.ndarray = field(default_factory=lambda: np.zeros(3))  # p_PC, [m].
    looking_at: np.ndarray = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))  # In P, [m].
    up: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))  # In P.
    lamp: float = 0.0  # Intensity of a lamp at the camera; the ceiling light's is 0.9.

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
            X_PC=looking_at(self.position, self.looking_at, self.up),
        )


def looking_at(
    p_PC: np.ndarray, p_PTarget: np.ndarray, up_P: np.ndarray | None = None
) -> RigidTransform:
    """X_PC of a camera at `p_PC` (3,) that looks at `p_PTarget` (3,), its -y towards `up_P`."""
    z = (p_PTarget - p_PC) / np.linalg.norm(p_PTarget - p_PC)
    x = np.cross(z, [0.0, 0.0, 1.0] if up_P is None else up_P)
    x /= np.linalg.norm(x)
    return RigidTransform(RotationMatrix(np.column_stack([x, np.cross(z, x), z])), p_PC)


@dataclass(kw_only=True)
class Scenario:
    """One kind of episode; with a seed, one episode."""

    system: str = ""  # The application that runs it; see `crossmodal list`.
    name: str = ""  # By default the file's.
    description: str = ""
    seed: int = 0
    duration: float = 40.0  # Simulated time after which an episode ends at the latest, [s].
    stop_time: float = 1.0  # How long it goes on when the robot is done, [s].
    network_period: float = 1.0 / 15.0  # Tick of the filters and the sensors' windows, [s].
    modalities: list[str] = field(default_factory=list)  # The estimators that run; none: all.
    cameras: dict[str, CameraConfig] = field(default_factory=dict)
    calibration: CalibrationConfig = field(default_factory=CalibrationConfig)
    disturbances: Disturbances = field(default_factory=Disturbances)
    versions: dict[str, str] = field(default_factory=dict)  # Written into a run's folder.


def read_document(path: Path, overrides: Sequence[str] = ()) -> dict[str, Any]:
    """A scenario's file as a mapping; assignments `key.path=value` replace what it says."""
    document = read_yaml(path)
    for assignment in overrides:
        apply_override(document, assignment)
    return document


def parse_scenario(schema: type[S], document: Mapping[str, Any], path: Path) -> S:
    """The scenario that a mapping describes, checked as far as every scenario is the same.

    Args:
        path: Of its file, which names it where it has no name.
    """
    scenario = load_typed(schema, dict(document), str(path))
    scenario = replace(scenario, name=scenario.name or path.stem)
    if scenario.name in ("..", ".") or "/" in scenario.name or not scenario.name.isprintable():
        raise ScenarioError(
            f"{path}: name = {scenario.name!r}, but it must be a file's name, without folders"
        )
    check_scenario(scenario, str(path))
    return scenario


def require_positive(source: str, **values: tuple[float, str]) -> None:
    """Refuses values that are not finite and above zero; each comes with its unit.

    Args:
        source: Where the values stand, the beginning of the message.
        values: By key, with `__` for the dot.
    """
    for key, (value, unit) in values.items():
        if not 0 < value < float("inf"):
            name = key.replace("__", ".")
            raise ScenarioError(f"{source}: {name} = {value!r} {unit}, but it must be > 0 {unit}")


def require_vector(key: str, value: np.ndarray, source: str, unit: str = ", [m]") -> None:
    """Refuses what is not three finite numbers."""
    if value.shape != (3,) or not np.all(np.isfinite(value)):
        raise ScenarioError(f"{source}: {key} = {value.tolist()}, but it must be 3 numbers{unit}")


def check_scenario(scenario: Scenario, source: str) -> None:
    """Refuses values that no episode can have."""
    require_positive(
        source,
        duration=(scenario.duration, "s"),
        network_period=(scenario.network_period, "s"),
    )
    if not 0 <= scenario.stop_time < float("inf"):
        raise ScenarioError(
            f"{source}: stop_time = {scenario.stop_time!r} s, but it must be >= 0 s"
        )
    if scenario.seed < 0:
        raise ScenarioError(f"{source}: seed = {scenario.seed}, but it must be >= 0")
    for name, camera in scenario.cameras.items():
        _check_camera(f"cameras.{name}", camera, source)
    for key in ("errors", "believed"):
        try:
            check_errors(getattr(scenario.calibration, key), f"calibration.{key}")
        except ValueError as error:
            raise ScenarioError(f"{source}: {error}") from None
    for key in ("lights_off", "camera_covered"):
        for index, interval in enumerate(getattr(scenario.disturbances, key)):
            if not 0 <= interval.start < interval.end:
                raise ScenarioError(
                    f"{source}: disturbances.{key}.{index} = {interval.start:g} to"
                    f" {interval.end:g} s, but it must be 0 <= start < end"
                )


def _check_camera(key: str, camera: CameraConfig, source: str) -> None:
    for name in ("width", "height"):
        if not 16 <= getattr(camera, name) <= 4096:
            raise ScenarioError(
                f"{source}: {key}.{name} = {getattr(camera, name)} pixels,"
                " but it must be from 16 to 4096 pixels"
            )
    if not 0 < camera.horizontal_angle < 180:
        raise ScenarioError(
            f"{source}: {key}.horizontal_angle = {camera.horizontal_angle!r} deg,"
            " but it must be between 0 and 180 deg"
        )
    for name in ("position", "looking_at", "up"):
        require_vector(f"{key}.{name}", getattr(camera, name), source)
    if not 0 <= camera.lamp < np.inf:
        raise ScenarioError(f"{source}: {key}.lamp = {camera.lamp!r}, must be from 0 on")
    ray = camera.looking_at - camera.position
    if np.allclose(ray, 0.0):
        raise ScenarioError(f"{source}: {key}.looking_at must differ from {key}.position")
    if np.linalg.norm(np.cross(ray, camera.up)) < 1e-6 * np.linalg.norm(ray):
        raise ScenarioError(f"{source}: {key}.up must not be zero or point where the camera looks")
