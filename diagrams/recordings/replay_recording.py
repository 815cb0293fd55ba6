"""A recording of a real robot drives the estimators of the simulated one."""

import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from crossmodal.diagrams.applications import find_application, resolved
from crossmodal.diagrams.crossmodal.estimators import PROPRIOCEPTION_INPUTS, VISION_INPUTS
from crossmodal.diagrams.crossmodal.modalities import FEELING, MODALITIES, SEEING
from crossmodal.diagrams.crossmodal.robot_config import ARM
from crossmodal.diagrams.joints.joint_truth import UNKNOWN_JOINT
from crossmodal.diagrams.recordings.calibration_file import RecordedRobot
from crossmodal.diagrams.recordings.port_sources import (
    CodecSource,
    ConstantSource,
    FlagSource,
    ImageSource,
    PositionSource,
    Rectifier,
    Source,
    SpanSource,
    WindowSource,
    color_image,
    depth_image,
    grey_image,
)
from crossmodal.diagrams.recordings.recording_log import RecordingLog
from crossmodal.diagrams.recordings.report import is_rectified
from crossmodal.diagrams.recordings.robot_mask_source import RenderedMaskSource
from crossmodal.diagrams.recordings.sample_rows import JointRows, PressureRows, wrench_row
from crossmodal.diagrams.recordings.survey import Survey
from crossmodal.diagrams.recordings.topic_map import TopicMap
from crossmodal.diagrams.run.application import Application
from crossmodal.diagrams.run.calibration import Calibration
from crossmodal.diagrams.run.record import EpisodeRecord
from crossmodal.diagrams.run.recorded_scenario import check_replaced
from crossmodal.diagrams.run.replay import replay
from crossmodal.diagrams.run.scenario import Scenario
from crossmodal.diagrams.run.sensor_streams.codecs import nanoseconds
from crossmodal.diagrams.run.sensor_streams.log import Stream
from crossmodal.diagrams.run.yaml_input.loader import apply_override
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, suggestion
from crossmodal.plants.robots.arm_with_hand import ArmWithHand
from crossmodal.plants.robots.wam import WAM_WITH_SOFT_HAND
from crossmodal.systems.recordings.camera_info import CameraFacts, camera_facts, scaled
from crossmodal.systems.recordings.images import size_of

if TYPE_CHECKING:
    from crossmodal.diagrams.run.stream.sinks import Sink

ROBOTS: dict[str, ArmWithHand] = {"wam": WAM_WITH_SOFT_HAND}
CALIBRATION_FILE, TOPICS_FILE = "calibration.yaml", "topics.yaml"  # Of a replay's folder.
_APPLICATION = "crossmodal"
_CHAMBERS = 4
_APART = 0.02  # Images whose stamps differ by no more are of the same instant, [s].
_LATEST_START = 1.0  # Streams that begin later after the images are said to be missing, [s].


class RecordingWarning(UserWarning):
    """What a user should know of what is perceived in a recording."""


@dataclass(frozen=True, kw_only=True)
class RecordedReplay:
    """A replay that is ready to run.

    Attributes:
        application: With the calibration of the real robot.
        scenario: What perceives.
        run: Runs it; given a function that is called with the time [s] at each tick, and what takes
            the stream for a viewer, each or None.
        warnings: What a user should know, a line each.
    """

    application: Application
    scenario: Any
    run: Callable[[Callable[[float], None] | None, "Sink | None"], EpisodeRecord]
    warnings: Sequence[str] = ()


def prepare(
    found: Survey,
    chosen: TopicMap,
    robot: RecordedRobot,
    name: str = "wam",
    overrides: Sequence[str] = (),
    kept: Mapping[str, Path] = MappingProxyType({}),
) -> RecordedReplay:
    """Wires a recording to the estimators that have what they need.

    Args:
        found: What is in the recording.
        chosen: Which topic is which stream.
        robot: Its calibration.
        name: Of the robot's model.
        overrides: Assignments `key.path=value` of what perceives.
        kept: By their names in the replay's folder, files to be copied there.

    Raises:
        ScenarioError: where nothing can be perceived, or a value is impossible.
        RecordingError: where the recording does not fit its map or its calibration.
    """
    if name not in ROBOTS:
        raise ScenarioError(f"--robot '{name}': {suggestion(name, ROBOTS)}")
    modalities = _modalities(found.path, chosen)
    facts = _camera(found, chosen, robot)
    frame = _camera_frame(found, chosen)
    calibration = robot.calibration(facts.intrinsics, ARM, ROBOTS[name], frame)
    scenario = _scenario(found, chosen, robot, facts, modalities, overrides)
    sets = [word for assignment in overrides for word in ("--set", _from_anywhere(assignment))]
    called = shlex.join([str(found.path.resolve()), "--robot", name, *sets])
    scenario = replace(scenario, replay=called)
    simulated = find_application(_APPLICATION, str(found.path))
    application = replace(
        simulated,
        make_calibration=lambda scenario: calibration,
        keep_files=lambda scenario: (scenario, kept),
        # Nobody says what was to be done.
        evaluate=lambda record: replace(simulated.evaluate(record), failure=None, judged=False),
    )
    originals = [scenario.original(name) for name in scenario.modalities]
    start, end, warnings = _span(found, chosen, originals)
    period = nanoseconds(scenario.network_period)  # The last tick counts, too.
    needed = [
        port
        for modality in originals
        for inputs, having in ((VISION_INPUTS, SEEING), (PROPRIOCEPTION_INPUTS, FEELING))
        if modality in having
        for port in inputs
    ]

    def open_log(streams: list[Stream]) -> RecordingLog:
        sources = _foreign(chosen, robot, facts, calibration, found)
        sources = {port: source for port, source in sources.items() if port in needed}
        sources |= _true(chosen)
        sources |= _own(found, chosen, streams, sources)
        return RecordingLog(found, sources, streams, start, end + period)

    def run(progress: Callable[[float], None] | None, sink: "Sink | None") -> EpisodeRecord:
        return replay(
            application, found.path, scenario, progress=progress, sink=sink, open_log=open_log
        )

    return RecordedReplay(application=application, scenario=scenario, run=run, warnings=warnings)


