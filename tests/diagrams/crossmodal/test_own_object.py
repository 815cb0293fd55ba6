"""An object of the user's own in place of a scenario's: from options to a run's folder."""

import os
import subprocess
import sys
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from synthetic_episode import empty_episode

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.crossmodal.application import APPLICATION
from crossmodal.diagrams.crossmodal.objects.object_import import (
    ObjectWarning,
    PlaceWarning,
    check_pull,
)
from crossmodal.diagrams.crossmodal.objects.object_model import read_object_model
from crossmodal.diagrams.crossmodal.own_object import keep_files, own_object_assignments
from crossmodal.diagrams.crossmodal.scenario import Scenario, object_model_file
from crossmodal.diagrams.crossmodal.station.start_warnings import overlaps, settling
from crossmodal.diagrams.crossmodal.station.station import (
    ManipulationStation,
    draw_placements,
    make_manipulation_station,
)
from crossmodal.diagrams.evaluation.run_writer import write_run
from crossmodal.diagrams.run.build import StationWarning, build_station
from crossmodal.diagrams.run.folder.fingerprint import fingerprint
from crossmodal.diagrams.run.folder.run_folder import write_scenario
from crossmodal.diagrams.run.own_object import OwnObject
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
from crossmodal.models import MODELS_DIR

pytestmark = pytest.mark.filterwarnings(
    "ignore::diagrams.crossmodal.objects.object_import.ObjectWarning"
)
EXAMPLE = MODELS_DIR / "examples" / "two_drawers.urdf"
DOOR = """<robot name='door'><link name='case'/><link name='leaf'><visual><geometry>
<box size='0.02 0.4 0.4'/></geometry></visual></link><joint name='hinge' type='revolute'>
<origin xyz='0 0.2 0'/><parent link='case'/><child link='leaf'/><axis xyz='0 0 1'/>
<limit lower='-0.1' upper='0' effort='0' velocity='1'/></joint><link name='knob'/><joint name='fix'
type='fixed'><origin xyz='0.05 -0.5 0.1' rpy='0 0 0.5'/><parent link='leaf'/><child link='knob'/>
</joint></robot>"""


def drawer(*given: str) -> Scenario:
    return load_scenario("drawer", given)[1]


def loaded(*given: str, **own: object) -> Scenario:
    values: dict = {"model": EXAMPLE, "grasp_frame": "left_handle"} | own
    made = own_object_assignments(drawer(*given), "drawer", OwnObject(**values), given)
    return drawer(*made, *given)


def station(scenario: Scenario) -> ManipulationStation:
    return make_manipulation_station(scenario, APPLICATION.make_calibration(scenario))


def handle_pose(scenario: Scenario) -> np.ndarray:
    thing = scenario.object
    model = read_object_model(
        object_model_file(thing), joint=thing.joint, frame=thing.handle_frame, source=""
    )
    return (thing.pose() @ model.X_OH).GetAsMatrix4()


def test_the_grasped_frame_comes_where_the_scenarios_handle_is() -> None:
    scenario = loaded()
    assert scenario.object.joint == "left_slide"
    assert_allclose(handle_pose(scenario), handle_pose(drawer()), atol=0.02)
    assert scenario.object.variation.yaw == drawer().object.variation.yaw


def test_a_turned_frame_turns_the_object_about_the_vertical_only(tmp_path: Path) -> None:
    (tmp_path / "door.urdf").write_text(DOOR)
    scenario = loaded(model=tmp_path / "door.urdf", grasp_frame="knob")
    expected = handle_pose(drawer())
    assert_allclose(handle_pose(scenario)[:3, :3], expected[:3, :3], atol=1e-9)
    assert_allclose(scenario.object.pose().rotation().col(2), [0, 0, 1], atol=1e-12)


def test_an_object_that_would_be_inside_the_table_is_lifted(tmp_path: Path) -> None:
    for height, lifted in ((0.1, False), (0.5, True)):
        (tmp_path / "door.urdf").write_text(DOOR.replace("0.02 0.4 0.4", f"0.02 0.4 {height}"))
        scenario = loaded(model=tmp_path / "door.urdf", grasp_frame="knob")
        p_WH = handle_pose(scenario)[:3, 3] - handle_pose(drawer())[:3, 3]
        assert_allclose(p_WH[:2], 0, atol=1e-9)
        assert bool(p_WH[2] > 0.1) is lifted
        assert overlaps(station(scenario)) == []


