"""Which objects an image shows: masks of the network's classes, taken apart into single objects."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations

import cv2
import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from crossmodal.maths.arrays import Array, Mask
from crossmodal.maths.validation import number
from crossmodal.models import WEIGHTS_DIR
from crossmodal.systems.onnx_network import OnnxNetwork
from crossmodal.systems.segmentation.network_input import CLASSES, OTHER, SHAPE, TRANSPARENT

_TABLE = 0  # Index of its class.
_SPECK = 0.1  # Share of the least object; what is smaller and by itself is nothing.
_WITHIN = 0.8  # Share of what is within something.
_FRINGE = 5  # Width of the rim of an object that is not taken for another one, [px at 320 x 240].


@dataclass(kw_only=True)
class ObjectsConfig:
    """How masks become objects."""

    # Share of the image, below which nothing is an object: seen from .7 m, a fingertip's 4 cm^2.
    least: float = number(1e-3, above=0.0, at_most=1.0)
    # A part of a class that is smaller by this belongs to the larger one if both are no longer than
    # an object of that class: more likely so than that most of a second one is hidden. A part of no
    # class, such as a cap, does if it is within the other one's convex hull.
    rest: float = number(0.33, at_least=0.0, at_most=1.0)
    # Step of depth within a mask, from which on there are two objects. The head of a spray bottle
    # is as far above its own shoulders.
    step: float = number(0.06, above=0.0, at_most=1.0, unit="m")
    # Above the table, from which on there is an object even where the network sees none: more than
    # three standard deviations of what camera, depth scale and table make of it, 5 mm.
    rise: float = number(0.02, above=0.0, at_most=1.0, unit="m")


@dataclass(frozen=True, kw_only=True)
class SeenObject:
    """An object in an image.

    Attributes:
        name: Of its class; empty for an object of no known class.
        mask: Its pixels (H, W).
    """

    name: str
    mask: Mask


@cache
def load_network() -> OnnxNetwork:
    """The one that is trained on our goods."""
    return OnnxNetwork(WEIGHTS_DIR / "segmentation.onnx", SHAPE)


def class_probabilities(
    network: OnnxNetwork, x: npt.NDArray[np.float32], size: tuple[int, int] = SHAPE[1:]
) -> npt.NDArray[np.float32]:
    """Of each of `CLASSES` at each pixel (14, H, W).

    Args:
        network: Of the segmentation.
        x: `network_input` (6, 240, 320).
        size: Height and width of what is returned.
    """
    logits = network(x[None])[0].transpose(1, 2, 0)
    odds = np.exp(logits - logits.max(axis=2, keepdims=True))
    odds /= odds.sum(axis=2, keepdims=True)
    return np.asarray(cv2.resize(odds, size[::-1], interpolation=cv2.INTER_LINEAR)).transpose(
        2, 0, 1
    )


def seen_objects(
    classes: npt.NDArray[np.integer],
    depth: Array,
    heights: Array,
    masked: Mask | None,
    focal: float,
    lengths: Mapping[str, float],
    config: ObjectsConfig,
) -> list[SeenObject]:
    """The objects of an image, class by class, then those of no class.

    Parts of a class that hang together are one object unless depth has a step within. Parts that do
    not are one object where another one lies before what is between them. Small ones belong to a
    large one near which they are.

    Args:
        classes: The most probable of `CLASSES` (H, W).
        depth: (H, W), [m]; zero, NaN or infinite where none was measured.
        heights: Above the table (H, W), [m]; NaN where no depth was measured.
        masked: Pixels (H, W) of the robot, on which there is no object.
        focal: Length of the camera, [px].
        lengths: Of the longest lines within objects of known classes, [m].
        config: Of objects.
    """
    usable = np.ones(classes.shape, bool) if masked is None else ~masked
    filled, kernel = _filled(depth), np.ones((3, 3), np.uint8)
    scene = _Scene(
        depth=filled,
        steps=cv2.dilate(filled, kernel) - cv2.erode(filled, kernel),
        things=classes != _TABLE,
        least=config.least * classes.size,
    )
    # NaN is not above anything.
    rises = _without_rims((classes == _TABLE) & usable & (heights > config.rise))
    found = []
    for index, name in enumerate(CLASSES[1:], start=1):
        mask = (classes == index) & usable
        if name == OTHER:
            mask = mask & ~(heights <= config.rise) | rises
        split = np.inf if name in TRANSPARENT else config.step  # Depth is of what is behind.
        parts = _single_objects(mask, scene, split)
        # A speck that the network got wrong would make a near object as long as it may be.
        parts = [part for part in parts if np.count_nonzero(part) >= scene.least]
        for one in _without_rests(parts, filled / focal, lengths.get(name, 0.0), config.rest):
            found.append(SeenObject(name="" if name == OTHER else name, mask=one))
    return _without_unknown_parts(found, config.rest)


@dataclass(frozen=True, kw_only=True)
class _Scene:
    """What is known of an image beside its classes.

    Attributes:
        depth: `_filled` (H, W), [m].
        steps: Between each pixel's neighbours (H, W), [m].
        things: Pixels (H, W) that show any object.
        least: Pixels of an object.
    """

    depth: npt.NDArray[np.float32]
    steps: npt.NDArray[np.float32]
    things: Mask
    least: float


def _without_rims(mask: Mask) -> Mask:
    """Without what is narrower than the rim that a class's mask leaves of an object."""
    side = round(_FRINGE * mask.shape[1] / SHAPE[2])
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    return cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, disc).astype(bool)


