"""What a recording is to whoever reads it: topics, and messages in order of their log times.

A recording is read from its beginning to its end; nothing but the message in hand is in memory.
"""

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Protocol, Self


class RecordingError(ValueError):
    """A recording cannot be read; the message is one line that says what to do."""

    def __init__(self, message: str) -> None:
        text = " ".join(message.split())
        super().__init__("".join(c if c.isprintable() else " " for c in text))


@dataclass(frozen=True, kw_only=True)
class TopicFacts:
    """A topic of a recording.

    Attributes:
        name: Of the topic.
        type: Of its messages, as in `sensor_msgs/msg/Image`, for both versions of ROS.
        count: Of its messages.
    """

    name: str
    type: str
    count: int


@dataclass(frozen=True, kw_only=True)
class Logged:
    """A message as it was logged.

    Attributes:
        topic: Of the message.
        type: Of the message.
        time: When it was logged, [ns].
        decode: Gives the message, with the fields that its type has in ROS, while the recording is
            open.
    """

    topic: str
    type: str
    time: int
    decode: Callable[[], Any]


class Recording(Protocol):
    """An open recording, to be used in a `with` statement."""

    @property
    def name(self) -> str:
        """What messages call it: its path."""

    @property
    def topics(self) -> dict[str, TopicFacts]:
        """All topics that have messages, by name."""

    def messages(self, topics: Collection[str]) -> Iterator[Logged]:
        """Messages of some topics in order of their log times.

        Raises:
            RecordingError: where the recording is damaged.
        """

    def __enter__(self) -> Self: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...


def stamp_of(message: Any) -> int:
    """The stamp in a message's header, [ns]; zero where it has none."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is None:
        return 0
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)
