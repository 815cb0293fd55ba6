"""Whether the files of a folder are those that were written: their SHA-256 sums beside them.

The list has the form of `sha256sum`, so that `sha256sum --check SHA256SUMS` in the folder says the
same.
"""

import hashlib
from collections.abc import Iterable
from pathlib import Path

from crossmodal.diagrams.run.folder.run_folder import write_text

CHECKSUM_FILE = "SHA256SUMS"


def write_checksums(folder: Path, files: Iterable[Path]) -> Path:
    """Lists files below `folder` in its `SHA256SUMS`."""
    lines = [f"{_sum(path)}  {path.relative_to(folder).as_posix()}\n" for path in sorted(files)]
    return write_text(folder / CHECKSUM_FILE, "".join(lines))


def damage(folder: Path, *needed: str) -> str:
    """Which file is missing or not what it was, in a few words; nothing where all are whole.

    Args:
        needed: Names of files that the list must hold.
    """
    try:
        text = (folder / CHECKSUM_FILE).read_text(encoding="utf-8")
        lines = [line.partition("  ") for line in text.splitlines()]
    except FileNotFoundError:
        return f"{CHECKSUM_FILE} is missing"
    except (OSError, ValueError):
        return f"{CHECKSUM_FILE} is damaged"
    sums = {name: found for found, _, name in lines}
    if not sums.keys() >= {*needed} or not all(sums):
        return f"{CHECKSUM_FILE} is damaged"
    for name, expected in sums.items():
        path = folder / name
        if not path.is_file():
            return f"{name} is missing"
        if _sum(path) != expected:
            return f"{name} is damaged"
    return ""


def _sum(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return ""