def test_an_object_whose_handle_is_too_high_on_the_table_stands_on_the_floor(
    tmp_path: Path,
) -> None:
    cabinet = tmp_path / "door.urdf"
    own: dict = {"model": cabinet, "grasp_frame": "knob"}
    for height, handle in ((1.4, 0.86), (2.4, 1.302)):  # Raised to the scenario's, or as it stands.
        cabinet.write_text(DOOR.replace("0.02 0.4 0.4", f"0.02 0.4 {height}"))
        with pytest.warns(PlaceWarning, match=r"on the table, the handle .* the arm does not get"):
            scenario = loaded(**own)
        assert scenario.plant.scene == "floor_scene.dmd.yaml"
        assert_allclose(handle_pose(scenario)[2, 3], handle + 0.1 * (height > 2), atol=0.1)
        assert overlaps(station(scenario)) == []
    with pytest.raises(ScenarioError, match=r"^--object: on the table.*; --object-pose puts it"):
        loaded("plant.scene=table_scene.dmd.yaml", **own)
    cabinet.write_text(DOOR.replace("0.02 0.4 0.4", "0.02 0.4 4"))
    with pytest.raises(ScenarioError, match=r"on the floor, .* the arm does not get to its handle"):
        loaded(**own)


def test_an_object_does_not_stand_in_the_robot(tmp_path: Path) -> None:
    case = "<link name='case'><visual><origin xyz='0.8 0 -0.5'/><geometry><box size='0.2 2 0.2'/>"
    case += "</geometry></visual></link>"
    (tmp_path / "door.urdf").write_text(DOOR.replace("<link name='case'/>", case))
    with pytest.raises(ScenarioError, match=r"on the table, .* it would stand in the robot"):
        loaded(model=tmp_path / "door.urdf", grasp_frame="knob")


@pytest.mark.parametrize("place", ["", "0.9,-0.2,0.86,0,0,3.14"])
def test_a_hand_tries_other_grasps_and_has_the_time_for_them(place: str) -> None:
    scenario, base = loaded("control.exploration.lead=0.1", pose=place), drawer()
    sequence = scenario.control.sequence
    assert sequence.other_grasps
    assert not base.control.sequence.other_grasps
    assert scenario.control.exploration.lead == 0.1  # As the user says.
    again = sequence.release_time + sequence.approach_time + sequence.close_time
    assert scenario.duration == base.duration + sequence.retries * again


def test_a_free_object_stands_on_the_table(tmp_path: Path) -> None:
    for height in (0.1, 0.5):
        (tmp_path / "door.urdf").write_text(DOOR.replace("0.02 0.4 0.4", f"0.02 0.4 {height}"))
        scenario = loaded(
            "objects.drawer.free=true", model=tmp_path / "door.urdf", grasp_frame="knob"
        )
        assert scenario.object.variation.position[2] == 0.0
        assert 0.70 < scenario.object.position[2] - 0.5 * height < 0.72  # The table's top is 0.7.
        plant = station(scenario).scene.plant
        assert plant.GetBodyByName("case").is_floating_base_body()


def test_without_a_table_an_object_stands_on_the_floor(tmp_path: Path) -> None:
    floor = "plant.scene=floor_scene.dmd.yaml"
    tall = DOOR.replace("0.02 0.4 0.4", "0.02 0.4 1.5").replace("-0.5 0.1", "-0.5 0.13")
    (tmp_path / "door.urdf").write_text(tall)
    own: dict = {"model": tmp_path / "door.urdf", "grasp_frame": "knob"}
    assert_allclose(handle_pose(loaded(floor, **own))[2, 3], 0.882 + 0.02, atol=1e-9)
    free = loaded(floor, "objects.drawer.free=true", **own)
    assert_allclose(free.object.position[2] - 0.75, 0.002, atol=1e-9)
    assert overlaps(station(loaded(floor, pose="0.9,-0.25,0.86,0,0,3.14"))) == []


