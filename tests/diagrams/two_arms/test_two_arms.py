"""Two arms, two cameras of which one is on a wrist, and two objects, in one short episode."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context
from truth_paths import truth_paths, truth_references

from crossmodal.diagrams.applications import OWN, load_scenario
from crossmodal.diagrams.drawing.diagram_drawing import diagram_dot, render_svg
from crossmodal.diagrams.evaluation.run_writer import write_run
from crossmodal.diagrams.run.application import Application
from crossmodal.diagrams.run.build import build_station
from crossmodal.diagrams.run.calibration import draw_base, draw_camera
from crossmodal.diagrams.run.episode import Episode, run_episode
from crossmodal.diagrams.run.folder.run_folder import SENSORS_FILE
from crossmodal.diagrams.run.record import EpisodeRecord
from crossmodal.diagrams.run.replay import check_recorded, replay
from crossmodal.diagrams.run.scenario import Scenario
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
from crossmodal.maths import se3
from crossmodal.systems.port_values import StampedImage

FOLDER = Path(__file__).parent
FILE = FOLDER / "two_arms.yaml"
SIDES = ("left", "right")
CAMERAS = ("fixed", "wrist")


@pytest.fixture(scope="module", autouse=True)
def two_arms() -> Iterator[None]:
    """The program knows this application while the file is tested."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(OWN, str(FOLDER / "two_arms.py"))
        yield


@pytest.fixture(scope="module")
def loaded(two_arms: None) -> tuple[Application, Scenario]:
    return load_scenario(str(FILE))


@pytest.fixture(scope="module")
def episode(loaded: tuple[Application, Scenario]) -> Episode:
    """The whole diagram, not run."""
    return Episode(*loaded)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("two-arms")


@pytest.fixture(scope="module")
def record(loaded: tuple[Application, Scenario], folder: Path) -> EpisodeRecord:
    """The episode, run and written with its sensor streams."""
    application, scenario = loaded
    found = run_episode(application, scenario, sensors_file=folder / SENSORS_FILE)
    write_run(folder, application, found, application.evaluate(found))
    return found


class Posed:
    """The station with its arms where they are put, nothing having moved yet."""

    def __init__(self, episode: Episode) -> None:
        self._diagram = episode.station.diagram
        self._plant = self._diagram.GetSubsystemByName("plant")
        self._episode = episode

    def at(self, **moved: float) -> Context:
        """All joints of the named arms off their start by so much, [rad]."""
        root = self._episode.diagram.CreateDefaultContext()
        self._episode.station.initialise(root)
        context = self._plant.GetMyMutableContextFromRoot(root)
        for side, angle in moved.items():
            arm = self._plant.GetModelInstanceByName(f"{side}_arm")
            self._plant.SetPositions(context, arm, self._plant.GetPositions(context, arm) + angle)
        self._episode.diagram.ExecuteInitializationEvents(root)
        return root

    def output(self, root: Context, port: str) -> np.ndarray:
        context = self._diagram.GetMyContextFromRoot(root)
        return np.array(self._diagram.GetOutputPort(port).Eval(context).data)

    def image(self, root: Context, port: str) -> StampedImage:
        context = self._diagram.GetMyContextFromRoot(root)
        image = self._diagram.GetOutputPort(port).Eval(context)
        assert isinstance(image, StampedImage)
        return image

    def pose(self, root: Context, model: str, frame: str) -> RigidTransform:
        """The true pose of a frame."""
        found = self._plant.GetFrameByName(frame, self._plant.GetModelInstanceByName(model))
        return found.CalcPoseInWorld(self._plant.GetMyContextFromRoot(root))

    def true_depth(self, root: Context, camera: str) -> np.ndarray:
        sensor = self._diagram.GetSubsystemByName(f"{camera}_rgbd_sensor")
        image = sensor.depth_image_32F_output_port().Eval(sensor.GetMyContextFromRoot(root))
        return np.array(image.data[:, :, 0])


@pytest.fixture(scope="module")
def posed(episode: Episode) -> Posed:
    return Posed(episode)


def test_the_directives_lie_beside_the_scenario(
    loaded: tuple[Application, Scenario], tmp_path: Path
) -> None:
    assert loaded[1].directives == str(FOLDER / "two_arms.dmd.yaml")
    with pytest.raises(ScenarioError, match=r"directives = 'none\.yaml': there is no such file"):
        load_scenario(str(FILE), ["directives=none.yaml"])


