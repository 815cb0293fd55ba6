"""The system that says which objects stand on a table, in each image that is taken for it."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely
from pydrake.systems.framework import Context
from pydrake.systems.sensors import ImageDepth32F, ImageGrey8U, ImageRgba8U

from crossmodal.maths.arrays import Array, Mask
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.pinhole import Intrinsics
from crossmodal.maths.validation import check, number
from crossmodal.systems.declutter.segments import (
    bare_part,
    segment_of_mask,
    shown_part,
    still_there,
    with_known_numbers,
)
from crossmodal.systems.onnx_network import OnnxNetwork
from crossmodal.systems.port_values import (
    NO_MASKS,
    NO_SEGMENTS,
    ObjectMasks,
    Segment,
    Segments,
    StampedImage,
)
from crossmodal.systems.recursive_filter import RecursiveFilter
from crossmodal.systems.segmentation.network_input import TRANSPARENT, network_input
from crossmodal.systems.segmentation.objects import (
    ObjectsConfig,
    SeenObject,
    class_probabilities,
    covered_share,
    seen_objects,
)

_BEFORE = 0.01  # Of two objects side by side, one that is nearer by more is before the other, [m].


@dataclass(kw_only=True)
class SegmenterConfig:
    """How images become numbered objects on a table."""

    objects: ObjectsConfig = field(default_factory=ObjectsConfig)
    # Farthest distance that an object goes between two images and is still known.
    reach: float = number(0.3, above=0.0, at_most=10.0, unit="m")
    # Farther than this from where the table is believed to be, nothing that is seen is the table:
    # four standard deviations of what camera and table, 4 and 2 mm off, make of it.
    table_error: float = number(0.02, above=0.0, at_most=1.0, unit="m")


@dataclass(frozen=True, kw_only=True)
class SegmenterState(Immutable):
    """Of the last image.

    Attributes:
        looked: Number of the view that was segmented last.
        segments: Its objects.
        masks: Their pixels.
        known: All objects that were ever seen, each as it was last.
    """

    looked: int = 0
    segments: Segments = NO_SEGMENTS
    masks: ObjectMasks = NO_MASKS
    known: tuple[Segment, ...] = ()


@dataclass(frozen=True, kw_only=True)
class View:
    """An image of the table, and from where.

    Attributes:
        colour: Red, green and blue (H, W, 3).
        depth: (H, W) along the camera's axis, [m]; zero where none was measured.
        masked: Pixels (H, W) of the robot.
        intrinsics: Of the image.
        X_WC: Of the camera (4, 4), where it is believed to have been.
        table: z of the table's plane in W, [m].
    """

    colour: npt.NDArray[np.uint8]
    depth: Array
    masked: Mask
    intrinsics: Intrinsics
    X_WC: Array
    table: float


def objects_in(
    view: View, network: OnnxNetwork, lengths: Mapping[str, float], config: ObjectsConfig
) -> list[SeenObject]:
    """All objects that an image shows, whether on the table or not.

    Args:
        view: Of the table.
        network: Of the segmentation.
        lengths: Of `seen_objects`.
        config: Of objects.
    """
    camera, X_WC, table = view.intrinsics, view.X_WC, view.table
    x = network_input(view.colour, view.depth, view.masked, camera, X_WC, table)
    classes = class_probabilities(network, x, view.depth.shape).argmax(axis=0)
    heights = camera.heights(view.depth, X_WC, table)
    return seen_objects(classes, view.depth, heights, view.masked, camera.focal_x, lengths, config)


def segments_in(
    view: View, found: list[SeenObject], region: shapely.Polygon, glass: Mapping[str, Array]
) -> tuple[tuple[Segment, ...], list[Mask]]:
    """The objects on a part of the table, numbered from zero, and their masks.

    What the ray of a pixel misses the table for is beyond it, and left out. Depth says nothing of
    glass but what is beneath it: it is outlined as if it lay on that, and as high as its length
    allows then.

    Args:
        view: Of the table.
        found: What `objects_in` gave.
        region: Of the table in W, [m].
        glass: Edges (3,) of the bounding boxes of classes that a depth camera looks through, [m].
    """
    kept: list[tuple[Segment, Mask]] = []
    solid = np.zeros(view.masked.shape, bool)
    for one in found:
        if one.name not in glass:
            solid |= one.mask
    heights = view.intrinsics.heights(view.depth, view.X_WC, view.table)
    for one in found:
        edges = glass.get(one.name)
        beneath = lying = highest = 0.0
        if edges is not None:
            beneath, highest = _quantiles(heights[one.mask])
            lying = beneath + 0.5 * float(np.sort(edges)[1])
        try:
            segment = segment_of_mask(
                len(kept),
                one.name,
                one.mask,
                view.intrinsics,
                view.X_WC,
                view.table + lying,
                view.depth if edges is None else None,
            )
        except ValueError:
            continue
        if edges is None:
            covered = covered_share(one.mask, solid & ~one.mask, view.depth, _BEFORE)
            segment = replace(segment, covered=covered)
        else:
            segment = replace(
                segment,
                top=top_of_glass(segment, edges, beneath, highest),
                is_glass=True,
                base=beneath,
                least_top=beneath + float(edges.min()),
            )
        segment = replace(
            segment,
            is_cut=bool(one.mask[[0, -1]].any() or one.mask[:, [0, -1]].any()),
        )
        if region.contains(segment.contour.centroid):
            kept.append((segment, one.mask))
    return tuple(segment for segment, _ in kept), [mask for _, mask in kept]


def _quantiles(heights: Array) -> Array:
    """Half and nine tenths of what was measured of heights (N,) are lower (2,), [m].

    Zero where nothing was measured.
    """
    known = heights[np.isfinite(heights)]
    return np.maximum(np.quantile(known, [0.5, 0.9]), 0.0) if len(known) else np.zeros(2)


def greatest_height(segment: Segment, edges: Array) -> float:
    """How high an object can be whose outline is as long as that, [m].

    Its longest edge, leaning, is as high as Pythagoras says, and its thickness comes on top; no
    object is higher than the diagonal of both.

    Args:
        segment: The object.
        edges: Of its bounding box (3,), [m].
    """
    sides = np.diff(shapely.get_coordinates(segment.box), axis=0)
    seen = float(np.linalg.norm(sides, axis=1).max())
    _, thick, long = np.sort(edges)
    return float(min(np.sqrt(max(long**2 - seen**2, 0.0)) + thick, np.hypot(long, thick)))


def table_error(heights: Array, largest: float) -> float:
    """By how much a table is seen above where it is believed to be, [m].

    What is near there is most of what is seen, and the middle of it is the table.

    Args:
        heights: Of pixels (N,) above where it is believed to be, [m]; NaN without a measurement.
        largest: By which it may be off at most, [m].
    """
    near = heights[np.abs(np.nan_to_num(heights, nan=np.inf)) < largest]
    return float(np.median(near)) if len(near) else 0.0


def top_of_glass(segment: Segment, edges: Array, beneath: float, highest: float) -> float:
    """How high glass may be above the table, by what is seen through it, [m].

    It stands on what most of it is above, or lies on the highest of that.

    Args:
        segment: The object.
        edges: Of its bounding box (3,), [m].
        beneath: Height that half of what is seen through it has at most, [m].
        highest: Likewise of nine tenths, [m].
    """
    return max(beneath + greatest_height(segment, edges), highest + float(edges.min()))


class Segmenter(RecursiveFilter):
    """Says which objects stand on the table, whenever the camera has come to rest at a new view.

    Input ports:
    - `color_measured`, `depth_measured`: `StampedImage` of the same size and the same camera.
    - `robot_mask`: `ImageGrey8U`, above zero where the robot is seen; may stay unconnected.
    - `looked`: (1,) number of the view at which the camera rests; where it has risen, the image is
      segmented.

    Output ports:
    - `segments`: `Segments` of the last tick, numbered from one image to the next; what was seen
      before and is beyond the image's border is there still.
    - `object_masks`: `ObjectMasks` of the same image.

    State: `SegmenterState`.

    Frames: W world, C camera.

    Args:
        network: Of the segmentation.
        intrinsics: Of the images, as believed.
        table: z of the table's plane in W, as believed, [m].
        region: Of the table in W, outside of which nothing is looked for, [m].
        edges: Of the bounding boxes of objects of the classes (3,), by the classes' names, [m].
        config: Of objects.
        period: Of the ticks, [s].
        skipped: So many views at first are not of the table.

    Raises:
        ValueError: for an impossible configuration.
    """

    def __init__(
        self,
        network: OnnxNetwork,
        intrinsics: Intrinsics,
        table: float,
        region: shapely.Polygon,
        edges: Mapping[str, Array],
        config: SegmenterConfig,
        period: float,
        skipped: int = 0,
    ) -> None:
        super().__init__()
        check(config, "Segmenter")
        self._network, self._config = network, config
        self._intrinsics, self._table, self._region = intrinsics, table, region
        self._lengths = {name: float(np.linalg.norm(own)) for name, own in edges.items()}
        self._glass = {name: edges[name] for name in TRANSPARENT if name in edges}
        self._colour, self._depth = (
            self._declare_value_input(name, StampedImage(time=0.0, image=kind()))
            for name, kind in (("color_measured", ImageRgba8U), ("depth_measured", ImageDepth32F))
        )
        self._mask = self._declare_value_input("robot_mask", ImageGrey8U())
        self._looked = self.DeclareVectorInputPort("looked", 1)
        self._declare_recursion(SegmenterState(looked=skipped), self._calc, period)
        self._declare_latest("segments", lambda state: state.segments)
        self._declare_latest("object_masks", lambda state: state.masks)

    def _calc(self, context: Context, state: Any) -> SegmenterState:
        before: SegmenterState = state
        looked = int(self._read(self._looked, context)[0])
        if looked <= before.looked:
            return before
        image: StampedImage = self._read(self._depth, context)
        view = self._view(context, image)
        seen, masks = segments_in(
            view,
            objects_in(view, self._network, self._lengths, self._config.objects),
            self._region,
            self._glass,
        )
        named = with_known_numbers(seen, before.known, self._config.reach)
        objects = np.full(view.depth.shape, -1)
        for segment, mask in zip(named, masks, strict=True):
            objects[mask] = segment.number
        shown = shown_part(self._region, view.intrinsics, view.X_WC, view.table)
        segments = (*named, *still_there(before.segments.segments, named, shown))
        count = before.segments.number + 1
        known = {segment.number: segment for segment in (*before.known, *named)}
        return SegmenterState(
            looked=looked,
            segments=Segments(
                number=count,
                time=image.time,
                segments=segments,
                table=view.table,
                bare=bare_part(shown, named, view.masked, view.intrinsics, view.X_WC, view.table),
            ),
            masks=ObjectMasks(
                number=count,
                view=looked,
                objects=objects,
                glass={s.number: s.top for s in named if s.is_glass},
                colour=view.colour,
                depth=view.depth,
                intrinsics=view.intrinsics,
                X_WC=view.X_WC,
                table=view.table,
            ),
            known=tuple(known.values()),
        )

    def _view(self, context: Context, image: StampedImage) -> View:
        colour: StampedImage = self._read(self._colour, context)
        mask = self._read_optional(self._mask, context)
        depth = np.array(image.image.data[:, :, 0], float)
        masked = np.zeros(depth.shape, bool) if mask is None else mask.data[:, :, 0] != 0
        heights = self._intrinsics.heights(depth, image.X_WC, self._table)[~masked]
        return View(
            colour=np.array(colour.image.data[:, :, :3]),
            depth=depth,
            masked=masked,
            intrinsics=self._intrinsics,
            X_WC=image.X_WC,
            table=self._table + table_error(heights, self._config.table_error),
        )