def test_friction_is_that_at_the_hand_and_the_opening_within_the_limits(tmp_path: Path) -> None:
    (tmp_path / "door.urdf").write_text(DOOR)
    scenario = loaded(model=tmp_path / "door.urdf", grasp_frame="knob")
    assert_allclose(scenario.object.friction, 6.0 * np.hypot(0.05, 0.5))
    assert_allclose(scenario.task.opening, 0.09)
    assert loaded("objects.drawer.friction=2").object.friction == 2.0


def test_an_asked_pose_is_that_of_the_models_frame_in_radians() -> None:
    scenario = loaded(pose="0.9,0.1,0.8,0.1,0.2,3", pull_direction="0,1,0")
    assert_allclose(scenario.object.pose().translation(), [0.9, 0.1, 0.8])
    angles = scenario.object.pose().rotation().ToRollPitchYaw().vector()
    assert_allclose(angles, [0.1, 0.2, 3])
    assert scenario.object.pull_direction.tolist() == [0, 1, 0]


def test_an_asked_pose_is_the_same_with_every_seed() -> None:
    poses = [
        draw_placements(loaded(f"seed={seed}", pose="0.9,0.1,0.8,0.1,0.2,3"))["drawer"].X_WO
        for seed in (1, 2)
    ]
    assert_allclose(poses[0].translation(), [0.9, 0.1, 0.8])
    assert poses[0].IsExactlyEqualTo(poses[1])


WIDE = DOOR.replace("lower='-0.1'", "lower='-3'")


def test_a_way_asked_for_is_that_of_the_handle_where_the_object_turns(tmp_path: Path) -> None:
    (tmp_path / "door.urdf").write_text(WIDE)
    own: dict = {"model": tmp_path / "door.urdf", "grasp_frame": "knob"}
    with pytest.warns(ObjectWarning, match=r"'hinge' is revolute, so task.opening = 0.2 m of the"
                                           r" handle is 0.398 rad"):  # fmt: skip
        task = loaded(**own).task
    assert_allclose(task.opening, 0.2 / np.hypot(0.05, 0.5))
    with pytest.warns(ObjectWarning, match=r"task.goal = 0.3 is in rad"):
        task = loaded("task.goal=0.3", **own).task
    assert task.goal == 0.3
    assert_allclose(task.tolerance, 0.05 / np.hypot(0.05, 0.5))


def test_what_is_asked_with_a_unit_is_in_that_of_the_own_object_s_joint(tmp_path: Path) -> None:
    (tmp_path / "door.urdf").write_text(WIDE)
    own = OwnObject(model=tmp_path / "door.urdf", grasp_frame="knob")
    for goal, refused in (("20 deg", False), ("20 cm", True)):
        given = [f"task.goal={goal}"]
        _, base = load_scenario("drawer", given, units_known=False)
        with pytest.warns(ObjectWarning, match=r"is in rad"):
            made = own_object_assignments(base, "drawer", own, given)
        if refused:
            with pytest.raises(ScenarioError, match=r"task.goal = '20 cm', but it must be in rad"):
                load_scenario("drawer", [*made, *given])
        else:
            assert load_scenario("drawer", [*made, *given])[1].task.goal == np.deg2rad(20.0)


def test_an_angle_asked_for_is_the_way_of_the_handle_where_the_object_slides() -> None:
    _, door = load_scenario("glass-door")
    values = own_object_assignments(
        door, "glass-door", OwnObject(model=EXAMPLE, grasp_frame="left_handle")
    )
    task = load_scenario("glass-door", values)[1].task
    lever = np.hypot(0.35, 0.07)
    assert_allclose([task.goal, task.tolerance], [0.349 * lever, 0.1 * lever], rtol=0.03)


def test_a_task_in_the_same_unit_stays(tmp_path: Path) -> None:
    assert loaded().task.opening == 0.2
    (tmp_path / "door.urdf").write_text(WIDE)
    own = OwnObject(model=tmp_path / "door.urdf", grasp_frame="knob")
    _, door = load_scenario("glass-door")
    task = load_scenario("glass-door", own_object_assignments(door, "glass-door", own))[1].task
    assert (task.goal, task.tolerance) == (0.349, 0.1)