def test_it_ticks_for_half_a_second(record: EpisodeRecord) -> None:
    assert_allclose(record.duration, 0.6, atol=1e-9)
    assert list(record.estimators) == ["left", "right", "eye"]
    for estimator in record.estimators.values():
        assert_allclose([tick.time for tick in estimator.ticks], np.arange(9) / 15, atol=1e-9)


def test_one_hand_stays_and_the_other_makes_its_step(record: EpisodeRecord) -> None:
    steps = {}
    for side in SIDES:
        poses = record.station_values(f"cheat_{side}_pose")
        steps[side] = poses[-1].translation() - poses[0].translation()
    assert_allclose(steps["left"], [0, 0, 0], atol=0.005)
    assert_allclose(steps["right"], [0, 0, 0.05], atol=0.01)


def test_each_estimator_knows_its_own_arm(record: EpisodeRecord) -> None:
    """The encoders are off by centimetres, the hands are apart by most of a metre."""
    for side in SIDES:
        last = record.estimators[side].ticks[-1].values["end_effector_latest"]
        truth = record.station_values(f"cheat_{side}_pose")[len(record.estimators[side].ticks) - 1]
        assert np.linalg.norm(last.X[:3, 3] - truth.translation()) < 0.06


def test_the_fixed_camera_follows_features(record: EpisodeRecord) -> None:
    for tick in record.estimators["eye"].ticks[1:]:
        features = tick.values["features_latest"]
        assert len(features.ids) > 5
        on_table = (features.p_WF > [0.6, -0.8, 0.6]) & (features.p_WF < [1.6, 0.8, 1.2])
        assert on_table.all(axis=1).mean() > 0.8


def test_all_cameras_and_arms_are_believed_and_truly_elsewhere(record: EpisodeRecord) -> None:
    calibration, errors = record.calibration, record.scenario.calibration.errors
    assert tuple(calibration.cameras) == CAMERAS
    assert tuple(calibration.arms) == SIDES
    off = [
        camera.X_PC.inverse() @ draw_camera(name, camera, errors, record.scenario.seed).X_PC
        for name, camera in calibration.cameras.items()
    ] + [
        arm.X_WBase.inverse() @ draw_base(name, arm.X_WBase, errors, record.scenario.seed)
        for name, arm in calibration.arms.items()
    ]
    sizes = np.array([np.linalg.norm(X.translation()) for X in off])
    assert np.all((sizes > 1e-4) & (sizes < 0.02))
    assert len(np.unique(sizes)) == 4


def test_the_simulated_arms_stand_where_they_were_drawn(
    episode: Episode, loaded: tuple[Application, Scenario]
) -> None:
    plant, scenario = episode.station.diagram.GetSubsystemByName("plant"), loaded[1]
    context = plant.CreateDefaultContext()
    for side, believed in episode.calibration.arms.items():
        base = plant.GetFrameByName("base", plant.GetModelInstanceByName(f"{side}_arm"))
        drawn = draw_base(side, believed.X_WBase, scenario.calibration.errors, scenario.seed)
        assert_allclose(
            base.CalcPoseInWorld(context).GetAsMatrix4(), drawn.GetAsMatrix4(), atol=1e-9
        )


def test_cameras_cannot_have_different_lamps(two_arms: None) -> None:
    with pytest.raises(ScenarioError, match=r"lamps of \[0\.0, 0\.5\], but all share one renderer"):
        build_station(*load_scenario(str(FILE), ["cameras.wrist.lamp=0.5"]))


def test_two_sensors_of_a_kind_do_not_err_alike(posed: Posed, episode: Episode) -> None:
    root = posed.at()
    station = episode.station.diagram
    context = station.GetMyContextFromRoot(root)
    for port in ("joint_state_window", "wrench_window", "pressure_window"):
        left, right = (
            station.GetOutputPort(f"{side}_{port}").Eval(context).values[0] for side in SIDES
        )
        assert np.all(left != right)


def test_the_wrist_camera_sees_its_arm_move(record: EpisodeRecord) -> None:
    """More changes than by noise, of which the fixed camera's background has as much."""
    changes = {}
    for camera in CAMERAS:
        first, last = (
            np.asarray(picture.color, dtype=float)
            for picture in record.pictures
            if picture.port == f"{camera}_color_measured"
        )
        changes[camera] = np.abs(last - first)
    noise = changes["fixed"][:20, :20].mean()
    assert changes["wrist"].mean() > 3.0 * noise


