from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose, assert_array_equal

from crossmodal.diagrams.clutter.training.segmentation_data import Images
from crossmodal.diagrams.clutter.training.segmentation_network import (
    SegmentationNetwork,
    export,
    make_network,
)
from crossmodal.diagrams.clutter.training.segmentation_training import (
    class_ious,
    confusion,
    mean_ious,
    sample,
    train,
)
from crossmodal.systems.onnx_network import OnnxNetwork
from crossmodal.systems.segmentation.network_input import CLASSES, SHAPE

CAN = CLASSES.index("can")


def images_of_a_can(count: int) -> Images:
    """A red square of 7 cm height somewhere on a white table, seen from above."""
    rng = np.random.default_rng(0)
    colour = np.full((count, 240, 320, 3), 220, np.uint8)
    depth = np.full((count, 240, 320), 0.6, np.float16)
    labels = np.zeros((count, 240, 320), np.uint8)
    for k in range(count):
        v, u = rng.integers([0, 0], [150, 230])
        part = k, slice(v, v + 90), slice(u, u + 90)
        colour[part], depth[part], labels[part] = (200, 30, 30), 0.53, CAN
    X_WC = np.diag([1.0, -1.0, -1.0, 1.0])
    X_WC[2, 3] = 0.6
    return Images(
        colour=colour,
        depth=depth,
        labels=labels,
        camera=np.tile([288.0, 288.0, 159.5, 119.5], (count, 1)),
        X_WC=np.tile(X_WC, (count, 1, 1)),
        scene=np.arange(count),
    )


def test_the_network_gives_each_class_at_half_of_the_size_and_is_small() -> None:
    network = SegmentationNetwork().eval()
    with torch.no_grad():
        assert network(torch.zeros(2, *SHAPE)).shape == (2, len(CLASSES), 120, 160)
    assert sum(values.numel() for values in network.parameters()) < 350_000


def test_what_is_exported_does_the_same(tmp_path: Path) -> None:
    network = make_network(0).eval()
    export(network, tmp_path / "network.onnx")
    x = np.random.default_rng(0).normal(size=(1, *SHAPE)).astype(np.float32)
    with torch.no_grad():
        expected = network(torch.tensor(x)).numpy()
    assert_allclose(OnnxNetwork(tmp_path / "network.onnx", SHAPE)(x), expected, atol=1e-4)


def test_it_learns_a_can_by_heart(tmp_path: Path) -> None:
    images, network = images_of_a_can(2), make_network(0)
    losses = list(train(network, images, 0, 40, batch=2))
    assert losses[-1] < 0.3 * losses[0]
    export(network, tmp_path / "network.onnx")
    ious = class_ious(confusion(OnnxNetwork(tmp_path / "network.onnx", SHAPE), images))
    assert ious[CAN] > 0.7
    assert ious[0] > 0.8


def test_training_that_goes_on_ends_where_it_would_have(tmp_path: Path) -> None:
    images = images_of_a_can(4)
    whole, parts = make_network(0), make_network(0)
    losses = list(train(whole, images, 0, 2, tmp_path / "whole.pt", batch=2))
    next(train(parts, images, 0, 2, tmp_path / "parts.pt", batch=2))
    again = make_network(1)
    assert list(train(again, images, 0, 2, tmp_path / "parts.pt", batch=2)) == losses
    finished = make_network(1)
    assert list(train(finished, images, 0, 2, tmp_path / "parts.pt", batch=2)) == losses
    for network in (again, finished):
        for name, values in network.state_dict().items():
            assert_array_equal(values.numpy(), whole.state_dict()[name].numpy(), err_msg=name)


def test_labels_stay_on_what_they_name_whatever_is_done_to_an_image() -> None:
    images, rng = images_of_a_can(16), np.random.default_rng(1)
    for k in range(16):
        x, labels = sample(images, k, rng)
        high = (x[3] > 0.4) & (x[4] == 0.0)
        assert_array_equal(high[labels != 255], (labels == CAN)[labels != 255])


def test_the_iou_of_a_class_is_what_both_say_over_what_either_says() -> None:
    counts = np.zeros((len(CLASSES), len(CLASSES)), np.int64)
    counts[0, 0], counts[0, CAN], counts[CAN, 0], counts[CAN, CAN] = 50, 10, 20, 30
    counts[12, 12] = 7
    ious = class_ious(counts)
    assert ious[CAN] == pytest.approx(30 / 60)
    assert ious[0] == pytest.approx(50 / 80)
    assert np.isnan(ious[1])
    assert mean_ious(ious) == pytest.approx((0.5, 1.0))
