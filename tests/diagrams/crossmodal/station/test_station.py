"""The station's sensors on whole scenes, and what the seed draws."""

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.crossmodal.application import APPLICATION
from crossmodal.diagrams.crossmodal.scenario import Scenario
from crossmodal.diagrams.crossmodal.station.station import (
    ManipulationStation,
    draw_placements,
    make_manipulation_station,
)
from crossmodal.diagrams.run.calibration import Camera


def make_station(*given: str) -> tuple[ManipulationStation, Camera]:
    """The station of a scenario, and the camera that the robot believes to have."""
    _, scenario = load_scenario(given[0], given[1:])
    calibration = APPLICATION.make_calibration(scenario)
    return make_manipulation_station(scenario, calibration), calibration.camera


def _pixel(camera: Camera, X_WB: RigidTransform, p_BP: Sequence[float]) -> tuple[int, int]:
    """Row and column at which the camera sees a point of a body."""
    ((u, v),) = camera.project(X_WB @ np.array(p_BP))
    return round(v), round(u)


def test_the_glass_pane_is_seen_through_but_returns_no_depth() -> None:
    station, camera = make_station("glass-door", "seed=3")
    context = station.diagram.CreateDefaultContext()
    station.initialise(context)
    color = station.diagram.GetOutputPort("color_measured").Eval(context).image.data[:, :, :3]
    depth = station.diagram.GetOutputPort("depth_measured").Eval(context).image.data[:, :, 0]
    plant = station.scene.plant
    door = plant.GetBodyByName("door").EvalPoseInWorld(plant.GetMyContextFromRoot(context))
    # On the pane and on the stile beside it, in the door's frame.
    for y, returned in ((-0.035, 0.0), (-0.188, 1.0)):
        around = [_pixel(camera, door, [0.0, y, z]) for z in np.linspace(-0.15, 0.15, 9)]
        rows, columns = np.array(around).T
        assert np.mean(depth[rows, columns] > 0.0) == returned
        assert color[rows, columns].mean() > 10.0


def test_lights_that_go_off_in_part_leave_a_dim_image() -> None:
    def grey(*given: str) -> float:
        small = ["cameras.camera.width=64", "cameras.camera.height=48"]
        station, _ = make_station("drawer", *small, *given)
        context = station.diagram.CreateDefaultContext()
        station.initialise(context)
        image = station.diagram.GetOutputPort("color_measured").Eval(context).image
        return float(image.data[:, :, :3].mean())

    bright, dim, dark = (
        grey(f"disturbances.lights_off=[{{start: 0, remaining: {share}}}]") for share in (1, 0.3, 0)
    )
    assert dark < 15.0
    assert abs(dim / bright - 0.3 ** (1.0 / 2.2)) < 0.03


TWO = ["objects={drawer: {}, box: {model: cardboard_box.sdf, joint: hinge, free: true,"
       " position: [1.0, 0.7, 0.7], variation: {position: [0.1, 0.1, 0.0]}}}",
       "task.object=drawer", "objects.drawer.variation.position=[0.02, 0.03, 0.02]"]  # fmt: skip


def drawn(seed: int, *given: str) -> dict[str, np.ndarray]:
    scenario: Scenario = load_scenario("drawer", [*given, f"seed={seed}"])[1]
    placements = draw_placements(scenario)
    return {name: placement.X_WO.translation() for name, placement in placements.items()}


def test_every_seed_places_the_objects_elsewhere_within_their_half_ranges() -> None:
    first, second = drawn(1, *TWO), drawn(2, *TWO)
    nominal = np.array([1.0, 0.7, 0.7])
    for name in ("drawer", "box"):
        assert not np.allclose(first[name], second[name])
    assert np.all(np.abs(first["box"] - nominal) <= [0.1, 0.1, 0.0])
    assert_allclose(drawn(1, *TWO)["box"], first["box"])


def test_another_object_beside_it_does_not_move_the_first() -> None:
    alone = "objects={drawer: {variation: {position: [0.02, 0.03, 0.02]}}}"
    assert_allclose(drawn(3, alone)["drawer"], drawn(3, *TWO)["drawer"])


def test_the_task_says_which_of_two_objects_the_robot_goes_to() -> None:
    station, _ = make_station("drawer", *TWO)
    assert station.joint.name() == "slide"
    assert set(station.scene.objects) == {"drawer", "box"}


