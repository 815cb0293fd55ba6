"""Whether the bytes of an MCAP file are those that were written.

The format has one checksum of everything before its summary and one of the summary with the footer;
either may be zero, which says that the writer has made none. The library compares neither with a
file that it seeks in.

Source: the MCAP specification, records DataEnd (opcode 15) and Footer (opcode 2).
"""

import io
import struct
import zlib
from pathlib import Path
from typing import IO

from mcap.writer import MCAP0_MAGIC, Writer
from mcap_ros2.writer import Writer as Ros2Writer

_FOOTER = struct.Struct("<BQQQI")  # Opcode, length, starts of summary and offsets, checksum.
_DATA_END = struct.Struct("<BQI")  # Opcode, length, checksum.
_BLOCK = 1 << 20  # [bytes]


class ChecksummedWriter(Ros2Writer):
    """The library's writer of ROS 2 messages, with a checksum also of what is in no chunk."""

    def __init__(self, output: IO[bytes]) -> None:
        super().__init__(io.BytesIO())
        self._writer = Writer(output, enable_data_crcs=True)
        self._writer.start(profile="ros2")


def check_bytes(path: Path) -> None:
    """Compares a file with its checksums.

    Raises:
        OSError: if it cannot be read.
        ValueError: if it is not as it was written, or not a whole MCAP file.
    """
    with path.open("rb") as file:
        size = file.seek(0, io.SEEK_END)
        footer_start = size - _FOOTER.size - len(MCAP0_MAGIC)
        if footer_start < 0:
            raise ValueError("it is no MCAP file, or was not written to its end")
        file.seek(footer_start)
        footer, magic = file.read(_FOOTER.size), file.read()
        opcode, length, summary_start, _, summary_crc = _FOOTER.unpack(footer)
        if magic != MCAP0_MAGIC or (opcode, length) != (2, _FOOTER.size - 9):
            raise ValueError("it is no MCAP file, or was not written to its end")
        data_end = summary_start - _DATA_END.size
        if not 0 < data_end <= footer_start - _DATA_END.size:
            raise ValueError("it is damaged at its end")
        file.seek(0)
        found = _checksum(file, data_end)
        opcode, length, data_crc = _DATA_END.unpack(file.read(_DATA_END.size))
        if (opcode, length) != (15, _DATA_END.size - 9) or data_crc not in (0, found):
            raise ValueError("it is damaged: the checksum of its data is wrong")
        found = zlib.crc32(footer[:-4], _checksum(file, footer_start - summary_start))
        if summary_crc not in (0, found):
            raise ValueError("it is damaged: the checksum of its summary is wrong")


def _checksum(file: IO[bytes], count: int) -> int:
    """Of the next `count` bytes."""
    crc = 0
    while count > 0:
        block = file.read(min(count, _BLOCK))
        if not block:
            raise ValueError("it ends too early")
        crc, count = zlib.crc32(block, crc), count - len(block)
    return crc
