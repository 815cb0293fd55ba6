"""Inputs of all kinds through the whole command line: one line and status 2, or a sensible run."""

import sys
import types
from pathlib import Path
from typing import Any

import pytest

from crossmodal.diagrams import command_line

CROSSMODAL = "system: crossmodal\n"
HUGE = "9" * 5000

# What a file says, and a part of the one line that answers; nothing where it can be run.
FILES: dict[str, tuple[str | bytes, str]] = {
    "empty": ("", "write `system: crossmodal`"),
    "only blanks": ("  \n\n", "write `system: crossmodal`"),
    "only a comment": ("# mine\n", "write `system: crossmodal`"),
    "only a marker": ("---\n", "write `system: crossmodal`"),
    "null": ("~", "write `system: crossmodal`"),
    "an empty mapping": ("{}", "write `system: crossmodal`"),
    "no system": ("seed: 3", "write `system: crossmodal`"),
    "an empty system": ("system: ''", "write `system: crossmodal`"),
    "a null system": ("system:", "system must be text"),
    "a system that is a list": ("system: [crossmodal]", "system must be text"),
    "a system that is a mapping": ("system: {crossmodal: 1}", "system must be text"),
    "a system that is a number": ("system: 1", "system must be text"),
    "an unknown system": ("system: crosmodal", "did you mean 'crossmodal'?"),
    "text": ("drawer", "must hold a mapping of keys to values, not a str"),
    "a number": ("3", "must hold a mapping of keys to values, not a int"),
    "a list": ("- a\n- b", "must hold a mapping of keys to values, not a list"),
    "a boolean": ("true", "must hold a mapping of keys to values, not a bool"),
    "two documents": ("seed: 1\n---\nseed: 2\n", "line 2, column 1: but found another document"),
    "a tab": ("system:\tcrossmodal\n\tseed: 1", "is not valid YAML: line "),
    "an open list": ("a: [1\n", "is not valid YAML: line 2"),
    "an open mapping": ("a: {b: 1\n", "is not valid YAML: line 2"),
    "an open quote": ("a: 'b\n", "is not valid YAML: line 2"),
    "a closing bracket": ("a: ]\n", "is not valid YAML: line 1"),
    "a wrong indent": ("a: 1\n b: 2\n", "is not valid YAML: line 2"),
    "a colon too much": ("a: b: c\n", "is not valid YAML: line 1"),
    "a percent sign": ("%YAML 9.9\n---\na: 1\n", "is not valid YAML: line 1"),
    "an at sign": ("a: @b\n", "is not valid YAML: line 1"),
    "a backquote": ("a: `b`\n", "is not valid YAML: line 1"),
    "a bad escape": ('a: "\\q"\n', "is not valid YAML: line 1"),
    "a control character": ("a: \x01\n", "is not valid YAML"),
    "a nul": (b"a: \0\n", "is not valid YAML"),
    "no UTF-8": (b"\xff\xfe\x00", "cannot be read"),
    "Latin-1": ("name: Tür".encode("latin-1"), "cannot be read"),
    "UTF-16": ("system: crossmodal".encode("utf-16"), "cannot be read"),
    "a picture": (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", "cannot be read"),
    "an alias of nothing": ("a: *x\n", "found undefined alias"),
    "a key twice": (CROSSMODAL + "seed: 3\nseed: 4\n", "line 3, column 1: the key 'seed' is there"
                    " already, in line 2"),
    "a key twice below": (CROSSMODAL + "task:\n  goal: 1\n  goal: 2\n", "line 4, column 3: the key"
                          " 'goal' is there already, in line 3"),
    "a key twice in braces": (CROSSMODAL + "task: {goal: 1, goal: 2}\n", "the key 'goal' is there"),
    "a key twice, once quoted": (CROSSMODAL + "seed: 3\n'seed': 4\n", "the key 'seed' is there"),
    "a system twice": (CROSSMODAL * 2, "line 2, column 1: the key 'system' is there already"),
    "a key that is true": (CROSSMODAL + "on: 2\n", "unknown key 'True'"),
    "a key that is a list": ("? [a, b]\n: 2\n", "found unhashable key"),
    "a number among the cameras": (CROSSMODAL + "cameras: {1: {}}", "but it must be keyed by text"),
    "an unknown key": (CROSSMODAL + "sede: 3\n", "unknown key 'sede'; did you mean 'seed'?"),
    "a key in capitals": (CROSSMODAL + "Seed: 3\n", "unknown key 'Seed'; did you mean 'seed'?"),
    "a key with a dot": (CROSSMODAL + "task.goal: 3\n", "unknown key 'task.goal'"),
    "a key with a line's end": (CROSSMODAL + '"a\\nb": 3\n', "unknown key 'a b'"),
    "a private key": (CROSSMODAL + "_seed: 3\n", "unknown key '_seed'"),
    "a set": (CROSSMODAL + "modalities: !!set {vision}\n", "{'vision'}, but it must be a list"),
    "a Python object": ("a: !!python/object/apply:os.system [ls]\n", "could not determine a cons"),
    "a timestamp": (CROSSMODAL + "duration: !!timestamp 2026-01-02\n", "but it must be a number"),
    "a number that is none": (CROSSMODAL + "seed: !!int abc\n", "invalid literal for int()"),
    "a fraction that is none": (CROSSMODAL + "duration: !!float x\n", "could not convert string"),
    "a very long number": (CROSSMODAL + f"seed: {HUGE}\n", "Exceeds the limit"),
    "a long number": (CROSSMODAL + "seed: 99999999999999999999\n", "need >= 0"),
    "a date for a number": (CROSSMODAL + "duration: 2026-01-02\n", "but it must be a number"),
    "a time for a number": (CROSSMODAL + "duration: 12:30 s\n", "but it must be a number"),
    "a unit behind a number": (CROSSMODAL + "duration: 40 s\n", ""),
    "a unit of something else": (CROSSMODAL + "duration: 40 mm\n", "duration = '40 mm', but it must"
                                 " be in s"),
    "a unit that is none": (CROSSMODAL + "duration: 40 s?\n", "duration = '40 s?', but it must be"),
    "a unit where there is none": (CROSSMODAL + "seed: 3 s\n", "a number without a unit"),
    "a unit with a huge power": (CROSSMODAL + "duration: 4 s^99999999\n", "but it must be in s"),
    "a number too large with its unit": (CROSSMODAL + "duration: 9 h\nstop_time: 9 h\n", "3600 s"),
    "a number beyond all units": (CROSSMODAL + "duration: 1e308 h\n", "but it must be in s"),
    "a way where the joint turns": ("system: crossmodal\nobjects: {door: {model: cupboard_door.sdf,"
                                    " joint: hinge}}\ntask: {goal: 20 cm}\n",
                                    "task.goal = '20 cm', but it must be in rad"),
    "a comma in a number": (CROSSMODAL + "duration: 1,5\n", "duration = '1,5', but it must be"),
    "a boolean for a number": (CROSSMODAL + "duration: yes\n", "duration = True, but it must be"),
    "null for a number": (CROSSMODAL + "duration:\n", "duration = None, but it must be a number"),
    "a list for a number": (CROSSMODAL + "duration: [1]\n", "duration = [1], but it must be"),
    "a fraction for a seed": (CROSSMODAL + "seed: 1.5\n", "seed = 1.5, but it must be a whole"),
    "text for a seed": (CROSSMODAL + "seed: 'three'\n", "seed = 'three', but it must be a whole"),
    "a number for a name": (CROSSMODAL + "name: 3\n", "name = 3, but it must be text"),
    "a list for a name": (CROSSMODAL + "name: [a]\n", "name = ['a'], but it must be text"),
    "text for a list": (CROSSMODAL + "modalities: vision\n", "modalities = 'vision', but it must"),
    "a mapping for a list": (CROSSMODAL + "modalities: {vision: 1}\n", "but it must be a list"),
    "a list for a mapping": (CROSSMODAL + "task: [1]\n", "task = [1], but it must be a mapping"),
    "text for a mapping": (CROSSMODAL + "objects: drawer\n", "but it must be a mapping"),
    "null for a mapping": (CROSSMODAL + "objects:\n", "objects = None, but it must be a mapping"),
    "null for an object": (CROSSMODAL + "objects: {drawer: }\n", "objects.drawer = None, but"),
    "text for a switch": (CROSSMODAL + "task: {return_to_start: 'yes'}\n", "true or false"),
    "a number for a switch": (CROSSMODAL + "task: {return_to_start: 1}\n", "true or false"),
    "text in an array": (CROSSMODAL + "control: {posture: [a, b]}\n", "control.posture.0 = 'a'"),
    "null in an array": (CROSSMODAL + "control: {posture: [1, ~]}\n", "control.posture.1 = None"),
    "true in an array": (CROSSMODAL + "control: {posture: [true]}\n", "control.posture.0 = True"),
    "a date in an array": (CROSSMODAL + "control: {posture: [2026-01-02]}\n", "but it must be a"),
    "a ragged array": (CROSSMODAL + "control: {posture: [[1, 2], [3]]}\n", "numbers in a list"),
    "a number for an array": (CROSSMODAL + "control: {posture: 1}\n", "numbers in a list"),
    "a mapping for an array": (CROSSMODAL + "control: {posture: {a: 1}}\n", "numbers in a list"),
    "too short an array": (CROSSMODAL + "control: {posture: [1]}\n", "need 7 numbers"),
    "a long value": (CROSSMODAL + f"duration: '{'a' * 10_000}'\n", "but it must be a number"),
    "only the system": (CROSSMODAL, ""),
    "Windows' line ends": ("system: crossmodal\r\nseed: 3\r\n", ""),
    "a byte order mark": ("\ufeffsystem: crossmodal\n", ""),
    "a quoted key": ("'system': crossmodal\n", ""),
    "JSON": ('{"system": "crossmodal", "control": {"posture": [0, 0, 0, 1, 0, 0, 0]}}', ""),
    "a power of ten": (CROSSMODAL + "duration: 1e1\n", ""),
    "a date for a name": (CROSSMODAL + "name: 2026-01-02\n", "but it must be text"),
    "a name from everywhere": (CROSSMODAL + "name: Schublade-引き出し\n", ""),
    "an anchor that nothing uses": (CROSSMODAL + "seed: &mine 3\n", ""),
    "an empty part": (CROSSMODAL + "task: {}\n", ""),
}  # fmt: skip

# One assignment of --set to the drawer.
ASSIGNMENTS: dict[str, str] = {
    "": "expected key.path=value",
    "seed": "expected key.path=value",
    "=": "expected key.path=value",
    "=3": "expected key.path=value",
    ".=3": "expected key.path=value",
    "seed.=3": "expected key.path=value",
    ".seed=3": "expected key.path=value",
    "task..goal=3": "expected key.path=value",
    "seed=": "seed = None, but it must be a whole number",
    "seed=x": "seed = 'x', but it must be a whole number",
    "seed=1.5": "seed = 1.5, but it must be a whole number",
    "seed=-1": "seed = -1, need >= 0",
    "seed=[1": "--set seed=[1: is not valid YAML: line ",
    "seed=*a": "found undefined alias",
    "seed={a: 1, a: 2}": "the key 'a' is there already",
    "seed=99999999999999999999": "need >= 0",
    f"seed={HUGE}": "Exceeds the limit",
    "seed=!!timestamp 2026-01-02": "but it must be a whole number",
    "seed=1=2": "seed = '1=2', but it must be a whole number",
    "seed.a=1": "seed = {'a': 1}, but it must be a whole number",
    "description.a=1": "'a' is inside a plain value",
    "system=": "system must be text",
    "system=door": "system = 'door': allowed: clutter, crossmodal",
    "sede=3": "did you mean 'seed'?",
    "Seed=3": "did you mean 'seed'?",
    "seed seed=3": "unknown key 'seed seed'",
    "task/goal=3": "unknown key 'task/goal'",
    "task[goal]=3": "unknown key 'task[goal]'",
    "--seed=3": "unknown key '--seed'",
    "\n=3": "expected key.path=value",
    "a\nb=3": "unknown key 'a b'",
    "duration=40 mm": "duration = '40 mm', but it must be in s",
    "duration=": "duration = None, but it must be a number",
    "duration=true": "duration = True, but it must be a number",
    "duration=2026-01-02": "but it must be a number",
    "duration=0": "duration = 0.0 s, need > 0",
    "duration=-3": "duration = -3.0 s, need > 0",
    "duration=.nan": "duration = nan s, need > 0",
    "name=3": "name = 3, but it must be text",
    "modalities=vision": "modalities = 'vision', but it must be a list",
    "modalities=[]": "must name each once, at least one",
    "modalities=[vision, vision]": "must name each once, at least one",
    "modalities=[smell]": "unknown modality 'smell'",
    "modalities=[1]": "modalities.0 = 1, but it must be text",
    "disturbances.lights_off.0.start=1": "must be a list",
    "disturbances.lights_off=[{start: 3, end: 1}]": "it must be start < end",
    "disturbances.lights_off=[3]": "must be a mapping",
    "disturbances.lights_out=[]": "key 'disturbances.lights_out'; did you mean 'lights_off'?",
    "objects=": "objects = None, but it must be a mapping",
    "objects={}": "task.object = ''",
    "objects.drawer=": "objects.drawer = None, but it must be a mapping",
    "objects.drawer.friction=a": "objects.drawer.friction = 'a', but it must be a number",
    "objects.drawer.friction=-1": "friction = -1.0 N or N m, need >= 0",
    "objects.drawer.model=": "objects.drawer.model = None, but it must be text",
    "objects.drawer.model=none.sdf": "there is no such file",
    "objects.drawer.position=1": "objects.drawer.position = 1, but it must be numbers in a list",
    "objects.drawer.position=[1]": "need 3 numbers",
    "objects.drawer.position=[1, 2, .inf]": "need 3 numbers",
    "objects.drawer.position=[1, 2, x]": "position.2 = 'x', but it must be a number",
    "objects.drawer.position.x=1": "objects.drawer.position = {'x': 1}, but it must be numbers",
    "cameras={}": "one camera",
    "cameras.0.width=1": "cameras.0.width = 1 px, need >= 16, <= 4096 px",
    "control.posture=[0, 0]": "need 7 numbers",
    "perception.cut=[nothing]": "nothing",
    "plant.scene=../../../etc/passwd": "there is no such file",
    "seed= 3": "",
    " seed =3": "",
    "duration=1e1": "",
    "objects.drawer.position=[.9, 0, 1e-1]": "",
    "versions.a.b=1": "versions.a = {'b': 1}, but it must be text",
}  # fmt: skip

# Arguments of the command, and a part of the answer.
ARGUMENTS: list[tuple[list[str], str]] = [
    (["fly"], "No such command 'fly'"),
    (["--fly"], "No such option: --fly"),
    (["run"], "Missing argument"),
    (["run", ""], "unknown scenario ''"),
    (["run", "drawr"], "did you mean 'drawer'?"),
    (["run", "Drawer"], "did you mean 'drawer'?"),
    (["run", "a" * 5000], "unknown scenario"),
    (["run", "a" * 5000 + ".yaml"], "cannot be read"),
    (["run", "drawer\n"], "unknown scenario 'drawer '"),
    (["run", "none.yaml"], "there is no such file"),
    (["run", "."], "unknown scenario '.'"),
    (["run", "folder.yaml"], "folder.yaml: cannot be read"),
    (["run", "circle.yaml"], "circle.yaml: cannot be read"),
    (["run", "/dev/zero"], "unknown scenario '/dev/zero'"),
    (["run", "file.txt/x.yaml"], "file.txt/x.yaml: "),
    (["run", "drawer", "--seed"], "Option '--seed' requires an argument"),
    (["run", "drawer", "--seed", ""], "value for '--seed'"),
    (["run", "drawer", "--seed", "x"], "value for '--seed'"),
    (["run", "drawer", "--seed", "1.5"], "value for '--seed'"),
    (["run", "drawer", "--seed", "-1"], "value for '--seed'"),
    (["run", "drawer", "--seed", HUGE], "value for '--seed'"),
    (["run", "drawer", "--seed", "9" * 25], "need >= 0"),
    (["run", "drawer", "--duration", "x"], "value for '--duration'"),
    (["run", "drawer", "--duration", "nan"], "duration = nan s"),
    (["run", "drawer", "--duration", "-1"], "duration = -1.0 s"),
    (["run", "drawer", "--modalities", ""], "modalities"),
    (["run", "drawer", "--modalities", ","], "modalities"),
    (["run", "drawer", "--modalities", "vision,vision"], "must name each once"),
    (["run", "drawer", "--modalities", "{a}"], "modalities"),
    (["run", "drawer", "--modalities", "[["], "modalities"),
    (["run", "drawer", "--out", "file.txt"], "file.txt: cannot be written"),
    (["run", "drawer", "--out", "file.txt/a"], "file.txt/a: cannot be written"),
    (["run", "drawer", "--out", "folder.yaml"], "already holds files"),
    (["run", "drawer", "drawer"], "unexpected extra argument"),
    (["run", "drawer", "--set"], "Option '--set' requires an argument"),
    (["evaluate"], "Missing argument"),
    (["evaluate", ""], "unknown experiment ''"),
    (["evaluate", "drawr"], "did you mean 'drawer'?"),
    (["evaluate", "drawer", "--seeds", ""], "expected a count"),
    (["evaluate", "drawer", "--seeds", "0"], "names no seed"),
    (["evaluate", "drawer", "--seeds", "-1"], "a seed is negative"),
    (["evaluate", "drawer", "--seeds", "5:3"], "names no seed"),
    (["evaluate", "drawer", "--seeds", "1.5"], "expected a count"),
    (["evaluate", "drawer", "--seeds", "1-3"], "expected a count"),
    (["evaluate", "drawer", "--seeds", HUGE], "expected a count"),
    (["evaluate", "drawer", "--jobs", "0"], "value for '--jobs'"),
    (["evaluate", "drawer", "--jobs", "x"], "value for '--jobs'"),
    (["evaluate", "drawer", "--backend", "Ray"], "did you mean 'ray'?"),
    (["evaluate", "drawer", "--address", "here"], "--address is for --backend ray only"),
    (["evaluate", "drawer", "--out", "file.txt"], "file.txt: cannot be written"),
    (["evaluate", "drawer", "--out", "a" * 5000], "cannot be written"),
    (["evaluate", "drawer", "--out", "folder.yaml"], "already holds files"),
    (["evaluate", "drawer", "--set", "duration=x"], "but it must be a number"),
    (["evaluate", "all", "--set", "sede=3"], "did you mean 'seed'?"),
    (["ablate", "nothing"], "nothing"),
    (["ablate", "--out", "file.txt"], "file.txt"),
    (["diagram", "drawr"], "did you mean 'drawer'?"),
    (["diagram", "drawer", "--modality", "smell"], "unknown modality 'smell'"),
    (["diagram", "drawer", "--set", "duration=x"], "but it must be a number"),
    (["diagram", "drawer", "--out", "file.txt"], "file.txt: exists already"),
    (["replay", "none"], "none: holds no scenario.yaml"),
    (["replay", "file.txt"], "file.txt: holds no scenario.yaml"),
    (["compare"], "Missing argument"),
    (["compare", "none"], "Name two folders or more"),
    (["compare", "a" * 5000, "file.txt"], "holds neither"),
    (["compare", "none", "file.txt"], "none: holds neither"),
    (["compare", "folder.yaml", "folder.yaml"], "folder.yaml: holds neither"),
    (["compare", "a", "b", "--out", "file.txt"], "file.txt: exists already"),
    (["list", "drawer"], "unexpected extra argument"),
]  # fmt: skip


@pytest.fixture(autouse=True)
def nothing_is_written(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("crossmodal.diagrams.commands.run.write_and_report", lambda *_: 0)


@pytest.fixture
def things(monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder with a file, a folder and a link that leads to itself; nothing simulates."""
    Path("file.txt").write_text("mine")
    Path("folder.yaml").mkdir()
    Path("folder.yaml/mine").touch()
    Path("circle.yaml").symlink_to("circle.yaml")

    def never(*_: Any, **__: Any) -> Any:
        raise AssertionError("nothing is simulated")

    monkeypatch.setattr("crossmodal.diagrams.evaluation.campaign.run", never)
    monkeypatch.setattr("crossmodal.diagrams.crossmodal.studies.ablation_study.run_episode", never)


def answer(
    arguments: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> tuple[int, str]:
    """Exit status and what the command said to standard error."""
    monkeypatch.setattr(sys, "argv", ["crossmodal", *arguments])
    status = command_line.main()
    return status, capsys.readouterr().err


def check(status: int, said: str, expected: str) -> None:
    if not expected:
        assert status == 0, said
        return
    assert status == 2, said
    assert said.startswith("crossmodal: ")
    assert said.count("\n") == 1
    assert expected in said


@pytest.mark.parametrize("about", FILES)
def test_a_scenario_s_file_is_run_or_refused_in_one_line(
    about: str,
    fake_episode: types.SimpleNamespace,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    text, expected = FILES[about]
    Path("mine.yaml").write_bytes(text if isinstance(text, bytes) else text.encode())
    status, said = answer(["run", "mine.yaml", "--no-recording"], monkeypatch, capsys)
    check(status, said, expected)
    assert len(fake_episode.runs) == (0 if expected else 1)
    assert [path.name for path in Path().iterdir()] == ["mine.yaml"]


@pytest.mark.usefixtures("fake_episode")
@pytest.mark.parametrize("assignment", ASSIGNMENTS)
def test_an_assignment_is_taken_or_refused_in_one_line(
    assignment: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["run", "drawer", "--no-recording", "--set", assignment]
    check(*answer(arguments, monkeypatch, capsys), ASSIGNMENTS[assignment])


@pytest.mark.usefixtures("fake_episode", "things")
@pytest.mark.parametrize(("arguments", "expected"), ARGUMENTS)
def test_arguments_that_cannot_be_meant_are_refused_in_one_line(
    arguments: list[str],
    expected: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    check(*answer(arguments, monkeypatch, capsys), expected)
