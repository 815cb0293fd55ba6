"""A recorded episode, written as a bag and read back, is perceived as the recording was."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from mcap.reader import make_reader
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import PassThrough
from ros_messages import header, image
from typer.testing import CliRunner

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.command_line import app
from crossmodal.diagrams.recordings.export_bag import export_bag
from crossmodal.diagrams.recordings.survey import JOINTS, survey
from crossmodal.diagrams.run.replay import check_recorded, replay
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
from crossmodal.systems.recordings.bag_writer import BagWriter
from crossmodal.systems.recordings.images import color_of, depth_of
from crossmodal.systems.recordings.open_recording import open_recording

RUN = Path(__file__).parents[2] / "recordings/drawer"
KEYS = ["time", "modality", "quantity", "component"]
ROUNDING = 1e-6  # Of a standard deviation, by the quaternion in which a pose is written.
COLOR, DEPTH, TRUTH = "/camera/color/image_raw", "/camera/depth/image_raw", "/drawer/joint_states"
JUMP = 5  # Images after which the exposure jumps.


@pytest.fixture(scope="module")
def recorded() -> pd.DataFrame:
    application, scenario = load_scenario(str(check_recorded(RUN)))
    return application.evaluate(replay(application, RUN, scenario)).estimates


def write_calibration(path: Path) -> Path:
    """What the recording's robot believes of itself, as a file."""
    application, scenario = load_scenario(str(check_recorded(RUN)))
    calibration = application.make_calibration(scenario)

    def pose(X: object) -> dict:
        w, x, y, z = X.rotation().ToQuaternion().wxyz().tolist()  # type: ignore[attr-defined]
        position = X.translation().tolist()  # type: ignore[attr-defined]
        return {"position": position, "quaternion": [x, y, z, w]}

    text = {"camera": pose(calibration.camera.X_PC), "arm": pose(calibration.arm.X_WBase)}
    path.write_text(yaml.safe_dump(text))
    return path


def write_foreign(path: Path) -> Path:
    """The images alone as another driver writes them: BGR, millimetres, a clock of its own.

    Every few images the exposure doubles or halves. A motion capture has measured the drawer.
    """
    offset = 1_700_000_000_000_000_000
    every = export_bag(RUN, path.with_name("all.bag"), "bag")
    with open_recording(every) as source, BagWriter(path, "bag") as writer:
        seen = 0
        for logged in source.messages([COLOR, DEPTH, "/cheat/configuration"]):
            message, time = logged.decode(), logged.time + offset
            if logged.topic == "/cheat/configuration":
                fields = {"header": header(time), "name": ["slide"], "position": message.data}
                writer.write(TRUTH, JOINTS, fields, time)
                continue
            if message.encoding == "rgba8":
                gain, seen = (1.0, 2.0)[seen // JUMP % 2], seen + 1
                pixels, encoding = np.uint8(np.minimum(gain * color_of(message), 255.0)), "bgr8"
                pixels = pixels[:, :, ::-1]
            else:
                depth = np.nan_to_num(depth_of(message), posinf=0.0)
                pixels, encoding = np.round(1000.0 * depth).astype(np.uint16), "16UC1"
            fields = image(np.ascontiguousarray(pixels), encoding, time)
            writer.write(logged.topic, logged.type, fields, time + 4_000_000)
    return path


def test_a_camera_whose_exposure_jumps_shows_the_drawer_and_is_scored(tmp_path: Path) -> None:
    path = write_foreign(tmp_path / "camera.bag")
    text = yaml.safe_load(write_calibration(tmp_path / "my.yaml").read_text())
    scenario = load_scenario(str(check_recorded(RUN)))[1]
    inner = scenario.cameras["camera"].camera().intrinsics
    text["camera"] |= {name: float(value) for name, value in vars(inner).items()}
    (tmp_path / "my.yaml").write_text(yaml.safe_dump(text))
    calibration = str(tmp_path / "my.yaml")
    topics = {"color": COLOR, "depth": DEPTH, "truth": {"topic": TRUTH, "type": "prismatic"}}
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(topics))
    options = ["--robot", "wam", "--calibration", calibration, "--out", str(tmp_path / "out")]
    options += ["--topics", str(tmp_path / "map.yaml")]
    options += ["--stream", str(tmp_path / "stream.mcap")]
    result = CliRunner().invoke(app, ["replay", str(path), *options])
    assert result.exit_code == 0, result.output
    assert "Whether the task was done is not known" in result.output
    assert "Against the truth:" in result.output
    summary = json.loads((tmp_path / "out/summary.json").read_text())
    assert summary["stream_faults"] == []
    (joint,) = summary["modalities"]["vision"]["joints"]
    assert (joint["name"], joint["type_true"]) == ("slide", "prismatic")
    assert joint["configuration_true"] > 0.05
    assert joint["configuration_inside_two_sigma"]
    assert joint["consistency"]["configuration_too_sure"] < 0.2
    assert joint["consistency"]["axis"] is None  # Nobody has measured where the axis is.
    came = pd.read_parquet(tmp_path / "out/estimates.parquet")
    assert set(came.modality) == {"vision"}
    with (tmp_path / "stream.mcap").open("rb") as file:
        sent = list(make_reader(file).iter_messages(topics=["/vision/joints"]))
    begun = survey(path).topics[DEPTH].times[0]
    ticks = np.unique(came.time[came.quantity == "configuration"])
    assert {*(np.array([each[2].log_time for each in sent]) - begun)} >= {*np.round(1e9 * ticks)}
    last = came[came.time == came[came.quantity == "configuration"].time.max()]
    types = last[last.quantity == "type_probability"].set_index("component").estimate
    assert types.idxmax() == "prismatic"
    q = last[last.quantity == "configuration"].estimate.abs()
    assert q.iloc[0] > 0.03


def test_an_estimator_that_reads_the_truth_of_a_recording_is_refused() -> None:
    application, scenario = load_scenario(str(check_recorded(RUN)))
    builder = DiagramBuilder()
    curious = builder.AddSystem(PassThrough(1))
    builder.ExportInput(curious.get_input_port(), "cheat_configuration")
    with pytest.raises(ScenarioError, match="'curious' reads 'cheat_configuration'"):
        replay(application, RUN, scenario, estimators={"curious": builder.Build()})


@pytest.mark.parametrize("kind", ["bag", "mcap"])
def test_a_recording_as_a_bag_gives_its_estimates(
    kind: str, recorded: pd.DataFrame, tmp_path: Path
) -> None:
    path = export_bag(RUN, tmp_path / ("drawer.bag" if kind == "bag" else "drawer"), kind)
    calibration = str(write_calibration(tmp_path / "my.yaml"))
    options = ["--robot", "wam", "--calibration", calibration, "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(app, ["replay", str(path), *options])
    assert result.exit_code == 0, result.output
    came = pd.read_parquet(tmp_path / "out/estimates.parquet")
    both = recorded.merge(came, on=KEYS, suffixes=("", "_came"), validate="one_to_one")
    # The last tick of one of them may be the instant at which it ended.
    ticks = recorded.time.nunique()
    assert both.time.nunique() >= ticks - 1
    assert len(both) == len(recorded[recorded.time <= both.time.max()])
    allowed = ROUNDING * both["std"].fillna(1.0).clip(lower=1e-9)
    difference = (both.estimate - both.estimate_came).abs()
    assert (difference[both.estimate.notna()] <= allowed[both.estimate.notna()]).all()
    np.testing.assert_allclose(both.truth, both.truth_came)
