"""What a scenario of any station can get wrong is refused in one line."""

from pathlib import Path

import pytest

from crossmodal.diagrams.run.scenario import CameraConfig, Scenario
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
from crossmodal.diagrams.stations.scenario_checks import (
    check_one_camera,
    check_scene,
    check_textures,
    model_file,
)
from crossmodal.models import SDF_DIR


@pytest.mark.parametrize(
    "cameras",
    [
        {},
        {"one": CameraConfig(base_frame="hand::eye")},
        {"one": CameraConfig(), "other": CameraConfig()},
    ],
)
def test_all_but_one_fixed_camera_is_refused(cameras: dict[str, CameraConfig]) -> None:
    check_one_camera(Scenario(cameras={"one": CameraConfig()}), "mine", "it sees")
    with pytest.raises(ScenarioError, match=r"^mine: cameras: it sees through one camera"):
        check_one_camera(Scenario(cameras=cameras), "mine", "it sees")


def test_what_is_not_there_is_refused_by_its_name(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"plant.scene = 'moon.yaml': there is no such file"):
        check_scene("moon.yaml", "mine")
    with pytest.raises(ScenarioError, match=r"^mine: unknown texture 'birk'.*birch"):
        check_textures(["birk"], "mine")
    with pytest.raises(ScenarioError, match=r"tool = 'none.sdf': there is no such file in"):
        model_file("none.sdf", "tool", tmp_path / "mine.yaml")


def test_a_model_beside_the_scenario_comes_before_the_programs_own(tmp_path: Path) -> None:
    scenario, own = tmp_path / "mine.yaml", tmp_path / "chest_drawer.sdf"
    assert model_file("chest_drawer.sdf", "key", scenario) == SDF_DIR / "chest_drawer.sdf"
    own.write_text("")
    assert model_file("chest_drawer.sdf", "key", scenario) == own
