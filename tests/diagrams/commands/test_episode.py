"""The process of one episode of a campaign."""

import subprocess
from pathlib import Path
from types import SimpleNamespace

import pytest

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.commands.episode import run_here
from crossmodal.diagrams.run import process
from crossmodal.diagrams.run.folder.run_folder import write_scenario
from crossmodal.diagrams.run.folder.written_files import write_text


def test_it_ends_with_the_one_that_started_it(tmp_path: Path) -> None:
    write_scenario(tmp_path, *load_scenario("drawer"))
    command = [*process._COMMAND, str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE) as child:
        pass  # Closes its input.
    assert child.returncode == 1
    assert not (tmp_path / "summary.json").exists()


def test_what_it_raises_is_kept_with_its_reason_first(tmp_path: Path) -> None:
    write_text(tmp_path / "scenario.yaml", "system: crossmodal\nduratoin: 3\n")
    assert run_here(tmp_path) == 1
    lines = (tmp_path / "error.txt").read_text().splitlines()
    assert "duratoin" in lines[0]
    assert lines[2].startswith("Traceback")


def test_its_log_says_what_that_of_a_run_does(
    tmp_path: Path, fake_episode: SimpleNamespace, capfd: pytest.CaptureFixture[str]
) -> None:
    fake_episode.warning = "the light is dim"
    write_scenario(tmp_path, *load_scenario("drawer"))
    assert run_here(tmp_path) == 0
    lines = capfd.readouterr().err.splitlines()
    assert lines[0].endswith(f"python -m crossmodal.diagrams.commands.episode {tmp_path}")
    assert [line for line in lines if "dim" in line] == [
        line for line in lines if line.endswith(" s  warning: the light is dim")
    ]
    for text in ("s  Building the simulation of drawer, seed 0", "Versions: ", "ended; "):
        assert sum(text in line for line in lines) == 1
    assert lines[lines.index("Events, in simulated time:") + 1].endswith("closing")
