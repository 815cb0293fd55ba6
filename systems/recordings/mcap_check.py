"""Whether an MCAP file is as it was written."""

from pathlib import Path
from zlib import crc32

from mcap.records import Chunk, Footer
from mcap.stream_reader import StreamReader, get_chunk_data_stream

_AFTER_SUMMARY = 12  # Bytes of its checksum and of the magic.


def check_mcap(path: Path) -> None:
    """Reads an MCAP file once, and compares all checksums that its writer has given with it.

    Raises:
        Exception: of a damaged file, whatever the libraries make of it.
    """
    with path.open("rb") as file:
        for record in StreamReader(file, validate_crcs=True, emit_chunks=True).records:
            if isinstance(record, Chunk):
                get_chunk_data_stream(record, validate_crc=True)
        if isinstance(record, Footer) and record.summary_crc and record.summary_start:
            size = file.tell() - _AFTER_SUMMARY - record.summary_start
            file.seek(record.summary_start)
            if crc32(file.read(size)) != record.summary_crc:
                raise ValueError("its index does not have the checksum that it says")
