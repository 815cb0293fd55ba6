"""A recorded episode, written as a bag and read back, is perceived as the recording was."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from ros_messages import image
from typer.testing import CliRunner

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.command_line import app
from crossmodal.diagrams.recordings.export_bag import export_bag
from crossmodal.diagrams.run.replay import check_recorded, replay
from crossmodal.systems.recordings.bag_writer import BagWriter
from crossmodal.systems.recordings.images import color_of, depth_of
from crossmodal.systems.recordings.open_recording import open_recording

RUN = Path(__file__).parents[2] / "recordings/drawer"
KEYS = ["time", "modality", "quantity", "component"]
ROUNDING = 1e-6  # Of a standard deviation, by the quaternion in which a pose is written.


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
    """The images alone as another driver writes them: BGR, millimetres, a clock of its own."""
    offset = 1_700_000_000_000_000_000
    every = export_bag(RUN, path.with_name("all.bag"), "bag")
    with open_recording(every) as source, BagWriter(path, "bag") as writer:
        for logged in source.messages(["/camera/color/image_raw", "/camera/depth/image_raw"]):
            message = logged.decode()
            if message.encoding == "rgba8":
                pixels, encoding = color_of(message)[:, :, ::-1], "bgr8"
            else:
                depth = np.nan_to_num(depth_of(message), posinf=0.0)
                pixels, encoding = np.round(1000.0 * depth).astype(np.uint16), "16UC1"
            fields = image(np.ascontiguousarray(pixels), encoding, logged.time + offset)
            writer.write(logged.topic, logged.type, fields, logged.time + offset + 4_000_000)
    return path


def test_a_camera_alone_shows_the_drawer_to_vision(tmp_path: Path) -> None:
    path = write_foreign(tmp_path / "camera.bag")
    text = yaml.safe_load(write_calibration(tmp_path / "my.yaml").read_text())
    scenario = load_scenario(str(check_recorded(RUN)))[1]
    inner = scenario.cameras["camera"].camera().intrinsics
    text["camera"] |= {name: float(value) for name, value in vars(inner).items()}
    (tmp_path / "my.yaml").write_text(yaml.safe_dump(text))
    calibration = str(tmp_path / "my.yaml")
    options = ["--robot", "wam", "--calibration", calibration, "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(app, ["replay", str(path), *options])
    assert result.exit_code == 0, result.output
    assert "Whether the task was done is not known" in result.output
    came = pd.read_parquet(tmp_path / "out/estimates.parquet")
    assert set(came.modality) == {"vision"}
    last = came[came.time == came[came.quantity == "configuration"].time.max()]
    types = last[last.quantity == "type_probability"].set_index("component").estimate
    assert types.idxmax() == "prismatic"
    q = last[last.quantity == "configuration"].estimate.abs()
    assert q.iloc[0] > 0.03


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
