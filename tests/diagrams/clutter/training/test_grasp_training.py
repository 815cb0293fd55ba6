from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose

from crossmodal.diagrams.clutter.training.grasp_training import (
    View,
    export,
    loss_of,
    make_network,
    targets,
    train,
    turned,
)
from crossmodal.systems.grasping.grasp_network import (
    WIDTH_SCALE,
    grasps_of_output,
    network_input,
)
from crossmodal.systems.grasping.height_map import CELLS, HeightMap
from crossmodal.systems.onnx_network import OnnxNetwork


def view_of_a_bar() -> View:
    """A bar along x that is grasped across it, and a little worse askew."""
    heights = np.zeros((CELLS, CELLS), np.float32)
    heights[65:85, 35:115] = 0.05
    columns = np.linspace(55.0, 95.0, 9)
    across = np.column_stack([columns, np.full(9, 74.5), np.full(9, 1.5), np.full(9, 0.06)])
    askew = across + np.array([0.0, 0.0, -0.3, 0.01])
    liking = np.repeat([0.0, -0.2], 9)
    return View(heights=heights, grasps=np.concatenate([across, askew]), liking=liking)


def test_the_network_gives_four_maps_and_is_as_small_as_published() -> None:
    network = make_network(0)
    with torch.no_grad():
        assert network(torch.zeros(2, 1, CELLS, CELLS)).shape == (2, 4, CELLS, CELLS)
    assert sum(values.numel() for values in network.parameters()) == 62420


def test_what_is_exported_does_the_same(tmp_path: Path) -> None:
    network = make_network(0)
    export(network, tmp_path / "network.onnx")
    assert (tmp_path / "network.onnx").stat().st_size < 300_000
    x = np.random.default_rng(0).normal(size=(1, 1, CELLS, CELLS)).astype(np.float32)
    with torch.no_grad():
        expected = network(torch.as_tensor(x)).numpy()
    said = OnnxNetwork(tmp_path / "network.onnx", (1, CELLS, CELLS))(x)
    assert_allclose(said, expected, atol=1e-5)


def test_the_grasp_that_is_liked_best_counts() -> None:
    quality, cosine, sine, width = targets(view_of_a_bar())
    assert quality[74, 75] == 1.0
    assert quality[40, 75] == 0.0
    assert_allclose(0.5 * np.arctan2(sine[74, 75], cosine[74, 75]), 1.5, atol=1e-6)
    assert_allclose(WIDTH_SCALE * width[74, 75], 0.06, atol=1e-7)


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_turned_view_shows_the_same_grasps_of_the_same_object(mirrored: bool) -> None:
    view = view_of_a_bar()
    other = turned(view, 0.7, mirrored)
    quality = targets(other)[0]
    assert other.heights.sum() == pytest.approx(view.heights.sum(), rel=0.02)
    # Where grasps are good, there is the object; and they are across its longer axis.
    assert (other.heights[quality > 0.0] > 0.0).all()
    rows, columns = np.nonzero(other.heights)
    along = np.linalg.eigh(np.cov(columns, rows))[1][:, 1]
    opening = np.column_stack([np.cos(other.grasps[:9, 2]), np.sin(other.grasps[:9, 2])])
    assert_allclose(opening @ along, opening[0] @ along, atol=1e-9)
    assert abs(opening[0] @ along) < 0.12


def test_it_learns_one_view_by_heart() -> None:
    view = view_of_a_bar()
    network = make_network(0)
    optimiser = torch.optim.Adam(network.parameters(), 5e-3)
    x = torch.as_tensor(network_input(view.heights)[None])
    y = torch.as_tensor(targets(view)[None].copy())
    for _ in range(120):
        optimiser.zero_grad()
        loss = loss_of(network(x), y)
        loss.backward()
        optimiser.step()
    output = network(x)[0].detach().numpy()
    seen = HeightMap(heights=view.heights, others=0.0 * view.heights, corner=np.zeros(2))
    grasps, quality = grasps_of_output(output, seen, 0.5)
    assert len(grasps) > 0
    assert quality[0] > 0.8
    assert grasps[0, 2] % np.pi == pytest.approx(1.5, abs=0.1)
    assert grasps[0, 3] == pytest.approx(0.06, abs=0.01)


def test_training_goes_on_where_it_was(tmp_path: Path) -> None:
    views = [view_of_a_bar()] * 4
    whole = list(train(make_network(0), views, seed=0, epochs=3, batch=2))
    checkpoint = tmp_path / "checkpoint.pt"
    run = train(make_network(0), views, seed=0, epochs=3, checkpoint=checkpoint, batch=2)
    assert next(run) == pytest.approx(whole[0], rel=1e-4)
    run.close()
    rest = list(train(make_network(1), views, seed=0, epochs=3, checkpoint=checkpoint, batch=2))
    assert_allclose(rest, whole, rtol=1e-4)
