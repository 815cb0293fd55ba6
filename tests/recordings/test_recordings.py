"""A change of perception shows: four short recordings are perceived as they were when kept."""

from pathlib import Path

import pytest
import yaml
from outputs import (
    COMMAND,
    FOLDER,
    OUTPUTS_FILE,
    RECORDINGS,
    SOURCES,
    differences,
    kept_outputs,
    perceive,
    write_outputs,
)
from typer.testing import CliRunner

from crossmodal.diagrams.command_line import app
from crossmodal.diagrams.run.folder.run_folder import SCENARIO_FILE, SENSORS_FILE

FILES = (SCENARIO_FILE, SENSORS_FILE, OUTPUTS_FILE)
JOINTS = {
    "cupboard-door": "revolute",
    "drawer": "prismatic",
    "failing-streams": "prismatic",
    "sliding-door": "prismatic",
}


@pytest.mark.parametrize("folder", RECORDINGS, ids=lambda folder: folder.name)
def test_a_recording_is_perceived_as_it_was(folder: Path) -> None:
    changed = differences(kept_outputs(folder), perceive(folder))
    assert not changed, "\n".join(
        [
            f"{folder.name} is perceived differently in {len(changed) - 1} values;"
            f" if that is intended, `{COMMAND}` writes them anew:",
            *changed[:40],
        ]
    )


def test_the_recordings_are_small_enough_to_be_kept() -> None:
    assert [folder.name for folder in RECORDINGS] == list(JOINTS)
    size = sum((folder / name).stat().st_size for folder in RECORDINGS for name in FILES)
    size += sum(source.stat().st_size for source in SOURCES)
    assert size < 3e6


@pytest.mark.parametrize(("name", "joint"), JOINTS.items())
def test_the_joint_is_found_in_every_recording(name: str, joint: str) -> None:
    kept = kept_outputs(FOLDER / name)
    last = kept[(kept.time == kept.time.max()) & (kept.modality == "crossmodal")]
    types = last[last.quantity == "type_probability"].set_index("component").estimate
    assert types.idxmax() == joint
    assert types.max() > 0.65
    assert kept[kept.quantity == "configuration"].estimate.abs().max() > 0.05


def test_a_recording_says_all_that_was_simulated_and_nothing_of_what_perceives() -> None:
    for folder in RECORDINGS:
        document = yaml.safe_load((folder / SCENARIO_FILE).read_text())
        assert "impedance" in document["control"]  # Which no source mentions.
        assert "perception" not in document
        assert list(document["calibration"]) == ["errors"]


def test_streams_fail_in_one_of_them() -> None:
    kept = kept_outputs(FOLDER / "failing-streams")
    told = {name.split(":")[0] for name in kept[kept.quantity == "event"].component}
    assert {"depth", "joint_state", "pressure", "wrench"} <= told


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("cupboard-door", "perception.cut=[joints_to_vision]"),
        ("drawer", "perception.cut=[held_body_to_grasp]"),
        ("drawer", "calibration.noise.angle=0.00012"),
        ("failing-streams", "disturbances.faults=[]"),
        ("sliding-door", "perception.hand.slip_translation=0.0021"),
    ],
)
def test_a_small_change_shows(name: str, change: str) -> None:
    assert differences(kept_outputs(FOLDER / name), perceive(FOLDER / name, [change]))


def test_they_are_recordings_for_the_command(tmp_path: Path) -> None:
    recording, out = str(FOLDER / "sliding-door"), tmp_path / "replay"
    result = CliRunner().invoke(app, ["replay", recording, "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert (out / "summary.json").exists()


def test_outputs_are_read_as_they_were_written(tmp_path: Path) -> None:
    kept = kept_outputs(FOLDER / "failing-streams")
    write_outputs(tmp_path, kept)
    assert not differences(kept, kept_outputs(tmp_path))


def test_a_difference_names_what_was_expected_and_what_came() -> None:
    expected = kept_outputs(FOLDER / "drawer")
    came = expected.copy()
    row = came.index[(came.quantity == "configuration") & came["std"].notna()][-1]
    came.loc[row, "estimate"] += 0.01 * came.loc[row, "std"]
    event = came.index[came.quantity == "event"][0]
    came.loc[event, "component"] = "dancing"
    heading, *lines = differences(expected, came)
    assert heading.split() == ["time", "[s]", "of", "what", "expected", "came"]
    assert len(lines) == 3
    assert f"{expected.estimate[row]:.6g} ± " in lines[-1]
    assert f"{came.estimate[row]:.6g} ± " in lines[-1]
    assert any("event dancing" in line and "nothing" in line for line in lines)
