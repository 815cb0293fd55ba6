"""What `crossmodal inspect` says of a recording."""

from pathlib import Path

from crossmodal.diagrams.recordings import calibration_file, topic_map
from crossmodal.diagrams.recordings.survey import Survey, TopicSurvey
from crossmodal.diagrams.recordings.topic_map import TopicMap, likely_topic_map
from crossmodal.systems.recordings.camera_info import CameraFacts, camera_facts
from crossmodal.systems.recordings.images import size_of
from crossmodal.systems.recordings.pose_topics import POSE_TYPES
from crossmodal.systems.recordings.recording import RecordingError

_SHOWN = 3  # Gaps of a topic.


def described(found: Survey) -> list[str]:
    """Topics with their rates and gaps, what can be perceived, and the commands for it."""
    chosen = likely_topic_map(found)
    seconds = 1e-9 * (found.end - found.start)
    count = len(found.topics)
    topics = f"{count} topic{'s' if count > 1 else ''}"
    lines = [f"{found.path}: {topics}, {seconds:.1f} s", "", "Topics"]
    width = max(len(name) for name in found.topics)
    for name, each in sorted(found.topics.items()):
        lines.append(f"  {name:{width}s}  {each.facts.type}")
        lines += [f"  {'':{width}s}    {text}" for text in _facts(each, found.start)]
    lines += ["", "What can be perceived", *(f"  {text}" for text in perceivable(found, chosen))]
    lines += ["", "Commands", *(f"  {text}" for text in _commands(found, chosen))]
    return lines


def _facts(each: TopicSurvey, start: int) -> list[str]:
    count, offset = len(each.times), 1e-9 * (each.times[0] - start)
    lines = [f"{count} messages, {each.rate:.3g} Hz" if count > 1 else "1 message"]
    if text := each.holds():
        lines.append(text)
    if count > 1 and offset > 1.0:
        lines.append(f"begins after {offset:.1f} s")
    if gaps := each.gaps:
        shown = ", ".join(f"{dt:.2g} s at {t + offset:.1f} s" for t, dt in gaps[:_SHOWN])
        more = f" and {len(gaps) - _SHOWN} more" if len(gaps) > _SHOWN else ""
        lines.append(f"gaps: {shown}{more}")
    if each.jumps:
        lines.append(f"its clock was set {each.jumps} times; its stamps go on from the log's")
    if each.disordered:
        lines.append(f"{each.disordered} messages out of order; they are sorted")
    return lines


def perceivable(found: Survey, chosen: TopicMap) -> list[str]:
    """Which estimators have what they need, and what others lack."""
    lines = []
    eye = [name for name in ("color", "depth") if not getattr(chosen, name)]
    hand = [name for name in ("joint_states", "wrench", "pressures") if not getattr(chosen, name)]
    if not eye:
        lines.append(f"vision: {chosen.color} with {chosen.depth}")
    elif len(eye) == 1:
        lines.append(f"no vision: there are no images of {eye[0]}, which it needs, too")
    if not hand:
        held = chosen.interaction or "the times `held` that you write into the map"
        lines.append(f"proprioception: the arm's joints, wrench and pressure; held by {held}")
    elif len(hand) < 3:
        lines.append(f"no proprioception: there is no topic of {', '.join(hand)}")
    if not (eye or hand):
        lines.append("cross-modal: both together")
    if not (eye and hand):
        lines += [
            f"scored by {each.facts.name} where that is the object's: `truth` in the map"
            for each in topic_map.object_joints(found, chosen)
        ]
    if poses := found.of_type(*POSE_TYPES):
        lines.append(f"joints from poses: {', '.join(each.facts.name for each in poses)}")
    return lines or ["nothing: there are neither images with depth nor joints nor poses"]


def _commands(found: Survey, chosen: TopicMap) -> list[str]:
    lines = []
    if can_be_replayed(chosen):
        lines += [
            f"crossmodal inspect {found.path} --drafts .   # topics.yaml, calibration.yaml",
            f"crossmodal replay {found.path} --robot wam --calibration calibration.yaml"
            " --topics topics.yaml",
        ]
    lines += [
        f"crossmodal joints {found.path} --topic {each.facts.name}"
        for each in found.of_type(*POSE_TYPES)
    ]
    return lines or ["none"]


def can_be_replayed(chosen: TopicMap) -> bool:
    """Whether vision, or proprioception, has all that it needs."""
    sees = bool(chosen.color and chosen.depth)
    return sees or bool(chosen.joint_states and chosen.wrench and chosen.pressures)


def drafts(found: Survey) -> dict[str, str]:
    """The map and the calibration as files to be completed, by their names."""
    chosen = likely_topic_map(found)
    width, height = size_of(found.topics[chosen.color].first) if chosen.color else (640, 480)
    return {
        "topics.yaml": topic_map.as_yaml(chosen, topic_map.object_joints(found, chosen)),
        "calibration.yaml": calibration_file.as_yaml(said_of(found, chosen), width, height),
    }


def said_of(found: Survey, chosen: TopicMap) -> CameraFacts | None:
    """What the recording says of the camera; None where it says nothing that can be used."""
    if not chosen.camera_info:
        return None
    try:
        info = found.topics[chosen.camera_info].first
        return camera_facts(info, is_rectified=is_rectified(chosen.color))
    except RecordingError:
        return None


def is_rectified(topic: str) -> bool:
    """Whether a topic's name says that its images are rectified."""
    return "rect" in topic


def written(found: Survey, folder: Path, *, force: bool) -> list[Path]:
    """Writes the drafts into a folder.

    Raises:
        RecordingError: where one is there already and must not be replaced.
    """
    from crossmodal.diagrams.run.folder.written_files import write_text

    texts = drafts(found)
    for name in texts:
        if (folder / name).exists() and not force:
            raise RecordingError(f"{folder / name}: exists already; replace it with --force")
    return [write_text(folder / name, text) for name, text in texts.items()]
