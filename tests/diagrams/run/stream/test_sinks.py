"""A file is there when it is whole, a viewer is served live, and bad targets are told."""

import asyncio
import json
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from crossmodal.diagrams.run.stream.messages import transforms
from crossmodal.diagrams.run.stream.sinks import FoxgloveServer, opened_sink
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError


def topics(path: Path) -> dict[str, int]:
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    counts = summary.statistics.channel_message_counts
    return {channel.topic: counts[channel.id] for channel in summary.channels.values()}


def test_a_file_is_at_its_place_once_it_is_closed(tmp_path: Path) -> None:
    path = tmp_path / "new/a.mcap"
    with opened_sink(str(path)) as sink:
        sink.write("/tf", transforms({"camera": np.eye(4)}, 0), 0)
        sink.write("/tf", transforms({"camera": np.eye(4)}, 1), 1)
        sink.write("/task", {"doing": "pulling"}, 2)
        assert not path.exists()
    assert topics(path) == {"/tf": 2, "/task": 1}
    with path.open("rb") as file:
        (task,) = make_reader(file).iter_messages(topics=["/task"])
    assert json.loads(task[2].data) == {"doing": "pulling"}


def stopped_by(error: BaseException, path: Path) -> None:
    with opened_sink(str(path)) as sink:
        sink.write("/task", {}, 0)
        raise error


def test_an_interrupt_keeps_what_came_and_an_error_nothing(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        stopped_by(KeyboardInterrupt(), tmp_path / "kept.mcap")
    assert topics(tmp_path / "kept.mcap") == {"/task": 1}
    with pytest.raises(ValueError, match="broken"):
        stopped_by(ValueError("broken"), tmp_path / "lost.mcap")
    assert [path.name for path in tmp_path.iterdir()] == ["kept.mcap"]


@pytest.mark.parametrize(
    ("target", "message"),
    [
        ("a.bag", "'a.bag': need FILE.mcap, or foxglove"),
        ("foxglove:port", "need a port from 1 to 65535"),
        ("foxglove:70000", "need a port from 1 to 65535"),
    ],
)
def test_bad_targets_are_told_in_one_line(target: str, message: str) -> None:
    with pytest.raises(ScenarioError, match=message), opened_sink(target):
        pass


def test_a_file_is_not_replaced_unless_that_is_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_text("mine")
    with pytest.raises(ScenarioError, match="exists already"), opened_sink(str(path)):
        pass
    assert path.read_text() == "mine"
    with opened_sink(str(path), force=True):
        pass
    assert topics(path) == {}


def test_a_viewer_gets_the_messages_live() -> None:
    pytest.importorskip("foxglove")
    websocket = pytest.importorskip("tornado.websocket")
    server = FoxgloveServer(port=0)

    async def channels() -> list[str]:
        viewer = await websocket.websocket_connect(server.place, subprotocols=["foxglove.sdk.v1"])
        server.write("/task", {"doing": "pulling"}, 0)
        server.write("/tf", transforms({"camera": np.eye(4)}, 0), 0)
        found: list[str] = []
        while len(found) < 2:
            said = json.loads(await asyncio.wait_for(viewer.read_message(), 30.0))
            found += [channel["topic"] for channel in said.get("channels", [])]
        viewer.close()
        return found

    try:
        assert sorted(asyncio.run(channels())) == ["/task", "/tf"]
    finally:
        server.close()