def _from_anywhere(assignment: str) -> str:
    """An assignment in which a file of Python is named by its whole path."""
    key, equals, value = assignment.partition("=")
    file, *name = value.split(":")
    path = Path(file)
    whole = str(path.resolve()) if path.suffix == ".py" and path.is_file() else file
    return key + equals + ":".join([whole, *name])


def repeated_by(scenario: Scenario, folder: Path) -> str:
    """The command that repeats the replay that is in a folder."""
    used = ["--calibration", folder / CALIBRATION_FILE, "--topics", folder / TOPICS_FILE]
    return f"crossmodal replay {scenario.replay} {shlex.join(map(str, used))}"


def _modalities(path: Path, chosen: TopicMap) -> list[str]:
    """The estimators that have all their streams."""
    sees = bool(chosen.color and chosen.depth)
    feels = bool(chosen.joint_states and chosen.wrench and chosen.pressures)
    feels &= bool(chosen.interaction or chosen.held)
    has = [
        name
        for name in MODALITIES
        if (sees or name not in SEEING) and (feels or name not in FEELING)
    ]
    if not has:
        raise ScenarioError(
            f"{path}: needs topics of color and depth, or of joint_states, wrench and pressures"
            " with interaction or held; see `crossmodal inspect` and name them in --topics"
        )
    return has


def _camera(found: Survey, chosen: TopicMap, robot: RecordedRobot) -> CameraFacts:
    """Intrinsics of the images as they were recorded, by the calibration or the camera info."""
    facts = robot.camera.facts()
    if facts is None and chosen.camera_info:
        info = found.topics[chosen.camera_info].first
        facts = camera_facts(info, is_rectified=is_rectified(chosen.color))
    if not chosen.color:
        return facts or CameraFacts(intrinsics=_any_camera())
    if facts is None:
        raise ScenarioError(
            f"{found.path}: has no camera info; write camera.width, height, focal_x, focal_y,"
            " center_x and center_y into the calibration, [px]"
        )
    width, height = size_of(found.topics[chosen.color].first)
    return replace(facts, intrinsics=scaled(facts.intrinsics, width, height))


def _camera_frame(found: Survey, chosen: TopicMap) -> str:
    """As its images name it, unless the recording's own TF says already where that frame is."""
    said = str(found.topics[chosen.color].first.header.frame_id if chosen.color else "")
    placed = {frame.lstrip("/") for each in found.topics.values() for frame in each.frames}
    return "camera" if said.lstrip("/") in {"", *placed} else said.lstrip("/")


def _any_camera() -> Any:
    from crossmodal.diagrams.run.scenario import CameraConfig

    return CameraConfig().camera().intrinsics


def _scenario(
    found: Survey,
    chosen: TopicMap,
    robot: RecordedRobot,
    facts: CameraFacts,
    modalities: Sequence[str],
    overrides: Sequence[str],
) -> Any:
    """What perceives; limits of the images' times follow from the rates of the recording."""
    X_WC, inner = robot.camera.pose(), facts.intrinsics
    axis, down = X_WC.rotation().col(2), X_WC.rotation().col(1)
    rates = [found.topics[name].interval for name in (chosen.color, chosen.depth) if name]
    slowest = max((each for each in rates if np.isfinite(each)), default=0.0)
    angle = 2.0 * np.arctan(0.5 * inner.width / inner.focal_x)
    document: dict[str, Any] = {
        "system": _APPLICATION,
        "name": found.path.stem,
        "description": "a recording of a real robot",
        "duration": max(1e-9 * (found.end - found.start), 1e-3),
        "modalities": list(modalities),
        "cameras": {
            "camera": {
                "width": inner.width,
                "height": inner.height,
                "horizontal_angle": float(np.rad2deg(angle)),
                "position": X_WC.translation().tolist(),
                "looking_at": (X_WC.translation() + axis).tolist(),
                "up": (-down).tolist(),
            }
        },
        "perception": {"images": {"apart": max(_APART, 0.6 * slowest)}},
    }
    application = find_application(_APPLICATION, str(found.path))
    check_replaced(application, overrides)
    for assignment in overrides:
        apply_override(document, assignment)
    source = Path("the recording's scenario")
    scenario = resolved(application, document, source, overrides)
    for name in scenario.modalities:
        if scenario.original(name) not in modalities:
            key = f"variants.{name}.of" if name in scenario.variants else "modalities"
            raise ScenarioError(
                f"{key}: the recording has no streams for {scenario.original(name)};"
                f" it has those for {', '.join(modalities)}"
            )
    return scenario


