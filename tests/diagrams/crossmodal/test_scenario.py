from pathlib import Path

import numpy as np
import pytest
from pydrake.common.yaml import yaml_dump_typed

from diagrams.crossmodal.scenario import (
    MODALITIES,
    Interval,
    load_scenario,
    object_model_file,
    scenario_files,
)
from diagrams.run.yaml_schema import ScenarioError, apply_override, building


def refusal(name: str, *overrides: str) -> str:
    with pytest.raises(ScenarioError) as caught:
        load_scenario(name, overrides)
    message = str(caught.value)
    assert "\n" not in message
    return message


def written(folder: Path, text: str) -> str:
    path = folder / "mine.yaml"
    path.write_text(text)
    return str(path)


@pytest.mark.parametrize("name", scenario_files())
def test_every_scenario_that_comes_along_loads(name: str) -> None:
    scenario = load_scenario(name)
    assert scenario.name == name
    assert scenario.description
    assert object_model_file(scenario).is_file()


def test_a_resolved_scenario_loads_as_the_same(tmp_path: Path) -> None:
    text = yaml_dump_typed(load_scenario("drawer", ["seed=7", "task.opening=0.1"]))
    again = load_scenario(written(tmp_path, text))
    assert yaml_dump_typed(again) == text
    assert again.seed == 7


def test_absent_keys_keep_their_defaults_and_overrides_win(tmp_path: Path) -> None:
    path = written(tmp_path, "duration: 3\ndisturbances:\n  lights_off:\n  - start: 1.0\n")
    scenario = load_scenario(path, ["disturbances.lights_off.0.start=2", "task={opening: 0.05}"])
    assert scenario.name == "mine"
    assert scenario.modalities == list(MODALITIES)
    assert scenario.duration == 3.0
    assert scenario.disturbances.lights_off[0].start == 2.0
    assert scenario.task.opening == 0.05


def test_the_network_period_reaches_every_filter_and_window() -> None:
    scenario = load_scenario("drawer", ["network_period=0.05"])
    assert scenario.perception.features.period == 0.05
    assert scenario.sensors.encoders.tick == 0.05
    assert "network_period" in refusal("drawer", "perception.features.period=0.2")


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("duraton=3", "unknown key 'duraton'; did you mean 'duration'?"),
        ("sensors.encoders.nois=3", "unknown key 'sensors.encoders.nois'; did you mean 'noise"),
        ("disturbances.lights_off=[{begin: 3}]", "unknown key 'disturbances.lights_off.0.begin'"),
        ("duration=fast", "duration = 'fast', but it must be a number"),
        ("duration=0", "duration = 0.0 s, but it must be > 0 s"),
        ("duration=.nan", "duration = nan s"),
        ("network_period=0", "network_period = 0.0 s"),
        ("plant.time_step=-0.001", "plant.time_step = -0.001 s"),
        ("seed=-1", "seed = -1"),
        ("seed=1.5", "seed = 1.5, but it must be a whole number"),
        ("modalities=[vision, touch]", "unknown modality 'touch'"),
        ("modalities=[]", "at least one"),
        ("modalities=[vision, vision]", "each once"),
        ("modalities=vision", "must be a list"),
        ("camera.width=0", "camera.width = 0 pixels"),
        ("camera.horizontal_angle=180", "between 0 and 180 deg"),
        ("camera.lamp=-0.1", "camera.lamp = -0.1"),
        ("camera.position=[0, 1]", "camera.position = [0.0, 1.0], but it must be 3 numbers"),
        ("camera.position=high", "camera.position = 'high', but it must be numbers in a list"),
        ("object.variation.yaw=-3", "object.variation.yaw = -3.0"),
        ("object.variation.textures=[glitter]", "unknown texture 'glitter'"),
        ("object.friction=-1", "object.friction = -1.0"),
        ("object.position=[1, 2]", "object.position = [1.0, 2.0], but it must be 3 numbers"),
        ("object.pull_direction=[0, 0, 0]", "object.pull_direction must not be all zero"),
        ("control.posture=[1, 2]", "control.posture = [1.0, 2.0], but it must be 7 numbers"),
        ("object.pull_direction=[1]", "object.pull_direction = [1.0], but it must be 3 numbers"),
        ("object.model=no_such.sdf", "object.model = 'no_such.sdf': there is no such file"),
        ("object.joint=slid", "has no joint 'slid'; did you mean 'slide'?"),
        ("object.handle_frame=handel", "has no frame 'handel'; did you mean 'handle'?"),
        ("plant.scene=no_scene.yaml", "plant.scene = 'no_scene.yaml': there is no such file"),
        ("disturbances.lights_off=[{start: 3, end: 2}]", "must be 0 <= start < end"),
        ("disturbances=dark", "disturbances = 'dark', but it must be a mapping"),
        ("duration", "expected key.path=value"),
        ("duration.x=3", "inside a plain value"),
        ("disturbances.lights_off.5.start=1", "not one of the 1 elements"),
    ],
)
def test_bad_values_are_refused_in_one_line(override: str, expected: str) -> None:
    assert expected in refusal("drawer-lights-off", override)


def test_bad_files_are_refused_in_one_line(tmp_path: Path) -> None:
    assert "there is no such file" in refusal(str(tmp_path / "none.yaml"))
    assert "did you mean 'drawer'?" in refusal("drawr")
    assert "line 3" in refusal(written(tmp_path, "duration: 3\nname: [a\n"))
    assert "mapping" in refusal(written(tmp_path, "- a\n- b\n"))
    assert "cannot be read" in refusal(str(_binary(tmp_path)))
    broken = tmp_path / "broken.sdf"
    broken.write_text("<sdf version='1.9'><model name='m'></sdf>")
    path = written(tmp_path, f"object: {{model: {broken}}}\n")
    assert "is not valid XML" in refusal(path)


def _binary(folder: Path) -> Path:
    path = folder / "binary.yaml"
    path.write_bytes(b"\xff\xfe\x00")
    return path


@pytest.mark.filterwarnings("ignore::diagrams.crossmodal.own_object.ObjectWarning")
def test_a_fixed_joint_cannot_be_explored(tmp_path: Path) -> None:
    (tmp_path / "stiff.sdf").write_text(
        "<sdf version='1.9'><model name='m'><link name='a'/><link name='b'/>"
        "<joint name='j' type='fixed'><parent>a</parent><child>b</child></joint></model></sdf>"
    )
    path = written(tmp_path, "object: {model: stiff.sdf, joint: j, handle_frame: b}\n")
    assert "no prismatic or revolute joint moves 'b'" in refusal(path)


def test_what_building_refuses_becomes_a_scenario_error() -> None:
    with pytest.raises(ScenarioError, match="drawer: Encoders: noise = -1 rad, need >= 0"):  # noqa: SIM117
        with building("drawer"):
            raise ValueError("Encoders: noise = -1\n rad, need >= 0")


def test_overrides_reach_into_lists_and_make_missing_mappings() -> None:
    document: dict = {"a": [{"b": 1}]}
    apply_override(document, "a.0.b=2")
    apply_override(document, "c.d.e=[1, 2]")
    assert document == {"a": [{"b": 2}], "c": {"d": {"e": [1, 2]}}}


def test_an_interval_holds_its_start_and_not_its_end() -> None:
    interval = Interval(start=1.0, end=2.0)
    assert 1.0 in interval
    assert 2.0 not in interval
    assert 1e9 in Interval(start=1.0)
    assert np.isinf(Interval().end)
