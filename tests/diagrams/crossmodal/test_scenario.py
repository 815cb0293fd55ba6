"""What a scenario of the cross-modal application may say."""

from pathlib import Path

import pytest
from pydrake.common.yaml import yaml_dump_typed

from crossmodal.diagrams.applications import load_scenario, scenarios_of
from crossmodal.diagrams.crossmodal.application import APPLICATION
from crossmodal.diagrams.crossmodal.modalities import MODALITIES
from crossmodal.diagrams.crossmodal.scenario import Scenario, object_model_file
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError


def loaded(name: str, *overrides: str) -> Scenario:
    return load_scenario(name, overrides)[1]


def refusal(name: str, *overrides: str) -> str:
    with pytest.raises(ScenarioError) as caught:
        load_scenario(name, overrides)
    message = str(caught.value)
    assert "\n" not in message
    return message


def written(folder: Path, text: str) -> str:
    path = folder / "mine.yaml"
    path.write_text(f"system: crossmodal\n{text}")
    return str(path)


@pytest.mark.parametrize("name", scenarios_of(APPLICATION))
def test_every_scenario_that_comes_along_loads(name: str) -> None:
    scenario = loaded(name)
    assert scenario.name == name
    assert scenario.description
    for thing in scenario.objects.values():
        assert object_model_file(thing).is_file()


def test_a_resolved_scenario_loads_as_the_same(tmp_path: Path) -> None:
    text = yaml_dump_typed(loaded("drawer", "seed=7", "task.opening=0.1"))
    path = tmp_path / "again.yaml"
    path.write_text(text)
    again = loaded(str(path))
    assert yaml_dump_typed(again) == text
    assert again.seed == 7


def test_absent_keys_keep_their_defaults_and_overrides_win(tmp_path: Path) -> None:
    path = written(tmp_path, "duration: 3\ndisturbances:\n  lights_off:\n  - start: 1.0\n")
    scenario = loaded(path, "disturbances.lights_off.0.start=2", "task={opening: 0.05}")
    assert scenario.name == "mine"
    assert scenario.modalities == list(MODALITIES)
    assert scenario.duration == 3.0
    assert scenario.disturbances.lights_off[0].start == 2.0
    assert scenario.task.opening == 0.05


def test_no_filter_and_no_sensor_can_be_given_a_period_of_its_own() -> None:
    for key in ("perception.features.period", "sensors.encoders.tick"):
        assert f"unknown key '{key}'" in refusal("drawer", f"{key}=0.2")


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("duraton=3", "unknown key 'duraton'; did you mean 'duration'?"),
        ("sensors.encoders.nois=3", "unknown key 'sensors.encoders.nois'; did you mean 'noise"),
        ("disturbances.hand_leaks=[{start: 3, end: 1}]", "hand_leaks.0 = 3 to 1 s, but it must be"),
        ("disturbances.forces=[{force: [1, 2]}]", "forces.0.force = [1.0, 2.0] N, need 3 numbers"),
        ("disturbances.lights_off=[{begin: 3}]", "unknown key 'disturbances.lights_off.0.begin'"),
        ("cameras.camera.width=0", "cameras.camera.width = 0 px, need"),
        ("plant.time_step=-0.001", "plant.time_step = -0.001 s"),
        ("modalities=[vision, touch]", "unknown modality 'touch'"),
        ("modalities=[]", "at least one"),
        ("modalities=[vision, vision]", "each once"),
        ("objects.drawer.variation.yaw=-3", "objects.drawer.variation.yaw = -3.0"),
        ("objects.drawer.variation.textures=[glitter]", "unknown texture 'glitter'"),
        ("objects.drawer.friction=-1", "objects.drawer.friction = -1.0"),
        (
            "objects.drawer.position=[1, 2]",
            "objects.drawer.position = [1.0, 2.0] m, need 3 numbers",
        ),
        (
            "objects.drawer.pull_direction=[0, 0, 0]",
            "objects.drawer.pull_direction must not be all zero",
        ),
        ("control.posture=[1, 2]", "control.posture = [1.0, 2.0] rad, need 7 numbers"),
        (
            "objects.drawer.pull_direction=[1]",
            "objects.drawer.pull_direction = [1.0], need 3 numbers",
        ),
        (
            "objects.drawer.model=no_such.sdf",
            "objects.drawer.model = 'no_such.sdf': there is no such file",
        ),
        ("objects.drawer.joint=slid", "has no joint 'slid'; did you mean 'slide'?"),
        ("objects.drawer.handle_frame=handel", "has no frame 'handel'; did you mean 'handle'?"),
        (
            "control.exploration.speed=.nan",
            "drawer-lights-off.yaml: control.exploration.speed = nan m/s, need > 0, <= 10 m/s",
        ),
        ("plant.time_step=1e-9", "plant.time_step = 1e-09 s, need >= 0.0001, <= 0.1 s"),
        ("network_period=1000", "network_period = 1000.0 s, need >= 0.001, <= 1 s"),
        ("cameras.camera.position=[0, 0, 1e+30]", "cameras.camera.position = [0.0, 0.0, 1e+30] m"),
        ("objects.drawer.friction=1.0e+300", "objects.drawer.friction = 1e+300 N or N m, need"),
        ("control.excitation={waves: 0}", "control.excitation.waves = 0, need >= 1, <= 1000"),
        ("plant.scene=no_scene.yaml", "plant.scene = 'no_scene.yaml': there is no such file"),
    ],
)
def test_bad_values_are_refused_in_one_line(override: str, expected: str) -> None:
    assert expected in refusal("drawer-lights-off", override)