def _span(found: Survey, chosen: TopicMap, modalities: Sequence[str]) -> tuple[int, int, list[str]]:
    """First and last tick on the recording's axis, [ns], and what is missing at its ends."""
    eye = [chosen.color, chosen.depth] if any(name in SEEING for name in modalities) else []
    hand = (
        [chosen.joint_states, chosen.wrench, *chosen.pressures]
        if any(name in FEELING for name in modalities)
        else []
    )
    leading, names = eye or hand, [*eye, *hand]
    start = max(int(found.topics[name].times[0]) for name in leading)
    end = min(int(found.topics[name].times[-1]) for name in leading)
    if end <= start:
        raise ScenarioError(
            f"{found.path}: {' and '.join(leading)} were not recorded at the same time; name others"
            " in the map"
        )
    warnings = [
        f"'{name}' {said} {abs(seconds):.1f} s {when}"
        for name in names
        for seconds, said, when in (
            (1e-9 * (int(found.topics[name].times[0]) - start), "begins", "after the images"),
            (1e-9 * (end - int(found.topics[name].times[-1])), "ends", "before them"),
        )
        if name not in leading and seconds > _LATEST_START
    ]
    return start, end, warnings


def _foreign(
    chosen: TopicMap,
    robot: RecordedRobot,
    facts: CameraFacts,
    calibration: Calibration,
    found: Survey,
) -> dict[str, Source]:
    """Sources of the ports that the map names topics for."""
    sources: dict[str, Source] = {}
    count = calibration.arm.model.num_positions()

    def joint_rows() -> JointRows:
        return JointRows(chosen.joint_states, chosen.joint_names, count)

    if chosen.interaction:
        sources["interaction_active"] = FlagSource(chosen.interaction)
    elif chosen.held:
        sources["interaction_active"] = SpanSource(
            lambda time: any(time in span for span in chosen.held)
        )
    if chosen.joint_states:
        names = [chosen.joint_states]
        sources["joint_state_window"] = WindowSource(names, joint_rows(), 2 * count)
    if chosen.wrench:
        sources["wrench_window"] = WindowSource([chosen.wrench], wrench_row, 6)
    if chosen.pressures:
        rows = PressureRows(chosen.pressures)
        sources["pressure_window"] = WindowSource(chosen.pressures, rows, _CHAMBERS)
    if not (chosen.color and chosen.depth):
        return sources
    rectifier, camera = Rectifier(facts), calibration.camera
    sources["color_measured"] = ImageSource(chosen.color, rectifier.color, color_image, camera)
    sources["depth_measured"] = ImageSource(chosen.depth, rectifier.depth, depth_image, camera)
    if chosen.robot_mask:
        sources["robot_mask"] = ImageSource(
            chosen.robot_mask,
            lambda message: rectifier.mask(message, chosen.robot_is_black),
            grey_image,
            None,
        )
    elif chosen.joint_states:
        held = sources.get("interaction_active")
        sources["robot_mask"] = RenderedMaskSource(
            joint_rows(), chosen.joint_states, calibration, held
        )
    else:
        size = facts.intrinsics.height, facts.intrinsics.width
        sources["robot_mask"] = ConstantSource(grey_image(np.zeros(size, dtype=np.uint8)))
    return sources


def _true(chosen: TopicMap) -> dict[str, Source]:
    """Sources of what only the evaluation reads: the object's joint, whose axis nobody knows."""
    truth = chosen.truth
    if not truth.topic:
        return {}
    constants = replace(UNKNOWN_JOINT, name=truth.joint, type=truth.type)
    return {
        "cheat_configuration": PositionSource(truth.topic, truth.joint),
        "cheat_joint": ConstantSource(constants),
    }


def _own(
    found: Survey, chosen: TopicMap, streams: Sequence[Stream], foreign: Mapping[str, Source]
) -> dict[str, Source]:
    """Sources of what this program itself has written beside the sensors: the task and the truth.

    The estimators' own inputs are not among them: these are named in the map.
    """
    mapped = {*chosen.topics().values()}
    measured = {*VISION_INPUTS, *PROPRIOCEPTION_INPUTS}
    return {
        stream.port: CodecSource(stream.topic, stream.codec)
        for stream in streams
        if stream.port not in foreign
        and (stream.port not in measured or stream.port == "interaction_active")
        and stream.topic not in mapped
        and stream.topic in found.topics
        and found.topics[stream.topic].facts.type == stream.codec.message_type
    }