def test_an_object_starts_as_far_open_as_the_scenarios_own(tmp_path: Path) -> None:
    (tmp_path / "door.urdf").write_text(WIDE)
    for scenario, position in (
        ("glass-door", -0.175),
        ("drawer-return", -0.05 / np.hypot(0.05, 0.5)),
    ):
        _, base = load_scenario(scenario)
        own = OwnObject(model=tmp_path / "door.urdf", grasp_frame="knob")
        values = own_object_assignments(base, scenario, own)
        assert_allclose(load_scenario(scenario, values)[1].object.initial_position, position)


def test_a_model_in_millimetres_is_scaled_to_the_same_one_in_metres(tmp_path: Path) -> None:
    (tmp_path / "metres.urdf").write_text(WIDE)
    text = WIDE.replace("0.02 0.4 0.4", "20 400 400").replace("0 0.2 0", "0 200 0")
    (tmp_path / "millimetres.urdf").write_text(text.replace("0.05 -0.5 0.1", "50 -500 100"))
    poses, positions = [], []
    for name, scale in (("metres", 1.0), ("millimetres", 0.001)):
        scenario = loaded(model=tmp_path / f"{name}.urdf", grasp_frame="knob", scale=scale)
        assert scenario.object.scale == 1.0
        poses.append(handle_pose(scenario))
        positions.append(scenario.object.position)
    assert_allclose(poses[0], poses[1], atol=1e-9)
    assert_allclose(positions[0], positions[1], atol=1e-9)


@pytest.mark.parametrize("scale", [0.0, -1.0, np.nan, np.inf])
def test_an_impossible_scale_is_refused_in_one_line(scale: float) -> None:
    with pytest.raises(ScenarioError, match="must be > 0"):
        loaded(scale=scale)


def test_a_scenario_file_says_the_same(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(
        f"system: crossmodal\nobjects: {{mine: {{model: {EXAMPLE}, joint: '',"
        " handle_frame: right_handle, place_handle: true, position: [0.8, -0.2, 0.9], yaw: 170}}\n"
    )
    _, scenario = load_scenario(str(path))
    assert scenario.object.joint == "right_slide"
    assert_allclose(handle_pose(scenario)[:3, 3], [0.8, -0.2, 0.9])


def said(scenario: Scenario) -> str:
    """Hash of all that a scenario says, its model among it."""
    return fingerprint(APPLICATION, scenario)["scenario_hash"]


def test_a_runs_folder_repeats_the_run_without_the_original(tmp_path: Path) -> None:
    scenario = loaded()
    path = write_scenario(tmp_path / "run", APPLICATION, scenario)
    moved = (tmp_path / "run").rename(tmp_path / "moved")
    with warnings.catch_warnings():
        warnings.simplefilter("error", ObjectWarning)
        _, again = load_scenario(str(moved / path.name))
    copy = object_model_file(again.object)
    assert copy == moved / "model" / "object.sdf"
    assert copy.read_bytes() == object_model_file(scenario.object).read_bytes()
    assert said(again) == said(scenario)
    copy.write_text(copy.read_text().replace("</mass>", "1</mass>"))
    assert said(again) != said(scenario)


def test_what_is_converted_does_not_outlive_the_process(tmp_path: Path) -> None:
    code = (
        "from pathlib import Path; from diagrams.crossmodal.objects.object_import import imported;"
        f"made = imported(Path({str(EXAMPLE)!r}), joint='', frame='left_handle', free=False,"
        " source=''); assert made.model.is_file(); print(made.model)"
    )
    root = str(MODELS_DIR.parent)
    environment = {**os.environ, "TMPDIR": str(tmp_path), "PYTHONPATH": root}
    made = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", code],
        env=environment,
        check=True,
        capture_output=True,
        text=True,
    )
    assert made.stdout.startswith(str(tmp_path))
    assert list(tmp_path.iterdir()) == []


