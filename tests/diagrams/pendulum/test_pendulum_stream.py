"""A live episode of an application of one's own is streamed while it runs."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from typer.testing import CliRunner

from crossmodal.diagrams.applications import OWN, load_scenario
from crossmodal.diagrams.command_line import app
from crossmodal.diagrams.run.episode import run_episode
from crossmodal.diagrams.run.record import Tick
from crossmodal.diagrams.run.stream.sinks import opened_sink
from crossmodal.systems.object_models.articulated_object import (
    ArticulatedObject,
    ObjectBody,
    ObjectJoint,
)


@pytest.fixture(scope="module", autouse=True)
def pendulum() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(OWN, str(Path(__file__).with_name("pendulum.py")))
        yield


def hinged(before: ArticulatedObject | None, tick: Tick) -> ArticulatedObject:
    angle = float(tick.values["state_latest"][0][0])
    joint = ObjectJoint(
        name="hinge",
        parent="stand",
        child="rod",
        type="revolute",
        S_P=np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0]),
        X_PB_zero=np.eye(4),
        q=angle,
    )
    rod = ObjectBody(name="rod", frame="rod_frame", X_WB=joint.pose(angle))
    return ArticulatedObject(root="stand", time=tick.time, bodies=[rod], joints=[joint])


def test_what_is_streamed_live_is_what_was_recorded(tmp_path: Path) -> None:
    application, scenario = load_scenario("swing", ["duration=1"])
    path = tmp_path / "live.mcap"
    with opened_sink(str(path)) as sink:
        record = run_episode(replace(application, perceived=hinged), scenario, sink=sink)
    for name, estimator in record.estimators.items():
        with path.open("rb") as file:
            found = list(make_reader(file).iter_messages(topics=[f"/{name}/joints"]))
        said = [json.loads(message.data)["joints"][0]["q"] for _, _, message in found]
        assert said == [float(tick.values["state_latest"][0][0]) for tick in estimator.ticks]
        assert [message.log_time for _, _, message in found] == [
            round(tick.time * 1e9) for tick in estimator.ticks
        ]


def test_a_run_writes_the_stream_that_was_asked_for(tmp_path: Path) -> None:
    options = [
        "run",
        "swing",
        "--duration",
        "0.2",
        "--out",
        str(tmp_path / "run"),
        "--no-recording",
    ]
    path = tmp_path / "a.mcap"
    result = CliRunner().invoke(app, [*options, "--stream", str(path)])
    assert f"Streaming to {path}" in result.output
    assert path.exists()
    result = CliRunner().invoke(app, [*options, "--force", "--stream", "a.bag"])
    assert result.exit_code == 2
    assert "'a.bag': need FILE.mcap, or foxglove" in result.stderr
