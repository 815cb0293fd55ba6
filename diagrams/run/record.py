"""What an episode leaves behind: what every estimator said, what the station gave, and pictures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from crossmodal.maths.immutable import Immutable

if TYPE_CHECKING:
    from crossmodal.diagrams.run.calibration import Calibration


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """A value on an output port that is recorded at every tick.

    Attributes:
        port: Name of the port, of an estimator or of the station.
        model: A value like the port's; an array for a vector port.
        estimators: Names of the estimators that have the port; none: all of them have it.
    """

    port: str
    model: Any
    estimators: Sequence[str] = ()


@dataclass(frozen=True, kw_only=True)
class TaskStatus(Immutable):
    """What the robot is doing, as it knows itself.

    Attributes:
        phase: What it does now, in a word or two; empty for what needs no mention.
        done: Whether it will do nothing more.
        note: What has led to this phase, in place of the phase's name in the list of events.
    """

    phase: str = ""
    done: bool = False
    note: str = ""

    @property
    def event(self) -> str:
        """What the beginning of this phase is called."""
        return self.note or self.phase


@dataclass(kw_only=True)
class Event:
    """Something that the robot knew that it did, at `time` [s]."""

    time: float
    name: str


@dataclass(kw_only=True)
class Tick:
    """Values by port at the tick at `time` [s]; a port without a source is left out."""

    time: float
    values: Mapping[str, Any]


@dataclass(kw_only=True)
class EstimatorRecord:
    """One estimator's outputs over the episode and the wall time of each of its ticks, [s]."""

    ticks: list[Tick] = field(default_factory=list)
    tick_times: list[float] = field(default_factory=list)

    def tick_at(self, time: float) -> Tick | None:
        """The tick nearest to a time, [s]; None without any."""
        return min(self.ticks, key=lambda tick: abs(tick.time - time), default=None)


@dataclass(kw_only=True)
class Picture:
    """A colour image (H, W, 3) uint8 that the station's `port` gave at `time` [s]."""

    time: float
    port: str
    color: npt.NDArray[np.uint8]


@dataclass(kw_only=True)
class EpisodeRecord:
    """One episode, simulated or replayed.

    Attributes:
        scenario: As run, with its seed; of the application's dataclass.
        calibration: What the robot believed of its cameras and arms.
        station: What the station gave at each tick: what the robot did, and the truth.
        estimators: By name, one for each of `scenario.modalities`.
        duration: Simulated time, [s].
        wall_time: Of the simulation, without setting up, compiling and writing, [s].
        pictures: Some camera images, in order of time.
        events: In order of time.
        peak_memory: Of the process, [bytes].
        interrupted: A person stopped it before its end, or did so when it was recorded.
        failure: What code of a user's own raised, which ended it; in one line.
        traceback: Of that.
        wants_next: The person at the live page wants the next seed.
        meshcat_html: The recording as a page that opens without a server.
        sensors_file: Where the sensor streams were kept.
        video_file: Where its video is.
        missing: What was to be kept and could not be written, and why, a line each.
    """

    scenario: Any
    calibration: "Calibration"
    station: list[Tick]
    estimators: dict[str, EstimatorRecord]
    duration: float
    wall_time: float
    pictures: list[Picture] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    peak_memory: int = 0
    interrupted: bool = False
    failure: str = ""
    traceback: str = ""
    wants_next: bool = False
    meshcat_html: str | None = None
    sensors_file: Path | None = None
    video_file: Path | None = None
    missing: list[str] = field(default_factory=list)

    def station_values(self, port: str) -> list[Any]:
        """What the station gave on a port, tick by tick."""
        return [tick.values[port] for tick in self.station if port in tick.values]
