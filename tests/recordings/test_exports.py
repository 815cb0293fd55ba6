"""Recordings are perceived once, exported as models and streamed: all of it is what was perceived.

The messages are decoded by another library than the one that encodes them.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from numpy.testing import assert_allclose
from outputs import FOLDER
from typer.testing import CliRunner

from benchmarks.exported_models import Reopened, deviations, perceived_over_time
from crossmodal.diagrams.applications import load_recorded
from crossmodal.diagrams.command_line import app
from crossmodal.diagrams.crossmodal.application import APPLICATION
from crossmodal.diagrams.joints.perceived_object import body_name
from crossmodal.diagrams.run.folder.perceived_file import (
    PERCEIVED_FILE,
    as_text,
    perceived,
    read_perceived,
)
from crossmodal.diagrams.run.folder.run_folder import SCENARIO_FILE, SENSORS_FILE, write_scenario
from crossmodal.diagrams.run.record import EpisodeRecord
from crossmodal.diagrams.run.replay import replay
from crossmodal.diagrams.run.stream.sinks import opened_sink
from crossmodal.systems.object_models.articulated_object import ArticulatedObject

JOINTS = {"cupboard-door": "revolute", "drawer": "prismatic", "sliding-door": "prismatic"}
MODALITY = "crossmodal"


@dataclass
class Perceived:
    record: EpisodeRecord
    file: Path
    each: list[ArticulatedObject | None]

    def messages(self, topic: str) -> list[Any]:
        """Instants [ns] and messages, JSON as mappings."""
        with self.file.open("rb") as file:
            reader = make_reader(file, decoder_factories=[DecoderFactory()])
            if topic.endswith("/joints"):
                found = reader.iter_messages(topics=[topic])
                return [(message.log_time, json.loads(message.data)) for _, _, message in found]
            decoded = reader.iter_decoded_messages(topics=[topic])
            return [(one.message.log_time, one.decoded_message) for one in decoded]


@pytest.fixture(scope="module", params=sorted(JOINTS))
def seen(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    folder = FOLDER / request.param
    file = tmp_path_factory.mktemp("stream") / "estimates.mcap"
    changes = [f"modalities=[{MODALITY}]"]
    application, scenario = load_recorded(folder, changes)
    with opened_sink(str(file)) as sink:
        record = replay(application, folder, scenario, sink=sink)
    each = perceived_over_time(application, record.estimators[MODALITY].ticks)
    return Perceived(record, file, each)


def test_a_model_of_a_recording_reopens_and_moves_as_perceived(seen: Perceived) -> None:
    last = seen.each[-1]
    assert last is not None
    assert last.joints[-1].type == JOINTS[seen.record.scenario.name]
    model, joint, body = Reopened(last), last.joints[-1], last.bodies[-1]
    assert_allclose(model.pose(body.frame, joint, joint.q), body.X_WB, atol=1e-7)
    for q in np.linspace(joint.lower, joint.upper, 7):
        assert_allclose(model.pose(body.frame, joint, q), joint.pose(q), atol=1e-7)
    off = np.array(list(deviations(seen.record.estimators[MODALITY].ticks, seen.each)))
    assert len(off) > 10
    # The first poses are of a hand that has hardly moved: at most 0.062 rad and 8.2 mm off.
    assert (np.median(off, axis=0) < [0.02, 0.002]).all()  # [rad], [m]
    assert (off.max(axis=0) < [0.08, 0.01]).all()


def test_joints_are_streamed_as_they_were_believed(seen: Perceived) -> None:
    ticks = {round(tick.time * 1e9): tick for tick in seen.record.estimators[MODALITY].ticks}
    streamed = seen.messages(f"/{MODALITY}/joints")
    assert len(streamed) > 10
    compared = 0
    for now, said in streamed:
        for joint in said["joints"]:
            if round(said["time"] * 1e9) != now or joint["q"] is None:
                continue  # It is as it was before, or does not move.
            (belief,) = (
                one
                for one in ticks[now].values["joints_latest"].joints
                if joint["parent"] == body_name(one.parent_id)
                and joint["child"] == body_name(one.child_id)
            )
            assert joint["probability"] == belief.probabilities[belief.type]
            assert abs(joint["q"]) == abs(belief.model.configuration[0])
            assert abs(np.dot(joint["axis"], belief.model.axis_P)) == pytest.approx(1.0)
            compared += 1
    assert compared > 10


def test_frames_are_streamed_where_bodies_were_believed(seen: Perceived) -> None:
    sent = {
        (now, one.child_frame_id): one.transform
        for now, message in seen.messages("/tf")
        for one in message.transforms
    }
    found = [one for one in seen.each if one is not None]
    for one in found:
        at = sent[round(one.time * 1e9), f"{MODALITY}/{one.bodies[-1].name}"]
        p = at.translation
        assert_allclose([p.x, p.y, p.z], one.bodies[-1].X_WB[:3, 3], atol=1e-12)
    assert (0, "camera") in sent
    assert f"{MODALITY}/end_effector" in {frame for _, frame in sent}


def test_images_are_streamed_with_their_camera(seen: Perceived) -> None:
    camera = seen.record.calibration.camera.intrinsics
    for topic, encoding in (("color", "rgb8"), ("depth", "32FC1")):
        images = seen.messages(f"/camera/{topic}/image_raw")
        cameras = seen.messages(f"/camera/{topic}/camera_info")
        assert len(images) == len(cameras) > 10
        _, first = images[0]
        assert (first.encoding, first.width, first.height) == (
            *(encoding, camera.width), camera.height,
        )  # fmt: skip
        assert first.header.frame_id == cameras[0][1].header.frame_id == "camera"
        assert_allclose(cameras[0][1].k[0], camera.focal_x)
    depth = np.frombuffer(first.data, np.float32)
    with (FOLDER / seen.record.scenario.name / SENSORS_FILE).open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        kept = next(iter(reader.iter_decoded_messages(topics=["/camera/depth/image_raw"])))
    assert_allclose(depth, np.frombuffer(kept.decoded_message.data, np.float32))


def test_bodies_and_axes_are_drawn(seen: Perceived) -> None:
    kinds = {one.type for _, message in seen.messages(f"/{MODALITY}/markers")
             for one in message.markers}  # fmt: skip
    assert {0, 9} <= kinds


def test_the_command_writes_what_a_run_has_kept(seen: Perceived, tmp_path: Path) -> None:
    write_scenario(tmp_path, APPLICATION, seen.record.scenario)
    kept = perceived(APPLICATION, seen.record)
    (tmp_path / PERCEIVED_FILE).write_text(as_text(kept))
    assert as_text(read_perceived(tmp_path)) == as_text(kept)
    for form in ("sdf", "urdf"):
        options = ["export", str(tmp_path), "--to", form]
        result = CliRunner().invoke(app, options)
        assert result.exit_code == 0, result.output
        assert JOINTS[seen.record.scenario.name] in (tmp_path / f"object.{form}").read_text()
        again = CliRunner().invoke(app, options)
        assert again.exit_code == 2
        assert "replace it with --force" in again.stderr


def test_a_recording_that_nobody_has_perceived_is_perceived_first(tmp_path: Path) -> None:
    recording, out = FOLDER / "sliding-door", tmp_path / "door.sdf"
    assert not (recording / PERCEIVED_FILE).exists()
    assert (recording / SCENARIO_FILE).exists()
    result = CliRunner().invoke(
        app, ["export", str(recording), "--to", "sdf", "--out", str(out), "--force"]
    )
    assert result.exit_code == 0, result.output
    assert "prismatic" in out.read_text()
