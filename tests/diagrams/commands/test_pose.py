"""`crossmodal pose`: a person's own mesh, cloud and contacts."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

from crossmodal.diagrams.command_line import app, main


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("pose")
    mesh = trimesh.creation.box(extents=[60.0, 90.0, 200.0])
    mesh.export(made / "parcel.stl")
    moved = mesh.copy()
    moved.apply_scale(1e-3)
    moved.apply_translation([0.4, 0.1, 0.1])
    points, faces = trimesh.sample.sample_surface(moved, 600, seed=0)[:2]
    trimesh.PointCloud(points).export(made / "cloud.ply")
    table = np.concatenate([points, moved.face_normals[faces]], axis=1)[:8]
    np.savetxt(made / "touches.csv", table, delimiter=",", header="x,y,z,nx,ny,nz", comments="")
    np.savetxt(made / "bare.csv", table[:, :3], delimiter=";")
    (made / "words.csv").write_text("what,is\nthis,file\n", encoding="utf-8")
    (made / "empty.ply").write_text("ply\n", encoding="utf-8")
    return made


def pose(folder: Path, *options: str) -> str:
    command = ["pose", "--model", str(folder / "parcel.stl"), "--scale", "0.001"]
    result = CliRunner().invoke(app, [*command, *(o.replace("@", f"{folder}/") for o in options)])
    assert result.exit_code == 0, result.output
    return result.output


def test_a_cloud_gives_a_pose_with_its_doubts(folder: Path) -> None:
    said = pose(folder, "--cloud", "@cloud.ply")
    position = said.split("(")[1].split(")")[0].split(",")
    np.testing.assert_allclose([float(x) for x in position], [0.4, 0.1, 0.1], atol=2e-3)
    for word in ("quaternion", "deviations", "ambiguity"):
        assert word in said


def test_contacts_with_a_guess_and_a_table_give_a_pose(folder: Path) -> None:
    options = ("--guess", "0.41,0.1,0.1,0,0,0", "--guess-error", "0.02,0.1", "--table", "0")
    for touches in ("@touches.csv", "@bare.csv"):
        said = pose(folder, "--touches", touches, *options)
        assert "position      (+0.4" in said or "position      (+0.39" in said


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "name a --cloud, --touches or both"),
        (["--cloud", "@none.ply"], "none.ply: there is no such file"),
        (["--cloud", "@empty.ply"], "empty.ply"),
        (["--touches", "@words.csv"], "words.csv: has 2 columns, but needs x, y, z"),
        (["--cloud", "@cloud.ply", "--eye", "1,2"], "--eye 1,2: needs 3 numbers"),
        (["--cloud", "@cloud.ply", "--guess", "0,0,0,0,0,0", "--guess-error", "0,1"], "above zero"),
        (["--cloud", "@cloud.ply", "--scale", "1"], "227 m large"),
    ],
)
def test_bad_input_is_answered_in_one_line(
    folder: Path,
    options: list[str],
    message: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    given = [option.replace("@", f"{folder}/") for option in options]
    command = ["pose", "--model", f"{folder}/parcel.stl", "--scale", "0.001", *given]
    monkeypatch.setattr("sys.argv", ["crossmodal", *command])
    assert main() == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
