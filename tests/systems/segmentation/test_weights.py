"""The trained network on two images of scenes that were held out: `samples`, rendered."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import shapely

from crossmodal.maths.arrays import Ids
from crossmodal.maths.pinhole import Intrinsics
from crossmodal.systems.segmentation.network_input import CLASSES, network_input
from crossmodal.systems.segmentation.objects import (
    ObjectsConfig,
    class_probabilities,
    load_network,
)
from crossmodal.systems.segmentation.segmenter import View, objects_in, segments_in

SAMPLES = Path(__file__).parent / "samples"
EVERYWHERE = shapely.box(-1.0, -1.0, 1.0, 1.0)


def sample(name: str) -> tuple[View, Ids]:
    """An image, and indices of `CLASSES` (H, W)."""
    colour, depth, labels = (
        cv2.imread(str(SAMPLES / f"{name}_{kind}.png"), cv2.IMREAD_UNCHANGED)
        for kind in ("colour", "depth", "labels")
    )
    camera = json.loads((SAMPLES / "cameras.json").read_text(encoding="utf-8"))[name]
    focal_x, focal_y, center_x, center_y = camera["camera"]
    view = View(
        colour=np.ascontiguousarray(colour[:, :, ::-1]),
        depth=1e-3 * depth,
        masked=np.zeros(depth.shape, bool),
        intrinsics=Intrinsics(
            width=320,
            height=240,
            focal_x=focal_x,
            focal_y=focal_y,
            center_x=center_x,
            center_y=center_y,
        ),
        X_WC=np.array(camera["X_WC"]),
        table=0.0,
    )
    return view, labels.astype(int)


# As it was when the weights were made; other processors round differently.
@pytest.mark.parametrize(("name", "score"), [("dense", 0.78), ("dropped", 0.92)])
def test_the_mean_iou_of_what_is_shown_is_what_it_was(name: str, score: float) -> None:
    view, labels = sample(name)
    x = network_input(view.colour, view.depth, None, view.intrinsics, view.X_WC, view.table)
    odds = class_probabilities(load_network(), x)
    np.testing.assert_allclose(odds.sum(axis=0), 1.0, atol=1e-5)
    found = odds.argmax(axis=0)
    ious = [
        ((found == k) & (labels == k)).sum() / ((found == k) | (labels == k)).sum()
        for k in np.unique(labels)
    ]
    assert np.mean(ious) == pytest.approx(score, abs=0.02)


def test_goods_and_unknown_objects_stand_where_they_stand() -> None:
    view, labels = sample("dropped")
    found = objects_in(view, load_network(), {}, ObjectsConfig())
    segments, masks = segments_in(view, found, EVERYWHERE, {})
    for name in ("cleaner", "oil", "spray"):
        true = labels == CLASSES.index(name)
        named = [m for s, m in zip(segments, masks, strict=True) if s.name == name]
        mask = max(named, key=np.count_nonzero)
        assert (mask & true).sum() > 0.7 * (mask | true).sum()
    unknown = labels == len(CLASSES) - 1
    count, parts = cv2.connectedComponents(unknown.astype(np.uint8))
    hidden = [k for k in range(1, count) if (parts == k).sum() > 100]
    assert len(hidden) == 2
    for k in hidden:  # Each of the unknown ones is an object without a name.
        assert any(
            not s.name and (m & (parts == k)).sum() > 0.5 * (m | (parts == k)).sum()
            for s, m in zip(segments, masks, strict=True)
        )
