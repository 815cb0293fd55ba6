"""Dense clutter: the same by the same seed, at rest, around a target as it was asked for."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.math import RigidTransform

from crossmodal.plants.goods.dense_clutter import (
    ClutterConfig,
    ClutterError,
    make_dense_clutter,
    names_in_clutter,
)
from crossmodal.plants.goods.goods_scene import GoodsScene

MIDDLE = np.array([0.5, 0.1, 0.0])
OTHERS = ["sponge", "black_box"]


@pytest.fixture(scope="module")
def lying() -> dict[str, RigidTransform]:
    return make_dense_clutter(ClutterConfig(count=2, laid_down=1.0), "cleaner", OTHERS, MIDDLE, 3)


def test_the_same_seed_gives_the_same_poses(lying: dict[str, RigidTransform]) -> None:
    again = make_dense_clutter(ClutterConfig(count=2, laid_down=1.0), "cleaner", OTHERS, MIDDLE, 3)
    assert list(again) == list(lying)
    config = ClutterConfig(count=2, laid_down=1.0)
    assert names_in_clutter(config, "cleaner", OTHERS, 3) == list(lying)
    for name, X_WO in lying.items():
        assert_array_equal(again[name].GetAsMatrix4(), X_WO.GetAsMatrix4())


def test_all_rest_on_the_table_and_not_in_each_other(lying: dict[str, RigidTransform]) -> None:
    scene = GoodsScene(list(lying), MIDDLE)
    scene.place(lying)
    assert all(distance > -3e-3 for distance in scene.distances(1e-3).values())
    scene.advance(0.5)
    for name, X_WO in scene.poses().items():
        assert_allclose(X_WO.translation(), lying[name].translation(), atol=5e-4)
        assert_allclose(X_WO.rotation().matrix(), lying[name].rotation().matrix(), atol=1e-2)
        assert -0.01 < X_WO.translation()[2] < 0.3
        assert np.linalg.norm((X_WO.translation() - MIDDLE)[:2]) < 0.35


def test_the_target_lies_or_stands_as_the_configuration_says(
    lying: dict[str, RigidTransform],
) -> None:
    upright = make_dense_clutter(ClutterConfig(count=0, laid_down=0.0), "oil", [], MIDDLE, 0)
    assert upright["oil"].rotation().matrix()[2, 2] == pytest.approx(1.0, abs=1e-4)
    assert abs(lying["cleaner"].rotation().matrix()[2, 2]) < 0.5


def test_the_seed_lays_about_half_of_the_targets_down() -> None:
    config = ClutterConfig(count=0, laid_down=0.5)
    scenes = [make_dense_clutter(config, "cleaner", [], MIDDLE, seed) for seed in range(6)]
    heights = [scene["cleaner"].rotation().matrix()[2, 2] for scene in scenes]
    lie = np.abs(heights) < 0.5
    assert 0 < np.sum(lie) < 6


def test_no_scene_that_rests_is_an_error_after_a_few_tries() -> None:
    config = ClutterConfig(count=1, pulled=0.0, settling=0.25, laid_down=0.0, tries=2)
    with pytest.raises(ClutterError, match=r"in 2 tries .* the last one still moved") as error:
        make_dense_clutter(config, "can", ["sponge"], MIDDLE, 0)
    assert "\n" not in str(error.value)


def test_what_is_asked_for_must_be_possible() -> None:
    with pytest.raises(ValueError, match="count = 2, but there are 1 others"):
        make_dense_clutter(ClutterConfig(count=2), "oil", ["can"], MIDDLE, 0)
    with pytest.raises(ValueError, match="no goods named 'teapot'; there are black_box"):
        make_dense_clutter(ClutterConfig(count=0), "teapot", [], MIDDLE, 0)
    with pytest.raises(ValueError, match="laid_down = 2"):
        make_dense_clutter(ClutterConfig(laid_down=2.0), "oil", OTHERS, MIDDLE, 0)
