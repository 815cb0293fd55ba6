"""Opens a recording of any known kind."""

from pathlib import Path

from crossmodal.systems.recordings.bags import BagRecording, is_bag
from crossmodal.systems.recordings.rbo_files import RboRecording, is_rbo_folder
from crossmodal.systems.recordings.recording import Recording, RecordingError


def is_recording(path: Path) -> bool:
    """Whether a path looks like a recording of a kind that can be read."""
    return is_bag(path) or (path.is_dir() and is_rbo_folder(path))


def open_recording(path: Path) -> Recording:
    """The recording at a path: a bag of ROS 1 or 2, an MCAP file, or an RBO interaction's folder.

    Raises:
        RecordingError: where there is none, it cannot be read, or nothing is in it.
    """
    if not path.exists():
        raise RecordingError(f"{path}: there is no such file or folder")
    if not (path.is_dir() or path.is_file()):  # Nobody may ever write to a pipe.
        raise RecordingError(f"{path}: is no file or folder; name a recording")
    if not is_recording(path):
        raise RecordingError(
            f"{path}: is no recording; need a .bag, .mcap or .db3 file, a folder of a ROS 2 bag, or"
            " one with camera_rgb and camera_depth_registered"
        )
    rbo = path.is_dir() and is_rbo_folder(path)
    recording: Recording = RboRecording(path) if rbo else BagRecording(path)
    if not recording.topics:
        recording.__exit__(None, None, None)
        raise RecordingError(f"{path}: holds no messages; record it again")
    return recording
