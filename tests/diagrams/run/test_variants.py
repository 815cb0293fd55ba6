"""Estimators with filters of one's own run under names of their own, by what a scenario says."""

import re
import shutil
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from typer.testing import CliRunner

from crossmodal.diagrams.applications import OWN, load_recorded, load_scenario
from crossmodal.diagrams.command_line import app
from crossmodal.diagrams.run.folder.fingerprint import fingerprint
from crossmodal.diagrams.run.folder.run_folder import SCENARIO_FILE, read_summary, write_scenario
from crossmodal.diagrams.run.replay import replay
from crossmodal.diagrams.run.variants import Variant
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError

ROOT = Path(__file__).parents[3]
RECORDING = ROOT / "tests/recordings/drawer"
PENDULUM = ROOT / "tests/diagrams/pendulum"
OF_OURS = "from crossmodal.systems.proprioception.hand_bending import HandBending as Bending\n"


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, with a file of filters."""
    (tmp_path / "mine.py").write_text(OF_OURS)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def changes(reference: str = "mine.py:Bending", of: str = "crossmodal") -> list[str]:
    return [
        f"variants.mine.of={of}",
        f"variants.mine.replacements.hand_bending={reference}",
    ]


def test_the_same_filter_in_place_of_ours_believes_the_same_beside_it(here: Path) -> None:
    application, scenario = load_recorded(
        RECORDING, ["modalities=[proprioception]", *changes(of="proprioception")]
    )
    record = replay(application, RECORDING, scenario)
    table = application.evaluate(record).estimates.drop(columns=["covariance"])
    ours, mine = (
        table[table.modality == name].drop(columns=["modality"]).reset_index(drop=True)
        for name in ("proprioception", "mine")
    )
    assert {"hand_bending", "type_probability", "body_position"} <= set(mine.quantity)
    pd.testing.assert_frame_equal(mine, ours, check_exact=True)


def test_variants_run_beside_the_estimators_or_alone(here: Path) -> None:
    assert load_scenario("drawer", changes())[1].modalities[-2:] == ["crossmodal", "mine"]
    alone = load_scenario("drawer", ["modalities=[mine]", *changes()])[1]
    assert alone.modalities == ["mine"]
    assert alone.acting_modality == "mine"
    flap = load_scenario("flap", changes(of="geometric"))[1]
    assert flap.modalities[0] != "mine"
    assert flap.modalities[-1] == "mine"


@pytest.mark.parametrize(
    ("assignments", "message"),
    [
        (changes(of="crosmodal"), "variants.mine.of = 'crosmodal'.*did you mean 'crossmodal'"),
        (changes("mine.py:Bendin"), "has no class or function 'Bendin'; did you mean 'Bending'"),
        (changes("other.py:Bending"), "hand_bending = 'other.py:Bending': there is no other.py in"),
        (changes("mine.py"), "must be FILE.py:NAME or module:NAME"),
        (changes("no.such.module:Bending"), "cannot be had: ModuleNotFoundError"),
        (["variants.vision.of=crossmodal"], "is the name of an estimator that there is"),
        (["variants={a b: {of: crossmodal}}"], "'a b' must be letters, digits, _ and -"),
        (["modalities=[mien]", *changes()], "unknown modality 'mien'; did you mean 'mine'"),
    ],
)
def test_a_variant_that_cannot_be_is_refused_with_its_key(
    here: Path, assignments: list[str], message: str
) -> None:
    with pytest.raises(ScenarioError, match=message):
        load_scenario("drawer", assignments)[1].replacements("mine")


def test_a_runs_folder_keeps_the_filters_file_and_runs_again_by_it(here: Path) -> None:
    application, scenario = load_scenario("drawer", changes())
    (here / "run").mkdir()
    write_scenario(here / "run", application, scenario)
    (here / "mine.py").unlink()
    (kept,) = (here / "run" / "filters").rglob("*.py")
    assert kept.read_text() == OF_OURS
    again = load_scenario(str(here / "run" / SCENARIO_FILE))[1]
    assert again.replacements("mine")["hand_bending"].__name__ == "HandBending"
    assert "mine" in again.modalities
    without = load_scenario(str(here / "run" / SCENARIO_FILE), ["modalities=[crossmodal]"])[1]
    assert (without.modalities, dict(without.variants)) == (["crossmodal"], {})


def test_an_edited_filter_makes_other_episodes(here: Path) -> None:
    application, scenario = load_scenario("drawer", changes())
    before = fingerprint(application, scenario)
    assert fingerprint(application, scenario) == before
    (here / "mine.py").write_text(f"{OF_OURS}# Other words.\n")
    assert fingerprint(application, scenario)["scenario_hash"] != before["scenario_hash"]


@pytest.fixture
def pendulum(here: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A pendulum's application whose filters can be replaced, and another filter for it."""
    page = (ROOT / "docs/own-application.md").read_text()
    (makes,) = [text for text in re.findall(r"```python\n(.*?)```", page, re.DOTALL)
                if "def make_estimators" in text]  # fmt: skip
    text = (PENDULUM / "pendulum.py").read_text()
    text = text.replace("\nAPPLICATION = ", f"\n{makes}\n\nAPPLICATION = ")
    start, end = text.index("make_estimators=lambda"), text.index("    quantities=")
    (here / "own.py").write_text(f"{text[:start]}make_estimators=make_estimators,\n{text[end:]}")
    shutil.copy(PENDULUM / "swing.yaml", here)
    (here / "lazy.py").write_text(
        "import sys\nfrom pathlib import Path\n\n"
        f"sys.path.append({str(PENDULUM)!r})\nfrom pendulum import KalmanFilter\n\n\n"
        "class Lazy(KalmanFilter):\n"
        "    def _update(self, context, posterior):\n        return posterior\n"
    )
    monkeypatch.setenv(OWN, str(here / "own.py"))
    return here


