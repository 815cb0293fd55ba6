"""What every scenario has, whatever its application."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from crossmodal.diagrams.run.build import building
from crossmodal.diagrams.run.scenario import (
    CameraBump,
    CameraConfig,
    Disturbances,
    Interval,
    LightsOff,
    Scenario,
    parse_scenario,
    read_document,
)
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
from crossmodal.maths import se3

PATH = Path("mine.yaml")


def test_a_scenario_without_a_name_is_called_like_its_file() -> None:
    assert parse_scenario(Scenario, {}, PATH).name == "mine"
    assert parse_scenario(Scenario, {"name": "yours"}, PATH).name == "yours"


def test_overrides_replace_what_the_file_says(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("duration: 3\ncameras:\n  head: {lamp: 0.5}\n")
    document = read_document(path, ["duration=4", "cameras.head.width=64", "cameras.wrist={}"])
    scenario = parse_scenario(Scenario, document, path)
    assert scenario.duration == 4.0
    assert (scenario.cameras["head"].lamp, scenario.cameras["head"].width) == (0.5, 64)
    assert set(scenario.cameras) == {"head", "wrist"}


def test_a_scenario_has_only_what_differs_from_its_base(tmp_path: Path) -> None:
    (tmp_path / "first.yaml").write_text(
        "name: other\nduration: 3\nmodalities: [a, b]\ncameras:\n  head: {lamp: 0.5, width: 64}\n"
    )
    (tmp_path / "second.yaml").write_text("base: first\nmodalities: [c]\n")
    path = tmp_path / "folder" / "third.yaml"
    path.parent.mkdir()
    path.write_text("base: ../second.yaml\ncameras:\n  head: {lamp: 1}\n  wrist: {}\n")
    scenario = parse_scenario(Scenario, read_document(path, ["cameras.head.height=48"]), path)
    head = scenario.cameras["head"]
    assert (scenario.name, scenario.duration, scenario.modalities) == ("third", 3.0, ["c"])
    assert (head.lamp, head.width, head.height) == (1.0, 64, 48)
    assert set(scenario.cameras) == {"head", "wrist"}


def test_a_base_is_beside_the_scenario_before_it_is_one_that_is_known(tmp_path: Path) -> None:
    (tmp_path / "first.yaml").write_text("duration: 3\n")
    (tmp_path / "elsewhere").write_text("duration: 4\n")
    path, elsewhere = tmp_path / "mine.yaml", tmp_path / "elsewhere"
    known = {"first": elsewhere, "other": elsewhere}
    for base, duration in (("first", 3), ("other", 4)):
        path.write_text(f"base: {base}\n")
        assert read_document(path, known=known) == {"duration": duration}


@pytest.mark.parametrize(
    ("base", "expected"),
    [
        ("frist", r"mine\.yaml: base = 'frist' is no file; .*first"),
        ("[first]", r"mine\.yaml: base must be text"),
        ("mine", r"mine\.yaml: base = 'mine' is based on this scenario itself"),
        ("around", r"around\.yaml: base = 'mine' is based on this scenario itself"),
    ],
)
def test_a_base_that_cannot_be_had_is_refused(base: str, expected: str, tmp_path: Path) -> None:
    (tmp_path / "first.yaml").write_text("duration: 3\n")
    (tmp_path / "around.yaml").write_text("base: mine\n")
    path = tmp_path / "mine.yaml"
    path.write_text(f"base: {base}\n")
    with pytest.raises(ScenarioError, match=expected):
        read_document(path)


@pytest.mark.parametrize(
    ("document", "expected"),
    [
        ({"duration": 0}, "duration = 0.0 s, need > 0, <= 86400 s"),
        ({"duration": float("nan")}, "duration = nan s"),
        ({"duration": "fast"}, "duration = 'fast', but it must be a number"),
        ({"network_period": -1}, "network_period = -1.0 s"),
        ({"stop_time": -1}, "stop_time = -1.0 s, need >= 0"),
        ({"seed": -1}, "seed = -1"),
        ({"seed": 1.5}, "seed = 1.5, but it must be a whole number"),
        ({"modalities": "vision"}, "must be a list"),
        ({"cameras": {"head": {"width": 0}}}, "cameras.head.width = 0 px, need >= 16"),
        ({"cameras": {"head": {"horizontal_angle": 180}}}, "= 180.0 deg, need"),
        ({"cameras": {"head": {"lamp": -0.1}}}, "cameras.head.lamp = -0.1"),
        ({"cameras": {"head": {"position": [0, 1]}}}, "head.position = [0.0, 1.0] m, need 3"),
        ({"cameras": {"head": {"position": "high"}}}, "must be numbers in a list"),
        ({"cameras": {"head": {"looking_at": [0, 0, 0]}}}, "looking_at must differ from"),
        ({"cameras": {"head": {"looking_at": [0, 0, 2]}}}, "cameras.head.up must not be zero or"),
        ({"cameras": {"head": {"up": [0, 0, 0]}}}, "cameras.head.up must not be zero or"),
        ({"calibration": {"errors": {"latency": -1}}}, "calibration.errors.latency = -1.0 s,"),
        ({"calibration": {"believed": {"focal_length": 0.5}}}, "calibration.believed.focal_length"),
        ({"disturbances": {"lights_off": [{"start": 3, "end": 2}]}}, "it must be start < end"),
        ({"disturbances": {"lights_off": [{"start": -1}]}}, "lights_off.0.start = -1.0 s, need"),
        (
            {"disturbances": {"lights_off": [{"start": 1, "remaining": 1.5}]}},
            "disturbances.lights_off.0.remaining = 1.5, need >= 0, <= 1",
        ),
        ({"disturbances": {"camera_covered": [{"begin": 3}]}}, "camera_covered.0.begin"),
        ({"disturbances": {"camera_bumps": [{"camera": "hed"}]}}, "camera_bumps.0.camera = 'hed'"),
        ({"disturbances": "dark"}, "disturbances = 'dark', but it must be a mapping"),
    ],
)
def test_values_that_no_episode_can_have_are_refused(document: dict, expected: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        parse_scenario(Scenario, document, PATH)
    assert str(caught.value).startswith("mine.yaml: ")
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_scenario_is_perfectly_calibrated_and_the_robot_does_not_know_it() -> None:
    calibration = parse_scenario(Scenario, {}, PATH).calibration
    assert set(vars(calibration.errors).values()) == {0.0}
    assert min(vars(calibration.believed).values()) > 0.0
    changed = parse_scenario(Scenario, {"calibration": {"believed": {"latency": 0.1}}}, PATH)
    assert changed.calibration.believed.latency == 0.1
    assert changed.calibration.believed.registration == calibration.believed.registration


def test_a_camera_looks_where_it_is_told_with_its_top_up() -> None:
    position, target = np.array([0.1, 0.4, 1.4]), np.array([0.8, -0.3, 0.9])
    up = np.array([0.2, 0.1, -1.0])
    camera = CameraConfig(position=position, looking_at=target, up=up).camera()
    assert_array_equal(camera.X_PC.GetAsMatrix4(), se3.looking_at(position, target, up))


def test_the_field_of_view_ends_at_the_edges_of_the_image() -> None:
    camera = CameraConfig(width=640, height=480, horizontal_angle=90.0).camera()
    assert_allclose(camera.intrinsics.focal_x, 320.0)
    assert camera.intrinsics.focal_y == camera.intrinsics.focal_x
    assert (camera.intrinsics.center_x, camera.intrinsics.center_y) == (319.0, 239.0)


def test_an_interval_holds_its_start_and_not_its_end() -> None:
    interval = Interval(start=1.0, end=2.0)
    assert 1.0 in interval
    assert 2.0 not in interval
    assert 1e9 in Interval(start=1.0)
    assert np.isinf(Interval().end)


def test_disturbances_are_told_in_words() -> None:
    disturbances = Disturbances(
        lights_off=[LightsOff(start=3.0), LightsOff(start=0.5, remaining=0.25)],
        camera_covered=[Interval(start=1.0, end=2.0)],
    )
    names = [(name, span.start) for name, span in disturbances.spans()]
    dark = [("lights off", 3.0), ("camera covered", 1.0)]
    assert names == [*dark, ("25 % of the light", 0.5)]
    assert [(name, span.start) for name, span in disturbances.dark()] == dark


def test_what_building_refuses_becomes_a_scenario_error() -> None:
    told = r"drawer: test_scenario\.py:\d+: Encoders: noise = -1 rad, need >= 0"
    with pytest.raises(ScenarioError, match=told), building("drawer"):
        raise ValueError("Encoders: noise = -1\n rad, need >= 0")


def test_a_second_bump_turns_the_camera_from_where_the_first_has_put_it() -> None:
    turn = CameraBump(start=1.0, rotation=np.array([0.0, 90.0, 0.0]))
    shift = CameraBump(start=2.0, translation=np.array([0.0, 0.0, 0.1]))
    other = CameraBump(start=0.5, camera="other", translation=np.array([9.0, 0.0, 0.0]))
    disturbances = Disturbances(camera_bumps=[shift, other, turn])
    X = disturbances.camera_displacement(3.0, "own")
    np.testing.assert_allclose(X.translation(), [0.1, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(X.rotation().matrix()[:, 2], [1.0, 0.0, 0.0], atol=1e-12)
    assert disturbances.camera_displacement(0.9, "own").IsExactlyIdentity()
