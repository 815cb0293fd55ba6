"""What the pages show is so: Python runs, commands are possible, links and names exist."""

import re
import shlex
from collections.abc import Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from pkgutil import resolve_name
from runpy import run_path
from textwrap import dedent
from typing import Any

import pytest
from typer.main import get_command

from crossmodal.diagrams.applications import experiments, find_scenario, load_scenario
from crossmodal.diagrams.command_line import app
from crossmodal.diagrams.crossmodal.studies.ablations import ABLATIONS
from crossmodal.diagrams.evaluation.seeds import parse_seeds
from crossmodal.diagrams.run.build import build_station
from crossmodal.diagrams.run.wiring import output_ports
from crossmodal.systems.port_values import JointType

ROOT = Path(__file__).parents[1]
HISTORY = ("CHANGELOG.md", "seeds.md")  # They may name what is gone.
PAGES = [*sorted(ROOT.glob("*.md")), *sorted(ROOT.glob("docs/**/*.md"))]
SOURCES = ("py", "yaml", "toml", "sdf", "urdf", "md")
ROOMS = (
    "benchmarks|controllers|crossmodal|diagrams|docs|maths|models|notebooks|plants|systems|tests"
)
PLACEHOLDER = re.compile(r"\b[A-Z]{2,}\b|\.\.\.|…")  # As in `crossmodal run NAME`.

every_page = pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))


def blocks(page: Path, language: str) -> list[str]:
    """The fenced blocks of a language; without one, of commands and of what they print."""
    fence = re.compile(rf"^( *)```{language}\n(.*?)^\1```", re.DOTALL | re.MULTILINE)
    return [dedent(text) for _, text in fence.findall(page.read_text())]


