"""An MCAP file that is written message by message."""

import contextlib
import json
import os
from pathlib import Path
from typing import Any

from mcap.writer import Writer

from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, one_line
from crossmodal.systems.recordings.ros_messages import definition, encoded

_ANY_FIELDS = {"type": "object"}  # A JSON schema.


class McapFile:
    """Writes messages into an MCAP file, which is at its place once it is closed.

    Raises:
        ScenarioError: where it cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self.place = str(path)
        self._path = path
        self._unfinished = path.with_name(f".{os.getpid()}-{path.name}")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = self._unfinished.open("wb")
        except OSError as error:
            raise ScenarioError(f"{path}: cannot be written: {one_line(error)}") from None
        self._writer = Writer(self._file, enable_data_crcs=True)
        self._writer.start(profile="ros2")
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}

    def write(self, topic: str, message: Any, now: int) -> None:
        if topic not in self._channels:
            name, form, text, encoding = schema_of(message)
            if name not in self._schemas:
                self._schemas[name] = self._writer.register_schema(name, form, text)
            self._channels[topic] = self._writer.register_channel(
                topic, encoding, self._schemas[name]
            )
        self._writer.add_message(
            self._channels[topic], log_time=now, data=bytes_of(message), publish_time=now
        )

    def describe(self, name: str, facts: dict[str, str]) -> None:
        """Writes a record of metadata."""
        self._writer.add_metadata(name, facts)

    def close(self) -> None:
        self._writer.finish()
        self._file.close()
        os.replace(self._unfinished, self._path)

    def discard(self) -> None:
        """Gives the file up."""
        self._unfinished.unlink(missing_ok=True)
        with contextlib.suppress(OSError):  # The disk may be full.
            self._file.close()


def schema_of(message: Any) -> tuple[str, str, bytes, str]:
    """Name, encoding and text of a message's schema, and the encoding of the message."""
    if isinstance(message, dict):
        return "Estimate", "jsonschema", json.dumps(_ANY_FIELDS).encode(), "json"
    kind = message.__msgtype__
    return kind, "ros2msg", definition(kind).encode(), "cdr"


def bytes_of(message: Any) -> bytes:
    """A ROS 2 message in CDR, or a mapping as JSON."""
    return (
        json.dumps(message, allow_nan=False).encode()
        if isinstance(message, dict)
        else (encoded(message))
    )
