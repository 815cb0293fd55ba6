"""Whole episodes of the measuring rig: what they come to, and bad input."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.clutter.estimators import load_model
from crossmodal.diagrams.clutter.results.results import average_distance
from crossmodal.diagrams.clutter.start import first_guess, true_pose
from crossmodal.diagrams.command_line import app
from crossmodal.diagrams.evaluation.run_writer import write_run
from crossmodal.diagrams.run.application import Results
from crossmodal.diagrams.run.episode import run_episode
from crossmodal.diagrams.run.folder.fingerprint import contents
from crossmodal.diagrams.run.folder.run_folder import SENSORS_FILE, SUMMARY_FILE
from crossmodal.diagrams.run.record import EpisodeRecord
from crossmodal.diagrams.run.replay import replay
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
from crossmodal.maths import se3


def episode(name: str, *changes: str) -> tuple[EpisodeRecord, Results]:
    application, scenario = load_scenario(name, list(changes))
    record = run_episode(application, scenario)
    return record, application.evaluate(record)


@pytest.fixture(scope="module")
def seen() -> tuple[EpisodeRecord, Results]:
    return episode("pose-estimation", "seed=1", "views.count=1", "touches.chosen_touches=2")


def test_a_view_and_touches_find_the_object(seen: tuple[EpisodeRecord, Results]) -> None:
    _, results = seen
    assert results.failure is None
    pose = results.summary["pose"]
    assert pose["target"] == "spray"
    assert pose["object_moved"] is None  # The rig's object stays by itself.
    assert [stage["stage"] for stage in pose["stages"]] == ["guess", "view", "touch", "touch"]
    assert [stage["acquisitions"] for stage in pose["stages"]] == [0, 1, 2, 3]
    adi = [stage["adi"] for stage in pose["stages"]]
    assert adi[0] > 8e-3
    assert adi[-1] < 4e-3
    assert set(results.summary["modalities"]) == {"density", "quaternion"}


def test_a_replay_believes_what_the_episode_believed(tmp_path: Path) -> None:
    """A recording holds each measurement once, however long it lasts."""
    changes = ["modalities=[density]", "touches.random_touches=1", "touches.chosen_touches=1"]
    application, scenario = load_scenario("touches", changes)
    sensors = tmp_path / SENSORS_FILE
    ran = run_episode(application, scenario, sensors_file=sensors)
    assert sensors.stat().st_size < 1e6
    again = replay(application, tmp_path, scenario)
    for before, after in zip(
        ran.estimators["density"].ticks, again.estimators["density"].ticks, strict=True
    ):
        was, is_ = (one.values["object_pose_latest"] for one in (before, after))
        assert (was.known, was.number) == (is_.known, is_.number)
        np.testing.assert_array_equal(was.X, is_.X)


def test_a_run_leaves_its_stages(seen: tuple[EpisodeRecord, Results], tmp_path: Path) -> None:
    record, results = seen
    application, _ = load_scenario("pose-estimation")
    write_run(tmp_path / "run", application, record, results)
    summary = json.loads((tmp_path / "run" / SUMMARY_FILE).read_text(encoding="utf-8"))
    assert len(summary["pose"]["stages"]) == 4
    assert (tmp_path / "run" / "figures" / "stages.png").is_file()
    assert any("95 % region" in line for line in results.report(summary))


def test_the_same_seed_gives_the_same_stages(seen: tuple[EpisodeRecord, Results]) -> None:
    _, again = episode("pose-estimation", "seed=1", "views.count=1", "touches.chosen_touches=2")
    assert again.summary["pose"] == seen[1].summary["pose"]


def test_poses_lie_inside_what_is_claimed_with_wrong_calibrations() -> None:
    inside = []
    for seed in range(12):
        changes = (f"seed={seed}", "modalities=[density]", "touches.chosen_touches=1")
        _, results = episode("pose-estimation", "target.object=cleaner", *changes)
        inside += [stage["inside_claim"] for stage in results.summary["pose"]["stages"][1:]]
    assert np.mean(inside) > 0.8


def test_touches_alone_need_no_camera() -> None:
    _, results = episode("touches", "seed=2", "touches.chosen_touches=1")
    assert results.failure is None
    stages = results.summary["pose"]["stages"]
    assert [stage["stage"] for stage in stages] == ["guess"] + 4 * ["touch"]
    assert stages[-1]["adi"] < 0.5 * stages[0]["adi"]


def test_a_few_false_contacts_are_outvoted() -> None:
    found = []
    for seed in range(6):
        changes = (f"seed={seed}", "contact.false_contacts=0.1")
        _, results = episode("touches", *changes)
        stages = results.summary["pose"]["stages"]
        found.append(stages[-1]["adi"] < 0.5 * stages[0]["adi"])
    assert np.mean(found) > 0.6


def test_a_mesh_of_ones_own_is_found(tmp_path: Path) -> None:
    trimesh.creation.box(extents=[60.0, 90.0, 200.0]).export(tmp_path / "parcel.stl")
    own = [f"target.mesh={tmp_path / 'parcel.stl'}", "target.scale=0.001"]
    _, results = episode(
        "pose-estimation", "seed=3", "views.count=1", "touches.chosen_touches=1", *own
    )
    assert results.summary["pose"]["target"] == "parcel"
    assert results.summary["pose"]["stages"][-1]["adi"] < 5e-3


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("target.object=sprai", "target.object = 'sprai', but it must be one of black_box"),
        ("touches.criterion=best", "touches.criterion = 'best', but it must be one of random"),
        ("modalities=[vision]", "unknown modality 'vision'; allowed: density, quaternion"),
        ("guess.translation=[0.05, 0.02]", "guess.translation must be least, then largest"),
        ("station=arm", "station = 'arm', but it must be one of rig, robots"),
        ("target.mesh=none.obj", "there is no such file"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(change: str, message: str) -> None:
    with pytest.raises(ScenarioError, match=message) as caught:
        load_scenario("pose-estimation", [change])
    assert str(caught.value).count("\n") == 0


def test_a_mesh_of_ones_own_is_kept_with_the_run(tmp_path: Path) -> None:
    mesh = tmp_path / "parcel.stl"
    trimesh.creation.box(extents=[60.0, 90.0, 200.0]).export(mesh)
    options = ["--object", str(mesh), "--scale", "0.001", "--no-recording", "--duration", "1"]
    result = CliRunner().invoke(
        app, ["run", "pose-estimation", *options, "--out", str(tmp_path / "run")]
    )
    assert result.exit_code in (0, 1), result.output
    assert (tmp_path / "run" / "model" / "parcel.stl").is_file()
    _, kept = load_scenario(str(tmp_path / "run" / "scenario.yaml"))
    assert kept.target.mesh == str(tmp_path / "run" / "model" / "parcel.stl")
    wrong = CliRunner().invoke(
        app, ["run", "pose-estimation", "--object", str(mesh), "--joint", "x"]
    )
    assert wrong.exit_code == 2


def test_a_mesh_in_another_unit_is_refused(tmp_path: Path) -> None:
    trimesh.creation.box(extents=[60.0, 90.0, 200.0]).export(tmp_path / "parcel.stl")
    with pytest.raises(ScenarioError, match=r"227 m large.*scale"):
        episode("pose-estimation", f"target.mesh={tmp_path / 'parcel.stl'}")


def test_a_seed_decides_the_same_whenever_it_is_put_in() -> None:
    """Evaluations read a scenario once and then put their seeds in."""
    application, first = load_scenario("touches", ["seed=0"])
    _, other = load_scenario("touches", ["seed=5"])
    assert contents(application, replace(first, seed=5)) == contents(application, other)


def test_the_guess_is_as_wrong_as_the_scenario_says() -> None:
    for seed in range(20):
        _, scenario = load_scenario("pose-estimation", [f"seed={seed}", "target.object=oil"])
        model = load_model(scenario)
        X = true_pose(scenario, model)
        guess = first_guess(scenario, X, model)
        moved = guess.X[:3, :3] @ model.middle + guess.X[:3, 3] - X[:3, 3]
        assert 0.02 <= np.linalg.norm(moved) <= 0.05
        turned = np.linalg.norm(se3.so3_log(np.ascontiguousarray(X[:3, :3].T @ guess.X[:3, :3])))
        assert np.deg2rad(10.0) - 1e-9 <= turned <= np.deg2rad(30.0) + 1e-9
        assert float(np.min(model.hull @ X[2, :3]) + X[2, 3]) == pytest.approx(0.0)


def test_the_distance_between_surfaces_is_zero_for_a_symmetry() -> None:
    _, scenario = load_scenario("pose-estimation", ["target.object=oil"])
    model = load_model(scenario)
    turned = np.eye(4)
    turned[:3, :3] = se3.so3_exp(np.array([0.0, 0.0, 1.0]))
    assert average_distance(np.eye(4), turned, model) < 2e-4
    moved = np.eye(4)
    moved[2, 3] = 0.01
    assert 1e-3 < average_distance(np.eye(4), moved, model) < 0.01


def test_without_the_true_pose_nothing_is_judged() -> None:
    """A recording of real robots has none."""
    application, scenario = load_scenario(
        "touches", ["touches.random_touches=1", "touches.chosen_touches=0"]
    )
    record = run_episode(application, scenario)
    for tick in record.station:
        del tick.values["cheat_object_pose"]
    results = application.evaluate(record)
    assert results.success is None
    assert not results.plots
    stages = results.summary["pose"]["stages"]
    assert [stage["stage"] for stage in stages] == ["guess", "touch"]
    assert all(stage["adi"] is None and stage["inside_claim"] is None for stage in stages)
    assert all(stage["translation_claimed"] > 0.0 for stage in stages)
    assert "claimed" in results.report(results.summary)[1]
