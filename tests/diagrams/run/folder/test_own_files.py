"""A run replaces and removes what runs have written, and nothing else."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from crossmodal.diagrams.run.folder.own_files import MANIFEST, OwnFiles, held
from crossmodal.diagrams.run.folder.run_folder import FILES, write_text
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError


def run(folder: Path, *names: str, force: bool = False) -> None:
    """What a run does that writes these files."""
    with held(folder, FILES, force=force) as own:
        own.remove_all_but(names)
        for name in names:
            write_text(own.place(name), "of a run")


def files(folder: Path) -> dict[str, str]:
    return {
        path.relative_to(folder).as_posix(): path.read_text()
        for path in folder.rglob("*")
        if path.is_file() and path.name != MANIFEST
    }


def test_force_in_a_folder_without_a_run_is_refused_and_leaves_all_as_it_was(
    tmp_path: Path,
) -> None:
    write_text(tmp_path / "model" / "mine.sdf", "mine")
    write_text(tmp_path / "summary.json", "mine")
    with pytest.raises(ScenarioError, match="no run that --force could replace") as caught:
        run(tmp_path, "scenario.yaml", force=True)
    assert "\n" not in str(caught.value)
    assert files(tmp_path) == {"model/mine.sdf": "mine", "summary.json": "mine"}
    assert not (tmp_path / MANIFEST).exists()


def test_a_later_run_leaves_no_file_of_an_earlier_one_and_every_other(tmp_path: Path) -> None:
    run(tmp_path, "scenario.yaml", "model/object.sdf", "figures/a.png")
    write_text(tmp_path / "figures" / "mine.png", "mine")
    with pytest.raises(ScenarioError, match=r"already holds files.*--force"):
        run(tmp_path, "scenario.yaml")
    run(tmp_path, "scenario.yaml", "figures/b.png", force=True)
    assert set(files(tmp_path)) == {"scenario.yaml", "figures/b.png", "figures/mine.png"}
    assert not (tmp_path / "model").exists()


def test_a_file_that_no_run_has_written_is_not_replaced(tmp_path: Path) -> None:
    run(tmp_path, "scenario.yaml")
    write_text(tmp_path / "meshcat.html", "mine")
    with pytest.raises(ScenarioError, match=r"meshcat\.html: is no file of the earlier run"):
        run(tmp_path, "scenario.yaml", force=True)
    (tmp_path / "meshcat.html").rename(tmp_path / "a.png")
    with pytest.raises(ScenarioError, match=r"a\.png: is no file of an earlier run"):
        run(tmp_path, "scenario.yaml", "a.png", force=True)
    assert (tmp_path / "a.png").read_text() == "mine"


def test_what_has_been_removed_is_the_runs_no_more(tmp_path: Path) -> None:
    run(tmp_path, "scenario.yaml", "figures/a.png")
    run(tmp_path, "scenario.yaml", force=True)
    mine = write_text(tmp_path / "figures" / "a.png", "mine")
    run(tmp_path, "scenario.yaml", force=True)
    assert mine.read_text() == "mine"


@pytest.mark.parametrize("name", ["../mine", "/etc/hostname", "link/mine", ".", ""])
def test_nothing_outside_the_folder_is_removed_whatever_the_list_says(
    tmp_path: Path, name: str
) -> None:
    mine, folder = write_text(tmp_path / "mine", "mine"), tmp_path / "run"
    run(folder, "scenario.yaml")
    (folder / "link").symlink_to(tmp_path)
    with (folder / MANIFEST).open("a") as manifest:
        manifest.write(f'"{name}"\nno JSON\n17\n')
    OwnFiles(folder).remove_all_but(())
    assert mine.read_text() == "mine"
    assert not (folder / "scenario.yaml").exists()


def test_a_second_run_into_the_same_folder_waits_for_the_end_of_the_first(tmp_path: Path) -> None:
    with (
        held(tmp_path / "run", FILES),
        pytest.raises(ScenarioError, match="another run is writing there"),
        held(tmp_path / "run", FILES, force=True),
    ):
        pass
    run(tmp_path / "run", "scenario.yaml")


def test_a_killed_run_holds_its_folder_no_more_and_its_partial_files_go(tmp_path: Path) -> None:
    code = (
        "import os; from pathlib import Path; from diagrams.run.folder.own_files import held;"
        "from crossmodal.diagrams.run.folder.run_folder import FILES, write_atomically;"
        f"own = held(Path({str(tmp_path / 'run')!r}), FILES).__enter__();"
        "write_atomically(own.place('sensors.mcap'),"
        " lambda path: (path.write_text('half'), os.kill(os.getpid(), 9)))"
    )
    subprocess.run([sys.executable, "-c", code], check=False)
    names = [path.name for path in (tmp_path / "run").iterdir()]
    assert any(name.endswith("-sensors.mcap") for name in names)
    run(tmp_path / "run", "scenario.yaml")
    assert set(files(tmp_path / "run")) == {"scenario.yaml"}


def test_a_folder_that_nothing_is_written_into_is_removed_again(tmp_path: Path) -> None:
    with held(tmp_path / "a" / "b", FILES):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_shared_folder_keeps_what_is_there_and_no_file_of_another_is_replaced(
    tmp_path: Path,
) -> None:
    write_text(tmp_path / "notes.txt", "mine")
    for _ in range(2):
        with held(tmp_path, ["table.md"], shared=True) as own:
            write_text(own.place("table.md"), "of a run")
    write_text(tmp_path / "page.html", "mine")
    with (
        pytest.raises(ScenarioError, match=r"page\.html: is no file of the earlier run"),
        held(tmp_path, ["table.md", "page.html"], shared=True),
    ):
        pass
    mine = {"notes.txt": "mine", "page.html": "mine"}
    assert files(tmp_path) == mine | {"table.md": "of a run"}


@pytest.mark.parametrize("place", ["file", "file/below", "/proc/nowhere/run", "a" * 300])
def test_a_folder_that_cannot_be_written_is_refused_in_one_line(tmp_path: Path, place: str) -> None:
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(ScenarioError, match="cannot be written") as caught,
        held(tmp_path / place, FILES),
    ):
        pass
    assert "\n" not in str(caught.value)


def test_a_lock_that_was_removed_by_its_owner_is_no_lock(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first run ends, and removes its file, just as the second one has opened it."""
    import fcntl

    real, first = fcntl.flock, [True]

    def flock(file: object, how: int) -> None:
        real(file, how)
        if first.pop() if first else False:
            os.unlink(tmp_path / MANIFEST)

    monkeypatch.setattr(fcntl, "flock", flock)
    run(tmp_path, "scenario.yaml")
    assert OwnFiles(tmp_path).names == ["scenario.yaml"]