def test_a_run_with_an_object_of_the_program_leaves_no_model_of_an_earlier_one(
    tmp_path: Path,
) -> None:
    for scenario, has_model in ((loaded(), True), (drawer(), False)):
        record = empty_episode()
        record.scenario = scenario
        write_run(tmp_path, APPLICATION, record, APPLICATION.evaluate(record))
        assert (tmp_path / "model" / "object.sdf").is_file() is has_model
    assert not (tmp_path / "model").exists()


def test_the_users_own_models_beside_a_runs_stay(tmp_path: Path) -> None:
    mine = tmp_path / "model" / "mine.sdf"
    mine.parent.mkdir()
    mine.write_text("mine")
    record = empty_episode()
    for scenario in (loaded(), drawer()):
        record.scenario = scenario
        write_run(tmp_path, APPLICATION, record, APPLICATION.evaluate(record))
    assert [path.name for path in mine.parent.iterdir()] == ["mine.sdf"]


def test_of_a_model_that_calls_itself_imported_only_its_parts_are_kept(tmp_path: Path) -> None:
    scenario = loaded()
    made = object_model_file(scenario.object)
    for name in ("textures/key.txt", "secret.pdf", "meshes/a.png"):
        (tmp_path / "downloads" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "downloads" / name).write_text("private")
    (tmp_path / "downloads" / "textures" / "b.png").symlink_to(tmp_path / "downloads/secret.pdf")
    model = tmp_path / "downloads" / "m.sdf"
    model.write_text(made.read_text())
    thing = replace(scenario.object, model=str(model))
    _, files = keep_files(replace(scenario, objects={"object": thing}))
    assert set(files) == {"model/object.sdf", "model/meshes/a.png"}


def test_of_several_objects_each_is_kept_in_a_folder_of_its_own(tmp_path: Path) -> None:
    (tmp_path / "door.urdf").write_text(DOOR)
    path = tmp_path / "mine.yaml"
    path.write_text(
        "system: crossmodal\ntask: {object: chest}\nobjects:\n"
        f"  chest: {{model: {EXAMPLE}, joint: '', handle_frame: right_handle}}\n"
        "  door: {model: door.urdf, joint: hinge, handle_frame: knob}\n"
        "  drawer: {model: chest_drawer.sdf}\n"
    )
    _, scenario = load_scenario(str(path))
    written = write_scenario(tmp_path / "run", APPLICATION, scenario)
    _, again = load_scenario(str(written))
    models = {name: object_model_file(thing) for name, thing in again.objects.items()}
    assert models["chest"] == tmp_path / "run" / "model" / "chest" / "object.sdf"
    assert models["door"] == tmp_path / "run" / "model" / "door" / "object.sdf"
    assert again.objects["drawer"].model == "chest_drawer.sdf"
    assert said(again) == said(scenario)


def test_what_is_assumed_is_said() -> None:
    with pytest.warns(ObjectWarning) as caught:
        loaded()
    lines = [str(warning.message) for warning in caught]
    assert any("nothing fixes the model to the world" in line for line in lines)
    assert any("600 kg/m^3" in line for line in lines)


def pull_warnings(tmp_path: Path, **own: str) -> list[str]:
    (tmp_path / "door.urdf").write_text(DOOR)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ObjectWarning)
        loaded(model=tmp_path / "door.urdf", **own)
    return [str(one.message) for one in caught if "pull along" in str(one.message)]


def test_a_pull_that_hardly_moves_the_joint_is_warned_of_with_a_better_one(tmp_path: Path) -> None:
    # At 3,-4 from its hinge, which turns to negative angles only, the handle goes to -4,-3.
    grasp = "leaf@0.3,-0.4,0,0,0,0"
    (line,) = pull_warnings(tmp_path, grasp_frame=grasp, pull_direction="4,-3,0")
    assert "pull along 4,-3,0 of 'grasp' is 106 deg off" in line
    assert "along it is -0.8,-0.6,0" in line
    (line,) = pull_warnings(tmp_path, grasp_frame=grasp, pull_direction="8,6,0")
    assert "is 180 deg off" in line
    assert pull_warnings(tmp_path, grasp_frame=grasp, pull_direction="-1,0,0") == []


