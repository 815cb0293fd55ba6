"""Which topic of a recording is which of the robot's streams, as a file says or as is likely."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from crossmodal.diagrams.recordings.survey import (
    ARRAYS,
    FLAGS,
    FLUID,
    JOINTS,
    WRENCH,
    Survey,
    TopicSurvey,
)
from crossmodal.diagrams.run.scenario import Interval
from crossmodal.diagrams.run.yaml_input.loader import read_yaml
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, load_typed, suggestion
from crossmodal.maths.validation import check
from crossmodal.systems.port_values import MOVING_TYPES
from crossmodal.systems.recordings.camera_info import CAMERA_INFO
from crossmodal.systems.recordings.images import IMAGE, IMAGE_TYPES, encoding_of, is_depth

_CHAMBERS, _JOINTS = 4, 7  # Of the hand and of the arm.


@dataclass(kw_only=True)
class RecordedTruth:
    """The position of the object's joint, as something else than the robot has measured it.

    Attributes:
        topic: Of joint states.
        joint: Its name there; of a single one it may be left out.
        type: Prismatic, revolute or screw: a position does not say its unit.
    """

    topic: str = ""
    joint: str = ""
    type: str = ""


@dataclass(kw_only=True)
class TopicMap:
    """Names of topics; a stream that was not recorded has none.

    Attributes:
        color: Images in colour or grey.
        depth: Images of depth, registered to the colour image.
        camera_info: Of the colour image.
        robot_mask: Images in which the robot itself is marked.
        robot_is_black: Whether it is black there, as OMIP has it, or white.
        joint_states: Of the arm.
        joint_names: Of its joints, from the base on; by default the first ones of the messages.
        wrench: Of the wrist's sensor, in its own frame.
        pressures: Of the hand's chambers: one topic of four numbers, or four `FluidPressure`, [Pa].
        interaction: Says by true, or a number above one half, that the hand holds the object.
        held: When it did, since the replay's start, where no topic says it.
        truth: Of the object's joint, for scoring alone.
    """

    color: str = ""
    depth: str = ""
    camera_info: str = ""
    robot_mask: str = ""
    robot_is_black: bool = False
    joint_states: str = ""
    joint_names: list[str] = field(default_factory=list)
    wrench: str = ""
    pressures: list[str] = field(default_factory=list)
    interaction: str = ""
    held: list[Interval] = field(default_factory=list)
    truth: RecordedTruth = field(default_factory=RecordedTruth)

    def topics(self) -> dict[str, str]:
        """The topics that it names, by what they are."""
        named = {item.name: getattr(self, item.name) for item in fields(self)}
        found = {key: name for key, name in named.items() if isinstance(name, str) and name}
        found |= {"truth.topic": self.truth.topic} if self.truth.topic else {}
        return found | {f"pressures.{k}": name for k, name in enumerate(self.pressures)}


# The types that a stream's topic may have.
_TYPES = {
    "color": IMAGE_TYPES,
    "depth": IMAGE_TYPES,
    "camera_info": (CAMERA_INFO,),
    "robot_mask": IMAGE_TYPES,
    "joint_states": (JOINTS,),
    "wrench": (WRENCH,),
    "pressures": (*ARRAYS, FLUID),
    "interaction": FLAGS + ARRAYS,
    "truth": (JOINTS,),
}


def read_topic_map(path: Path, found: Survey) -> TopicMap:
    """The map in a file, checked against what is in the recording.

    Raises:
        ScenarioError: for unknown keys, and topics that are not there or have another type.
    """
    made = load_typed(TopicMap, read_yaml(path), str(path))
    try:
        check(made, str(path))
    except ValueError as error:
        raise ScenarioError(str(error)) from None
    for key, name in made.topics().items():
        if name not in found.topics:
            raise ScenarioError(f"{path}: {key} = '{name}': {suggestion(name, found.topics)}")
        kind, allowed = found.topics[name].facts.type, _TYPES[key.partition(".")[0]]
        if kind not in allowed:
            raise ScenarioError(
                f"{path}: {key} = '{name}' holds {kind}; need {' or '.join(allowed)}"
            )
    if len(made.pressures) not in (0, 1, _CHAMBERS):
        raise ScenarioError(
            f"{path}: pressures names {len(made.pressures)} topics; need one or {_CHAMBERS}"
        )
    _check_truth(made.truth, found, str(path))
    return made


def _check_truth(truth: RecordedTruth, found: Survey, source: str) -> None:
    """Names the only joint of the topic; refuses one that is not there and an unknown type."""
    if not truth.topic:
        if truth.joint or truth.type:
            raise ScenarioError(f"{source}: truth needs a topic of joint states")
        return
    names = list(found.topics[truth.topic].first.name)
    if not truth.joint and len(names) == 1:
        truth.joint = names[0]
    if truth.joint not in names:
        raise ScenarioError(
            f"{source}: truth.joint = '{truth.joint}': {suggestion(truth.joint, names)}"
        )
    types = [str(kind) for kind in MOVING_TYPES]
    if truth.type not in types:
        raise ScenarioError(
            f"{source}: truth.type = '{truth.type}': {suggestion(truth.type, types)}"
        )


def likely_topic_map(found: Survey) -> TopicMap:
    """The map that names and types suggest."""
    made = TopicMap()
    images = found.of_type(*IMAGE_TYPES)
    depths = [each for each in images if is_depth(encoding_of(each.first))]
    others = [each for each in images if each not in depths]
    masks = [each for each in others if "mask" in _words(each) or "occlusion" in _words(each)]
    colors = [each for each in others if each not in masks]
    made.depth = _best(depths, ("registered", "aligned", "rect"), ("infra", "/ir"))
    made.color = _best(colors, ("color", "rgb", "rect"), ("infra", "/ir", "depth"))
    made.robot_mask = _best(masks, ("robot",), ())
    made.robot_is_black = "occlusion" in made.robot_mask
    infos = [each.facts.name for each in found.of_type(CAMERA_INFO)]
    made.camera_info = max(infos, key=lambda name: _common(name, made.color), default="")
    arms = [each for each in found.of_type(JOINTS) if len(each.first.position) >= _JOINTS]
    made.joint_states = _best(arms, ("arm", "wam", "joint_states"), ())
    made.wrench = _best(found.of_type(WRENCH), ("wrist", "ft", "wrench"), ())
    arrays = [
        each
        for each in found.of_type(*ARRAYS)
        if len(each.first.data) == _CHAMBERS and "pressure" in _words(each)
    ]
    fluids = sorted(each.facts.name for each in found.of_type(FLUID))
    if arrays:
        made.pressures = [_best(arrays, ("hand",), ())]
    elif len(fluids) == _CHAMBERS:
        made.pressures = fluids
    flags = [
        each
        for each in found.of_type(*FLAGS, *ARRAYS)
        if "interaction" in _words(each) or "grasped" in _words(each)
    ]
    made.interaction = _best(flags, ("active",), ())
    return made


def _words(each: TopicSurvey) -> str:
    return each.facts.name.lower()


def _best(topics: list[TopicSurvey], good: tuple[str, ...], bad: tuple[str, ...]) -> str:
    """The topic whose name has most of the good words, none of the bad ones, and raw images."""

    def points(each: TopicSurvey) -> tuple[int, bool, int]:
        name = _words(each)
        of_words = sum(word in name for word in good) - 9 * sum(word in name for word in bad)
        return of_words, each.facts.type == IMAGE, each.facts.count

    return max(topics, key=points).facts.name if topics else ""


def _common(first: str, second: str) -> int:
    """How many parts of two topics' names are the same from the beginning on."""
    count = 0
    for a, b in zip(first.split("/"), second.split("/"), strict=False):
        if a != b:
            break
        count += 1
    return count


