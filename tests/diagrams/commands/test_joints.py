"""`crossmodal joints` on tracks of real drawers and doors, and what it says of bad input."""

from pathlib import Path

import pandas as pd
import pytest
import yaml
from typer.testing import CliRunner

from crossmodal.diagrams.command_line import app

TRACKS = sorted((Path(__file__).parents[3] / "benchmarks/tracks").glob("*.txt"))
DRAWERS = [str(path) for path in TRACKS if path.stem.startswith("drawer_")]


def joints(*options: str, code: int = 0) -> str:
    result = CliRunner().invoke(app, ["joints", *options])
    assert result.exit_code == code, result.output
    return result.output


@pytest.mark.parametrize("track", TRACKS, ids=lambda path: path.stem)
def test_the_real_tracks_are_right_from_their_own_files(track: Path, tmp_path: Path) -> None:
    rate = "15" if track.stem in ("door", "drawer") else "50"
    said = joints(str(track), "--rate", rate, "--out", str(tmp_path / "new"))
    expected = "prismatic" if "drawer" in track.stem else "revolute"
    assert said.startswith(f"{expected}, p = ")
    values = yaml.safe_load((tmp_path / "new/joint.yaml").read_text())
    assert values["type"] == expected
    table = pd.read_csv(tmp_path / "new/configuration.csv")
    assert table["q"].max() == pytest.approx(values["limits_seen"][1], abs=0.05)
    assert (tmp_path / "new/configuration.png").stat().st_size > 10_000


def test_repeats_become_one_model_that_is_not_overwritten(tmp_path: Path) -> None:
    out = str(tmp_path / "drawer")
    options = [*DRAWERS, "--rate", "50", "--to", "sdf", "--out", out]
    assert "joint.sdf" in joints(*options)
    assert "replace them with --force" in joints(*options, code=2)
    assert joints(*options, "--force").startswith("prismatic, p = 1.000")
    assert joints(*options, "--force", "--quiet") == ""


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["none.csv"], "none.csv: is not a file"),
        ([DRAWERS[0]], "no times; give the rate"),
        ([DRAWERS[0], "--rate", "50", "--to", "mjcf"], "--to = 'mjcf', need urdf or sdf"),
        ([*DRAWERS, "--rate", "50", "--parent", DRAWERS[0]], "--parent: goes with one file"),
        ([DRAWERS[0], "--columns", "x"], "need NAME=COLUMN"),
        ([DRAWERS[0], "--rate", "50", "--parent", DRAWERS[0]], "has no rotations"),
        ([DRAWERS[0], "--rate", "50", "--deviations", "1"], "--deviations"),
        ([DRAWERS[0], "--rate", "50", "--deviations", "0,0.1"], "above zero"),
    ],
)
def test_bad_input_is_answered_in_one_line(
    options: list[str], message: str, tmp_path: Path
) -> None:
    said = joints(*options, "--out", str(tmp_path / "new"), code=2)
    assert message in said
    assert said.count("\n") == 1
    assert not (tmp_path / "new").exists()
