from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from crossmodal.diagrams.clutter.training.segmentation_data import (
    Images,
    is_dense,
    is_held_out,
    read_scenes,
    render_scene,
    write_scenes,
)
from crossmodal.systems.segmentation.network_input import CLASSES

SCENE = 0  # A cheap one with unknown shapes.


@pytest.fixture(scope="module")
def images() -> Images:
    return render_scene(0, SCENE, 2)


def test_the_same_seed_gives_the_same_images(images: Images) -> None:
    again = render_scene(0, SCENE, 2)
    for name in ("colour", "depth", "labels", "X_WC"):
        assert_array_equal(getattr(again, name), getattr(images, name), err_msg=name)


def test_labels_are_where_depth_says_that_something_stands_on_the_table(images: Images) -> None:
    assert images.labels.max() < len(CLASSES)
    for k in range(2):
        heights = images.intrinsics(k).heights(images.depth[k].astype(float), images.X_WC[k], 0.0)
        solid = np.isin(images.labels[k], [i for i, n in enumerate(CLASSES) if "glass" not in n])
        high = np.isfinite(heights) & (heights > 0.03) & solid
        assert high.sum() > 200
        assert (images.labels[k][high] > 0).mean() > 0.98


def test_scenes_are_made_once_and_read_together(
    tmp_path: Path, images: Images, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = "crossmodal.diagrams.clutter.training.segmentation_data"
    made = []

    def render(seed: int, scene: int, views: int) -> Images:
        made.append(scene)
        return images

    monkeypatch.setattr(f"{module}.render_scene", render)
    assert len(list(write_scenes(tmp_path, 0, 2))) == 2
    assert len(list(write_scenes(tmp_path, 0, 3))) == 3
    assert made == [0, 1, 2]
    read = read_scenes(tmp_path, 0, 3)
    assert_array_equal(read.labels, np.concatenate([images.labels] * 3))


def test_dense_clutter_is_learned_from_and_held_out() -> None:
    scenes = np.arange(400)
    assert 30 <= is_held_out(scenes).sum() <= 50
    assert (is_dense(scenes) & is_held_out(scenes)).sum() == 20
    assert (is_dense(scenes) & ~is_held_out(scenes)).sum() == 80
