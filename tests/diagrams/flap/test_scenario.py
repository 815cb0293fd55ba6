"""What a scenario of the flap application may say."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose

from crossmodal.diagrams.flap.episode_parts import make_calibration
from crossmodal.diagrams.flap.scenario import Scenario
from crossmodal.diagrams.run.calibration import draw_base
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError

Load = Callable[..., Scenario]


@pytest.mark.parametrize("name", ["flap", "flap-visible", "flap-jerked"])
def test_the_scenarios_come_with_the_errors_of_a_careful_laboratory(load: Load, name: str) -> None:
    errors = load(name).calibration.errors
    assert_allclose(errors.camera_translation, 0.005)
    assert_allclose(np.rad2deg(errors.arm_rotation), 0.3)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("sensors.taxels.tick=0.5", "unknown key 'sensors.taxels.tick'"),
        ("tool.model=none.sdf", "tool.model = 'none.sdf': there is no such file"),
        ("tool.model=tripod.sdf", "tripod.sdf: need a revolute joint named 'hinge', found none"),
        ("tool.variation.textures=[tartan]", "unknown texture 'tartan'"),
        ("plant.scene=none.yaml", "plant.scene = 'none.yaml'"),
        ("finger.taxels=[[0, 0], [0.003, 0], [0, 0.003]]", "3 taxels, need at least 4"),
        ("finger.taxels=[[0, 0], [0.003, 0], [0, 0.003], [0.02, 0]]", "taxel 3 at"),
        ("cameras.camera.base_frame=fingertip::finger", "one camera that is fixed to the world"),
        ("task.least_angle=200", "task.least_angle = 200"),
        ("modalities=[guessing]", "modalities: "),
    ],
)
def test_what_is_impossible_is_refused_in_one_line(load: Load, override: str, message: str) -> None:
    with pytest.raises(ScenarioError) as error:
        load("flap", override)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_the_robots_know_where_their_arms_stand_whatever_the_seed(load: Load) -> None:
    one, other = make_calibration(load("flap")), make_calibration(load("flap", "seed=7"))
    assert list(one.arms) == ["holder_arm", "finger_arm"]
    for name, y in (("holder_arm", -0.45), ("finger_arm", 0.55)):
        assert_allclose(one.arms[name].X_WBase.translation(), [0.0, y, 0.0])
        assert one.arms[name].X_WBase.IsExactlyEqualTo(other.arms[name].X_WBase)
        assert one.arms[name].model.num_positions() == 7


def test_the_seed_draws_where_the_camera_is_and_the_robot_knows_it(load: Load) -> None:
    scenario = load("flap")
    (camera,) = scenario.cameras.values()
    vary, places = scenario.camera_variation, []
    for seed in range(20):
        seeded = load("flap", f"seed={seed}")
        (drawn,) = seeded.drawn_cameras().values()
        assert np.all(np.abs(drawn.position - camera.position) <= vary.position)
        assert np.all(np.abs(drawn.looking_at - camera.looking_at) <= vary.looking_at)
        assert abs(drawn.lamp / camera.lamp - 1.0) <= vary.lamp
        believed = make_calibration(seeded).camera.X_PC.translation()
        assert_allclose(believed, drawn.position)
        places.append(drawn.position)
    assert np.all(np.ptp(places, axis=0) > 1.2 * vary.position)
    assert_allclose(load("flap", "seed=3").drawn_cameras()["camera"].position, places[3])


def test_the_arms_truly_stand_somewhere_else_each(load: Load) -> None:
    errors = load("flap").calibration.errors
    off = {
        name: arm.X_WBase.inverse() @ draw_base(name, arm.X_WBase, errors, 0)
        for name, arm in make_calibration(load("flap")).arms.items()
    }
    distances = [np.linalg.norm(X.translation()) for X in off.values()]
    assert all(1e-4 < distance < 0.02 for distance in distances)
    assert abs(distances[0] - distances[1]) > 1e-5