def _filled(depth: Array) -> npt.NDArray[np.float32]:
    """With the nearest measured depth where none was measured; zero if none was at all."""
    known = np.isfinite(depth) & (depth > 0.0)
    if not known.any():
        return np.zeros(depth.shape, np.float32)
    nearest = _nearest(known)
    return depth.ravel()[nearest].astype(np.float32)


def _nearest(mask: Mask) -> npt.NDArray[np.int64]:
    """Flat index of the nearest pixel of a mask for each pixel (H, W)."""
    _, labels = cv2.distanceTransformWithLabels(
        (~mask).astype(np.uint8), cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL
    )
    of_label = np.zeros(labels.max() + 1, np.int64)
    of_label[labels[mask]] = np.flatnonzero(mask)
    return np.asarray(of_label[labels])


def _single_objects(mask: Mask, scene: _Scene, step: float) -> list[Mask]:
    """Masks of the single objects in the mask of a class, and of what may be a part of one.

    Args:
        mask: (H, W).
        scene: With which it goes.
        step: Of depth between two objects, [m].
    """
    if np.count_nonzero(mask) < scene.least:
        return []
    u, v, width, height = cv2.boundingRect(mask.astype(np.uint8))
    window = slice(v, v + height), slice(u, u + width)
    inside = mask[window]
    count, labels, facts, _ = cv2.connectedComponentsWithStats(
        (inside & (scene.steps[window] < step)).astype(np.uint8)
    )
    large = [k for k in range(1, count) if facts[k, cv2.CC_STAT_AREA] >= _SPECK * scene.least]
    if not large:
        return []
    # What is narrower than the rims at steps belongs to what it hangs together with.
    _, regions = cv2.connectedComponents(inside.astype(np.uint8))
    nearest = _nearest(np.isin(labels, large))
    hang = inside & (regions.ravel()[nearest] == regions)
    parts = np.where(hang, labels.ravel()[nearest], 0)
    masks = np.array([parts == k for k in large])
    depth, between = scene.depth[window], scene.things[window] & ~inside
    linked = np.zeros((len(masks), len(masks)), bool)
    for i, j in combinations(range(len(masks)), 2):
        linked[i, j] = _hidden_between(masks[i], masks[j], between, depth)
    number, group = connected_components(csr_array(linked), directed=False)
    objects = np.zeros((number, *mask.shape), bool)
    for one, k in zip(masks, group, strict=True):
        objects[k][window] |= one
    return list(objects)