def test_a_camera_on_the_wrist_goes_with_it_and_so_does_the_mask_of_its_hand(posed: Posed) -> None:
    depths, hands = [], []
    for angle in (0.0, -0.3):
        root = posed.at(right=angle)
        depths.append(posed.true_depth(root, "wrist"))
        hands.append(depths[-1] < 0.25)
        mask = posed.output(root, "wrist_robot_mask")[:, :, 0] == 255
        assert mask[hands[-1]].mean() > 0.95
        assert mask.mean() < 0.9
    assert 0.02 < hands[0].mean() < 0.9
    assert (hands[0] == hands[1]).mean() > 0.98
    both = hands[0] & hands[1]
    assert_allclose(depths[1][both], depths[0][both], atol=1e-3)


def test_an_image_says_where_its_camera_is(posed: Posed, episode: Episode) -> None:
    """The fixed one by its calibration, the one on the wrist by the joints, within its errors."""
    fixed, wrist = (episode.calibration.cameras[name] for name in CAMERAS)
    scenario = load_scenario(str(FILE))[1]
    true = draw_camera("wrist", wrist, scenario.calibration.errors, scenario.seed)
    places = []
    for angle in (0.0, -0.3):
        root = posed.at(right=angle)
        image = posed.image(root, "fixed_depth_measured")
        assert_array_equal(image.X_WC, fixed.X_PC.GetAsMatrix4())
        assert_array_equal(image.covariance, fixed.pose_covariance)
        image = posed.image(root, "wrist_depth_measured")
        X_WP = posed.pose(root, "right_arm", "tool_plate")
        error = se3.log(se3.inverse(image.X_WC) @ (X_WP @ true.X_PC).GetAsMatrix4())
        assert np.linalg.norm(error) > 1e-4
        assert error @ np.linalg.solve(image.covariance, error) < 22.5  # 99.9 % of 6 dof.
        assert np.sqrt(np.diag(image.covariance)[3:]).max() < 0.1
        places.append(image.X_WC[:3, 3])
    assert np.linalg.norm(places[1] - places[0]) > 0.1


def test_the_fixed_cameras_mask_covers_both_robots(posed: Posed) -> None:
    masks = [
        posed.output(posed.at(**moved), "fixed_robot_mask")[:, :, 0]
        for moved in ({}, {"left": 0.3}, {"right": 0.3})
    ]
    middle = masks[0].shape[1] // 2
    assert (masks[0][:, :middle] != 0).any()
    assert (masks[0][:, middle:] != 0).any()
    assert (masks[0][:, :middle] != masks[1][:, :middle]).any()
    assert (masks[0][:, middle:] != masks[2][:, middle:]).any()


def test_the_streams_carry_their_owners_names(record: EpisodeRecord, folder: Path) -> None:
    with (folder / SENSORS_FILE).open("rb") as file:
        summary = make_reader(file).get_summary()
    topics = {channel.topic for channel in summary.channels.values()}
    assert topics == {
        "/left_joint_state_window",
        "/right_joint_state_window",
        "/fixed_color_measured",
        "/fixed_depth_measured",
        "/fixed_robot_mask",
        "/wrist_color_measured",
        "/wrist_color_measured/pose",
        "/cheat_left_pose",
        "/cheat_right_pose",
    }


def test_a_replay_gives_the_same_beliefs(record: EpisodeRecord, folder: Path) -> None:
    application, scenario = load_scenario(str(check_recorded(folder)))
    again = replay(application, folder, scenario)
    for side in SIDES:
        pairs = zip(record.estimators[side].ticks, again.estimators[side].ticks, strict=False)
        for old, new in pairs:  # The file rounds the samples' stamps to nanoseconds.
            X_old, X_new = (tick.values["end_effector_latest"].X for tick in (old, new))
            assert_allclose(X_new, X_old, atol=1e-9)
    old, new = (
        found.estimators["eye"].ticks[8].values["features_latest"] for found in (record, again)
    )
    assert_array_equal(new.p_WF, old.p_WF)


def test_nothing_true_reaches_what_the_robot_runs(episode: Episode) -> None:
    assert truth_paths(episode.diagram) == []
    assert truth_references(episode.diagram) == []


@pytest.mark.parametrize("part", ["station", "left", "eye"])
def test_each_part_can_be_drawn(episode: Episode, part: str) -> None:
    systems = {"station": episode.station.diagram, **episode.estimators}
    dot = diagram_dot(systems[part], part)
    shown = {
        "station": ["joint encoders\\nleft encoders", "fixed camera noise", "wrist camera noise"],
        "left": ["end effector motion"],
        "eye": ["feature motion"],
    }
    for name in shown[part]:
        assert name in dot
    if shutil.which("dot"):
        assert "</svg>" in render_svg(dot)