def quoted(page: Path) -> list[str]:
    """What stands between backticks in the text."""
    text = re.sub(r"^ *```.*?^ *```", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    return [" ".join(words.split()) for words in re.findall(r"`([^`]+)`", text)]


def commands(page: Path, name: str) -> Iterator[list[str]]:
    """The words after `name` in blocks and in the text, where no placeholder stands among them.

    In the text a command's name alone, as `crossmodal evaluate`, speaks of it and calls nothing.
    """
    lines = "\n".join(blocks(page, "")).replace("\\\n", " ").splitlines()
    lines += [text for text in quoted(page) if len(text.split()) > 2 or name != "crossmodal"]
    for line in lines:
        if line.startswith(f"{name} ") and not PLACEHOLDER.search(line.split(" #")[0]):
            yield shlex.split(line, comments=True)[len(name.split()) :]


@pytest.mark.parametrize("name", ["README.md", "docs/own-poses.md"])
def test_poses_of_a_door_are_found_to_be_a_hinge(name: str) -> None:
    names: dict[str, Any] = {}
    for code in blocks(ROOT / name, "python"):
        exec(code, names)
    found = names["found"]
    assert found.type == JointType.REVOLUTE
    assert abs(found.limits[1] - 1.78) < 0.02
    if "belief" in names:
        assert names["belief"].type == JointType.REVOLUTE
        assert abs(names["belief"].model.configuration[0] - 1.78) < 0.01
        assert names["belief"].skipped == {}


def test_an_application_of_ones_own_is_the_pendulum_of_the_tests() -> None:
    page, pendulum = ROOT / "docs/own-application.md", ROOT / "tests/diagrams/pendulum"
    assert blocks(page, "python")[0] == (pendulum / "pendulum.py").read_text()
    assert blocks(page, "yaml") == [(pendulum / "swing.yaml").read_text()]


def test_a_filter_of_ones_own_is_the_notebooks_file_and_fits_into_the_network() -> None:
    code, in_python = blocks(ROOT / "docs/own-filter.md", "python")
    assert code == (ROOT / "notebooks/my_filters.py").read_text()
    names: dict[str, Any] = {}
    exec(f"{code}\n{in_python}", names)
    assert isinstance(names["network"].GetSubsystemByName("hand_bending"), names["SpringBending"])


def test_the_filters_that_the_page_lists_are_those_that_there_are() -> None:
    listed = set(quoted(ROOT / "docs/own-filter.md"))
    for name in ("crossmodal", "flap", "clutter"):
        source = (ROOT / f"diagrams/{name}/estimators.py").read_text()
        there = re.findall(r'filters\.(?:add|make)\(\s*(?:builder, )?"(\w+)"', source)
        assert there
        assert set(there) <= listed


@every_page
def test_commands_are_possible(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CROSSMODAL_APPLICATIONS", str(ROOT / "tests/diagrams/pendulum/pendulum.py"))
    if page.name == "own-filter.md":  # It tells to save its files.
        (tmp_path / "my_filters.py").write_text(blocks(page, "python")[0])
        (tmp_path / "mine.yaml").write_text(blocks(page, "yaml")[0])
        monkeypatch.chdir(tmp_path)
    for words in commands(page, "crossmodal"):
        if words[0] == "--version" or words[-1] == "--help":
            continue
        _check_command(words)


def _check_command(words: list[str]) -> None:
    """Parses a command as the program does, and looks up the scenario or experiment in it."""
    taken: dict[str, Any] = {}
    program = get_command(app)
    _instead_of_running(program, taken)
    program.main(list(words), standalone_mode=False)
    overrides = list(taken.get("overrides") or [])
    if words[0] in ("run", "diagram", "inspect"):
        model = taken.get("own_object") or taken.get("model")
        if model is not None and not str(model).startswith("my"):
            assert (ROOT / model).is_file(), words
        if model is None:
            _check_scenario(taken["scenario"], overrides)
        else:
            find_scenario(taken["scenario"])
    elif words[0] == "replay":
        _check_scenario("drawer", overrides)
    elif words[0] == "evaluate":
        assert taken["experiment"] in ("all", *experiments()), words
        parse_seeds(taken["seeds"])
    elif words[0] == "ablate":
        assert set(taken.get("names") or []) <= set(ABLATIONS), words


def _check_scenario(name: str, overrides: list[str]) -> None:
    """Loads it, and looks up the streams that fail."""
    application, scenario = load_scenario(name, overrides)
    failing = {fault.stream for fault in scenario.disturbances.faults}
    if failing:
        ports = output_ports(build_station(application, scenario).diagram)
        assert failing <= {port.get_name() for port in ports}, (name, overrides)


def _instead_of_running(command: Any, taken: dict[str, Any]) -> None:
    for inner in getattr(command, "commands", {}).values():
        _instead_of_running(inner, taken)
    if not hasattr(command, "commands"):
        command.callback = lambda **options: taken.update(options)


@every_page
def test_make_has_the_targets(page: Path) -> None:
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    for target, *_ in commands(page, "make"):
        assert target in targets


@every_page
def test_modules_that_are_run_exist(page: Path) -> None:
    for module, *_ in commands(page, "python -m"):
        assert find_spec(module) is not None, module


@pytest.mark.parametrize("script", sorted(ROOT.glob("docs/make_*.py")), ids=lambda path: path.stem)
def test_scripts_of_the_pages_find_what_they_import(script: Path) -> None:
    run_path(str(script), run_name=script.stem)


@cache
def headings(page: Path) -> set[str]:
    """The anchors of a page, as GitHub makes them."""
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    titles = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


@every_page
def test_links_lead_somewhere(page: Path) -> None:
    for path, anchor in re.findall(r"\]\(([^)\s#]*)(?:#([^)\s]*))?\)", page.read_text()):
        if path.startswith("http"):
            continue
        target = (page.parent / path) if path else page
        assert target.exists(), path
        assert not anchor or anchor in headings(target.resolve()), f"{path}#{anchor}"


@cache
def words_of_the_source() -> set[str]:
    files = [
        file
        for room in ROOMS.split("|")
        for suffix in SOURCES
        if room not in ("crossmodal", "docs")
        for file in (ROOT / room).rglob(f"*.{suffix}")
    ]
    files += [ROOT / "pyproject.toml", ROOT / "Makefile", ROOT / "crossmodal" / "__init__.py"]
    return {word for file in files for word in re.findall(r"\w+", file.read_text())} | {
        part for file in files for part in re.findall(r"[^\W_]+|\w+", file.name)
    }


@every_page
def test_modules_files_and_names_exist(page: Path) -> None:
    if page.name in HISTORY:
        return
    for text in quoted(page):
        if PLACEHOLDER.search(text) and not re.fullmatch(r"[A-Z_]+", text):
            continue
        if re.fullmatch(rf"({ROOMS})/[\w./-]*", text):
            assert (ROOT / text).exists(), text
        elif re.fullmatch(r"crossmodal(\.\w+)+", text):
            assert resolve_name(text) is not None
        elif re.fullmatch(r"[A-Za-z_]\w*(\.\w+)*", text):
            unknown = [word for word in text.split(".") if word not in words_of_the_source()]
            assert not unknown, text