def crossmodal(*words: object) -> Any:
    return CliRunner().invoke(app, [str(word) for word in words])


LAZY = (
    "--set", "variants.mine.of=open",
    "--set", "variants.mine.replacements.kalman_filter=lazy.py:Lazy",
)  # fmt: skip


def test_run_replay_and_evaluate_have_a_variant_by_what_is_set(pendulum: Path) -> None:
    options = ("--duration", 1, "--no-recording", "--record-sensors")
    result = crossmodal("run", "swing", *options, *LAZY, "--out", "run")
    assert result.exit_code == 0, result.output
    assert list(read_summary(pendulum / "run")["modalities"]) == ["stubborn", "open", "mine"]
    again = crossmodal("replay", "run", "--out", "again")
    assert again.exit_code == 0, again.output
    estimates = [
        pd.read_parquet(pendulum / name / "estimates.parquet") for name in ("run", "again")
    ]
    pd.testing.assert_frame_equal(*estimates, check_exact=True)
    mine = estimates[0].query("modality == 'mine'")
    assert mine.estimate.nunique() == 1
    options = ("--seeds", 2, "--set", "duration=1", "--out", "evaluated")
    result = crossmodal("evaluate", "swing", *options, *LAZY)
    assert result.exit_code == 0, result.output
    figures = pd.read_csv(pendulum / "evaluated/results.csv")
    assert set(figures.modality.dropna()) == {"stubborn", "open", "mine"}


def test_an_application_without_such_filters_says_so(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(OWN, str(PENDULUM / "pendulum.py"))
    result = crossmodal("run", "swing", "--set", "variants.mine.of=open", "--out", "run")
    assert result.exit_code == 2
    assert "'pendulum' has no filters that can be replaced" in result.stderr


def test_a_scenario_in_python_takes_a_variant(here: Path) -> None:
    variant = Variant(of="crossmodal", replacements={"hand_bending": f"{here}/mine.py:Bending"})
    assert variant.makers("variants.mine")["hand_bending"].__name__ == "HandBending"
