"""Files that Git LFS keeps elsewhere: a clone without it holds a small text in their place."""

from pathlib import Path

STANDS_FOR_ANOTHER = "only stands for a file that Git LFS keeps; get it by `git lfs pull`"
_BEGINNING = b"version https://git-lfs.github.com/spec/"


def is_lfs_pointer(path: Path) -> bool:
    """Whether a file is such a text."""
    with path.open("rb") as file:
        return file.read(len(_BEGINNING)) == _BEGINNING
