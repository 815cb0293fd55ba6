import subprocess
import sys
from importlib.metadata import version

from typer.testing import CliRunner

from crossmodal.diagrams.command_line import app

RUNNER = CliRunner()


def test_help_teaches_by_example_and_needs_no_heavy_import() -> None:
    code = (
        "import sys; from crossmodal.diagrams import command_line;"
        "heavy = {'pydrake', 'numpy', 'numba', 'scipy', 'torch', 'cv2', 'matplotlib', 'pandas',"
        " 'trimesh', 'yaml'} & set(sys.modules);"
        "assert not heavy, heavy"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
    names = ("list", "run", "replay", "evaluate", "ablate", "diagram", "train", "compare", "export")
    names += ("stream",)
    for command in (
        [],
        *([name] for name in names),
        ["train", "hand-bending"],
        ["train", "segmentation"],
        ["train", "grasp"],
    ):
        result = RUNNER.invoke(app, [*command, "--help"])
        assert result.exit_code == 0
        assert "crossmodal" in result.output


def test_list_names_the_scenarios_and_the_flows() -> None:
    result = RUNNER.invoke(app, ["list"])
    assert result.exit_code == 0
    assert "drawer" in result.output
    assert "grasp-in-the-dark" in result.output


def test_the_version_is_that_of_the_package() -> None:
    result = RUNNER.invoke(app, ["--version"])
    assert result.exit_code == 0
    assert result.output == f"crossmodal {version('crossmodal')}\n"
