"""`crossmodal joints` on tracks of real drawers and doors, and what it says of bad input."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from crossmodal.diagrams.command_line import app
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array

TRACKS = sorted((Path(__file__).parents[3] / "benchmarks/tracks").glob("*.txt"))
DRAWERS = [str(path) for path in TRACKS if path.stem.startswith("drawer_")]


TIMES = np.arange(40) / 15
HINGE = np.array([0.0, 0.0, 1.0, 0.4, 0.0, 0.0])
# The command where neither Drake nor torch is installed.
WITHOUT = """
import sys
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("pydrake", "torch"):
            raise ModuleNotFoundError(name)
sys.meta_path.insert(0, Absent())
from crossmodal.diagrams.command_line import main
sys.exit(main())
"""


def joints(*options: object, code: int = 0) -> str:
    result = CliRunner().invoke(app, ["joints", *map(str, options)])
    assert result.exit_code == code, result.output
    return result.output


def door() -> Array:
    """Poses (N, 4, 4) of a door, 2 mm and .3 deg wrong."""
    noise = np.repeat([0.005, 0.002], 3) * np.random.default_rng(0).standard_normal((40, 6))
    return np.array([se3.exp(0.03 * k * HINGE) @ se3.exp(e) for k, e in enumerate(noise)])


def written(path: Path, X: Array) -> Path:
    """Poses (N, 4, 4) as CSV."""
    q = Rotation.from_matrix(X[:, :3, :3]).as_quat()
    table = np.column_stack([TIMES, X[:, :3, 3], q])
    header = "t,x,y,z,qx,qy,qz,qw"
    np.savetxt(path, table, delimiter=",", header=header, comments="")
    return path


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
    low, high = values["limits_seen_deviation"]
    assert {low, high} <= set(table["q_deviation"])
    unit, factor = ("cm", 100.0) if expected == "prismatic" else ("deg", np.rad2deg(1.0))
    seen = values["limits_seen"][1]
    assert f" to {factor * seen:.2f} +- {factor * high:.2g} {unit}; the first" in said
    assert (tmp_path / "new/configuration.png").stat().st_size > 10_000


def test_repeats_become_one_model_that_is_not_overwritten(tmp_path: Path) -> None:
    out = str(tmp_path / "drawer")
    options = [*DRAWERS, "--rate", "50", "--to", "sdf", "--out", out]
    assert "joint.sdf" in joints(*options)
    assert "replace them with --force" in joints(*options, code=2)
    assert joints(*options, "--force").startswith("prismatic, p = 1.000")
    assert joints(*options, "--force", "--quiet") == ""
    origin = pd.read_csv(tmp_path / "drawer/configuration.csv")["file"]
    assert origin.drop_duplicates().tolist() == DRAWERS
    assert origin.value_counts()[DRAWERS[0]] == len(Path(DRAWERS[0]).read_text().split()) // 3


def test_repeats_have_a_parent_each_that_moves(tmp_path: Path) -> None:
    moved = np.array([se3.exp(np.array([0.1, 0.2, 0.3, 0.4, 0.1, 0.2]) * t) for t in TIMES])
    first = [written(tmp_path / "a.csv", door()), written(tmp_path / "b.csv", moved @ door())]
    still = written(tmp_path / "still.csv", np.tile(np.eye(4), (40, 1, 1)))
    parents = ["--parent", still, "--parent", written(tmp_path / "moved.csv", moved)]
    joints(*first, *parents, "--out", tmp_path / "both")
    values = yaml.safe_load((tmp_path / "both/joint.yaml").read_text())
    assert values["type"] in ("revolute", "screw")
    assert values["notes"] == []
    assert_allclose(values["axis"], HINGE[:3], atol=0.03)


def test_without_a_model_the_joint_is_told_and_written_all_the_same(tmp_path: Path) -> None:
    free = np.array([np.eye(4)] * 40)
    for k, step in enumerate(np.random.default_rng(6).standard_normal((39, 6)) * 0.05, 1):
        free[k] = free[k - 1] @ se3.exp(step)
    out = tmp_path / "new"
    out.mkdir()
    (out / "joint.urdf").write_text("of an earlier joint")
    file = written(tmp_path / "free.csv", free)
    said = joints(
        *(file, "--deviations", "0.6,0.003", "--to", "urdf", "--out", out, "--force"), code=1
    )
    assert said.startswith("disconnected, p = ")
    assert "no joint.urdf is written: the body is disconnected" in said.splitlines()[-1]
    assert {path.name for path in out.iterdir()} == {
        *("joint.yaml", "configuration.csv", "configuration.png")
    }


def test_it_takes_neither_drake_nor_torch(tmp_path: Path) -> None:
    file = written(tmp_path / "door.csv", door())
    told = subprocess.run(
        [sys.executable, "-c", WITHOUT, "joints", file, "--to", "sdf", "--out", tmp_path / "new"],
        capture_output=True,
        text=True,
    )
    assert told.returncode == 0, told.stderr
    assert told.stdout.startswith("revolute, p = ")
    assert (tmp_path / "new/joint.yaml").is_file()
    assert "limits are what was seen, 0 +- " in (tmp_path / "new/joint.sdf").read_text()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["none.csv"], "none.csv: there is no such file"),
        ([DRAWERS[0]], "no times; give the rate"),
        ([DRAWERS[0], "--rate", "50", "--to", "mjcf"], "--to = 'mjcf', need urdf or sdf"),
        ([*DRAWERS, "--rate", "50", "--parent", DRAWERS[0]], "--parent: named 1 times for"),
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