def test_a_joint_that_goes_both_ways_may_be_pushed_as_well(tmp_path: Path) -> None:
    for limits, count in (("lower='-1' upper='1'", 0), ("lower='-1' upper='0'", 1)):
        (tmp_path / "shelf.urdf").write_text(DOOR.replace("lower='-0.1' upper='0'", limits))
        scenario = loaded(model=tmp_path / "shelf.urdf", grasp_frame="leaf@0,-0.4,0,0,0,0")
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", ObjectWarning)
            check_pull(
                read_object_model(
                    object_model_file(scenario.object), joint="hinge", frame="grasp", source=""
                ),
                np.array([1.0, 0.0, 0.0]),
                "hinge",
                "grasp",
            )
        assert len(caught) == count


@pytest.mark.parametrize(
    ("own", "expected"),
    [
        ({"grasp_frame": ""}, "left_handle, right_drawer, right_handle"),
        ({"grasp_frame": "knob"}, "has no frame or link 'knob'"),
        ({"joint": "right_slide"}, "does not move 'left_handle'; those that do: left_slide"),
        ({"pull_direction": "1,0"}, "--pull-direction 1,0: expected 3 numbers"),
        ({"pose": "1,0,0,nan,0,0"}, "expected 6 numbers"),
        ({"model": Path("none.sdf")}, "none.sdf: there is no such file"),
    ],
)
def test_bad_options_are_refused_in_one_line(own: dict, expected: str) -> None:
    with pytest.raises(ScenarioError, match=r".") as caught:
        loaded(**own)
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_object_in_the_way_of_the_hand_is_said_to_be(tmp_path: Path) -> None:
    assert overlaps(station(loaded())) == []
    (tmp_path / "door.urdf").write_text(DOOR.replace("0.02 0.4 0.4", "0.5 0.9 0.4"))
    scenario = loaded(model=tmp_path / "door.urdf", grasp_frame="knob")
    with pytest.warns(StationWarning, match=r"^drawer: link 'leaf' starts \d+ cm inside 'palm'"):
        build_station(APPLICATION, scenario)


def test_a_handle_out_of_reach_is_refused_in_one_line() -> None:
    for pose in ("3,0,0.9,0,0,0", "1.2,-0.3,0.9,0,0,3.14"):
        with pytest.raises(
            ScenarioError, match=r"does not reach .* place the object elsewhere"
        ) as caught:
            build_station(APPLICATION, loaded(pose=pose))
        better = str(caught.value).partition("--object-pose ")[2].partition(" ")[0]
        assert station(loaded(pose=better)) is not None


def test_a_handle_that_falls_before_the_hand_closes_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "flap.urdf"
    for mass in (20.0, 0.3):
        path.write_text(
            "<robot name='m'><link name='case'/><link name='flap'><inertial><origin xyz='.1 0 0'/>"
            f"<mass value='{mass}'/><inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0'"
            " iyz='0'/>"
            "</inertial><visual><origin xyz='.2 0 0' rpy='1.5708 0 0'/><geometry><cylinder"
            " radius='.009' length='.17'/></geometry></visual></link><joint name='hinge'"
            " type='revolute'><parent link='case'/><child link='flap'/><axis xyz='0 1 0'/><limit"
            " lower='-1.5' upper='1.5' effort='0' velocity='1'/></joint></robot>"
        )
        scenario = loaded(model=path, grasp_frame="flap@0.2,0,0,0,0,0", pull_direction="0,0,1")
        if mass > 1.0:
            with pytest.raises(ScenarioError, match=r"^drawer: the handle 'grasp' falls by \d+ cm"):
                settling(scenario, draw_placements(scenario), np.zeros(7))
        else:
            assert settling(scenario, draw_placements(scenario), np.zeros(7)) == []
    assert settling(drawer(), draw_placements(drawer()), drawer().control.posture) == []


def test_what_is_wrong_with_a_grasp_is_said_when_the_object_is_read(tmp_path: Path) -> None:
    (tmp_path / "door.urdf").write_text(DOOR)
    with pytest.warns(ObjectWarning, match=r"the grasp frame 'knob' is in thin air"):
        loaded(model=tmp_path / "door.urdf", grasp_frame="knob")