@pytest.mark.parametrize("error", ["camera_translation=0.05", "focal_length=0.1"])
def test_the_true_camera_is_not_quite_the_believed_one(error: str) -> None:
    """What the robot believes stays; the images are those of another camera."""
    images = []
    for given in ([], [f"calibration.errors.{error}"]):
        small = ["cameras.camera.width=64", "cameras.camera.height=48", "seed=4"]
        station, _ = make_station("drawer", *small, *given)
        context = station.diagram.CreateDefaultContext()
        station.initialise(context)
        images.append(
            station.diagram.GetOutputPort("color_measured").Eval(context).image.data.copy()
        )
    assert np.mean(images[0] != images[1]) > 0.05


@pytest.mark.parametrize(("modality", "is_metered"), [("proprioception", False), ("vision", True)])
def test_the_camera_follows_the_light_only_for_those_who_look(
    modality: str, is_metered: bool
) -> None:
    covered = "disturbances.camera_covered=[{start: 0.05}]"
    small = ["cameras.camera.width=64", "cameras.camera.height=48"]
    station, _ = make_station("drawer", *small, covered, f"modalities=[{modality}]")
    simulator = Simulator(station.diagram)
    station.initialise(simulator.get_mutable_context())
    simulator.AdvanceTo(0.2)
    noise = station.diagram.GetSubsystemByName("camera_noise")
    gain = noise.GetMyContextFromRoot(simulator.get_context()).get_discrete_state_vector()
    assert (gain.value()[0] != 1.0) == is_metered


def test_leaks_and_forces_of_a_scenario_reach_hand_and_plant_while_they_last() -> None:
    overrides = [
        "disturbances.hand_leaks=[{start: 2, end: 3}]",
        "disturbances.forces=[{frame: 'drawer::handle', force: [-50, 0, 0], start: 2, end: 3}]",
    ]
    _, scenario = load_scenario("drawer", overrides)
    station = make_manipulation_station(scenario, APPLICATION.make_calibration(scenario))
    root = station.diagram.CreateDefaultContext()
    plant = station.scene.plant
    pneumatics = station.diagram.GetSubsystemByName("pneumatics")
    for time, counts in ((1.9, 0), (2.0, 1), (3.0, 0)):
        root.SetTime(time)
        forces = plant.get_applied_spatial_force_input_port()
        assert len(forces.Eval(plant.GetMyContextFromRoot(root))) == counts
        leaking = pneumatics.GetInputPort("leaking").Eval(pneumatics.GetMyContextFromRoot(root))
        assert leaking[0] == counts


@pytest.mark.parametrize("leaks", ["[]", "[{start: 5}]"])
def test_somebody_lets_air_escape(leaks: str) -> None:
    station, _ = make_station("drawer", f"disturbances.hand_leaks={leaks}")
    root = station.diagram.CreateDefaultContext()
    context = station.diagram.GetMyContextFromRoot(root)
    pneumatics = station.diagram.GetSubsystemByName("pneumatics")
    port = pneumatics.GetInputPort("leaking")
    for value in (1.0, 0.0):
        station.diagram.GetInputPort("leak_by_hand").FixValue(context, [value])
        assert port.Eval(pneumatics.GetMyContextFromRoot(root))[0] == value


def test_a_detent_holds_the_joint_at_its_start_beyond_friction() -> None:
    station, _ = make_station(
        "drawer", "seed=0", "objects.drawer.detent=25", "objects.drawer.variation.friction=0"
    )
    context = station.diagram.CreateDefaultContext()
    station.initialise(context)
    plant, slide = station.scene.plant, station.scene.plant.GetJointByName("slide")
    inside = plant.GetMyMutableContextFromRoot(context)
    port = plant.get_applied_generalized_force_input_port()
    forces = []
    most = 2.0 * np.e * plant.time_step() ** 2 * 25.0 / 2.5  # The drawer weighs 2.5 kg.
    for x in (0.0, most, 0.1):
        slide.set_translation(inside, x)
        forces.append(float(np.asarray(port.Eval(inside))[slide.velocity_start()]))
    assert_allclose(forces, [0.0, -25.0, 0.0], atol=1e-9)
    truth = station.diagram.GetOutputPort("cheat_joint_mechanics").Eval(context)
    assert_allclose([truth.friction, truth.detent], [6.0, 25.0])
