"""A clone without Git LFS is told, whatever kind of file it is about."""

from collections.abc import Callable
from pathlib import Path

import pytest

from crossmodal.maths.git_lfs import is_lfs_pointer
from crossmodal.plants.object_import.model_source import read_model
from crossmodal.systems.pose_tracks.track_files import read_track
from crossmodal.systems.recordings.open_recording import open_recording

POINTER = "version https://git-lfs.github.com/spec/v1\noid sha256:0df1d8\nsize 391932253\n"


def test_other_files_pass(tmp_path: Path) -> None:
    for text in ("", "version 1", f" {POINTER}"):
        (tmp_path / "file").write_text(text)
        assert not is_lfs_pointer(tmp_path / "file")


@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("a.urdf", read_model),
        ("a.csv", read_track),
        ("a.bag", open_recording),
        ("a.mcap", open_recording),
        ("a.db3", open_recording),
    ],
)
def test_a_pointer_is_told(tmp_path: Path, name: str, read: Callable[[Path], object]) -> None:
    path = tmp_path / name
    path.write_text(POINTER)
    with pytest.raises(ValueError, match=rf"{name}: only stands for .* `git lfs pull`") as raised:
        read(path)
    assert "\n" not in str(raised.value)