def test_models_that_cannot_be_read_are_refused_in_one_line(tmp_path: Path) -> None:
    broken = tmp_path / "broken.sdf"
    broken.write_text("<sdf version='1.9'><model name='m'></sdf>")
    path = written(tmp_path, f"objects: {{thing: {{model: {broken}}}}}\n")
    assert "is not valid XML" in refusal(path)


@pytest.mark.filterwarnings("ignore::diagrams.crossmodal.objects.object_import.ObjectWarning")
def test_a_fixed_joint_cannot_be_explored(tmp_path: Path) -> None:
    (tmp_path / "stiff.sdf").write_text(
        "<sdf version='1.9'><model name='m'><link name='a'/><link name='b'/>"
        "<joint name='j' type='fixed'><parent>a</parent><child>b</child></joint></model></sdf>"
    )
    path = written(tmp_path, "objects: {thing: {model: stiff.sdf, joint: j, handle_frame: b}}\n")
    assert "no prismatic or revolute joint with travel moves 'b'" in refusal(path)


TWO_OBJECTS = """
objects:
  box: {model: cardboard_box.sdf, joint: hinge, free: true, position: [1.0, 0.6, 0.7]}
  drawer: {model: chest_drawer.sdf}
"""


def test_of_several_objects_the_task_says_which_one_is_manipulated(tmp_path: Path) -> None:
    path = written(tmp_path, TWO_OBJECTS)
    message = refusal(path)
    assert "task.object must say which of the objects is manipulated: box, drawer" in message
    scenario = loaded(path, "task.object=drawer")
    assert list(scenario.objects) == ["box", "drawer"]
    assert scenario.object is scenario.objects["drawer"]
    assert "did you mean 'drawer'?" in refusal(path, "task.object=drawr")
    assert "task.object = ''" in refusal(path, "objects={}")
    wrong = refusal(path, "task.object=drawer", "objects.box.joint=slide")
    assert "objects.box" in wrong
    assert "has no joint 'slide'" in wrong


def test_the_only_object_needs_no_mention() -> None:
    scenario = loaded("drawer")
    assert scenario.object is scenario.objects["drawer"]
    assert loaded("drawer", "task.object=drawer").object.joint == "slide"


@pytest.mark.parametrize(
    "override",
    ["cameras={}", "cameras.second={}", "cameras.camera.base_frame=arm::tool_plate"],
)
def test_the_estimators_see_through_one_camera_that_stands(override: str) -> None:
    message = refusal("box-lid", override)
    assert "cameras: the estimators see through one camera that is fixed to the world" in message


def test_the_camera_may_have_any_name() -> None:
    scenario = loaded("drawer", "cameras={head: {position: [-0.1, 0.4, 1.4]}}")
    assert list(scenario.cameras) == ["head"]


def test_a_camera_that_is_moved_a_little_keeps_the_rest_of_its_defaults() -> None:
    usual = loaded("drawer").cameras["camera"]
    moved = loaded("drawer", "cameras.camera.lamp=0.5").cameras["camera"]
    assert moved.lamp == 0.5
    assert moved.position.tolist() == usual.position.tolist()
    assert moved.looking_at.tolist() == usual.looking_at.tolist()


def test_a_hand_without_a_driver_is_refused() -> None:
    assert "model_drivers" in refusal("drawer", "model_drivers={left_hand: {}}")


def test_the_robot_acts_by_all_senses_unless_it_is_told_otherwise() -> None:
    assert loaded("drawer").acting_modality == "crossmodal"
    assert loaded("drawer", "modalities=[vision]").acting_modality == "vision"
    assert loaded("drawer", "task.modality=proprioception").acting_modality == "proprioception"