def as_yaml(made: TopicMap, objects: Sequence[TopicSurvey] = ()) -> str:
    """The map as a file that can be changed.

    Args:
        objects: Joint states that are not the arm's; they may be the truth.
    """
    notes: dict[str, str] = {
        "color": "Images in colour or grey.",
        "depth": "Registered to the colour image.",
        "camera_info": "Of the colour image; without it, the calibration says the intrinsics.",
        "robot_mask": "Marks the robot itself.",
        "joint_states": "Of the arm.",
        "wrench": "Of the wrist, in the sensor's own frame.",
        "pressures": "Of the hand's chambers, [Pa].",
        "interaction": "Says when the hand holds the object.",
    }
    lines = []
    for key, note in notes.items():
        value: Any = getattr(made, key)
        shown = f"[{', '.join(value)}]" if isinstance(value, list) else value or '""'
        lines.append(f"{key}: {shown}  # {note}")
    if made.robot_mask:
        lines.append(f"robot_is_black: {str(made.robot_is_black).lower()}  # Or white.")
    if made.joint_states:
        lines.append("joint_names: []  # From the base on; empty: the first of the messages.")
    if made.wrench and not made.interaction:
        lines.append("held: [{start: 0, end: inf}]  # Since the replay's start, [s].")
    for each in objects:
        joint = each.first.name[0] if len(each.first.name) else ""
        lines.append(
            f"# truth: {{topic: {each.facts.name}, joint: {joint}, type: prismatic}}"
            "  # Or revolute; for scoring alone."
        )
    return "\n".join(lines) + "\n"


def object_joints(found: Survey, made: TopicMap) -> list[TopicSurvey]:
    """Topics of joint states that are not the arm's."""
    return [each for each in found.of_type(JOINTS) if each.facts.name != made.joint_states]
