from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from crossmodal.diagrams.clutter.training.grasp_data import (
    body_at,
    draw_samples,
    draw_scene,
    lowered,
    observe,
    standing,
    true_heights,
)
from crossmodal.diagrams.clutter.training.grasp_network_training import (
    load_views,
    make_data,
    seen_files,
)
from crossmodal.diagrams.clutter.training.shapes import GOODS, goods
from crossmodal.models.make_goods import GOODS as MADE
from crossmodal.systems.grasping.height_map import CELL


def test_the_goods_are_those_that_are_simulated() -> None:
    assert set(GOODS) == set(MADE)
    for name in ("oil", "marker"):
        shape, made = goods(name), MADE[name]()
        assert (shape.mass, shape.friction) == (made.mass, made.friction)
        assert_allclose(shape.corners.min(axis=(0, 1)), made.mesh.bounds[0], atol=1e-4)
    assert [name for name in GOODS if goods(name).is_glass] == ["transparent_box", "wineglass"]


def test_a_scene_follows_from_its_seed_and_number() -> None:
    first, again, other = (draw_samples(0, scene) for scene in (4, 4, 5))
    assert_array_equal(first[0].view.heights, again[0].view.heights)
    assert_array_equal(first[0].grasps, again[0].grasps)
    assert other[0].view.heights.shape == first[0].view.heights.shape
    assert (other[0].view.heights != first[0].view.heights).any()


@pytest.mark.parametrize("seed", range(3))
def test_what_lies_in_a_heap_is_on_the_table_or_on_others(seed: int) -> None:
    for body in draw_scene(np.random.default_rng(seed)):
        assert body.corners[..., 2].min() > -1e-9


def test_an_object_is_lowered_until_it_touches() -> None:
    rng = np.random.default_rng(0)
    box, can = goods("black_box"), goods("can")
    upright = standing(can, rng)
    below = body_at(box, np.eye(4))
    above = lowered(can, upright, np.zeros(2), [below])
    assert above.corners[..., 2].min() == pytest.approx(0.06, abs=1e-6)
    beside = lowered(can, upright, np.array([0.3, 0.0]), [below])
    assert beside.corners[..., 2].min() == pytest.approx(0.0, abs=1e-9)
    assert_allclose(beside.p_WCm[:2], [0.3, 0.0], atol=1e-9)


def test_true_heights_are_those_of_the_mesh() -> None:
    corner = np.array([-0.15, -0.15])
    heights = true_heights([body_at(goods("black_box"), np.eye(4))], corner)
    assert_allclose(heights[heights > 0.0], 0.06)
    assert (heights > 0.0).sum() * CELL**2 == pytest.approx(0.16 * 0.11, rel=0.03)
    assert true_heights([], corner).max() == 0.0


def test_an_opaque_object_is_seen_as_high_as_it_is_and_glass_is_not() -> None:
    (box,) = observe([body_at(goods("black_box"), np.eye(4))], np.random.default_rng(1))
    both = (box.view.heights > 0.0) & (box.heights > 0.0)
    assert both.sum() > 0.9 * (box.heights > 0.0).sum()
    assert np.median(np.abs(box.view.heights - box.heights)[both]) < 0.004
    assert len(box.grasps) > 0
    (glass,) = observe([body_at(goods("wineglass"), np.eye(4))], np.random.default_rng(1))
    assert_allclose(glass.view.heights[glass.view.heights > 0.0], 0.06)


def test_data_that_are_there_are_left_alone_and_some_are_held_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    training = "crossmodal.diagrams.clutter.training.grasp_network_training"
    monkeypatch.setattr(f"{training}.SCENES", 1)
    paths = list(make_data(tmp_path, 2, seed=4, jobs=1))
    before = [path.stat().st_mtime_ns for path in paths]
    views = [view for path in paths for view in load_views(path)]
    samples = [sample for scene in range(2) for sample in draw_samples(4, scene)]
    assert len(views) == len(samples)
    for view, sample in zip(views, samples, strict=True):
        assert_allclose(view.heights, sample.view.heights, atol=1e-3)
        assert_allclose(view.grasps[:, 2:], sample.grasps[:, 2:4], atol=1e-6)
    assert list(make_data(tmp_path, 2, seed=4, jobs=1)) == paths
    assert [path.stat().st_mtime_ns for path in paths] == before
    assert len(seen_files(paths * 8)) == 14
