"""Where messages go: an MCAP file, or Foxglove's viewer while the program runs."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Protocol

from crossmodal.diagrams.run.sensor_streams.mcap_file import McapFile, bytes_of, schema_of
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, one_line

VIEWER = "foxglove"  # In place of a file's name.
_PORT = 8765  # Foxglove's usual one.


class Sink(Protocol):
    """Takes messages in the order of time.

    Attributes:
        place: The file, or the address that a viewer opens.
    """

    place: str

    def write(self, topic: str, message: Any, now: int) -> None:
        """Takes a ROS 2 message, or a mapping that becomes JSON, of an instant [ns]."""

    def close(self) -> None:
        """Nothing comes any more; what came is kept."""


class FoxgloveServer:
    """Sends messages to the viewers that are connected to a port of this machine.

    Raises:
        ScenarioError: where the extra `foxglove` is not installed, or the port is taken.
    """

    def __init__(self, port: int = _PORT) -> None:
        try:
            import foxglove
        except ImportError:
            raise ScenarioError(
                "a live stream needs foxglove-sdk: .venv/bin/pip install --editable '.[foxglove]'"
            ) from None
        self._foxglove, self._context = foxglove, foxglove.Context()
        try:
            self._server = foxglove.start_server(
                name="crossmodal", port=port, context=self._context
            )
        except (OSError, RuntimeError) as error:
            raise ScenarioError(f"port {port}: cannot be listened on: {one_line(error)}") from None
        self.place = f"ws://localhost:{self._server.port}"
        self._channels: dict[str, Any] = {}

    def write(self, topic: str, message: Any, now: int) -> None:
        if topic not in self._channels:
            name, form, text, encoding = schema_of(message)
            self._channels[topic] = self._foxglove.Channel(
                topic,
                schema=self._foxglove.Schema(name=name, encoding=form, data=text),
                message_encoding=encoding,
                context=self._context,
            )
        self._channels[topic].log(bytes_of(message), log_time=now)

    def close(self) -> None:
        self._server.stop()


@contextlib.contextmanager
def opened_sink(target: str, *, force: bool = False) -> Iterator[Sink]:
    """The file, or with `foxglove` or `foxglove:PORT` a server for the viewer.

    An error leaves no file; an interrupt leaves what came until then.

    Args:
        target: What the user has named.
        force: Whether the file may replace another one.

    Raises:
        ScenarioError: for what is neither, and where it cannot be had.
    """
    sink = _open(target, force)
    try:
        yield sink
    except Exception:
        if isinstance(sink, McapFile):
            sink.discard()
        raise
    except BaseException:
        sink.close()
        raise
    sink.close()


def _open(target: str, force: bool) -> Sink:
    viewer, _, port = target.partition(":")
    if viewer == VIEWER:
        if port and not (port.isdecimal() and 0 < int(port) < 65536):
            raise ScenarioError(f"'{target}': need a port from 1 to 65535")
        return FoxgloveServer(int(port or _PORT))
    if Path(target).suffix != ".mcap":
        raise ScenarioError(f"'{target}': need FILE.mcap, or {VIEWER}[:PORT]")
    if os.path.lexists(target) and not force:
        raise ScenarioError(f"{target}: exists already; replace it with --force, or name another")
    return McapFile(Path(target))
