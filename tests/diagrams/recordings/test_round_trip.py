"""A recorded episode, written as a bag and read back, is perceived as the recording was."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from typer.testing import CliRunner

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.command_line import app
from crossmodal.diagrams.recordings.export_bag import export_bag
from crossmodal.diagrams.run.replay import check_recorded, replay

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