def _without_rests(
    parts: list[Mask], scale: npt.NDArray[np.floating], longest: float, rest: float
) -> list[Mask]:
    """The larger parts of a class, with the small ones that belong to them.

    Args:
        parts: Masks (H, W).
        scale: Of a pixel at what it shows (H, W), [m/px].
        longest: An object is no longer, [m].
        rest: Of `ObjectsConfig`.
    """
    objects: list[Mask] = []
    for part in sorted(parts, key=np.count_nonzero, reverse=True):
        for k, one in enumerate(objects):
            both = one | part
            _, radius = cv2.minEnclosingCircle(cv2.findNonZero(both.astype(np.uint8)))
            is_rest = np.count_nonzero(part) <= rest * np.count_nonzero(one)
            if is_rest and 2.0 * radius * np.median(scale[both]) <= longest:
                objects[k] = both
                break
        else:
            objects.append(part)
    return objects


def _without_unknown_parts(found: list[SeenObject], rest: float) -> list[SeenObject]:
    """Known objects with the small things of no class that are within them, then all others.

    Args:
        found: All objects.
        rest: Of `ObjectsConfig`.
    """
    known = [one for one in found if one.name]
    hulls = []
    for one in known:
        hull = np.zeros(one.mask.shape, np.uint8)
        points = cv2.convexHull(cv2.findNonZero(one.mask.astype(np.uint8)))
        hulls.append(cv2.fillConvexPoly(hull, points, 1).astype(bool))
    unknown = []
    for part in (one for one in found if not one.name):
        size = np.count_nonzero(part.mask)
        for k, (one, hull) in enumerate(zip(known, hulls, strict=True)):
            is_within = np.count_nonzero(part.mask & hull) >= _WITHIN * size
            if is_within and size <= rest * np.count_nonzero(one.mask):
                known[k] = replace(one, mask=one.mask | part.mask)
                break
        else:
            unknown.append(part)
    return known + unknown


def covered_share(mask: Mask, others: Mask, depth: Array, step: float) -> float:
    """Share of an object's outline along which another object is before it, 0 to 1.

    Args:
        mask: Of the object (H, W), not empty.
        others: Pixels of all others (H, W) whose depth is theirs.
        depth: (H, W), [m]; zero, NaN or infinite where nothing was measured.
        step: By which another object is before it at least, [m].
    """
    u, v, width, height = cv2.boundingRect(mask.astype(np.uint8))
    window = np.s_[max(v - 1, 0) : v + height + 1, max(u - 1, 0) : u + width + 1]
    inside = mask[window]
    rim = cv2.dilate(inside.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool) & ~inside
    filled = _filled(depth[window])
    own = filled.ravel()[_nearest(inside)]
    return float((others[window] & (filled < own - step))[rim].mean()) if rim.any() else 0.0


def _hidden_between(one: Mask, other: Mask, things: Mask, depth: npt.NDArray[np.float32]) -> bool:
    """Whether all that is between two masks, where they are nearest, is another thing before both.

    That is said along the straight line between their nearest pixels.
    """
    distance = cv2.distanceTransform((~other).astype(np.uint8), cv2.DIST_L2, 3)
    start = np.flatnonzero(one)[distance[one].argmin()]
    end = int(_nearest(other).ravel()[start])
    (v0, u0), (v1, u1) = (divmod(int(k), one.shape[1]) for k in (start, end))
    count = max(abs(v1 - v0), abs(u1 - u0))
    between = np.arange(1, count) / max(count, 1)
    v = (v0 + between * (v1 - v0)).round().astype(int)
    u = (u0 + between * (u1 - u0)).round().astype(int)
    behind = min(depth[v0, u0], depth[v1, u1])
    return bool(count > 2 and things[v, u].all() and (depth[v, u] <= behind).mean() > 0.5)
