"""The notebooks are stored without outputs and run from top to bottom on short episodes."""

from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient
from typer.testing import CliRunner

from crossmodal.diagrams.applications import OWN, load_scenario
from crossmodal.diagrams.command_line import app
from crossmodal.diagrams.evaluation.run_writer import write_run
from crossmodal.diagrams.run.episode import run_episode
from tests.diagrams.clutter.declutter_record import CLEARED, made

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
PICTURES = {  # How many each draws, at least.
    "01_one_episode": 7,
    "02_how_the_network_thinks": 8,
    "03_joint_filters_and_the_truth": 3,
    "04_your_own_tracker": 3,
    "05_the_flap": 11,
    "06_views_touches_and_pose": 3,
    "07_declutter_step_by_step": 7,
    "08_a_filter_of_your_own": 2,
    "09_a_hundred_seeds": 2,
}
every_notebook = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def code_cells(path: Path) -> list[nbformat.NotebookNode]:
    return [cell for cell in nbformat.read(path, 4).cells if cell.cell_type == "code"]


def test_there_are_notebooks() -> None:
    assert [path.stem for path in NOTEBOOKS] == list(PICTURES)


@every_notebook
def test_it_is_stored_without_outputs(path: Path) -> None:
    for cell in code_cells(path):
        assert cell.outputs == []
        assert cell.execution_count is None


@every_notebook
def test_its_cells_are_short_and_define_no_class(path: Path) -> None:
    for cell in code_cells(path):
        assert len(cell.source.splitlines()) <= 20
        assert "class " not in cell.source


@every_notebook
def test_what_it_links_to_is_there(path: Path) -> None:
    text = "".join(cell.source for cell in nbformat.read(path, 4).cells)
    for part in text.split("](")[1:]:
        assert (path.parent / part.partition(")")[0]).exists(), part


@pytest.fixture(scope="session")
def evaluated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of an evaluation of the pendulum over some seeds."""
    folder = tmp_path_factory.mktemp("evaluation") / "swing"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(OWN, str(ROOT / "tests/diagrams/pendulum/pendulum.py"))
        options = ("--seeds", "3", "--jobs", "2", "--set", "duration=2", "--out", str(folder))
        result = CliRunner().invoke(app, ["evaluate", "swing", *options])
    assert result.exit_code == 0, result.output
    return folder


@pytest.fixture(scope="session")
def flipped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run whose finger turns the flap quickly, until the camera has lost it."""
    changes = [
        "duration=6",
        "modalities=[geometric]",
        "finger.clearance=0.01",
        "finger.rotation=2",
        "control.sequence.feed_speed=0.02",
        "cameras.camera.width=320",
        "cameras.camera.height=240",
    ]
    folder = tmp_path_factory.mktemp("flipped")
    application, scenario = load_scenario("flap", changes)
    record = run_episode(application, scenario)
    write_run(folder, application, record, application.evaluate(record))
    return folder


@pytest.fixture(scope="session")
def cleared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run that clears the way, of a record that is made up."""
    folder = tmp_path_factory.mktemp("cleared")
    application, _ = load_scenario("declutter")
    record = made(CLEARED)
    write_run(folder, application, record, application.evaluate(record))
    return folder


@every_notebook
def test_it_runs_and_draws(
    path: Path, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = path.read_text()
    for variable, fixture in (
        ("CROSSMODAL_RUN", "recorded_run"),
        ("CROSSMODAL_FLAP", "flipped"),
        ("CROSSMODAL_DECLUTTER", "cleared"),
        ("CROSSMODAL_EVALUATION", "evaluated"),
    ):
        if variable in text:
            monkeypatch.setenv(variable, str(request.getfixturevalue(fixture)))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    notebook = nbformat.read(path, 4)
    client = NotebookClient(notebook, timeout=300, resources={"metadata": {"path": path.parent}})
    client.execute()
    images = [
        output
        for cell in notebook.cells
        for output in cell.get("outputs", [])
        if "image/png" in output.get("data", {})
    ]
    assert len(images) >= PICTURES[path.stem]
